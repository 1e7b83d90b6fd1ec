"""XCP around the native ECU, without a bus: its option, its identifiers, and what is told where it cannot be had."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from codegen.config import parse
from codegen.emit.write import write_folder
from codegen.emit.xcp_view import xcp_view
from codegen.errors import BuildError, ConfigError
from codegen.sil.toolchain import compiler_command
from hil_sim import native
from tests import builds
from tests.xcp.elf import Program

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="SocketCAN is a part of Linux")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_folder(builds.render(builds.paper_map(), builds.CONFIG), tmp_path / "build")
    return tmp_path / "build"


# --- the identifiers -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("can", "told"),
    [
        ({"xcp_receive_id": 0x6A1}, "xcp_receive_id and xcp_transmit_id are the same, 0x6A1"),
        ({"xcp_receive_id": 0x101}, "xcp_receive_id is the id of VehicleMotion, 0x101"),
        ({"xcp_transmit_id": 0x201}, "xcp_transmit_id is the id of RearSteerCommand, 0x201"),
        ({"vehicle_conditions": {"id": 0x6A0}}, "xcp_receive_id is the id of VehicleConditions, 0x6A0"),
        ({"xcp_receive_id": 0x800}, "xcp_receive_id"),
    ],
)
def test_identifiers_that_clash_are_refused(can: dict[str, Any], told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        parse({"can": can}, "car.toml")


def test_the_configured_identifiers_are_in_the_program() -> None:
    config = parse({"can": {"xcp_receive_id": 0x7A, "xcp_transmit_id": 0x7B}}, "car.toml")
    view = xcp_view(config)
    assert (view.receive_id, view.transmit_id) == ("0x07A", "0x07B")


@pytest.mark.parametrize(
    ("period", "ticks", "mode", "cycle", "unit"),
    [
        (0.01, 10, "0x62u", 10, 6),
        (0.005, 5, "0x62u", 5, 6),
        (0.0025, 25, "0x52u", 25, 5),  # of 100 us
        (0.01225, 1225, "0x42u", 0, 6),  # of 10 us; too many for the byte of the event's cycle
    ],
)
def test_the_period_in_units_of_the_standard(period: float, ticks: int, mode: str, cycle: int, unit: int) -> None:
    config = parse({"controller": {"sampling_time_s": period}, "plant": {"sampling_time_s": 0.00025}}, "car.toml")
    view = xcp_view(config)
    assert (view.timestamp_ticks, view.timestamp_mode, view.event_cycle, view.event_unit) == (ticks, mode, cycle, unit)


# --- the program ---------------------------------------------------------------------------------------------------


def test_the_option_is_passed_on(folder: Path) -> None:
    program = str(native.compile_ecu(folder))
    assert native.command(folder, "vcan3", lock_step=True, xcp=True) == [program, "--lock-step", "--xcp", "vcan3"]


def test_addresses_are_those_of_the_file_and_the_same_everywhere(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """32 bits, what lies where is told, and no folder of this machine."""
    made = native.compile_ecu(folder)
    program = Program(made)
    gain = program.place("ars_parameters_default.proportional_gain")
    assert 0 < gain.address < 2**32
    assert gain.size == 4
    assert 0 < program.place("ecu.task").address < 2**32
    monkeypatch.setenv("ARS_CACHE", str(folder.parent / "another"))
    again = native.compile_ecu(folder)
    assert again.read_bytes() == made.read_bytes()


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        (("-no-pie",), "the calibration has no section of its own; compile as the head of ars_xcp.h says"),
        (("-fPIE", "-pie", native.section_flag("ars")), "the addresses do not fit the 32 bits of XCP; link with -no-pie"),
    ],
    ids=["no section", "PIE"],
)
def test_a_program_that_cannot_be_calibrated_says_so(folder: Path, flags: tuple[str, ...], told: str) -> None:
    sources = [*sorted(folder.glob("src/*.c")), *sorted(folder.glob("linux/*.c"))]
    made = folder.parent / "ecu"
    command = [*compiler_command(), "-std=c99", "-O1", *flags, "-Iinclude", *sources, "-o", made, "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    result = subprocess.run([made, "--xcp", "vcan0"], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (2, "", f"error: --xcp: {told}\n")


def test_a_build_of_before_says_so(folder: Path) -> None:
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"linux/ars_xcp.c"', '"linux/other.c"'))
    (folder / "linux" / "ars_xcp.c").rename(folder / "linux" / "other.c")
    with pytest.raises(BuildError, match=r"the build has no linux/ars_xcp\.c; build again"):
        native.command(folder, "vcan0", xcp=True)


# --- the commands --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [
        ("ecu", "--bus", "socketcan:vcan0", "--ecu", "cffi"),
        ("ecu", "--bus", "virtual:test"),
        ("hil", "--bus", "socketcan:vcan0", "--ecu", "cffi"),
        ("hil", "--bus", "socketcan:vcan0", "--ecu", "external"),
    ],
    ids=" ".join,
)
def test_other_ecus_have_none(folder: Path, arguments: tuple[str, ...]) -> None:
    kind = arguments[4] if len(arguments) > 4 else "cffi"
    command = [sys.executable, "-m", "codegen", *arguments, "--build", folder, "--xcp"]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    told = f"error: --xcp: only the native ECU has XCP, not {kind}; take --ecu native\n"
    assert (result.returncode, result.stdout, result.stderr) == (2, "", told)
