"""The firmware project: it boots in QEMU, and what it sends is what the software in the loop sends, bit for bit."""

from __future__ import annotations

import functools
import io
import os
import re
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import NoReturn

import pytest
from elftools.elf.elffile import ELFFile

from codegen.emit.folder import read_manifest
from codegen.emit.from_files import prepare
from codegen.emit.write import write_folder
from codegen.errors import BuildError, CodegenError
from codegen.export.firmware import image
from codegen.export.firmware.image import ImageRun, Toolchain, image_sizes, run_image
from codegen.export.firmware.project import Project, project
from codegen.sil.software import load
from hil_sim.frames import Frame
from hil_sim.runs import run_through_can
from hil_sim.scenarios import find

GENERATED = Path(__file__).parents[2] / "generated"
BUILDS = ("4ws2", "4ws2-tracking")
TOOLCHAINS: tuple[Toolchain, ...] = ("gcc", "zig")

FAULT, LATE, SELFTEST = 2, 1, 3
"""Exit codes of the image."""

# Usage faults of the Configurable Fault Status Register (ARMv7-M Architecture Reference Manual, B3.2.15), as it is printed.
UNDEFINED_INSTRUCTION, NO_COPROCESSOR, DIVIDE_BY_ZERO = "00010000", "00080000", "02000000"


def needs(*programs: str) -> None:
    """Skip the test where one is missing, or fail it where all tests must run."""
    for program in programs:
        if shutil.which(program) is None:
            _lacking(program)


def _lacking(program: str) -> NoReturn:
    if os.environ.get("CI", "").lower() not in ("", "0", "false"):
        pytest.fail(f"in CI no test here may be skipped: {program} is not installed")
    pytest.skip(f"{program} is not installed")


@functools.cache
def made(name: str = "4ws2") -> Project:
    return project(GENERATED / name)


def ran(files: Mapping[str, bytes], name: str = "4ws2", toolchain: Toolchain = "gcc") -> ImageRun:
    needs("make", image.QEMU, *([image.GCC] if toolchain == "gcc" else []))
    return run_image(files, made(name).sent, toolchain)


def changed(path: str, old: str, new: str, name: str = "4ws2") -> dict[str, bytes]:
    """The files of a project, one place of one of them changed."""
    files = dict(made(name).folder.files)
    text = files[path].decode()
    assert text.count(old) == 1, (path, old)
    return {**files, path: text.replace(old, new).encode()}


@functools.cache
def elf(name: str = "4ws2", toolchain: Toolchain = "gcc") -> bytes:
    """An image."""
    needs("make", *([image.GCC] if toolchain == "gcc" else []))
    kept: list[bytes] = []

    class Kept(Exception):
        pass

    def keep(data: bytes) -> NoReturn:
        kept.append(data)
        raise Kept

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(image, "image_sizes", keep)
        patch.setattr(image, "require_tools", lambda: None)
        with pytest.raises(Kept):
            run_image(made(name).folder.files, (), toolchain)
    return kept[0]


# --- the whole drive ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("toolchain", TOOLCHAINS)
@pytest.mark.parametrize("name", BUILDS)
def test_the_frames_are_those_of_the_software_in_the_loop(name: str, toolchain: Toolchain) -> None:
    found = ran(made(name).folder.files, name, toolchain)
    assert found.passed, found
    assert (found.compared, found.different, found.faults, found.exit_code) == (1500, 0, 0, 0)
    assert found.cycles == found.ticks == 1500  # one tick of SysTick began each, none was missed
    assert found.lost_samples == 0
    assert found.fpu
    assert 0 < found.stack < 4096


