"""Check that the C compiles without a warning, uses only what every target has, and rejects options that would break it.

The compilers run on copies of the files. If gcc is missing, the other compilers still run, and the check counts as not run.
The sources must reject a header of another build, and a compiler that may ignore NaN.
"""

from __future__ import annotations

import importlib.metadata
import io
import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

from codegen.emit import casadi_c
from codegen.errors import BuildError
from codegen.sil.toolchain import require_success, run
from codegen.verify import on_host
from codegen.verify.on_host import COMPILED_PROGRAMS, HOST_PROGRAMS
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.target import CORES, CORTEX_M4F, INCLUDES, TARGET_FLAGS, X86_64, Core, source_tree, zig, zig_result
from codegen.verify.tools import module, require

REFUSES = "different builds"
"""Phrase of the error of a source or header that meets one of another build."""

FAST_FLAGS = ("-ffast-math", "-ffinite-math-only")
REFUSES_FAST = "fast-math"
FUNCTION = re.compile(r"\)\s*\{")

WITHOUT_IDENTITY = ("include/{prefix}_sections.h", "linux/ars_xcp.h")
"""Headers that are the same in every build."""

EMPTY = "empty"
"""Folder of the empty system headers."""
_PREPROCESS = ("-E", "-nostdinc", "-Iinclude", "-isystem", EMPTY, "-fno-caret-diagnostics")

_INCLUDE = re.compile(r'^#include "([^"\n]+)"', re.MULTILINE)
_SYSTEM = re.compile(r"^#include <([^>\n]+)>", re.MULTILINE)
_IDENTITY = re.compile(r"^#define +(\w+_BUILD) +0x([0-9A-F]+)u$", re.MULTILINE)
_INCLUDED = re.compile(r"In file included from ([^:]+):")
_ERROR = re.compile(r"([^:]+):\d+:\d+: error:")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)


@dataclass(frozen=True)
class Mixture:
    """Source and a header that it includes, directly or indirectly."""

    source: str
    header: str


def text_of(subject: Subject, path: str) -> str:
    """Return the text of a C file."""
    return subject.files[path].decode("ascii", "replace")


def mixtures(subject: Subject) -> tuple[Mixture, ...]:
    """Return every source for an ECU or for the Linux program with each header of the build that it includes."""
    exempt = [path.format(prefix=subject.prefix) for path in WITHOUT_IDENTITY]
    sources = sorted(path for path in subject.sources("src", "linux") if path.endswith(".c"))
    return tuple(
        Mixture(source, header) for source in sources for header in sorted(_headers_of(subject, source)) if header not in exempt
    )


def _headers_of(subject: Subject, path: str) -> set[str]:
    """Return the build's own headers that a file includes."""
    seen: set[str] = set()
    waiting = [path]
    while waiting:
        for name in _INCLUDE.findall(text_of(subject, waiting.pop())):
            for header in (f"include/{name}", f"linux/{name}"):
                if header in subject.files and header not in seen:
                    seen.add(header)
                    waiting.append(header)
    return seen


def not_refused(subject: Subject) -> Iterator[str]:
    """Yield headers without an identity, and mixtures that the compiler accepts. Raises CodegenError if there is no
    compiler."""
    pairs = mixtures(subject)
    for header in sorted({pair.header for pair in pairs}):
        text = text_of(subject, header)
        identity = _IDENTITY.search(text)
        if identity is None:
            yield f"{header}:1: it does not say of which build it is"
            continue
        start, end = identity.span(2)
        other = f"{text[:start]}{int(identity[2], 16) ^ 1:08X}{text[end:]}"
        with source_tree({**_preprocessed(subject), header: other}) as tree:
            for source in _accepting([pair.source for pair in pairs if pair.header == header], (), REFUSES, tree):
                yield f"{source}:1: it takes a {PurePosixPath(header).name} of another build"


def takes_fast_math(subject: Subject) -> Iterator[str]:
    """Yield sources that compute with reals and accept -ffast-math. Raises CodegenError if there is no compiler."""
    with source_tree(_preprocessed(subject)) as tree:
        for flag in FAST_FLAGS:
            for source in _accepting(units_with_reals(subject), (flag,), REFUSES_FAST, tree):
                yield f"{source}:1: it takes {flag}"


