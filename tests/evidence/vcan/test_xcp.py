"""XCP on SocketCAN: pyxcp, configured from the A2L alone, measures and calibrates the native ECU in the loop.

The A2L is read by pya2l. The reference is the same task in this process.
"""

import binascii
import functools
import logging
import math
import os
import struct
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
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
from pyxcp.types import XcpTimeoutError

from codegen.export.a2l import fill
from codegen.export.elf import Elf
from codegen.sil.software import Software, Status
from hil_sim import ecu_process, manoeuvres
from hil_sim.bench import Cycle, run_through_can
from hil_sim.bus import Bus, BusAddress
from hil_sim.codec import Codec, Frame, RearSteerCommand
from hil_sim.ecu_process import EcuProcess
from hil_sim.metrics import column
from hil_sim.plant_node import PlantNode
from hil_sim.scenario_files import find
from hil_sim.session import Setup, run_plant
from tests import builds, frame_kinds
from tests.evidence.vcan.conftest import FOLDER
from tests.xcp.description import Description

CAN = builds.CONFIG.can
TIMEOUT_S = 10.0
"""Timeout in s; only a failure waits this long."""
GAIN = "ars.parameters.proportional_gain"
KINDS = {"B": "U8", "H": "U16", "I": "U32", "f": "F32"}
"""Types of pyxcp by those of `struct`."""
CHANGED_AT = 130
"""Cycle, in the turn-in of the scenario."""
STRONGER = 0.2
"""s; twenty times the preset's gain."""
KEEP_ALIVE: list[Any] = []
"""Objects that pyxcp's listening thread may still call from C++ after a session; they live until the process ends."""


@pytest.fixture(scope="module")
def folder(request: pytest.FixtureRequest) -> Path:
    """Return the committed build, or one with XCP in frames of CAN FD and 29-bit identifiers."""
    return frame_kinds.xcp_folder() if getattr(request, "param", "") == "FD" else FOLDER


both_kinds = pytest.mark.parametrize("folder", ["classical", "FD"], indirect=True)