@pytest.mark.parametrize("name", BUILDS)
def test_what_is_expected_is_the_task_fed_with_the_frames_of_the_trace(name: str) -> None:
    """The trace and the answers, read back from the files, against the task through cffi."""
    files = made(name).folder.files
    rows = re.findall(r"\{ (\d+)u, (0x\w+)u, (\d)u, \{ (.*) \} \}", files["src/trace.c"].decode())
    expected = files["expected.txt"].decode().splitlines()
    task = load(GENERATED / name).task()
    answers = []
    for cycle in range(len(expected)):
        for _, identifier, length, data in (row for row in rows[2 * cycle : 2 * cycle + 2] if int(row[0]) == cycle):
            content = bytes(int(byte.removesuffix("u"), 16) for byte in data.split(", "))
            assert len(content) == int(length) == 8
            task.on_can_frame(int(identifier, 16), content)
        identifier, data = task.run()
        answers.append(f"{identifier:03X}#{data.hex().upper()}")
    assert len(rows) == 2 * len(expected) == 3000
    assert answers == expected == list(made(name).sent)
    assert task.counters()["lost_samples"] == 0


def test_the_drive_is_the_whole_step_steer_run() -> None:
    """As `codegen sil --can` drives it: every frame on its bus, the car's and the controller's."""
    software = load(GENERATED / "4ws2")
    scenario = find("step-steer", software.config)
    sent: list[Frame] = []

    class Log:
        def write(self, frame: Frame, *, received: bool) -> None:
            if received:
                sent.append(frame)

    from hil_sim.bench import run_in_process
    from hil_sim.plant_node import PlantNode

    result = run_in_process(PlantNode(software.config, scenario), software, log=Log())  # type: ignore[arg-type]
    assert [f"{frame.id:03X}#{frame.data.hex().upper()}" for frame in sent] == list(made().sent)
    assert (result.record == run_through_can(software, scenario).record).all()
    assert len(sent) * software.config.controller.sampling_time_s == scenario.duration


def test_a_build_with_another_prefix_runs_too(tmp_path: Path) -> None:
    write_folder(prepare(GENERATED / "4ws2.npz", prefix="src").folder, tmp_path / "other")
    other = project(tmp_path / "other")
    assert other.sent == made().sent
    needs("make", image.QEMU, image.GCC)
    assert run_image(other.folder.files, other.sent, "gcc").passed


# --- what must be seen ----------------------------------------------------------------------------------------------


def test_an_undefined_instruction_is_a_fault() -> None:
    planted = '        if (cycles == 100u) {\n            __asm volatile("udf #0");\n        }\n        run_cycle();'
    found = ran(changed("src/main.c", "        run_cycle();", planted))
    assert (found.faults, found.exit_code, found.passed) == (1, FAULT, False)
    assert re.fullmatch(r"fault: exception=6 cfsr=0x(\w+) hfsr=0x00000000 pc=0x\w+", found.message)[1] == UNDEFINED_INSTRUCTION  # type: ignore[index]
    assert found.different == 1500 - 99  # those before were sent
    assert found.first_difference.startswith("cycle 99: nothing sent")


def test_without_the_fpu_the_first_float_is_a_fault() -> None:
    found = ran(changed("src/startup.c", "orr r1, r1, #0xF00000", "orr r1, r1, #0"))
    assert (found.faults, found.exit_code) == (1, FAULT)
    assert f"cfsr=0x{NO_COPROCESSOR}" in found.message


def test_an_overflow_of_the_stack_is_a_fault_and_reported() -> None:
    deep = (
        "static void deep(uint32_t level)\n{\n    volatile uint32_t own[64];\n\n    own[0] = level;\n    (void)own[0];\n"
        "    if (level < 1000u) {\n        deep(level + 1u);\n        own[1] = level;\n    }\n}\n\nint main(void)\n"
    )
    files = changed("src/main.c", "int main(void)\n", deep)
    text = files["src/main.c"].decode().replace("        run_cycle();", "        deep(0u);\n        run_cycle();")
    files["src/main.c"] = text.encode()
    found = ran(files)
    assert (found.faults, found.exit_code) == (1, FAULT)
    assert found.message.startswith("fault: exception=4 ")  # memory management
    assert found.message.endswith(" stack overflow")