def units_with_reals(subject: Subject) -> tuple[str, ...]:
    """Return sources for an ECU that compute with reals; a source without a function only stores them."""
    real = re.compile(rf"\b{'float' if subject.is_single else 'double'}\b")
    texts = {path: _COMMENT.sub(" ", text_of(subject, path)) for path in subject.sources("src") if path.endswith(".c")}
    return tuple(sorted(path for path, text in texts.items() if real.search(text) and FUNCTION.search(text)))


def _preprocessed(subject: Subject) -> dict[str, str | bytes]:
    """Return the sources with empty system headers: only macros of the build and of the compiler decide here."""
    sources = subject.sources("include", "src", "linux")
    system = {name for path in sources for name in _SYSTEM.findall(text_of(subject, path))}
    return {**sources, **{f"{EMPTY}/{name}": "" for name in system}}


def _accepting(sources: Sequence[str], flags: tuple[str, ...], phrase: str, tree: Path) -> list[str]:
    """Return the sources whose preprocessing meets no #error that contains the phrase."""
    output = zig_result(["cc", *TARGET_FLAGS, *flags, *_PREPROCESS, *sources], tree).stderr
    refusing = set()
    source = ""  # that includes the header of the next message, directly or indirectly
    for line in output.splitlines():
        if included := _INCLUDED.match(line):
            source = source or included[1]
            continue
        if phrase in line and (error := _ERROR.match(line)):
            refusing.add(source or error[1])
        source = ""
    return [each for each in sources if each not in refusing]


WARNINGS = (
    *("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wfloat-equal", "-Wshadow", "-Wundef"),
    *("-Wmissing-prototypes", "-Werror"),
)
C_STANDARDS = ("c99", "c11")
CXX_STANDARDS = ("c++11", "c++17")

DYNAMICS = "dynamics"
"""The unit whose object may need the mathematical library."""

_COMMON = tuple(flag for flag in TARGET_FLAGS if not flag.startswith("-std") and flag != "-g")
# gcc's name in C++ for what -Wmissing-prototypes means.
_CXX_WARNINGS = tuple("-Wmissing-declarations" if flag == "-Wmissing-prototypes" else flag for flag in WARNINGS)


@dataclass(frozen=True)
class Compilation:
    """Units compiled by one compiler for one target and standard.

    Attributes:
        label: for findings.
        call: compiles units; arguments: the units, the source folder, and the name of the output next to that folder. Raises
            BuildError if the compiler rejects them.
        units: paths of the sources.
        core: target of the object, if the object is inspected.
        library: the units may need the mathematical library.
    """

    label: str
    call: Callable[[Sequence[str], Path, str], None]
    units: tuple[str, ...]
    core: Core | None = None
    library: bool = False

    def complaints(self, tree: Path, output: str) -> tuple[str, ...]:
        """Return the first message of the compiler for each unit."""
        try:
            self.call(self.units, tree, output)
        except BuildError as whole:
            # It may stop at the first unit with an error.
            messages = tuple(complaint for unit in self.units for complaint in self._alone(unit, tree, output))
            (tree.parent / f"{output}.o").unlink(missing_ok=True)  # of one unit at most
            return messages or (_message(whole),)
        return ()

    def _alone(self, unit: str, tree: Path, output: str) -> Iterator[str]:
        try:
            self.call((unit,), tree, output)
        except BuildError as error:
            yield _message(error)


def _message(error: BuildError) -> str:
    return f"{error.where}: {error.what.removeprefix('the C does not compile: ')}"


def alone(subject: Subject) -> dict[str, str]:
    """Return units that include a single header twice, in C and in C++, by path."""
    units: dict[str, str] = {}
    for path in sorted(subject.sources("include")):
        name = PurePosixPath(path).name
        # The last line is for a header without a declaration: a unit must have one.
        text = f'#include "{name}"\n#include "{name}"\nextern int declared_by_{PurePosixPath(name).stem};\n'
        units |= {f"alone/{name}.c": text, f"alone/{name}.cc": text}
    return units


def sources(subject: Subject) -> dict[str, str | bytes]:
    """Return all C files of a build and the headers of a bare target that they need."""
    both = (f"{name}{suffix}" for name in LIBRARY for suffix in ("", "f"))
    kinds = ((name, "float" if name.endswith("f") else "double") for name in both)
    declared = "".join(f"{kind} {name}({kind});\n" for name, kind in kinds)
    return {**subject.sources("include", "src", *HOST_PROGRAMS), "bare/math.h": declared}


