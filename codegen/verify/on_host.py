"""Use of this machine: its C compilers, and the C of a build, which is checked before it runs here unguarded."""

from __future__ import annotations

import functools
import shutil
import sys

from codegen.errors import BuildError, CodegenError
from codegen.sil.compile import DEFAULT_FLAGS
from codegen.sil.software import Software, compile_build
from codegen.sil.toolchain import compiler_identity, find_compiler, run
from codegen.verify.outcomes import Subject
from codegen.verify.tools import MissingTool

HOST_FLAGS = tuple(flag for flag in DEFAULT_FLAGS if flag != "-Werror")
"""Flags for this machine's compiler. Another check judges its warnings."""
HOST_PROGRAMS = ("example", "linux")
"""Folders of programs for a host."""
COMPILED_PROGRAMS = HOST_PROGRAMS if sys.platform == "linux" else HOST_PROGRAMS[:1]
"""Those for which this machine has the headers."""


def require_compiler() -> None:
    """Raise MissingTool if this machine has no C compiler."""
    try:
        find_compiler()
    except BuildError as error:
        raise MissingTool(error.what, where=error.where, remedy=error.remedy) from None


class MightNotReturn(CodegenError):
    """A call of the C might not terminate, or this cannot be decided. The check is not run."""


def software_of(subject: Subject) -> Software:
    """Compile the C of a build and load it. All checks share this library. Raises BuildError: it does not compile."""
    return compile_build(subject.files, subject.manifest, flags=HOST_FLAGS)


def compiled(subject: Subject) -> Software:
    """Compile and load the C of a build, to run it in this process.

    Raises:
        MissingTool: `ziglang`, which the check of loops requires, is not installed.
        BuildError: the C does not compile.
        MightNotReturn: a loop has no fixed bound, or the C cannot be parsed.
    """
    software = software_of(subject)
    try:
        found = subject.unbounded
    except BuildError as error:
        raise MightNotReturn(f"it cannot be read, and so it might never return: {error}") from None
    if found:
        raise MightNotReturn(f"it might never return: {found[0]}")
    return software


GCC_MISSING = "gcc: it is not on the PATH, so its part was not run; install it, e.g. apt install gcc"


@functools.cache
def gcc() -> str | None:
    """Return the path of gcc, or None if there is none."""
    program = shutil.which("gcc")
    if program is None:
        return None
    macros = run([program, "-dM", "-E", "-xc", "/dev/null"])
    return program if macros.returncode == 0 and "__clang__" not in macros.stdout else None


def gcc_version(program: str) -> str:
    """Return the version line of gcc."""
    return compiler_identity((program,), ())[0]