def test_a_division_by_zero_is_a_fault() -> None:
    planted = "    volatile uint32_t zero = 0u;\n\n    cycles = 1000u / zero;\n    for (passed ="
    found = ran(changed("src/main.c", "    for (passed =", planted))
    assert (found.faults, found.exit_code) == (1, FAULT)
    assert f"cfsr=0x{DIVIDE_BY_ZERO}" in found.message


def test_a_fault_before_the_board_is_up_is_reported_too() -> None:
    found = ran(changed("src/main.c", "    board_init();", '    __asm volatile("udf #0");\n    board_init();'))
    assert (found.faults, found.exit_code) == (1, FAULT)


def test_a_cycle_that_takes_too_long_is_seen() -> None:
    wait = "for (volatile uint32_t wait = 0u; (cycles == 7u) && (wait < 400000u); wait++) {\n        }"
    planted = f"        run_cycle();\n        {wait}"
    found = ran(changed("src/main.c", "        run_cycle();", planted))
    assert (found.exit_code, found.faults, found.passed) == (LATE, 0, False)
    assert found.ticks > found.cycles == 1500


def test_a_self_test_that_fails_ends_it() -> None:
    found = ran(changed("src/main.c", "healthy = ars_selftest()", "healthy = !ars_selftest()"))
    assert (found.exit_code, found.message, found.different) == (SELFTEST, "self-test failed", 1500)


def test_one_bit_of_one_frame_is_a_difference() -> None:
    files = dict(made().folder.files)
    first = re.search(rb"\{ 700u, 0x102u, 8u, \{ 0x(\w\w)u", files["src/trace.c"])
    assert first is not None
    other = b"%02X" % (int(first[1], 16) ^ 1)
    at = first.start(1)
    files["src/trace.c"] = files["src/trace.c"][:at] + other + files["src/trace.c"][at + 2 :]
    found = ran(files)
    assert found.exit_code == 0  # the program itself is well: a frame with a wrong CRC is a lost sample
    assert found.lost_samples == 1
    assert found.different >= 1
    assert found.first_difference.startswith("cycle 700: 201#")
    assert not found.passed


def test_nothing_but_systick_begins_a_cycle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(image, "RUN_LIMIT", 3.0)
    with pytest.raises(CodegenError, match="did not end within 3 s"):
        ran(changed("src/board_mps2_an386.c", "SYSTICK->control = 7u", "SYSTICK->control = 5u"))


def test_c_that_does_not_compile_is_one_line() -> None:
    with pytest.raises(BuildError, match=r"src/main\.c:\d+: the C does not compile"):
        ran(changed("src/main.c", "    board_init();", "    int unused = 1.5f;\n    board_init();"))


# --- the image ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("toolchain", TOOLCHAINS)
def test_vectors_stacks_and_sections_lie_where_they_must(toolchain: Toolchain) -> None:
    file = ELFFile(io.BytesIO(elf(toolchain=toolchain)))
    symbols = {symbol.name: symbol["st_value"] for symbol in file.get_section_by_name(".symtab").iter_symbols()}
    table = file.get_section_by_name(".vectors")
    words = [int.from_bytes(table.data()[at : at + 4], "little") for at in range(0, table["sh_size"], 4)]
    handler = symbols["fault_handler"]
    assert (table["sh_addr"], len(words)) == (0, 16)
    assert words[0] % 8 == 0
    assert words[0] == symbols["handler_stack"] + 1024
    assert words[1] == symbols["reset_handler"] == file.header["e_entry"]
    assert words[2:7] == [handler] * 5
    assert words[15] == symbols["systick_handler"]
    assert all(word % 2 for word in words[1:] if word)  # Thumb
    assert (symbols["thread_stack_bottom"], symbols["thread_stack_top"]) == (0x2000_0000, 0x2000_1100)
    assert symbols["calibration_start"] <= symbols["ars_parameters_default"] < symbols["calibration_end"]