def by_clang(subject: Subject, cores: Sequence[Core], standards: Sequence[str]) -> Iterator[Compilation]:
    """Yield compilations by the clang in `ziglang`, at -O2."""
    below = _units(subject)
    dynamics = f"src/{subject.prefix}_{DYNAMICS}.c"
    rest = (*(unit for unit in below["src"] if unit != dynamics), *below["alone"])
    for core in cores:
        for standard in standards:
            call = partial(_clang, (*core.flags, *INCLUDES, f"-std={standard}"))
            label = f"clang, {core.name}, {standard}"
            yield Compilation(label, call, rest, core)
            if dynamics in below["src"]:
                yield Compilation(f"{label}, {DYNAMICS}", call, (dynamics,), core, library=True)
    for standard in standards:
        call = partial(_clang, (*HOSTED, "-Iinclude", f"-std={standard}"))
        for folder in HOST_PROGRAMS:
            if below[folder]:
                yield Compilation(f"clang, {folder}/ for Linux, {standard}", call, below[folder])
    for standard in CXX_STANDARDS:
        yield Compilation(f"clang, {standard}", partial(clang_cxx, (f"-std={standard}",)), below["alone C++"])


def by_gcc(subject: Subject, program: str, standards: Sequence[str], levels: Sequence[str]) -> Iterator[Compilation]:
    """Yield compilations by the host's gcc at several optimisation levels. Some warnings require optimisation; some code is
    removed by it."""
    below = _units(subject)
    units = (*below["src"], *below["alone"], *(unit for folder in COMPILED_PROGRAMS for unit in below[folder]))
    for standard in standards:
        for level in levels:
            flags = (f"-std={standard}", level, *WARNINGS)
            yield Compilation(f"gcc, {standard}, {level}", partial(_gcc, program, flags), units)
    if _has_cxx(program):
        for standard in CXX_STANDARDS:
            cxx = ("-xc++", f"-std={standard}", *_CXX_WARNINGS)
            yield Compilation(f"gcc, {standard}", partial(_gcc, program, cxx), below["alone C++"])


def clang_cxx(flags: Sequence[str], units: Sequence[str], tree: Path, output: str) -> None:
    """Compile C++ for a target without a library."""
    _clang(("-target", "x86_64-freestanding", "-xc++", *INCLUDES, *flags), units, tree, output)


def _clang(flags: Sequence[str], units: Sequence[str], tree: Path, output: str) -> None:
    zig(["cc", *_COMMON, "-O2", *WARNINGS, *flags, "-c", *units, "-o", f"../{output}.o"], tree)


def _gcc(program: str, flags: Sequence[str], units: Sequence[str], tree: Path, output: str) -> None:
    folder = tree.parent / output  # gcc writes an object for each unit where it is called
    folder.mkdir(exist_ok=True)
    up = f"../{tree.name}/"
    result = run([program, *flags, f"-I{up}include", "-c", *(f"{up}{unit}" for unit in units)], folder)
    try:
        require_success(result, units[0])
    except BuildError as error:
        raise BuildError(error.what, where=error.where.removeprefix(up), remedy=error.remedy) from None


def _has_cxx(program: str) -> bool:
    return Path(run([program, "-print-prog-name=cc1plus"]).stdout.strip()).is_absolute()


def _units(subject: Subject) -> dict[str, tuple[str, ...]]:
    """Return unit paths by the first part of their path; the units of single headers in C and in C++ separately."""
    paths = sorted(path for path in sources(subject) if path.endswith(".c"))
    headers = sorted(alone(subject))
    below = {folder: tuple(path for path in paths if path.startswith(f"{folder}/")) for folder in ("src", *HOST_PROGRAMS)}
    for name, suffix in (("alone", ".c"), ("alone C++", ".cc")):
        below[name] = tuple(path for path in headers if path.endswith(suffix))
    return below


HOSTED = ("-target", "x86_64-linux-musl")
"""Target whose system headers come with clang, so that the Linux program compiles everywhere."""

SHOWS = (
    "gcc and clang compile the C without a warning as {standards}, each header alone and as C++, for {cores}; the objects need "
    "only symbols that a bare target provides; headers of another build and -ffast-math are rejected"
)

THREADS = 2
LABELS_MAX = 3
LINKAGE = "alone/linkage.cc"


