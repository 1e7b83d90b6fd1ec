"""The firmware in QEMU: the image sends the frames of the software in the loop, bit for bit, and reports every fault."""

import os
import re
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from codegen.emit.write import write_folder
from codegen.errors import CodegenError
from codegen.export import firmware
from codegen.export.firmware import ImageRun, Toolchain, image_sizes, run_image
from tests.export.test_firmware import made

TOOLCHAINS: tuple[Toolchain, ...] = ("gcc", "zig")
FAULT, LATE, SELFTEST = 2, 1, 3
"""Exit codes of the image."""


def run_project(files: Mapping[str, bytes], name: str = "4ws2-paper", toolchain: Toolchain = "gcc") -> ImageRun:
    return run_image(files, made(name).sent, toolchain)


def changed(path: str, old: str, new: str, files: Mapping[str, bytes] | None = None) -> dict[str, bytes]:
    """Return the files of a project with one text in one of them replaced."""
    files = dict(made().folder.files if files is None else files)
    text = files[path].decode()
    assert text.count(old) == 1, (path, old)
    return {**files, path: text.replace(old, new).encode()}


@pytest.mark.parametrize("toolchain", TOOLCHAINS)
@pytest.mark.parametrize(
    "name",
    [
        "4ws2",
        *(pytest.param(name, marks=pytest.mark.long) for name in ("4ws2-paper", "FD, 24 bytes, profile 11C, 29 bits")),
        "FD, 64 bytes, profile 5",
    ],
)
def test_the_frames_are_those_of_the_software_in_the_loop(name: str, toolchain: Toolchain) -> None:
    found = run_project(made(name).folder.files, name, toolchain)
    assert found.passed, found
    assert (found.compared, found.different, found.faults, found.exit_code) == (1500, 0, 0, 0)
    assert found.cycles == found.ticks == 1500  # each started with one SysTick tick, none was missed
    assert found.lost_samples == 2 and found.fpu and 0 < found.stack < 4096


UNDEFINED = '__asm volatile("udf #0");'
DEEP = """static void deep(uint32_t level)
{
    volatile uint32_t own[64];

    own[0] = level;
    (void)own[0];
    if (level < 1000u) {
        deep(level + 1u);
        own[1] = level;
    }
}

int main(void)
"""
CYCLE = "        run_cycle();"
# Usage faults of the Configurable Fault Status Register (ARMv7-M Architecture Reference Manual, B3.2.15): undefined
# instruction 00010000, no coprocessor 00080000. Exception 4 is memory management.
FAULTS: dict[str, tuple[Callable[[], dict[str, bytes]], str]] = {
    "undefined instruction": (
        lambda: changed("src/main.c", CYCLE, f"        if (cycles == 100u) {{\n            {UNDEFINED}\n        }}\n{CYCLE}"),
        r"fault: exception=6 cfsr=0x00010000 hfsr=0x00000000 pc=0x\w+",
    ),
    "no FPU": (lambda: changed("src/startup.c", "orr r1, r1, #0xF00000", "orr r1, r1, #0"), ".*cfsr=0x00080000.*"),
    "overflow of the stack": (
        lambda: changed("src/main.c", CYCLE, f"        deep(0u);\n{CYCLE}", changed("src/main.c", "int main(void)\n", DEEP)),
        "fault: exception=4 .* stack overflow",
    ),
    "before the board is up": (
        lambda: changed("src/main.c", "    board_init();", f"    {UNDEFINED}\n    board_init();"),
        ".*cfsr=0x00010000.*",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_ends_the_program_and_is_reported(fault: str) -> None:
    plant, message = FAULTS[fault]
    found = run_project(plant())
    assert (found.faults, found.exit_code, found.passed) == (1, FAULT, False)
    assert re.fullmatch(message, found.message)
    if fault == "undefined instruction":
        assert found.different == 1500 - 99  # the earlier ones were sent
        assert found.first_difference.startswith("cycle 99: nothing sent")


def test_a_cycle_that_takes_too_long_is_detected() -> None:
    wait = "for (volatile uint32_t wait = 0u; (cycles == 7u) && (wait < 400000u); wait++) {\n        }"
    found = run_project(changed("src/main.c", CYCLE, f"{CYCLE}\n        {wait}"))
    assert (found.exit_code, found.faults, found.passed) == (LATE, 0, False)
    assert found.ticks > found.cycles == 1500


def test_a_failed_self_test_ends_it() -> None:
    found = run_project(changed("src/main.c", "healthy = ars_selftest()", "healthy = !ars_selftest()"))
    assert (found.exit_code, found.message, found.different) == (SELFTEST, "self-test failed", 1500)


@pytest.mark.long
def test_only_systick_starts_a_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(firmware, "RUN_LIMIT", 3.0)
    with pytest.raises(CodegenError, match="did not end within 3 s"):
        run_project(changed("src/board_mps2_an386.c", "SYSTICK->control = 7u", "SYSTICK->control = 5u"))


def test_its_own_makefile_does_it_all(tmp_path: Path) -> None:
    """The folder's name has blanks, `CC` names another compiler and the objects are elsewhere."""
    folder = tmp_path / "a firmware"
    write_folder(made().folder, folder)
    environment = {name: value for name, value in os.environ.items() if name not in firmware.VARIABLES_OF_MAKE}

    def make(*arguments: str, code: int = 0) -> str:
        result = subprocess.run(["make", *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert bool(result.returncode) == bool(code), result.stdout + result.stderr
        return result.stdout + (result.stderr if code else "")

    make()
    assert "thread_stack" in (folder / "build" / "gcc" / "firmware.map").read_text()
    text, data, bss = (int(word) for word in make("-s", "size").splitlines()[1].split()[:3])
    sizes = image_sizes((folder / "build" / "gcc" / "firmware.elf").read_bytes())
    assert (text + data, data + bss) == (sizes.flash, sizes.ram)
    lines = make("-s", "run").splitlines()
    assert tuple(lines[:-1]) == made().sent
    assert lines[-1].startswith("end: cycles=1500 ticks=1500 lost_samples=2 fpu=1 stack=")
    assert make("-s", "check").splitlines() == lines[-1:]
    expected = folder / "expected.txt"
    expected.write_bytes(expected.read_bytes().replace(b"201#", b"202#", 1))
    assert "differ" in make("check", code=2)
    make("clean")
    assert not (folder / "build").exists()
    assert "-ffp-contract=off" in make("-n", f"CC={firmware.GCC} -DMORE", "BUILD=out")
