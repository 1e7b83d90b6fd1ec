"""XCP on real SocketCAN: pyxcp as the master of the native ECU, the car in the loop, against the same task in this process."""

from __future__ import annotations

import logging
import math
import os
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest
from pyxcp.config import PyXCP, create_application_from_config, reset_application, set_application
from pyxcp.cpp_ext.cpp_ext import DaqList
from pyxcp.daq_stim import DaqOnlinePolicy
from pyxcp.master import Master
from pyxcp.types import Command, XcpResponseError, XcpTimeoutError

from codegen.emit.write import write_folder
from codegen.sil.software import RECORD_COLUMNS, Software, Status, load
from hil_sim import manoeuvres, native
from hil_sim.bench import Cycle
from hil_sim.bus import Bus, BusAddress
from hil_sim.codec import Codec, RearSteerCommand
from hil_sim.ecu_process import EcuProcess
from hil_sim.frames import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.runs import run_through_can
from hil_sim.scenarios import Scenario, find
from hil_sim.session import Setup, run_plant
from tests import builds
from tests.xcp.elf import Program

pytestmark = pytest.mark.vcan

CAN = builds.CONFIG.can
PATIENCE = 10.0
"""s: far longer than anything here takes; only a failure waits so long."""
GAIN = "ars_parameters_default.proportional_gain"
MEASURED = {
    "yaw_rate_reference": ("ecu.task.controller.yaw_rate_reference", "F32"),
    "integral": ("ecu.task.controller.integral", "F32"),
    "rear_angle": ("ecu.task.controller.rear_angle", "F32"),
    "status": ("ecu.task.controller.status", "U32"),
}
CHANGED_AT = 130
"""Cycle, in the turn-in of the scenario."""
STRONGER = 0.2
"""s; twenty times the preset's gain."""
Hook = Callable[[int], None]
KEPT: list[Any] = []
"""What pyxcp's listening thread may still call into from C++ when a session ends: it lives as long as this process."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    at = tmp_path_factory.mktemp("build") / "4ws2"
    write_folder(builds.render(builds.paper_map(), builds.CONFIG), at)
    return at


@pytest.fixture(scope="module")
def software(folder: Path) -> Software:
    return load(folder)


@pytest.fixture(scope="module")
def program(folder: Path) -> Program:
    """What lies where in the native ECU."""
    return Program(native.compile_ecu(folder))


@pytest.fixture
def ecu(folder: Path, vcan: str) -> Iterator[EcuProcess]:
    """In lock-step."""
    with EcuProcess(native.command(folder, vcan, lock_step=True, parent=os.getpid(), xcp=True)) as ecu:
        yield ecu


def short(duration: float = 2.0) -> Scenario:
    """A turn-in after a second."""
    return replace(find("step-steer"), duration=duration, steer_time=1.0, drive=manoeuvres.step(1.0))


class Rows(DaqOnlinePolicy):  # type: ignore[misc]
    """The values of one list of measurements, run by run, as pyxcp decodes them."""

    def __init__(self, program: Program) -> None:
        measured = [(name, program.place(path).address, 0, kind) for name, (path, kind) in MEASURED.items()]
        super().__init__([DaqList("task", 0, False, True, measured, 0, 1)])
        self.rows: list[dict[str, Any]] = []
        self.stamps: list[int] = []
        self._came = threading.Condition()

    def initialize(self) -> None:
        """Nothing is written anywhere."""

    def finalize(self) -> None:
        """Nothing was."""

    def on_daq_list(self, _number: int, _received: int, stamp: int, values: list[Any]) -> None:
        """A sample came."""
        names = [header[0] for header in self.daq_lists[0].headers]
        with self._came:
            self.rows.append(dict(zip(names, values, strict=True)))
            self.stamps.append(stamp)
            self._came.notify_all()

    def wait_for(self, count: int) -> None:
        """Until so many samples came."""
        with self._came:
            assert self._came.wait_for(lambda: len(self.rows) >= count, PATIENCE), f"{len(self.rows)} of {count} samples came"


def application(interface: str) -> PyXCP:
    """pyxcp's settings, without a file."""
    settings = {
        "interface": "socketcan",
        "channel": interface,
        "can_id_master": CAN.xcp_receive_id,
        "can_id_slave": CAN.xcp_transmit_id,
    }
    made = create_application_from_config({"Transport": {"CAN": settings}}, log_level=logging.WARNING)
    made.transport.layer = "CAN"
    made.general.disable_error_handling = True  # an error is what the slave said, not a reason to try again
    return made