def check(subject: Subject, effort: Effort) -> Outcome:
    """Check 1. Raises MissingTool: ziglang or pyelftools is not installed; CodegenError: the sources cannot be stored."""
    require("ziglang")
    module("elftools.elf.elffile", "pyelftools")
    gcc = on_host.gcc()
    cores = (X86_64, CORTEX_M4F) if effort.quick else CORES
    standards = C_STANDARDS[:1] if effort.quick else C_STANDARDS
    levels = ("-O2",) if effort.quick else ("-O2", "-O0")
    plan = (*by_clang(subject, cores, standards), *(by_gcc(subject, gcc, standards, levels) if gcc else ()))
    with source_tree({**sources(subject), **alone(subject)}) as tree:
        complaints = _compile(plan, tree)
        needs = _needs(plan, tree)
        found = [
            *_together(plan, complaints),
            *_foreign(subject, plan, tree),
            *_cxx_linkage(subject, plan, tree),
            *not_refused(subject),
            *takes_fast_math(subject),
        ]
    names = dict.fromkeys(compilation.core.name for compilation in plan if compilation.core is not None)
    shows = SHOWS.format(standards=" and ".join(map(str.upper, standards)), cores=", ".join(names))
    return replace(_outcome(subject, plan, needs, tuple(dict.fromkeys(found)), gcc), shows=shows)


def _compile(plan: Sequence[Compilation], tree: Path) -> list[tuple[str, ...]]:
    """Compile the plan and return the messages of each compiler. The object of compilation k is `k.o` next to the tree."""
    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(lambda k: plan[k].complaints(tree, str(k)), range(len(plan))))


