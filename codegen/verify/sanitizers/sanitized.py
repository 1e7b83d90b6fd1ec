"""Compile programs with AddressSanitizer and UndefinedBehaviorSanitizer, and read their reports.

A compiler is used only if its sanitizers find three planted faults first.
"""

from __future__ import annotations

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from codegen.emit.render import verbatim
from codegen.errors import BuildError, CodegenError
from codegen.programs import run_program
from codegen.sil.toolchain import compiler_command, compiler_identity, require_success, run
from codegen.verify.packages import MissingTool

SANITIZERS = "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow"
"""Sanitizers; `undefined` does not include the last two."""

FLAGS = ("-std=c99", "-O1", "-g", "-fno-omit-frame-pointer", "-ffp-contract=off")
PLAIN_FLAGS = ("-std=c99", "-O2", "-g", "-ffp-contract=off")

OPTIONS = {
    "ASAN_OPTIONS": "detect_leaks=0:malloc_context_size=0:quarantine_size_mb=8:abort_on_error=1:color=never",
    "UBSAN_OPTIONS": "print_stacktrace=0:halt_on_error=0:color=never",
}
"""Options of the runtimes. Undefined behaviour is reported and the program continues, so that a run finds several faults; a
wrong address ends it."""

SYMBOLIZERS = ("llvm-symbolizer", *(f"llvm-symbolizer-{version}" for version in range(30, 10, -1)))
"""Programs that turn addresses into lines for clang's runtime; gcc's needs none."""

FINDINGS_MAX = 20

ROOT = "/generated"
"""Folder of the sources in debug information, independent of the build folder."""

CANARY_FAULTS = {"a": "heap-buffer-overflow", "c": "outside the range of representable values", "d": "division by zero"}

_UNDEFINED = re.compile(r"^(?P<place>[^\s:]+:\d+)(?::\d+)?: runtime error: (?P<what>.+)$", re.MULTILINE)
_ADDRESS = re.compile(r"==ERROR: AddressSanitizer: (?P<what>[\w-]+)")
_ACCESS = re.compile(r"^(?P<how>READ|WRITE) of size (?P<size>\d+)", re.MULTILINE)
_FRAME = re.compile(r"^\s+#\d+ 0x[0-9a-f]+ in (?P<function>\S+) (?P<place>[^\s:]+:\d+)", re.MULTILINE)
_PROPERTY = re.compile(r"^(?P<what>property not held: .+)$", re.MULTILINE)


@dataclass(frozen=True)
class Compiler:
    """Compiler with working sanitizers.

    Attributes:
        command: words of the command.
        version: its version line.
    """

    command: tuple[str, ...]
    version: str


def find_compiler() -> Compiler:
    """Return the first of the user's C compiler, gcc and clang whose sanitizers find the planted faults.

    Raises:
        MissingTool: there is none.
    """
    candidates: list[tuple[str, ...]] = []
    with contextlib.suppress(BuildError):
        candidates.append(compiler_command())
    # An explicit choice is not overruled: the result is for the user's compiler.
    others = (
        () if os.environ.get("CC", "").strip() else ("gcc", "clang", *(f"clang-{version}" for version in range(30, 10, -1)))
    )
    candidates += [(str(Path(path).absolute()),) for name in others if (path := shutil.which(name))]
    for command in dict.fromkeys(candidates):
        if _finds_planted_faults(command):
            return Compiler(command, compiler_identity(command, ())[0])
    tried = ", ".join(shlex.join((Path(command[0]).name, *command[1:])) for command in candidates) or "no C compiler is here"
    raise MissingTool(
        f"no C compiler whose sanitizers find a planted fault ({tried})",
        where="sanitizers",
        remedy="install gcc with libasan and libubsan, or clang with compiler-rt",
    )


@lru_cache(maxsize=16)
def _finds_planted_faults(command: tuple[str, ...]) -> bool:
    try:
        with tempfile.TemporaryDirectory(prefix="ars-canary-") as scratch:
            tree = Path(scratch)
            (tree / "canary.c").write_bytes(verbatim("verify/canary.c"))
            require_success(run([*command, *FLAGS, SANITIZERS, "canary.c", "-o", "canary"], tree), "canary.c")
            return all(
                what in run_sanitized(tree / "canary", fault, seconds=60).stderr for fault, what in CANARY_FAULTS.items()
            )
    except (BuildError, OSError):
        return False


