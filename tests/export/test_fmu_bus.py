"""FMUs on a CAN bus (FMI-LS-BUS): their frames equal those of the software in the loop, bit for bit."""

from __future__ import annotations

import ctypes
import functools
import re
import struct
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import replace

import fmpy
import pytest
from fmpy.validation import validate_fmu

from hil_sim.bench import run_in_process
from hil_sim.codec import Codec, Frame
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import find
from tests.export import fmus
from tests.export.bus import (
    CONFIGURATION,
    FORMAT_ERROR,
    STATUS,
    TRANSMIT,
    WAKEUP,
    Bus,
    Node,
    arbitration_lost,
    bus_error,
    confirm,
    frame_of,
    operation,
    operations,
    simulate,
    transmit,
)
from tests.export.fmus import STEP, Slave, made, text_of
from tests.export.test_fmu_states import refused

SCENARIO = "sine-with-dwell"
ECU_ID, MOTION_ID, CONDITIONS_ID = 0x201, 0x101, 0x102


class Log:
    """Frames of a run, in order."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []

    def write(self, frame: Frame, *, received: bool) -> None:
        self.frames.append(frame)


@functools.cache
def recorded(kind: str, scenario: str, elapsed: float) -> tuple[list[Frame], int]:
    """Return the frames of the SIL, whose command acts `elapsed` (s) after the frames of the car, and its cycles."""
    software, log = fmus.software(kind), Log()
    node = PlantNode(software.config, find(scenario), precision=software.precision)
    node.task_starts = [(elapsed,)] * node.cycles
    run_in_process(node, software, log=log)  # type: ignore[arg-type]
    return log.frames, node.cycles


def driver(kind: str, scenario: str) -> Callable[[float], Mapping[str, float]]:
    rows = fmus.inputs(kind, scenario)

    def values(time: float) -> Mapping[str, float]:
        return fmus.loop_inputs(rows[min(round(time / STEP - 0.5 + 1e-6), len(rows) - 1)])

    return values


def test_fmpy_validates_the_files() -> None:
    assert validate_fmu(str(made("ecu", "3").path)) == []
    assert validate_fmu(str(made("bus_plant", "3").path)) == []


@pytest.mark.parametrize(("bit_rate", "elapsed", "notifies"), [(None, 0.005, False), (500e3, 0.006, True)])
def test_both_nodes_on_a_bus(bit_rate: float | None, elapsed: float, notifies: bool) -> None:
    check_run("tracking", SCENARIO, bit_rate, elapsed, notifies)


def check_run(kind: str, scenario: str, bit_rate: float | None, elapsed: float, notifies: bool) -> None:
    """Compare all frames of a scenario on a bus with those of the SIL."""
    wanted, cycles = recorded(kind, scenario, elapsed)
    given = driver(kind, scenario)
    start = {"CanChannel.BusNotifications": float(notifies)}
    plant = Node(Slave(made("bus_plant", "3", kind), event_mode=True)).start({**start, **given(0.0)})
    ecu = Node(Slave(made("ecu", "3", kind), event_mode=True)).start(start)
    bus = Bus((plant, ecu), bit_rate, notifies=notifies)
    simulate(bus, cycles * 0.01 - STEP, STEP, lambda number, time: given(time) if number == 0 else {})
    assert [(frame.id, frame.data) for frame in bus.frames] == [(frame.id, frame.data) for frame in wanted]
    assert bus.configuration == {(0, 1): 500000, (0, 4): 1, (1, 1): 500000, (1, 4): 1}
    assert (bus.statuses, bus.errors) == ([], [])
    assert ecu.slave.get("lost_samples") <= 2


@pytest.mark.parametrize("in_event", [True, False])
def test_the_frames_of_the_sil_give_its_commands(in_event: bool) -> None:
    """A run of `codegen sil --can`: the car's frames arrive one by one, and every command equals the SIL's.

    The SIL Kit FMU Importer sets frames before a step, without an event.
    """
    wanted, cycles = recorded("tracking", SCENARIO, 0.0)
    ecu = started_ecu()
    commands, deliver = [], ecu.event if in_event else ecu.receive
    for cycle in range(cycles):
        motion, conditions, command = wanted[3 * cycle : 3 * cycle + 3]
        ecu.slave.step(0.001)
        deliver(transmit(motion))
        ecu.slave.step(0.0003)  # a step may end anywhere
        deliver(transmit(conditions))
        ecu.slave.step(0.0037 if cycle == 0 else 0.0087)
        commands += [(command.data, frame_of(content).data) for code, content in operations(ecu.event()) if code == TRANSMIT]
    assert len(commands) == cycles
    assert all(sent == got for sent, got in commands)


# ---- the node ----


def started_ecu(notifies: bool = False) -> Node:
    """Return an ECU that has sent its configuration."""
    ecu = Node(Slave(made("ecu", "3"), event_mode=True)).start({"CanChannel.BusNotifications": notifies})
    assert [code for code, _ in operations(ecu.finish_event())] == [CONFIGURATION, CONFIGURATION]
    return ecu


def first_command(ecu: Node) -> bytes:
    """Return the operation with the first frame of an ECU."""
    ecu.slave.step(0.005)
    assert ecu.slave.has_event
    return ecu.event()


def answer(ecu: Node, received: bytes) -> bytes:
    """Return the operations that an ECU sends a step after it has received some."""
    assert ecu.event(received) == b""
    ecu.slave.step(0.0001)
    return ecu.event() if ecu.slave.has_event else b""


def test_a_frame_is_repeated_until_the_bus_confirms_it() -> None:
    ecu = started_ecu(notifies=True)
    command = first_command(ecu)
    assert answer(ecu, bus_error(ECU_ID, 4, 2, True)) == command
    assert answer(ecu, arbitration_lost(ECU_ID)) == command
    assert answer(ecu, confirm(ECU_ID)) == b""
    assert answer(ecu, arbitration_lost(ECU_ID)) == b""


def test_without_notifications_they_are_ignored() -> None:
    ecu = started_ecu()
    first_command(ecu)
    assert answer(ecu, bus_error(ECU_ID, 4, 2, True) * 40 + arbitration_lost(ECU_ID) + confirm(ECU_ID)) == b""


def test_errors_lead_to_bus_off_and_back() -> None:
    """ISO 11898-1, fault confinement: a sender adds 8 for each error, is passive above 127 and off above 255."""
    ecu = started_ecu(notifies=True)
    command = first_command(ecu)
    error, passive, off, active = bus_error(ECU_ID, 4, 2, True), *(operation(STATUS, bytes([k])) for k in (2, 3, 1))
    assert answer(ecu, error * 15) == command * 15
    assert answer(ecu, error) == passive + command
    assert answer(ecu, confirm(ECU_ID)) == active  # 127
    assert answer(ecu, error) == passive
    no_answer = bus_error(ECU_ID, 5, 2, True)
    assert answer(ecu, no_answer * 100) == b""  # without an acknowledgement a passive node counts no more
    assert answer(ecu, error * 15) == b""  # 255
    assert answer(ecu, error) == off
    assert answer(ecu, error) == b""
    ecu.slave.step(0.0004)  # the rest of this step of the model
    seen = []
    for _ in range(3):  # 128 times 11 bits at 500 kbit/s are 2.8 ms
        ecu.slave.step(0.001)
        seen.append(ecu.event() if ecu.slave.has_event else b"")
    assert b"".join(seen) == active


def test_a_receiver_counts_less_and_recovers() -> None:
    ecu = started_ecu(notifies=True)
    passive, active = operation(STATUS, b"\2"), operation(STATUS, b"\1")
    assert answer(ecu, bus_error(MOTION_ID, 4, 1, False) * 16) == passive  # 8 each
    assert answer(ecu, transmit(Frame(0x7FF, b""))) == active
    assert answer(ecu, bus_error(MOTION_ID, 4, 2, False) * 8) == b""  # 119 + 8
    assert answer(ecu, bus_error(MOTION_ID, 4, 2, False)) == passive


@pytest.mark.parametrize(
    ("received", "returned"),
    [
        (operation(0x99, b"?"), operation(0x99, b"?")),
        (operation(TRANSMIT, b"short"), operation(TRANSMIT, b"short")),
        (transmit(Frame(MOTION_ID, bytes(9))), transmit(Frame(MOTION_ID, bytes(9)))),
        (operation(STATUS, b"\1")[:-1], operation(STATUS, b"\1")[:-1]),
        (b"12345", b"12345"),
        (operation(STATUS, b"\1\2") + operation(WAKEUP), operation(STATUS, b"\1\2")),
    ],
)
def test_a_corrupt_operation_is_returned(received: bytes, returned: bytes) -> None:
    error = operation(FORMAT_ERROR, len(returned).to_bytes(2, "little") + returned)
    assert answer(started_ecu(), received) == error
    assert answer(started_ecu(), error) == b""  # not for ever


@pytest.mark.parametrize(("are_others", "early"), [(True, 1.0), (False, 0.0)])
def test_frames_of_other_kinds_are_ignored(are_others: bool, early: float) -> None:
    motion, conditions, _ = recorded("tracking", SCENARIO, 0.0)[0][:3]
    fd = operation(0x11, struct.pack("<IBBBH", MOTION_ID, 0, 1, 0, 8) + motion.data)
    xl = operation(0x12, struct.pack("<IBBBBIH", MOTION_ID, 0, 0, 0, 0, 0, 8) + motion.data)
    others = transmit(replace(motion, extended=True)) + transmit(replace(motion, remote=True)) + fd + xl
    ecu = started_ecu()
    ecu.event(others if are_others else transmit(motion) + transmit(conditions))
    first_command(ecu)
    assert ecu.slave.get("early_cycles") == early


def test_a_value_that_is_set_again_counts_once_and_another_one_is_added() -> None:
    motion, conditions, _ = (transmit(frame) for frame in recorded("tracking", SCENARIO, 0.0)[0][:3])
    ecu = started_ecu()
    ecu.slave.fmu.enterEventMode()
    for content in (motion, motion, conditions, conditions):
        ecu.receive(content)
    ecu.leave_event()
    first_command(ecu)
    assert (ecu.slave.get("early_cycles"), ecu.slave.get("late_cycles")) == (0.0, 0.0)


def test_operations_that_are_not_read_are_announced_again() -> None:
    ecu = started_ecu()
    ecu.slave.step(0.005)
    ecu.slave.fmu.enterEventMode()
    ecu.leave_event()
    ecu.slave.step(0.001)
    assert ecu.slave.has_event
    assert [code for code, _ in operations(ecu.event())] == [TRANSMIT]


def test_a_run_continues_from_a_saved_state() -> None:
    wanted, _ = recorded("tracking", SCENARIO, 0.0)
    ecu = started_ecu(notifies=True)
    fmu = ecu.slave.fmu

    def drive(cycles: range) -> list[bytes]:
        sent = []
        for cycle in cycles:
            ecu.event(transmit(wanted[3 * cycle]) + transmit(wanted[3 * cycle + 1]))
            ecu.slave.step(0.01)
            sent.append(ecu.event(confirm(ECU_ID)))
        return sent

    drive(range(50))
    time, state = ecu.slave.time, bytes(fmu.serializeFMUState(fmu.getFMUState()))
    first = drive(range(50, 200))
    ecu.slave.restore(fmu.deserializeFMUState(state), time)
    assert bytes(fmu.serializeFMUState(fmu.getFMUState())) == state
    assert drive(range(50, 200)) == first


def test_misuse_of_events_is_refused() -> None:
    ecu = started_ecu()
    fmu, number = ecu.slave.fmu, {name: [each.valueReference] for name, each in ecu.slave.variables.items()}
    rx_clock, rx_data = number["CanChannel.Rx_Clock"], number["CanChannel.Rx_Data"]
    assert "no event to leave" in refused(ecu.slave, fmu.enterStepMode)
    assert "no event to update" in refused(ecu.slave, fmu.updateDiscreteStates)
    assert "computed" in refused(ecu.slave, fmu.setClock, number["CanChannel.Tx_Clock"], [True])
    assert "computed" in refused(ecu.slave, fmu.setBinary, number["CanChannel.Tx_Data"], [b"?"])
    assert "another type" in refused(ecu.slave, fmu.getClock, rx_data)
    assert "another type" in refused(ecu.slave, fmu.getBinary, rx_clock)
    fmu.enterEventMode()
    assert "while an event is handled" in refused(ecu.slave, ecu.slave.step, 0.001)
    assert "between two steps" in refused(ecu.slave, fmu.enterEventMode)
    assert "room for 2048 bytes" in refused(ecu.slave, fmu.setBinary, rx_data, [bytes(2049)])
    ecu.leave_event()
    assert "not possible" in refused(ecu.slave, ecu.slave.step, 0.0)
    with pytest.raises(Exception, match="instantiate"):
        Slave(made("ecu", "3"), event_mode=True)
    silent = Slave(made("bus_plant", "3")).start()  # a simulator without events
    silent.step(0.1)
    assert not silent.has_event
    ticked = [silent.variables["CanChannel.Rx_Clock"].valueReference]
    assert "a simulator that handles events" in refused(silent, silent.fmu.setClock, ticked, [True])
    assert "simulator announced" in refused(silent, silent.fmu.enterEventMode)


# ---- files ----


def test_the_layered_standards_are_described() -> None:
    for what in ("ecu", "bus_plant"):
        known = made(what, "3")
        terminals = ET.fromstring(text_of(known, "terminalsAndIcons/terminalsAndIcons.xml"))
        names = {each.name for each in known.description.modelVariables}
        members = {each.get("memberName"): each.get("variableName") for each in terminals.iter("TerminalMemberVariable")}
        assert set(members) == {"Tx_Data", "Tx_Clock", "Rx_Data", "Rx_Clock", "BusNotifications"}
        assert set(members.values()) <= names
        manifest = ET.fromstring(text_of(known, "extra/org.fmi-standard.fmi-ls-bus/fmi-ls-manifest.xml"))
        assert manifest.get("{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-version") == "1.0.0"


def test_the_a2l_has_the_addresses_of_the_binary() -> None:
    """A value is read and one is changed in the memory of the loaded library, at its base plus the address in the A2L."""
    ecu = started_ecu()
    text = text_of(ecu.slave.made, f"extra/org.fmi-standard.fmi-ls-xcp/{fmpy.platform_tuple}/ars.a2l")
    base = base_of(ecu.slave.fmu.dll)

    def address_of(link: str) -> int:
        before, _, _ = text.partition(f'{link}" 0')
        return base + int(re.findall(r"0x([0-9A-F]{8})\b", before)[-1], 16)

    for motion, conditions, command in zip(*[iter(recorded("tracking", SCENARIO, 0.0)[0][:1200])] * 3, strict=True):
        ecu.event(transmit(motion) + transmit(conditions))
        ecu.slave.step(0.01)
        (sent,) = (frame_of(content) for _, content in operations(ecu.event()))
        assert sent.data == command.data
        angle = ctypes.c_float.from_address(address_of("task.controller.sample.front_angle"))
        assert angle.value == pytest.approx(Codec(ecu_config().can).decode(motion.id, motion.data).front_angle, abs=1e-9)
    characteristic = ctypes.c_float.from_address(address_of("ars_parameters_default.rear_rate_max"))
    before, characteristic.value = characteristic.value, float("nan")
    message = refused(ecu.slave, ecu.slave.step, 0.01)
    characteristic.value = before
    assert "parameters of the build are not valid" in message


def ecu_config():
    return fmus.software("tracking").config


class _LinkMap(ctypes.Structure):
    _fields_ = (("l_addr", ctypes.c_void_p),)


def base_of(library: ctypes.CDLL) -> int:
    """Return the address at which a library is loaded. In the C library of Linux, a handle is the address of a link map."""
    return _LinkMap.from_address(library._handle).l_addr
