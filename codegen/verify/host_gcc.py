"""The host's gcc: found, and told from a clang that answers to its name, as macOS has one."""

from __future__ import annotations

import functools
import shutil

from codegen.sil.toolchain import compiler_identity, run

MISSING = "gcc: it is not on the PATH, and what it shows was not run; install it, e.g. apt install gcc"


@functools.cache
def gcc() -> str | None:
    """Its path, or None where there is none."""
    program = shutil.which("gcc")
    if program is None:
        return None
    macros = run([program, "-dM", "-E", "-xc", "/dev/null"])
    return program if macros.returncode == 0 and "__clang__" not in macros.stdout else None


def gcc_version(program: str) -> str:
    """As it tells it."""
    return compiler_identity((program,), ())[0]
