"""29-bit identifiers and frames of CAN FD in C, DBC and bench, as other tools see them."""

import re
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cantools
import numpy as np
import pytest

from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.sil.toolchain import compiler_command
from hil_sim import bus, ecu_process
from hil_sim.bench import run_through_can
from hil_sim.bus import Bus, BusAddress
from hil_sim.codec import Codec, Frame, VehicleMotion, frame_of, is_configured
from hil_sim.e2e import protect
from hil_sim.plant_node import PlantNode
from hil_sim.scenario_files import find
from tests import builds
from tests.frame_kinds import FD, IDS, KINDS, built, folder
from tests.sil.e2e_profiles import check_start_values
from tests.test_config import refused
from tests.whole_car import car


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


@pytest.mark.parametrize("name", KINDS)
def test_a_run_through_frames_is_that_of_the_default_frames(name: str) -> None:
    here, there = (run_through_can(one.software, find("step-steer")) for one in (built(name), builds.paper()))
    np.testing.assert_array_equal(here.record, there.record)


@pytest.mark.parametrize("name", KINDS)
def test_dbc_and_python_have_the_same_frames(name: str) -> None:
    software = built(name).software
    can, codec = software.config.can, Codec(software.config.can)
    database = cantools.database.load_string(built(name).folder.files["ars.dbc"].decode())
    for message in database.messages:
        assert (message.length, message.is_fd) == (can.frame_bytes, can.is_fd)
        assert message.dbc.attributes["CANFD_BRS"].value == 1 if can.is_fd else "CANFD_BRS" not in message.dbc.attributes
    check_start_values(can, built(name).folder.files["ars.dbc"])
    motion = VehicleMotion(12.5, 0.05, -0.25)
    data = protect(can.vehicle_motion.e2e_data_id, 3, codec.encode(motion), can.e2e.definition)
    found = database.decode_message(can.vehicle_motion.id, data)
    assert [found[key] for key in ("Speed", "FrontAngle", "YawRate")] == pytest.approx([12.5, 0.05, -0.25])


def test_bit_rates_of_all_descriptions_are_whole_numbers() -> None:
    """In bit/s, where a DBC, an A2L and an ARXML can state whole numbers only."""
    can = car({"can": {"bitrate_kbit_s": 83.33333, "data_bitrate_kbit_s": 666.66667}}).can
    files = builds.render(builds.paper_map(), builds.CONFIG.model_copy(update={"can": can})).files
    attributes = cantools.database.load_string(files["ars.dbc"].decode()).dbc.attributes
    assert (attributes["Baudrate"].value, attributes["BaudrateCANFD"].value) == (83_333, 666_667)
    assert "BAUDRATE 83333\n" in files["ars.a2l"].decode()


@pytest.mark.parametrize("name", KINDS)
def test_receiver_and_supervision(name: str) -> None:
    frame_bytes, task = built(name).software.config.can.frame_bytes, built(name).software.task()
    (identifier, data), config = task.run(), built(name).software.config
    assert (identifier, len(data)) == (config.can.rear_steer_command.id, frame_bytes)
    assert built(name).software.function("selftest")()


def test_bus_carries_frames_of_can_fd() -> None:
    software = built("FD, 12 bytes, profile 5").software
    address = BusAddress("virtual", "frame kinds")
    with Bus(address, software.config.can) as sender, Bus(address, software.config.can) as receiver:
        sent = frame_of(software.config.can, *software.task().run())
        assert sender.send(sent)
        found = receiver.receive(5.0)
    assert found == sent and found.fd and len(found.data) == 12
    assert not PlantNode(software.config, find("step-steer")).receive(replace(found, fd=False))


def test_an_interface_of_classical_can_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus, "NETWORK", tmp_path)
    (tmp_path / "can9").mkdir()
    (tmp_path / "can9" / "mtu").write_text("16\n")
    for start in (
        lambda: ecu_process.command(folder("FD, 8 bytes"), "can9"),
        lambda: Bus(BusAddress("socketcan", "can9"), built("FD, 8 bytes").software.config.can),
    ):
        with pytest.raises(CodegenError, match=r"^can9: the interface carries no frames of CAN FD; set its MTU to 72"):
            start()
    (tmp_path / "can9" / "mtu").write_text("72\n")
    bus.require_fd("can9")
    bus.require_fd("can10")  # not there: reported when it is opened


@pytest.mark.parametrize("name", KINDS)
def test_native_ecu_compiles_under_strict_warnings(name: str, tmp_path: Path) -> None:
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
        result = subprocess.run(command, cwd=folder(name), capture_output=True, text=True, check=False)
        assert (result.returncode, result.stderr) == (0, "")


def test_examples_of_the_guide_are_valid() -> None:
    page = (Path(__file__).parents[2] / "docs" / "own-can-ids.md").read_text(encoding="utf-8")
    examples = [car(tomllib.loads(text)).can for text in re.findall(r"```toml\n(.*?)```", page, re.DOTALL)]
    assert {(can.extended_ids, can.frame_bytes, can.e2e.profile) for can in examples} == {
        (False, 8, "1A"),
        (True, 8, "1A"),
        (False, 8, "2"),
        (False, 64, "5"),
    }


def test_identifiers_that_do_not_fit_are_rejected() -> None:
    motion = {"vehicle_motion": {"id": 0x18FF0101, "data_id": 1}}
    assert "VehicleMotion has the id 0x18FF0101; give at most 0x7FF, or set extended_ids = true" in refused({"can": motion})
    assert "can.vehicle_motion.id" in refused({"can": {"extended_ids": True, "vehicle_motion": {"id": 0x20000000}}})
    only_id = {"extended_ids": True, "vehicle_motion": {"id": 0x18FF0101}}
    assert "VehicleMotion has the data id 0x18FF0101; E2E profile 1, variant 1A needs a data_id" in refused({"can": only_id})


@pytest.mark.parametrize(
    ("can", "words"),
    [
        ({"frame_bytes": 12}, "frame_bytes is 12 without CAN FD; give data_bitrate_kbit_s, or 8 bytes"),
        ({**FD, "frame_bytes": 13}, "can.frame_bytes"),
        ({**FD, "bitrate_kbit_s": 1000.0, "data_bitrate_kbit_s": 999.0}, "is 999, below the bit rate of 1000; raise it"),
        ({**FD, "frame_bytes": 32}, "E2E profile 1, variant 1A protects up to 30 bytes; give fewer, or another profile"),
        ({**FD, "vehicle_motion": {"speed": {"start_bit": 90}}}, "Speed reaches beyond the 12 bytes of its frame"),
    ],
)
def test_frames_that_do_not_fit_are_rejected(can: dict[str, Any], words: str) -> None:
    assert words in refused({"can": can})