@contextmanager
def connected(interface: str, policy: Any = None) -> Iterator[Master]:
    """A master with a session."""
    with Master("can", config=application(interface), policy=policy) as master:
        KEPT.extend((master, policy))
        master.connect()
        yield master
        master.disconnect()


@pytest.fixture(autouse=True)
def settings(vcan: str) -> Iterator[None]:
    """Of this process: what pyxcp's lists of measurements ask for."""
    set_application(application(vcan))
    yield
    reset_application()


def read(master: Master, program: Program, name: str) -> bytes:
    place = program.place(name)
    return bytes(master.shortUpload(place.size, place.address))


def write(master: Master, address: int, data: bytes) -> None:
    master.setMta(address)
    master.download(data)


def number(value: float) -> bytes:
    return struct.pack("<f", value)


def refused(call: Callable[..., Any], *arguments: Any) -> str:
    """The name of the error that the slave answers."""
    with pytest.raises(XcpResponseError) as caught:
        call(*arguments)
    return str(caught.value.get_error_code())


@dataclass
class Drive:
    """The frames of an ECU in the loop, and what its task held after each run where that can be seen."""

    frames: list[Frame] = field(default_factory=list)
    states: list[dict[str, Any]] = field(default_factory=list)

    def commands(self) -> list[RearSteerCommand]:
        decoded = [Codec(CAN).decode(frame.id, frame.data) for frame in self.frames]
        assert all(isinstance(command, RearSteerCommand) for command in decoded)
        return [command for command in decoded if isinstance(command, RearSteerCommand)]


def simulated(software: Software, scenario: Scenario, gain: float | None = None) -> Drive:
    """The task in this process; with another gain from `CHANGED_AT` on."""
    drive, node, parameters = Drive(), PlantNode(software.config, scenario), software.parameters()
    task = software.task(parameters)
    for cycle in range(node.cycles):
        if cycle == CHANGED_AT and gain is not None:
            parameters.proportional_gain = gain
        for frame in node.outgoing(cycle):
            task.on_can_frame(frame.id, frame.data)
        drive.frames.append(Frame(*task.run()))
        node.receive(drive.frames[-1])
        node.finish(cycle)
        state = task.state.controller
        drive.states.append({name: getattr(state, name) for name in MEASURED})
    return drive


def driven(interface: str, software: Software, scenario: Scenario, before: Hook = lambda cycle: None) -> Drive:
    """The ECU on the bus, in lock-step; `before` each cycle anything may be done."""
    drive, node = Drive(), PlantNode(software.config, scenario)
    with Bus(BusAddress("socketcan", interface)) as bus:
        for cycle in range(node.cycles):
            before(cycle)
            for frame in node.outgoing(cycle):
                assert bus.send(frame)
            drive.frames.append(next(frame for frame in iter(lambda: bus.receive(PATIENCE), None) if node.receive(frame)))
            node.finish(cycle)
    return drive


# --- measuring -----------------------------------------------------------------------------------------------------


def test_a_measurement_is_what_the_ecu_sent(vcan: str, ecu: EcuProcess, software: Software, program: Program) -> None:
    seen: list[float] = []
    with connected(vcan) as master:
        path = MEASURED["yaw_rate_reference"][0]
        drive = driven(vcan, software, short(), lambda cycle: seen.append(*struct.unpack("<f", read(master, program, path))))
        seen.append(*struct.unpack("<f", read(master, program, path)))
    sent = [command.yaw_rate_reference for command in drive.commands()]
    # Half a step of the signal; a tenth of a thousandth more for the rounding of single precision.
    step = CAN.rear_steer_command.yaw_rate_reference.factor
    assert max(abs(value - other) for value, other in zip(seen[1:], sent, strict=True)) <= 0.5001 * step
    assert max(sent) > 0.1  # rad/s: it turned
    assert ecu.alive


def test_a_list_holds_each_run_of_the_task(vcan: str, ecu: EcuProcess, software: Software, program: Program) -> None:
    rows = Rows(program)
    with connected(vcan, rows) as master:
        rows.setup()
        rows.start()
        drive = driven(vcan, software, short(), rows.wait_for)
        rows.wait_for(len(drive.frames))
        rows.stop()
        assert driven(vcan, software, short(0.05)).frames
        assert bytes(master.shortUpload(4, program.place(MEASURED["status"][0]).address))
    expected = simulated(software, short())
    assert max(state["yaw_rate_reference"] for state in expected.states) > 0.1
    assert drive.frames == expected.frames
    assert rows.rows == expected.states  # bit for bit: no number is NaN
    assert {later - earlier for earlier, later in pairwise(rows.stamps)} == {10_000_000}  # ns
    step = CAN.rear_steer_command
    for row, command in zip(rows.rows, drive.commands(), strict=True):
        assert row["status"] == command.status
        assert abs(row["rear_angle"] - command.rear_angle) <= 0.5001 * step.rear_angle.factor
        assert abs(row["yaw_rate_reference"] - command.yaw_rate_reference) <= 0.5001 * step.yaw_rate_reference.factor
    assert ecu.alive