@pytest.fixture(scope="module")
def a2l(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Description:
    """Return the A2L of the native ECU, as `codegen a2l` writes it."""
    path = tmp_path_factory.mktemp("a2l") / "ecu.a2l"
    path.write_text(fill(folder, Elf.read(ecu_process.compile_ecu(folder))).text, encoding="ascii")
    return Description.read(path)


@pytest.fixture
def ecu(vcan: str, folder: Path) -> Iterator[EcuProcess]:
    """Start an ECU in lock-step; it must still run after the test."""
    with EcuProcess(ecu_process.command(folder, vcan, lock_step=True, parent=os.getpid(), xcp=True)) as ecu:
        yield ecu
        assert ecu.alive


SHORT = replace(find("step-steer"), duration=2.0, steer_time=1.0, drive=manoeuvres.step(1.0))
"""Turn-in after one second."""


class Rows(DaqOnlinePolicy):  # type: ignore[misc]
    """Values of all measurements of the A2L in a list at their default event, run by run, as decoded by pyxcp."""

    def __init__(self, a2l: Description) -> None:
        measured = [(name, each.address, 0, KINDS[each.format]) for name, each in a2l.measured.items()]
        (event,) = {each.event for each in a2l.measured.values()}
        super().__init__([DaqList("task", event, False, True, measured, 0, 1)])
        self.rows: list[dict[str, Any]] = []
        self.stamps: list[int] = []
        self._came = threading.Condition()

    def initialize(self) -> None: ...

    def finalize(self) -> None: ...

    def on_daq_list(self, _number: int, _received: int, stamp: int, values: list[Any]) -> None:
        """Keep a sample."""
        names = [header[0] for header in self.daq_lists[0].headers]
        with self._came:
            self.rows.append(dict(zip(names, values, strict=True)))
            self.stamps.append(stamp)
            self._came.notify_all()

    def wait_for(self, count: int) -> None:
        """Wait until `count` samples have arrived."""
        with self._came:
            assert self._came.wait_for(lambda: len(self.rows) >= count, TIMEOUT_S), f"{len(self.rows)} of {count} samples came"


def application(interface: str, a2l: Description) -> PyXCP:
    """pyxcp's settings, without a file."""
    settings = {"interface": "socketcan", "channel": interface, **a2l.bus}
    made = create_application_from_config({"Transport": {"CAN": settings}}, log_level=logging.WARNING)
    made.transport.layer = "CAN"
    made.general.disable_error_handling = True  # no retries: an error is a valid response
    return made


@contextmanager
def connected(interface: str, a2l: Description, policy: Any = None) -> Iterator[Master]:
    """Provide a master with a session."""
    with Master("can", config=application(interface, a2l), policy=policy) as master:
        KEEP_ALIVE.extend((master, policy))
        master.connect()
        yield master
        master.disconnect()


@pytest.fixture(autouse=True)
def settings(vcan: str, a2l: Description) -> Iterator[None]:
    """Set pyxcp's settings of this process, which its measurement lists read."""
    set_application(application(vcan, a2l))
    yield
    reset_application()


def read(master: Master, a2l: Description, address: int, kind: str) -> Any:
    """Return a number in the memory of the ECU; `kind` is its type in the notation of `struct`."""
    return struct.unpack(a2l.order + kind, bytes(master.shortUpload(struct.calcsize(kind), address)))[0]


def access(ecu: EcuProcess, address: int) -> str:
    """Return the access rights of a process to its memory at an address: proc(5), maps."""
    for line in Path(f"/proc/{ecu._process.pid}/maps").read_text().splitlines():
        span, rights = line.split()[:2]
        low, high = (int(end, 16) for end in span.split("-"))
        if low <= address < high:
            return rights
    raise AssertionError("no memory there")


def simulate(
    software: Software, gain: float | None = None, measured: Mapping[str, str] | None = None
) -> tuple[list[Frame], list[dict[str, Any]]]:
    """Run the task in this process, with another gain from `CHANGED_AT` on.

    Args:
        measured: paths in the task by the name of the measurement.

    Returns:
        The ECU's frames, and the measured values after each run.
    """
    frames, states, node, parameters = [], [], PlantNode(software.config, SHORT), software.parameters()
    task = software.task(parameters)
    for cycle in range(node.cycles):
        if cycle == CHANGED_AT and gain is not None:
            parameters.proportional_gain = gain
        for frame in node.outgoing(cycle):
            task.on_can_frame(frame.id, frame.data)
        frames.append(Frame(*task.run()))
        node.receive(frames[-1])
        node.finish(cycle)
        states.append({name: _field(task.state, path) for name, path in (measured or {}).items()})
    return frames, states


def _field(struct: Any, path: str) -> Any:
    """Return a field of a struct; a dot in the path selects a nested struct."""
    return functools.reduce(getattr, path.split("."), struct)


def drive(interface: str, software: Software, before: Callable[[int], None] = lambda cycle: None) -> list[Frame]:
    """Run the ECU on the bus in lock-step, call `before` before each cycle, and return the ECU's frames."""
    frames, node = [], PlantNode(software.config, SHORT)
    with Bus(BusAddress("socketcan", interface)) as bus:
        for cycle in range(node.cycles):
            before(cycle)
            for frame in node.outgoing(cycle):
                assert bus.send(frame)
            frames.append(next(frame for frame in iter(lambda: bus.receive(TIMEOUT_S), None) if node.receive(frame)))
            node.finish(cycle)
    return frames


def check_command(frame: Frame, row: dict[str, Any]) -> None:
    """Compare a command with the measured state of the same run. Tolerance: half a step, and 1e-4 for rounding."""
    command, step = Codec(CAN).decode(frame.id, frame.data), CAN.rear_steer_command
    assert isinstance(command, RearSteerCommand)
    assert command.status == row["ars.status"]
    assert math.isnan(command.rear_angle) or abs(command.rear_angle - row["ars.rear_angle"]) <= 0.5001 * step.rear_angle.factor
    reference = command.yaw_rate_reference
    assert math.isnan(reference) or abs(reference - row["ars.yaw_rate_reference"]) <= 0.5001 * step.yaw_rate_reference.factor


@both_kinds
def test_all_measurements_of_each_run_of_the_task(vcan: str, ecu: EcuProcess, software: Software, a2l: Description) -> None:
    rows = Rows(a2l)
    with connected(vcan, a2l, rows) as master:
        rows.setup()
        rows.start()
        frames = drive(vcan, software, rows.wait_for)
        rows.wait_for(len(frames))
        rows.stop()
        uploaded = {name: read(master, a2l, each.address, each.format) for name, each in a2l.measured.items()}
    links = {each["Name"]["Value"]: each["SYMBOL_LINK"]["SymbolName"]["Value"] for each in a2l.module["MEASUREMENT"]}
    expected, states = simulate(software, measured={name: link.removeprefix("ecu.task.") for name, link in links.items()})
    assert max(state["ars.yaw_rate_reference"] for state in states) > 0.1
    assert frames == expected
    assert len(rows.rows) == len(states) and len(states[0]) == len(links) > 20
    for measured, state in zip([*rows.rows, uploaded], [*states, states[-1]], strict=True):  # bit for bit
        assert measured.keys() == state.keys()
        assert np.array_equal(*([float(row[name]) for name in state] for row in (measured, state)), equal_nan=True)
    period = 10_000_000  # ns, of the event in the A2L: 10 ms
    assert a2l.xcp["DAQ"]["EVENT"].values[5:7] == [10, 6]
    assert {later - earlier for earlier, later in pairwise(rows.stamps)} == {period}
    for frame, row in zip(frames, rows.rows, strict=True):
        check_command(frame, row)


@both_kinds
def test_a_gain_changed_in_the_loop_changes_the_response(
    vcan: str, ecu: EcuProcess, software: Software, a2l: Description
) -> None:
    """The frames equal those of the task in this process with that gain from that sample on, bit for bit."""
    address, kind = a2l.value(GAIN)
    with connected(vcan, a2l) as master:

        def change(cycle: int) -> None:
            if cycle == CHANGED_AT:
                master.setMta(address)
                master.download(struct.pack(a2l.order + kind, STRONGER))

        changed = drive(vcan, software, change)
        assert read(master, a2l, address, kind) == np.float32(STRONGER)
    unchanged, _ = simulate(software)
    assert changed[:CHANGED_AT] == unchanged[:CHANGED_AT]
    assert changed[CHANGED_AT] != unchanged[CHANGED_AT]
    assert changed == simulate(software, gain=STRONGER)[0]


def test_the_identity_and_the_memory_segment_of_the_a2l_are_those_of_the_slave(
    vcan: str, ecu: EcuProcess, a2l: Description
) -> None:
    """A tool reads the EPK, and compares the checksum of both pages with its own file."""
    address, size = (int(a2l.segment[key]["Value"], 0) for key in ("Address", "Size"))
    content = Elf.read(ecu_process.compile_ecu(FOLDER)).bytes_at(address, size)
    ((place,), epk) = (a2l.module["MOD_PAR"][key] for key in ("ADDR_EPK", "EPK"))
    identity = epk["Identifier"]["Value"].encode()
    assert content is not None
    with connected(vcan, a2l) as master:
        assert [master.getSegmentInfo(0, 0, info, 0).basicInfo for info in (0, 1)] == [address, size]
        for page in range(2):
            master.setCalPage(2, 0, page)
            master.setMta(address)
            assert master.buildChecksum(size).checksum == binascii.crc32(content)
        master.setMta(int(place["Address"]["Value"], 0))
        assert master.fetch(len(identity)) == identity


def test_measurements_in_real_time(vcan: str, software: Software, a2l: Description) -> None:
    """The list's sample of the same run follows each command. While commands are on time, the run equals lock-step."""
    seen: list[can.Message] = []
    rows, address = Rows(a2l), BusAddress("socketcan", vcan)
    wanted = run_through_can(software, SHORT).record
    ids = (CAN.rear_steer_command.id, a2l.bus["can_id_slave"])
    filters = [{"can_id": identifier, "can_mask": 0x7FF, "extended": False} for identifier in ids]

    def listen(_cycle: Cycle | None = None) -> None:
        seen.extend(iter(lambda: listener.recv(0.0), None))

    with (
        EcuProcess(ecu_process.command(FOLDER, vcan, parent=os.getpid(), xcp=True)) as ecu,
        can.Bus(interface="socketcan", channel=vcan, can_filters=filters) as listener,
    ):
        with connected(vcan, a2l, rows) as master:
            rows.setup()
            rows.start()
            result = run_plant(Setup(software.config, SHORT, address), ecu, listen)
            rows.stop()
            assert not master.getStatus().sessionStatus.daqRunning
        listen()
        counters = ecu_process.counters(ecu.stop())
    assert (result.send_errors, counters["send_errors"], counters["lost_packets"]) == (0, 0, 0)
    sent = [message.data[1] & 0xF for message in seen if message.arbitration_id == ids[0]]
    assert {(later - earlier) % 15 for earlier, later in pairwise(sent)} == {1}  # E2E counters: none is missing
    samples = [k for k, message in enumerate(seen) if message.arbitration_id == ids[1] and message.data[0] == 0]
    assert len(samples) == len(rows.rows) > 150
    for row, k in zip(rows.rows, samples, strict=True):
        check_command(Frame(seen[k - 1].arbitration_id, bytes(seen[k - 1].data)), row)
    answered = np.isfinite(result.response) & (result.diagnostics == 0)
    in_control = column(result.record, "status") <= Status.LIMITED  # fail-safe before the car started
    first = int(np.argmax(answered & in_control))
    late = np.flatnonzero(~answered[first:])
    end = first + int(late[0]) if late.size else len(answered)
    if answered[first] and first < 90:  # before the driver steers: the states of both runs are the same
        assert np.array_equal(result.record[first:end], wanted[first:end])


@pytest.mark.parametrize("xcp", [False, True])
def test_without_the_option_there_is_no_slave_and_the_memory_is_read_only(vcan: str, a2l: Description, xcp: bool) -> None:
    command = ecu_process.command(FOLDER, vcan, lock_step=True, parent=os.getpid(), xcp=xcp)
    with EcuProcess(command) as ecu, Master("can", config=application(vcan, a2l)) as master:
        master.transport.timeout = int((TIMEOUT_S if xcp else 0.2) * 1e9)
        if xcp:
            master.connect()
        else:
            with pytest.raises(XcpTimeoutError):
                master.connect()
        assert access(ecu, a2l.value(GAIN)[0]) == ("rw-p" if xcp else "r--p")
        assert ecu.alive
