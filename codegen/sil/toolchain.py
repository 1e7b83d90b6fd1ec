"""Find, identify and run the user's C compiler, and report its first error in one line."""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

from codegen.errors import BuildError
from codegen.programs import run_program

_ERROR_LINE = re.compile(
    r"^(?:(?P<place>[^\s:][^:\n]*:\d+)(?::\d+)?: |\S+: )?(?:fatal )?error: (?P<text>.+)$", re.MULTILINE | re.IGNORECASE
)
_LINK_ERROR_LINE = re.compile(r"(?P<text>(?:multiple definition|undefined reference|duplicate symbol).*)")


def find_compiler() -> str:
    """Return the command of the C compiler: `$CC` (may include arguments), else the first of cc, gcc and clang on the PATH.

    Raises:
        BuildError: no compiler was found, or `$CC` cannot be run.
    """
    command = os.environ.get("CC", "").strip()
    if command:
        try:
            program = shlex.split(command)[0]
        except ValueError:
            raise BuildError(f"{command!r} cannot be read as a command", where="CC") from None
        if shutil.which(program) is None:
            raise BuildError(
                f"the compiler {program!r} does not exist or cannot be run",
                where="CC",
                remedy="set CC to a C compiler, or unset it",
            )
        return command
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return name
    raise BuildError("no C compiler was found", remedy="install one, e.g. apt install gcc, or set CC")


def compiler_command() -> tuple[str, ...]:
    """Return `find_compiler` split into words; the first is an absolute path."""
    # The path is absolute, because the compiler starts in other folders. Symbolic links are kept: some compilers depend on the
    # name by which they are called.
    program, *arguments = shlex.split(find_compiler())
    return (str(Path(shutil.which(program) or program).absolute()), *arguments)


def run(command: Sequence[str], folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run the compiler in `folder` with English messages. Its temporary files go to `folder` too."""
    environment = None if folder is None else {**os.environ, "TMPDIR": str(folder.absolute())}
    try:
        return run_program(command, folder, environment=environment)
    except OSError as error:
        raise BuildError(f"the compiler cannot be started: {error.strerror}", where=command[0]) from error


def require_success(result: subprocess.CompletedProcess[str], where: str) -> None:
    """Raise the first error of the compiler as a BuildError, located at `where` if it names no file and line."""
    if result.returncode == 0:
        return
    if result.returncode < 0:
        raise BuildError(
            f"the compiler was terminated by signal {-result.returncode}", where=where, remedy="check the free memory"
        )
    output = result.stderr + result.stdout
    found = _LINK_ERROR_LINE.search(output) or _ERROR_LINE.search(output)
    if found is None:
        first = next((line for line in output.splitlines() if line.strip()), "it printed nothing")
        raise BuildError(f"the compiler failed with exit code {result.returncode}: {first}", where=where)
    raise BuildError(f"the C does not compile: {found['text']}", where=found.groupdict().get("place") or where)


@functools.lru_cache(maxsize=16)
def compiler_identity(command: tuple[str, ...], native_flags: tuple[str, ...]) -> tuple[str, ...]:
    """Return version and target of a compiler, and a hash of the macros that flags such as -march=native define."""
    version = run([*command, "--version"])
    if version.returncode != 0 or not version.stdout.strip():
        raise BuildError("the compiler does not answer --version", where=shlex.join(command), remedy="set CC to a C compiler")
    target = run([*command, "-dumpmachine"]).stdout.strip()
    # Machines that share a home, and so the cache, may support different instructions.
    macros = run([*command, *native_flags, "-dM", "-E", "-xc", "/dev/null"]).stdout if native_flags else ""
    return version.stdout.strip().splitlines()[0], target, hashlib.sha256(macros.encode()).hexdigest()
