"""Frames with 29-bit identifiers in C, DBC and bench, as other tools see them."""

import functools
import subprocess
from pathlib import Path

import cantools
import numpy as np

from codegen.configuration import Config, parse
from codegen.emit.write import write_folder
from codegen.sil.toolchain import compiler_command
from hil_sim.bench import run_through_can
from hil_sim.codec import Frame, frame_of, is_configured
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import find
from tests import builds
from tests.test_config import refused

IDS = {"vehicle_motion": 0x18FF0101, "vehicle_conditions": 0x102, "rear_steer_command": 0x1FFFFFFF}
"""Identifiers of 29 bits; one of them would fit into 11."""
EXTENDED = {"extended_ids": True, **{role: {"id": number, "data_id": number & 0x7FF} for role, number in IDS.items()}}


@functools.cache
def built() -> builds.Built:
    """Return the paper's build with 29-bit identifiers."""
    can = parse({"can": EXTENDED}, "test").can
    return builds.make(builds.paper_map(), builds.CONFIG.model_copy(update={"can": can}))


def test_dbc_and_c_have_the_identifiers() -> None:
    database = cantools.database.load_string(built().folder.files["ars.dbc"].decode())
    assert {message.frame_id for message in database.messages} == set(IDS.values())
    assert all(message.is_extended_frame for message in database.messages)
    assert database.get_message_by_name("VehicleMotion").comment is not None
    identifier, _ = built().software.task().run()
    assert identifier == IDS["rear_steer_command"]
    header = built().folder.files["include/ars_task.h"].decode()
    assert "Pass only classical data frames with 29-bit identifiers" in header


def test_bench_sends_and_accepts_only_29_bit_identifiers() -> None:
    config: Config = built().software.config
    node = PlantNode(config, find("step-steer"))
    frames = node.outgoing(0)
    assert [(frame.id, frame.extended) for frame in frames] == [
        (IDS["vehicle_motion"], True),
        (IDS["vehicle_conditions"], True),
    ]
    command = frame_of(config.can, *built().software.task().run())
    assert is_configured(config.can, command) and node.receive(command)
    assert not node.receive(Frame(command.id, command.data))


def test_a_run_through_frames_is_that_of_the_default_frames() -> None:
    here, there = (run_through_can(one.software, find("step-steer")) for one in (built(), builds.paper()))
    np.testing.assert_array_equal(here.record, there.record)


def test_native_ecu_compiles_under_strict_warnings(tmp_path: Path) -> None:
    folder = tmp_path / "build"
    write_folder(built().folder, folder)
    flags = [
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wpedantic",
        "-Wconversion",
        "-Wsign-conversion",
        "-Wshadow",
        "-Werror",
        "-O1",
        "-Iinclude",
    ]
    for unit in ("linux/ars_ecu.c", "src/ars_can.c"):
        command = [*compiler_command(), *flags, "-c", unit, "-o", str(tmp_path / "unit.o")]
        result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert (result.returncode, result.stderr) == (0, "")


def test_identifiers_that_do_not_fit_are_rejected() -> None:
    motion = {"vehicle_motion": {"id": 0x18FF0101, "data_id": 1}}
    assert "VehicleMotion has the id 0x18FF0101; give at most 0x7FF, or set extended_ids = true" in refused({"can": motion})
    assert "can.vehicle_motion.id" in refused({"can": {"extended_ids": True, "vehicle_motion": {"id": 0x20000000}}})
    only_id = {"extended_ids": True, "vehicle_motion": {"id": 0x18FF0101}}
    assert "VehicleMotion has the data id 0x18FF0101; E2E profile 1, variant 1A needs a data_id" in refused({"can": only_id})
