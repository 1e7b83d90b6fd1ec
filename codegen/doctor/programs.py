"""External programs: presence, version and purpose."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass

from codegen.doctor.finding import Finding, State
from codegen.errors import BuildError, one_line
from codegen.sil.toolchain import compiler_command, compiler_identity

ANSWER_LIMIT = 20.0
"""Timeout of a query for a version, in s."""


@dataclass(frozen=True)
class Program:
    """A program that some part uses.

    Attributes:
        names: under which it is looked for, in order.
        package: of Debian and Ubuntu.
        arguments: that make it tell its version; none where it has no such.
    """

    names: tuple[str, ...]
    package: str
    serves: str
    arguments: tuple[str, ...] = ("--version",)


PROGRAMS = (
    Program(("make",), "make", "generated Makefiles, codegen firmware --run"),
    Program(("cmake",), "cmake", "generated folders as a CMake project"),
    Program(("clang",), "clang", "a second compiler; MC/DC and libFuzzer in make evidence"),
    Program(("arm-none-eabi-gcc",), "gcc-arm-none-eabi", "codegen firmware --run with GCC"),
    Program(("qemu-system-arm",), "qemu-system-arm", "codegen firmware --run"),
    Program(("candump",), "can-utils", "to look at a bus by hand", ()),
    Program(("ip",), "iproute2", "to make a vcan0", ("-Version",)),
    Program(("chromium", "chromium-browser", "google-chrome"), "chromium", "the tests of reports, in a browser"),
)


def compiler() -> Finding:
    """The C compiler, which `codegen sil` needs."""
    serves = "the generated C on this machine"
    try:
        command = compiler_command()
        what = f"{compiler_identity(command, ())[0]} ({command[0]})"
    except BuildError as error:
        remedy = error.remedy or "install one, e.g. apt install gcc libc6-dev, or set CC"
        return Finding("C compiler", State.MISSING, error.what, serves, remedy, needed=True)
    return Finding("C compiler", State.GOOD, what, serves, needed=True)


def programs() -> list[Finding]:
    """Check the optional programs; `codegen sil` needs none of them."""
    return [_look_for(program) for program in PROGRAMS]


def _look_for(program: Program) -> Finding:
    name = program.names[0]
    path = next(filter(None, map(shutil.which, program.names)), None)
    if path is None:
        return Finding(name, State.MISSING, "not installed", program.serves, f"apt install {program.package}")
    if not program.arguments:
        return Finding(name, State.GOOD, path, program.serves)
    try:
        answer = subprocess.run(
            [path, *program.arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=ANSWER_LIMIT,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return Finding(name, State.BAD, f"{path} does not run: {one_line(error, 100)}", program.serves)
    told = (answer.stdout or answer.stderr).strip().splitlines()
    if answer.returncode != 0 or not told:
        return Finding(name, State.BAD, f"{path} does not tell its version (exit code {answer.returncode})", program.serves)
    return Finding(name, State.GOOD, one_line(told[0], 80), program.serves)