def test_checksum_and_identification(vcan: str, ecu: EcuProcess, program: Program) -> None:
    with connected(vcan) as master:
        assert [master.identifier(kind) for kind in (0, 1)] == ["sample", "ars"]  # the build; its A2L
        segment = master.getSegmentInfo(0, 0, 0, 0).basicInfo, master.getSegmentInfo(0, 0, 1, 0).basicInfo
        master.setMta(segment[0])
        told = master.buildChecksum(segment[1])
        assert master.verify(segment[0], segment[1])
        place = program.place("ars_parameters_default")
        assert segment[0] <= place.address <= segment[0] + segment[1] - place.size
        assert told.checksumType == "XCP_CRC_32"
    assert ecu.alive


# --- calibrating ---------------------------------------------------------------------------------------------------


def test_a_gain_changed_in_the_loop_changes_the_response(
    vcan: str, ecu: EcuProcess, software: Software, program: Program
) -> None:
    """And the frames are those of the task in this process with that gain from that sample on, bit for bit."""
    with connected(vcan) as master:
        gain = program.place(GAIN)

        def change(cycle: int) -> None:
            if cycle == CHANGED_AT:
                write(master, gain.address, number(STRONGER))

        changed = driven(vcan, software, short(), change).frames
        assert read(master, program, GAIN) == number(STRONGER)
    unchanged = simulated(software, short()).frames
    assert changed[:CHANGED_AT] == unchanged[:CHANGED_AT]
    assert changed[CHANGED_AT] != unchanged[CHANGED_AT]
    assert changed == simulated(software, short(), gain=STRONGER).frames
    assert ecu.alive


def test_pages_are_switched_in_the_loop(vcan: str, ecu: EcuProcess, software: Software, program: Program) -> None:
    """The working page is edited beside, taken over at one sample, and left again."""
    with connected(vcan) as master:

        def switch(cycle: int) -> None:
            if cycle == 0:
                master.setCalPage(1, 0, 1)
            if cycle == 50:
                write(master, program.place(GAIN).address, number(math.nan))
                assert "PAGE_NOT_VALID" in refused(master.setCalPage, 1, 0, 0)
                write(master, program.place(GAIN).address, number(STRONGER))
            if cycle == CHANGED_AT:
                master.setCalPage(1, 0, 0)

        assert driven(vcan, software, short(), switch).frames == simulated(software, short(), gain=STRONGER).frames
        master.setCalPage(3, 0, 1)
        assert read(master, program, GAIN) == number(software.parameters().proportional_gain)
    assert ecu.alive


def test_what_is_refused(vcan: str, ecu: EcuProcess, software: Software, program: Program) -> None:
    """While the loop runs, which goes on as if nobody had asked."""
    speeds = program.place("ars_map_speed_breakpoints[3]").address
    reference = program.place(MEASURED["yaw_rate_reference"][0]).address
    whole = program.place("ars_map_yaw_rate_table")
    names: list[str] = []
    with connected(vcan) as master:
        highest = bytes(master.shortUpload(4, speeds + 4))

        def ask(cycle: int) -> None:
            if cycle == CHANGED_AT:
                gain = program.place(GAIN).address
                names.append(refused(write, master, gain, number(math.nan)))
                names.append(refused(write, master, gain, number(1e6)))
                names.append(refused(write, master, speeds, highest))
                names.append(refused(write, master, 0x1000, number(1.0)))
                names.append(refused(write, master, reference, number(1.0)))
                names.append(refused(master.shortUpload, 4, 0x1000))
                names.append(refused(master.transport.request, Command.USER_CMD, 1))
                names.append(refused(master.setCalPage, 3, 0, 2))

        frames = driven(vcan, software, short(), ask).frames
        assert read(master, program, GAIN) == number(software.parameters().proportional_gain)
        assert bytes(master.shortUpload(4, whole.address)) == number(0.0)
    wanted = ("OUT_OF_RANGE",) * 3 + ("ACCESS_DENIED", "WRITE_PROTECTED", "ACCESS_DENIED", "CMD_UNKNOWN", "PAGE_NOT_VALID")
    assert [name.rpartition("ERR_")[2] for name in names] == list(wanted)
    assert frames == simulated(software, short()).frames
    assert ecu.alive


