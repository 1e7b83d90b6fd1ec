"""Find the host's gcc, and distinguish it from a clang of that name, as on macOS."""

from __future__ import annotations

import functools
import shutil

from codegen.sil.toolchain import compiler_identity, run

MISSING = "gcc: it is not on the PATH, so its part was not run; install it, e.g. apt install gcc"


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
