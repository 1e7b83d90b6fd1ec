"""XCP in the native ECU, without a bus: its option, its identifiers and its addresses; random packets to the slave."""

import shutil
import subprocess
from pathlib import Path

import pytest

from codegen.emit.render import hexadecimal
from codegen.emit.xcp_view import xcp_timing
from codegen.errors import BuildError, CodegenError
from codegen.sil.toolchain import compiler_command
from hil_sim import ecu_process
from hil_sim.session import check_xcp
from tests.whole_car import car
from tests.xcp.checks import run_random_packets
from tests.xcp.slave import BUILD, COMMANDS, ERRORS


@pytest.mark.parametrize(
    ("period", "ticks", "mode", "cycle", "unit"),
    [
        (0.01, 10, "0x62u", 10, 6),
        (0.0025, 25, "0x52u", 25, 5),  # units of 100 us
        (0.01225, 1225, "0x42u", 0, 6),  # units of 10 us; exceeds the byte of the event's cycle
    ],
)
def test_the_period_in_the_program(period: float, ticks: int, mode: str, cycle: int, unit: int) -> None:
    tables = {"controller": {"sampling_time_s": period}, "plant": {"sampling_time_s": 0.00025}}
    config = car(tables)
    timing = xcp_timing(config)
    printed = f"{hexadecimal(timing.timestamp_mode, 2)}u"
    assert (timing.timestamp_ticks, printed, timing.event_cycle, timing.event_unit) == (ticks, mode, cycle, unit)


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("-no-pie",), "the calibration has no section of its own; compile as the head of ars_xcp.h says"),
        (("-fPIE", "-pie", ecu_process.section_flag("ars")), "the addresses do not fit the 32 bits of XCP; link with -no-pie"),
    ],
    ids=["no section", "PIE"],
)
def test_a_program_that_cannot_be_calibrated_is_refused(tmp_path: Path, flags: tuple[str, ...], message: str) -> None:
    sources = [*BUILD.glob("src/*.c"), *BUILD.glob("linux/*.c")]
    command = [*compiler_command(), "-std=c99", "-O0", *flags, "-Iinclude", *sources, "-o", tmp_path / "ecu", "-lm"]
    subprocess.run(command, cwd=BUILD, check=True)
    result = subprocess.run([tmp_path / "ecu", "--xcp", "vcan0"], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (2, "", f"error: --xcp: {message}\n")


def test_builds_and_ecus_without_a_slave_are_refused(tmp_path: Path) -> None:
    folder = Path(shutil.copytree(BUILD, tmp_path / "build"))
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"linux/ars_xcp.c"', '"linux/other.c"'))
    (folder / "linux" / "ars_xcp.c").rename(folder / "linux" / "other.c")
    with pytest.raises(BuildError, match=r"the build has no linux/ars_xcp\.c; build again"):
        ecu_process.command(folder, "vcan0", xcp=True)
    with pytest.raises(CodegenError, match=r"^`xcp=True`: only the native ECU has XCP, not cffi; use `ecu='native'`$"):
        check_xcp("cffi", xcp=True)


def test_random_packets_keep_every_invariant(program: Path) -> None:
    """Every error occurs, every command except three rare ones succeeds, and measurement lists run."""
    seen, measured = run_random_packets(program, 6_000)
    assert {*COMMANDS, *ERRORS.values()} - set(seen) <= {"SYNCH", "GET_CAL_PAGE", "SHORT_UPLOAD"}
    assert measured > 100