@lru_cache(maxsize=1)
def launcher() -> tuple[str, ...]:
    """Return the command that disables address randomisation, if allowed. Older runtimes find no room for their shadow
    memory in some layouts."""
    program = shutil.which("setarch")
    if program is None or run_program([program, "-R", "true"]).returncode != 0:
        return ()
    return (program, "-R")


def run_sanitized(program: Path, *arguments: str, seconds: float) -> subprocess.CompletedProcess[str]:
    """Run a sanitized program to its end. Raises subprocess.TimeoutExpired after `seconds`."""
    return run_program([*launcher(), str(program), *arguments], timeout=seconds, environment=environment())


def environment() -> dict[str, str]:
    """Return the environment of a sanitized program."""
    found = {**os.environ, **OPTIONS, "LC_ALL": "C"}
    symbolizer = next((path for name in SYMBOLIZERS if (path := shutil.which(name))), None)
    return found if symbolizer is None else {**found, "ASAN_SYMBOLIZER_PATH": symbolizer}


@contextlib.contextmanager
def compiled(
    compiler: Compiler,
    sources: Mapping[str, bytes],
    plain: Mapping[str, bytes],
    flags: Sequence[str] = (),
    link: Sequence[str] = (),
) -> Iterator[Path]:
    """Compile a program of sanitized sources and of plain ones around them, in a folder that is gone when the context ends.

    Args:
        sources: relative path -> content of the sanitized sources, headers included.
        plain: likewise for the plain ones.
        flags: additional flags for the sanitized sources.
        link: additional flags for linking.

    Raises:
        BuildError: C that does not compile.
        CodegenError: a full disk.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="ars-sanitized-") as folder:
            scratch = Path(folder).resolve()
            tree = scratch / "tree"
            for name, content in {**plain, **sources}.items():
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                (tree / name).write_bytes(content)
            search = [f"-I{folder}" for folder in ("include", "bench") if (tree / folder).is_dir()]
            common = [*search, f"-fdebug-prefix-map={tree}={ROOT}", "-c"]
            every = {**dict.fromkeys(plain, PLAIN_FLAGS), **dict.fromkeys(sources, (*FLAGS, SANITIZERS, *flags))}
            objects = {unit: f"{scratch}/{number}.o" for number, unit in enumerate(every) if unit.endswith(".c")}
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                commands = ([*compiler.command, *every[unit], *common, unit, "-o", name] for unit, name in objects.items())
                for unit, result in zip(objects, pool.map(lambda command: run(command, tree), commands), strict=True):
                    require_success(result, unit)
            linking = [*compiler.command, SANITIZERS, *link, *objects.values(), "-o", "program", "-lm"]
            require_success(run(linking, scratch), "linking")
            yield scratch / "program"
    except OSError as error:
        what = f"the sources cannot be stored: {error.strerror or error}"
        raise CodegenError(what, remedy="free space for temporary files") from error


def findings_of(report: str) -> tuple[str, ...]:
    """Return a line with file and line for each report of the sanitizers and of a harness on standard error."""
    text = report.replace(f"{ROOT}/", "")
    found = [f"{match['place']}: undefined behaviour: {match['what']}" for match in _UNDEFINED.finditer(text)]
    found += [_address(text[match.start() :], match["what"]) for match in _ADDRESS.finditer(text)]
    found += [match["what"] for match in _PROPERTY.finditer(text)]
    return tuple(dict.fromkeys(found))[:FINDINGS_MAX]


def _address(text: str, what: str) -> str:
    # The innermost frame of the sources; the runtime's own memcpy may be above it.
    frames = [frame for frame in _FRAME.finditer(text) if not frame["place"].startswith(("/", "."))]
    access = _ACCESS.search(text)
    how = f", {access['how'].lower()} of {access['size']} bytes" if access else ""
    where = f" in {frames[0]['function']}" if frames else ""
    return f"{frames[0]['place'] if frames else 'the program'}: wrong address: {what}{how}{where}"
