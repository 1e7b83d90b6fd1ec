"""What the checks ask before they run the C of a build, unguarded, on this machine."""

from __future__ import annotations

from codegen.errors import BuildError, CodegenError
from codegen.sil.compile import DEFAULT_FLAGS
from codegen.sil.software import Software, compile_build
from codegen.sil.toolchain import find_compiler
from codegen.verify.budgets.bounded_loops import complaints
from codegen.verify.check import Subject
from codegen.verify.packages import MissingTool

HOST_FLAGS = tuple(flag for flag in DEFAULT_FLAGS if flag != "-Werror")
"""Of this machine's compiler. What it warns of is judged by another check."""


def require_compiler() -> None:
    """Refuse to go on without a C compiler of this machine. Raises MissingTool."""
    try:
        find_compiler()
    except BuildError as error:
        raise MissingTool(error.what, where=error.where, remedy=error.remedy) from None


class MightNotReturn(CodegenError):
    """A call of the C might never return, or nobody can read whether it does: what would run it is not run."""


def compiled(subject: Subject) -> Software:
    """The C of a build, to be run by this process.

    Raises:
        MissingTool: `ziglang` is not installed, without which its loops cannot be judged.
        BuildError: it does not compile.
        MightNotReturn: it has a loop without a fixed number of rounds, or cannot be read.
    """
    software = compile_build(subject.files, subject.manifest, flags=HOST_FLAGS)
    try:
        found = complaints(subject.files, subject.manifest)
    except BuildError as error:
        raise MightNotReturn(f"it cannot be read, and so it might never return: {error}") from None
    if found:
        raise MightNotReturn(f"it might never return: {found[0]}")
    return software
