"""FMUs of the other kind and scenario, of another configuration, and under a misbehaving simulator."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from codegen.emit.from_files import prepare
from codegen.emit.write import write_folder
from codegen.export.fmu.export import make_fmu
from codegen.export.fmu.variables import Version, What
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.software import load
from codegen.sil.toolchain import compiler_command
from tests.export import fmus, test_fmu_bus
from tests.export.test_fmu_file import RECORD_ORDER
from tests.export.test_fmu_states import misuse
from tests.whole_car import car_toml


@pytest.mark.long
@pytest.mark.parametrize("version", ["2", "3"])
def test_misuse_under_sanitizers(version: Version, tmp_path: Path) -> None:
    answer = misuse(version, tmp_path, "-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1")
    assert answer.returncode == 0, answer.stderr


@pytest.mark.long
@pytest.mark.parametrize("kind", ["pi", "tracking", "FD, 24 bytes, profile 11C, 29 bits", "FD, 64 bytes, profile 5"])
def test_nodes_on_a_bus_in_another_scenario(kind: str) -> None:
    test_fmu_bus.check_run(kind, "step-steer", 500e3, 0.006, True)


@pytest.mark.long
@pytest.mark.parametrize("kind", ["tracking", "FD, 12 bytes, profile 5"])
@pytest.mark.parametrize(("what", "is_clocked"), [("ecu", False), ("ecu", True), ("bus_plant", False)])
def test_random_operations_from_the_bus_under_sanitizers(what: What, is_clocked: bool, kind: str, tmp_path: Path) -> None:
    known, program = fmus.made(what, "3", kind), tmp_path / "flood"
    number = {each.name: str(each.valueReference) for each in known.description.modelVariables}
    flags = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g", "-O1", "-std=c99", "-Wall", "-Werror", "-I.")
    sources = [*fmus.listed_sources(known), fmus.ROOT / "tests" / "export" / "flood.c"]
    command = [*compiler_command(), *flags, *sources, "-o", program, "-lm"]
    subprocess.run(command, cwd=known.folder / "sources", check=True)
    names = ("CanChannel.Rx_Clock", "CanChannel.BusNotifications", *(("task_is_clocked", "task_clock") if is_clocked else ()))
    arguments = [program, known.fmu.token, *(number[name] for name in names)]
    answer = subprocess.run(arguments, capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stderr


@pytest.mark.long
def test_another_configuration(tmp_path: Path) -> None:
    """Double precision, another prefix, tyres with a relaxation length, and a command delayed by two samples."""
    settings, build = tmp_path / "ars.toml", tmp_path / "build"
    plant = "[plant]\ncommand_delay_samples = 2\nrelaxation_length_m = 0.3\n"
    settings.write_text(car_toml(f'[controller]\nkind = "pi"\n{plant}'), encoding="utf-8")
    write_folder(prepare(fmus.ROOT / "generated" / "4ws2-paper.npz", settings, build, "rear", "double").folder, build)
    known = fmus.unpacked(tmp_path / "fmu", "other", make_fmu(build, "loop", "3"))
    assert validate_fmu(str(known.path)) == []
    slave = fmus.Slave(known).start()
    rows = fmus.inputs("pi", "sine-with-dwell")
    wanted = ClosedLoop(load(build)).run(rows)
    assert np.array_equal(fmus.drive(slave, rows, fmus.STEP), wanted[:, RECORD_ORDER])
    assert not np.array_equal(wanted, fmus.recorded("pi", "sine-with-dwell"))