@pytest.mark.parametrize("toolchain", TOOLCHAINS)
def test_there_is_no_heap_no_double_and_nothing_that_nobody_calls(toolchain: Toolchain) -> None:
    file = ELFFile(io.BytesIO(elf(toolchain=toolchain)))
    names = {symbol.name for symbol in file.get_section_by_name(".symtab").iter_symbols()}
    assert not names & {"malloc", "free", "_sbrk", "sbrk", "__aeabi_dadd", "__aeabi_dmul", "__aeabi_f2d"}
    assert "ars_task_10ms" in names
    assert "ars_can_pack_vehicle_motion" not in names  # the car's side: --gc-sections
    assert file.header["e_flags"] & 0x400  # EF_ARM_ABI_FLOAT_HARD


@pytest.mark.parametrize("toolchain", TOOLCHAINS)
def test_the_sizes_are_those_of_an_independent_reader(toolchain: Toolchain) -> None:
    sections = [section for section in ELFFile(io.BytesIO(elf(toolchain=toolchain))).iter_sections() if section["sh_flags"] & 2]
    in_ram = [section for section in sections if section["sh_addr"] >= 0x2000_0000]
    flash = sum(section["sh_size"] for section in sections if section["sh_type"] != "SHT_NOBITS")
    sizes = image_sizes(elf(toolchain=toolchain))
    assert (sizes.flash, sizes.ram) == (flash, sum(section["sh_size"] for section in in_ram))


# --- the folder -----------------------------------------------------------------------------------------------------


def test_the_same_build_gives_the_same_bytes_and_no_path() -> None:
    again = project(GENERATED / "4ws2").folder
    assert again.content() == made().folder.content()
    for path, content in again.files.items():
        assert str(GENERATED).encode() not in content, path
        assert str(Path.home()).encode() + b"/" not in content, path


def test_it_says_what_build_it_is_from(tmp_path: Path) -> None:
    write_folder(made().folder, tmp_path / "fw")
    manifest, source = read_manifest(tmp_path / "fw"), read_manifest(GENERATED / "4ws2")
    assert (manifest["what"], manifest["name"], manifest["build"]["id"]) == ("firmware", "4ws2", source["build_id"])
    readme = (tmp_path / "fw" / "README.md").read_text()
    assert source["build_id"] in readme
    assert manifest["build"]["manifest_sha256"] in readme


def test_its_own_makefile_does_it_all(tmp_path: Path) -> None:
    """In a folder whose name has blanks; the compiler in `CC`, the objects elsewhere, if so wished."""
    needs("make", image.GCC, image.QEMU, "cmp")
    folder = tmp_path / "a firmware"
    write_folder(made().folder, folder)

    def make(*arguments: str) -> str:
        environment = {name: value for name, value in os.environ.items() if name not in image.VARIABLES_OF_MAKE}
        result = subprocess.run(["make", *arguments], cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    make()
    assert "thread_stack" in (folder / "build" / "gcc" / "firmware.map").read_text()
    text, data, bss = (int(word) for word in make("-s", "size").splitlines()[1].split()[:3])
    sizes = image_sizes((folder / "build" / "gcc" / "firmware.elf").read_bytes())
    assert (text + data, data + bss) == (sizes.flash, sizes.ram)
    lines = make("-s", "run").splitlines()
    assert tuple(lines[:-1]) == made().sent
    assert lines[-1].startswith("end: cycles=1500 ticks=1500 lost_samples=0 fpu=1 stack=")
    assert make("-s", "check").splitlines() == lines[-1:]
    make("clean")
    assert not (folder / "build").exists()
    assert "-ffp-contract=off" in make("-n", f"CC={image.GCC} -DMORE", "BUILD=out")


def test_make_check_sees_a_difference(tmp_path: Path) -> None:
    needs("make", image.GCC, image.QEMU, "cmp")
    files = dict(made().folder.files)
    files["expected.txt"] = files["expected.txt"].replace(b"201#", b"202#", 1)
    for path, content in files.items():
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_bytes(content)
    result = subprocess.run(["make", "check"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert result.returncode != 0
    assert "differ" in result.stdout + result.stderr