# --- the task is not disturbed -------------------------------------------------------------------------------------


@pytest.mark.parametrize("how", ["without", "not connected", "idle"])
def test_the_frames_stay_the_same(vcan: str, folder: Path, software: Software, how: str) -> None:
    command = native.command(folder, vcan, lock_step=True, parent=os.getpid(), xcp=how != "without")
    with EcuProcess(command) as ecu:
        if how == "idle":
            with connected(vcan):
                frames = driven(vcan, software, short()).frames
        else:
            frames = driven(vcan, software, short()).frames
        counts = native.counters(ecu.stop())
    assert frames == simulated(software, short()).frames
    assert counts.get("lost_packets", 0) == 0
    assert ("lost_packets" in counts) == (how != "without")


def test_by_the_clock_measured_and_not_disturbed(vcan: str, folder: Path, software: Software, program: Program) -> None:
    """Behind each command lies the list's sample of the same run; and where each command is in time, the run is the one of
    lock-step (as that of an ECU without XCP, see test_bench.py)."""
    seen: list[can.Message] = []
    rows, scenario, address = Rows(program), short(), BusAddress("socketcan", vcan)
    wanted = run_through_can(software, scenario).record
    ids = (CAN.rear_steer_command.id, CAN.xcp_transmit_id)
    filters = [{"can_id": identifier, "can_mask": 0x7FF, "extended": False} for identifier in ids]

    def listen(_cycle: Cycle | None = None) -> None:
        seen.extend(iter(lambda: listener.recv(0.0), None))

    with (
        EcuProcess(native.command(folder, vcan, parent=os.getpid(), xcp=True)) as ecu,
        can.Bus(interface="socketcan", channel=vcan, can_filters=filters) as listener,
    ):
        with connected(vcan, rows) as master:
            rows.setup()
            rows.start()
            result = run_plant(Setup(software.config, scenario, address), ecu, listen)
            rows.stop()
            assert not master.getStatus().sessionStatus.daqRunning
        listen()
        counters = native.counters(ecu.stop())
    assert (result.send_errors, counters["send_errors"], counters["lost_packets"]) == (0, 0, 0)
    sent = [message.data[1] & 0xF for message in seen if message.arbitration_id == ids[0]]
    assert {(later - earlier) % 15 for earlier, later in pairwise(sent)} == {1}  # the counters of E2E: none is left out
    samples = [k for k, message in enumerate(seen) if message.arbitration_id == ids[1] and message.data[0] == 0]
    assert len(samples) == len(rows.rows) > 150
    codec, step = Codec(CAN), CAN.rear_steer_command.rear_angle.factor
    for row, k in zip(rows.rows, samples, strict=True):
        command = codec.decode(seen[k - 1].arbitration_id, bytes(seen[k - 1].data))
        assert isinstance(command, RearSteerCommand)
        assert command.status == row["status"]
        assert math.isnan(command.rear_angle) or abs(command.rear_angle - row["rear_angle"]) <= 0.5001 * step
    answered = np.isfinite(result.response) & (result.diagnostics == 0)
    in_control = result.record[:, RECORD_COLUMNS.index("status")] <= Status.LIMITED  # before the car came, it was fail-safe
    first = int(np.argmax(answered & in_control))
    late = np.flatnonzero(~answered[first:])
    end = first + int(late[0]) if late.size else len(answered)
    if answered[first] and first < 90:  # before the driver steers: the states of both runs are the same
        assert np.array_equal(result.record[first:end], wanted[first:end])


# --- without it ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("xcp", [False, True])
def test_without_it_nobody_answers_and_nothing_can_be_written(vcan: str, folder: Path, program: Program, xcp: bool) -> None:
    command = native.command(folder, vcan, lock_step=True, parent=os.getpid(), xcp=xcp)
    with EcuProcess(command) as ecu, Master("can", config=application(vcan)) as master:
        master.transport.timeout = int((PATIENCE if xcp else 0.2) * 1e9)
        if xcp:
            master.connect()
        else:
            with pytest.raises(XcpTimeoutError):
                master.connect()
        assert _access(ecu, program.place(GAIN).address) == ("rw-p" if xcp else "r--p")
        assert ecu.alive


def _access(ecu: EcuProcess, address: int) -> str:
    """What a process may do with its memory there: proc(5), maps."""
    assert ecu._process is not None
    for line in Path(f"/proc/{ecu._process.pid}/maps").read_text().splitlines():
        span, access = line.split()[:2]
        low, high = (int(end, 16) for end in span.split("-"))
        if low <= address < high:
            return access
    raise AssertionError("no memory there")
