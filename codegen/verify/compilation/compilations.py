"""Which compilers, targets and standards the C is compiled for, and how each is called."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

from codegen.errors import BuildError
from codegen.sil.toolchain import require_success, run
from codegen.verify.check import Subject
from codegen.verify.compilation.mixtures import HOSTED
from codegen.verify.compilation.object_symbols import LIBRARY
from codegen.verify.target.cross import FLAGS, INCLUDES, Core, zig

WARNINGS = (
    *("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wfloat-equal", "-Wshadow", "-Wundef"),
    *("-Wmissing-prototypes", "-Werror"),
)
C_STANDARDS = ("c99", "c11")
CXX_STANDARDS = ("c++11", "c++17")

DYNAMICS = "dynamics"
"""The unit whose object may need the mathematical library."""

PROGRAMS = ("example", "linux")
"""Folders of programs for a host."""

_COMMON = tuple(flag for flag in FLAGS if not flag.startswith("-std") and flag != "-g")
# gcc's name in C++ for what -Wmissing-prototypes means.
_CXX_WARNINGS = tuple("-Wmissing-declarations" if flag == "-Wmissing-prototypes" else flag for flag in WARNINGS)


@dataclass(frozen=True)
class Compilation:
    """Units for one compiler, target and standard.

    Attributes:
        label: for findings.
        call: takes units, the folder with the sources, and the file beside that folder to write objects to. Raises BuildError:
            the compiler says no.
        units: paths of the sources.
        core: what the object is for where somebody looks at it.
        library: the units may need the mathematical library.
    """

    label: str
    call: Callable[[Sequence[str], Path, str], None]
    units: tuple[str, ...]
    core: Core | None = None
    library: bool = False

    def complaints(self, tree: Path, output: str) -> tuple[str, ...]:
        """What the compiler says against the units, the first word on each."""
        try:
            self.call(self.units, tree, output)
        except BuildError as whole:
            # It may stop at the first unit that it dislikes.
            told = tuple(complaint for unit in self.units for complaint in self._alone(unit, tree, output))
            (tree.parent / f"{output}.o").unlink(missing_ok=True)  # of one unit at most
            return told or (_told(whole),)
        return ()

    def _alone(self, unit: str, tree: Path, output: str) -> Iterator[str]:
        try:
            self.call((unit,), tree, output)
        except BuildError as error:
            yield _told(error)


def _told(error: BuildError) -> str:
    return f"{error.where}: {error.what.removeprefix('the C does not compile: ')}"


def alone(subject: Subject) -> dict[str, str]:
    """Units of one header each, taken in twice, in C and in C++, by path."""
    units: dict[str, str] = {}
    for path in sorted(subject.sources("include")):
        name = PurePosixPath(path).name
        # The last line is for a header without a declaration: a unit must have one.
        text = f'#include "{name}"\n#include "{name}"\nextern int declared_by_{PurePosixPath(name).stem};\n'
        units |= {f"alone/{name}.c": text, f"alone/{name}.cc": text}
    return units


def sources(subject: Subject) -> dict[str, str | bytes]:
    """Every file of C of a build, and what a bare target's own headers must hold for it."""
    both = (f"{name}{suffix}" for name in LIBRARY for suffix in ("", "f"))
    kinds = ((name, "float" if name.endswith("f") else "double") for name in both)
    declared = "".join(f"{kind} {name}({kind});\n" for name, kind in kinds)
    return {**subject.sources("include", "src", *PROGRAMS), "bare/math.h": declared}


def by_clang(subject: Subject, cores: Sequence[Core], standards: Sequence[str]) -> Iterator[Compilation]:
    """By the clang in `ziglang`, at -O2."""
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
        for folder in PROGRAMS:
            if below[folder]:
                yield Compilation(f"clang, {folder}/ for Linux, {standard}", call, below[folder])
    for standard in CXX_STANDARDS:
        yield Compilation(f"clang, {standard}", partial(clang_cxx, (f"-std={standard}",)), below["alone C++"])


def by_gcc(subject: Subject, program: str, standards: Sequence[str], levels: Sequence[str]) -> Iterator[Compilation]:
    """By the host's gcc, at several levels of optimisation: some warnings need it, some code is gone with it."""
    below = _units(subject)
    programs = PROGRAMS if sys.platform == "linux" else PROGRAMS[:1]
    units = (*below["src"], *below["alone"], *(unit for folder in programs for unit in below[folder]))
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
    """Paths of the units by the first part of their path; those of the headers alone in C and in C++."""
    paths = sorted(path for path in sources(subject) if path.endswith(".c"))
    headers = sorted(alone(subject))
    below = {folder: tuple(path for path in paths if path.startswith(f"{folder}/")) for folder in ("src", *PROGRAMS)}
    for name, suffix in (("alone", ".c"), ("alone C++", ".cc")):
        below[name] = tuple(path for path in headers if path.endswith(suffix))
    return below