def _together(plan: Sequence[Compilation], complaints: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Yield each message once, with the compilers that report it."""
    labels: dict[str, list[str]] = {}
    for compilation, messages in zip(plan, complaints, strict=True):
        for complaint in messages:
            labels.setdefault(complaint, []).append(compilation.label)
    for complaint, who in labels.items():
        more = f"; and {len(who) - LABELS_MAX} more" if len(who) > LABELS_MAX else ""
        yield f"{complaint} ({'; '.join(who[:LABELS_MAX])}{more})"


def _objects(plan: Sequence[Compilation], tree: Path) -> Iterator[tuple[Compilation, Core, bytes]]:
    """Yield every compiled object for a core."""
    for k, compilation in enumerate(plan):
        path = tree.parent / f"{k}.o"
        if compilation.core is not None and path.exists():
            yield compilation, compilation.core, path.read_bytes()


def _needs(plan: Sequence[Compilation], tree: Path) -> dict[str, list[str]]:
    """Return the undefined symbols of the objects, by core."""
    needs: dict[str, set[str]] = {}
    for _, core, content in _objects(plan, tree):
        needs.setdefault(core.name, set()).update(needed(content))
    return {name: sorted(names) for name, names in needs.items()}


def _foreign(subject: Subject, plan: Sequence[Compilation], tree: Path) -> Iterator[str]:
    """Yield forbidden undefined symbols, with the source and the cores."""
    cores: dict[str, list[str]] = {}
    for compilation, core, content in _objects(plan, tree):
        wrong = {
            name
            for name in needed(content)
            if not is_allowed(name, library=compilation.library, single=subject.is_single, has_double=core.has_double)
        }
        # An object holds several units; compiling each alone shows which one requires the symbol.
        for unit in compilation.units if wrong else ():
            compilation.call((unit,), tree, "alone")
            for name in sorted(wrong.intersection(needed((tree.parent / "alone.o").read_bytes()))):
                cores.setdefault(f"{unit}: {fault(name)}", []).append(core.name)
    for finding, names in cores.items():
        yield f"{finding} ({', '.join(dict.fromkeys(names))})"


def _cxx_linkage(subject: Subject, plan: Sequence[Compilation], tree: Path) -> Iterator[str]:
    """Yield functions that C defines and the headers do not declare for C++."""
    objects = [content for _, core, content in _objects(plan, tree) if core is X86_64]
    defined = sorted(set().union(*map(exported, objects)))
    headers = [PurePosixPath(path).name for path in sorted(subject.sources("include"))]
    lines = [
        *(f'#include "{name}"' for name in headers),
        "extern const void *const reached[];",
        "const void *const reached[] = {",
    ]
    first = len(lines) + 1
    lines += [*(f"    reinterpret_cast<const void *>(&{name})," for name in defined), "};", ""]
    (tree / LINKAGE).write_text("\n".join(lines), encoding="utf-8")
    try:
        clang_cxx((f"-std={CXX_STANDARDS[0]}",), (LINKAGE,), tree, "linkage")
    except BuildError as error:
        found = re.fullmatch(rf"{re.escape(LINKAGE)}:(\d+)", error.where)
        line = int(found[1]) - first if found else -1
        yield f"include/: no header declares {defined[line]}" if 0 <= line < len(defined) else f"include/: {error}"
        return
    for name in sorted(set(defined).difference(needed((tree.parent / "linkage.o").read_bytes()))):
        yield f'include/: {name} is not declared extern "C" for C++'


def _outcome(
    subject: Subject, plan: Sequence[Compilation], needs: dict[str, list[str]], found: tuple[str, ...], gcc: str | None
) -> Outcome:
    pairs = len(mixtures(subject))
    verdict = Verdict.FAILED if found else Verdict.PASSED if gcc else Verdict.NOT_RUN
    count = f"{len(found)} finding{'' if len(found) == 1 else 's'}"
    return Outcome(
        shows=SHOWS,
        figure=f"{count} in {len(plan)} compilations and {pairs} mixtures of builds",
        verdict=verdict,
        findings=found if gcc else (*found, on_host.GCC_MISSING),
        figures={
            "compilations": [compilation.label for compilation in plan],
            "warnings": list(WARNINGS),
            "needed_of_others": needs,
            "mixtures_refused": pairs - sum("of another build" in finding for finding in found),
            "mixtures": pairs,
            "sources_that_refuse_fast_math": len(units_with_reals(subject)),
        },
        limits=(
            "Production compilers, such as those for TriCore and RH850, are not among those tried.",
            "The example and the Linux program are compiled for hosts only.",
        ),
        tools={"ziglang": importlib.metadata.version("ziglang"), **({"gcc": on_host.gcc_version(gcc)} if gcc else {})},
    )


# Functions that a compiler calls to copy or clear a struct, and a symbol that the ARM ABI references without a call.
_RUNTIME = re.compile(r"mem(?:cpy|move|set)|__aeabi_mem(?:cpy|move|set|clr)[48]?|__aeabi_unwind_cpp_pr[012]")

# In double precision on a core whose FPU is for single only: arithmetic, comparisons, conversions, shifts of 64 bits.
_SOFT_DOUBLE = re.compile(r"__aeabi_(?:d\w+|f2d|u?i2d|u?l2d|l[lr]s[lr]|lasr)|__\w*df\w*|__(?:ash[lr]|lshr)di3")

LIBRARY = (*casadi_c.LIBRARY.values(), "sqrt")
"""Functions of the mathematical library that the dynamics, and no other files, may call; with the suffix f in single
precision."""


def exported(content: bytes) -> set[str]:
    """Return the names that an object exports. Raises MissingTool."""
    return {each.name for each in _symbols(content) if each["st_info"]["bind"] == "STB_GLOBAL"} - needed(content)


def needed(content: bytes) -> set[str]:
    """Return the undefined names of an object. Raises MissingTool."""
    return {symbol.name for symbol in _symbols(content) if symbol["st_shndx"] == "SHN_UNDEF"}


def is_allowed(name: str, *, library: bool, single: bool, has_double: bool) -> bool:
    """Return whether generated C may require a function.

    Args:
        library: the object may call the mathematical library.
        single: the build computes in single precision.
        has_double: the core's FPU computes in double precision.
    """
    suffix = "f" if single else ""
    return (
        _RUNTIME.fullmatch(name) is not None
        or (library and name in {f"{function}{suffix}" for function in LIBRARY})
        or (not single and not has_double and _SOFT_DOUBLE.fullmatch(name) is not None)
    )


def fault(name: str) -> str:
    """Describe the fault of a required function that is not allowed."""
    kind = "double precision" if _SOFT_DOUBLE.fullmatch(name) else "which a bare target need not have"
    return f"needs {name}, {kind}"


def _symbols(content: bytes) -> list[Any]:
    elf = module("elftools.elf.elffile", "pyelftools").ELFFile(io.BytesIO(content))
    return [symbol for symbol in elf.get_section_by_name(".symtab").iter_symbols() if symbol.name]
