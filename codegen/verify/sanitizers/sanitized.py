"""Programs compiled for this machine with AddressSanitizer and UndefinedBehaviorSanitizer, and what these report.

A compiler counts only where its sanitizers are seen to work: before anything else, three faults are planted and must be found.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from codegen.errors import BuildError, CodegenError
from codegen.sil.toolchain import compiler_command, compiler_identity, require_success, run
from codegen.verify.packages import MissingTool

SANITIZERS = "-fsanitize=address,undefined,float-divide-by-zero,float-cast-overflow"
"""The last two are not among `undefined`: named, or they are not looked for."""

FLAGS = ("-std=c99", "-O1", "-g", "-fno-omit-frame-pointer", "-ffp-contract=off")
PLAIN_FLAGS = ("-std=c99", "-O2", "-g", "-ffp-contract=off")

OPTIONS = {
    "ASAN_OPTIONS": "detect_leaks=0:malloc_context_size=0:quarantine_size_mb=8:abort_on_error=1:color=never",
    "UBSAN_OPTIONS": "print_stacktrace=0:halt_on_error=0:color=never",
}
"""Undefined behaviour is told and the program goes on, so that one run finds more than one fault; a wrong address ends it."""

SYMBOLIZERS = ("llvm-symbolizer", *(f"llvm-symbolizer-{version}" for version in range(30, 10, -1)))
"""clang's runtime needs one to turn addresses into lines; gcc's has its own."""

FINDINGS_MAX = 20

ROOT = "/generated"
"""Where the sources lie for the debugger, whatever folder they are compiled in."""

_CANARY = """#include <stdio.h>
#include <stdlib.h>
int main(int count, char **arguments)
{
    volatile float number = 1.0e30f;
    volatile float zero = 0.0f;
    float *volatile place = malloc(4u * sizeof(float));

    switch ((count > 1) ? arguments[1][0] : ' ') {
    case 'a': number = place[4]; break;
    case 'c': number = (float)(int)number; break;
    case 'd': number = number / zero; break;
    default: break;
    }
    printf("%g", (double)number);
    free(place);
    return 0;
}
"""
_CANARY_FAULTS = {"a": "heap-buffer-overflow", "c": "outside the range of representable values", "d": "division by zero"}

_UNDEFINED = re.compile(r"^(?P<place>[^\s:]+:\d+)(?::\d+)?: runtime error: (?P<what>.+)$", re.MULTILINE)
_ADDRESS = re.compile(r"==ERROR: AddressSanitizer: (?P<what>[\w-]+)")
_ACCESS = re.compile(r"^(?P<how>READ|WRITE) of size (?P<size>\d+)", re.MULTILINE)
_FRAME = re.compile(r"^\s+#\d+ 0x[0-9a-f]+ in (?P<function>\S+) (?P<place>[^\s:]+:\d+)", re.MULTILINE)
_PROPERTY = re.compile(r"^(?P<what>property not held: .+)$", re.MULTILINE)


@dataclass(frozen=True)
class Compiler:
    """One whose sanitizers work here.

    Attributes:
        command: its words.
        version: first line of what it says of itself.
    """

    command: tuple[str, ...]
    version: str


def find_compiler() -> Compiler:
    """The user's C compiler, else gcc or clang, whichever first shows that its sanitizers find the planted faults.

    Raises:
        MissingTool: none does.
    """
    candidates: list[tuple[str, ...]] = []
    with contextlib.suppress(BuildError):
        candidates.append(compiler_command())
    # An explicit choice is not overruled: what it says holds for the user's compiler.
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
            (tree / "canary.c").write_text(_CANARY, encoding="ascii")
            require_success(run([*command, *FLAGS, SANITIZERS, "canary.c", "-o", "canary"], tree), "canary.c")
            return all(what in run_program(tree / "canary", fault, seconds=60).stderr for fault, what in _CANARY_FAULTS.items())
    except (BuildError, OSError):
        return False


@lru_cache(maxsize=1)
def launcher() -> tuple[str, ...]:
    """Words before a sanitized program: without a random layout of its memory where that is allowed here, for older runtimes do
    not find room for their shadow in every one."""
    program = shutil.which("setarch")
    if program is None or subprocess.run([program, "-R", "true"], capture_output=True, check=False).returncode != 0:
        return ()
    return (program, "-R")


def run_program(program: Path, *arguments: str, seconds: float) -> subprocess.CompletedProcess[str]:
    """Run a sanitized program to its end. Raises subprocess.TimeoutExpired: it takes longer than so many seconds."""
    return subprocess.run(
        [*launcher(), str(program), *arguments],
        env=environment(),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=seconds,
    )


def environment() -> dict[str, str]:
    """For a sanitized program."""
    found = {**os.environ, **OPTIONS, "LC_ALL": "C"}
    symbolizer = next((path for name in SYMBOLIZERS if (path := shutil.which(name))), None)
    return found if symbolizer is None else {**found, "ASAN_SYMBOLIZER_PATH": symbolizer}


@dataclass(frozen=True)
class Program:
    """A compiled program, in a folder of its own that is gone when the context ends."""

    path: Path


@contextlib.contextmanager
def compiled(
    compiler: Compiler,
    sources: Mapping[str, str | bytes],
    plain: Mapping[str, str | bytes],
    flags: Sequence[str] = (),
    link: Sequence[str] = (),
) -> Iterator[Program]:
    """A program of sanitized sources and of others, which are compiled without: the bench around them.

    Args:
        compiler: see `find_compiler`.
        sources: relative path -> content of what is judged, headers included.
        plain: the same for what is not.
        flags: more, for the sanitized sources alone.
        link: more, for linking alone.

    Raises:
        BuildError: C that does not compile.
        CodegenError: a full disk.
    """
    with _folder() as scratch:
        tree, path = scratch / "tree", scratch / "program"
        for name, content in {**plain, **sources}.items():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            (tree / name).write_bytes(content.encode() if isinstance(content, str) else content)
        objects: list[str] = []
        judged = _Units(compiler, tree, (*FLAGS, SANITIZERS, *flags), sources)
        for units in (judged, _Units(compiler, tree, PLAIN_FLAGS, {**sources, **plain}, tuple(plain))):
            for compiled_unit in units.objects():
                objects.append(f"{len(objects)}.o")
                (scratch / objects[-1]).write_bytes(compiled_unit)
        require_success(run([*compiler.command, SANITIZERS, *link, *objects, "-o", "program", "-lm"], scratch), "linking")
        yield Program(path)


_objects: dict[str, bytes] = {}
"""Of this process: a harness and the next one take mostly the same units."""


@dataclass(frozen=True)
class _Units:
    """The .c files among `sources`, or those of them that are named, compiled in a tree that holds them and their headers."""

    compiler: Compiler
    tree: Path
    flags: tuple[str, ...]
    sources: Mapping[str, str | bytes]
    named: tuple[str, ...] = ()

    def objects(self) -> Iterator[bytes]:
        """Each unit's object file."""
        headers = {name: content for name, content in self.sources.items() if name.endswith(".h")}
        for unit in sorted(name for name in self.named or self.sources if name.endswith(".c")):
            seen = repr((self.compiler, self.flags, sorted(headers.items()), unit, self.sources[unit]))
            key = hashlib.sha256(seen.encode()).hexdigest()
            if key not in _objects:
                _objects[key] = self._compiled(unit)
            yield _objects[key]

    def _compiled(self, unit: str) -> bytes:
        search = [f"-I{folder}" for folder in ("include", "bench") if (self.tree / folder).is_dir()]
        moved = f"-fdebug-prefix-map={self.tree}={ROOT}"
        command = [*self.compiler.command, *self.flags, moved, *search, "-c", unit, "-o", "../unit.o"]
        require_success(run(command, self.tree), unit)
        return (self.tree.parent / "unit.o").read_bytes()


@contextlib.contextmanager
def _folder() -> Iterator[Path]:
    try:
        with tempfile.TemporaryDirectory(prefix="ars-sanitized-") as scratch:
            yield Path(scratch).resolve()
    except OSError as error:
        raise CodegenError(
            f"the sources cannot be stored: {error.strerror or error}", remedy="free space for temporary files"
        ) from error


def findings_of(report: str) -> tuple[str, ...]:
    """What the sanitizers and the properties of a harness say on standard error, a line each with file and line."""
    text = report.replace(f"{ROOT}/", "")
    found = [f"{match['place']}: undefined behaviour: {match['what']}" for match in _UNDEFINED.finditer(text)]
    found += [_address(text[match.start() :], match["what"]) for match in _ADDRESS.finditer(text)]
    found += [match["what"] for match in _PROPERTY.finditer(text)]
    return tuple(dict.fromkeys(found))[:FINDINGS_MAX]


def _address(text: str, what: str) -> str:
    # The innermost frame of the sources: above it may stand the runtime's own memcpy.
    frames = [frame for frame in _FRAME.finditer(text) if not frame["place"].startswith(("/", "."))]
    access = _ACCESS.search(text)
    how = f", {access['how'].lower()} of {access['size']} bytes" if access else ""
    where = f" in {frames[0]['function']}" if frames else ""
    return f"{frames[0]['place'] if frames else 'the program'}: wrong address: {what}{how}{where}"
