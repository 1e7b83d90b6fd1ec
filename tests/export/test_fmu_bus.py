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
from hil_sim.scenario_files import find
from tests.export import fmus
from tests.export.bus import (
    ARBITRATION,
    BAUDRATE,
    CONFIGURATION,
    FD_BAUDRATE,
    FORMAT_ERROR,
    STATUS,
    TASK_CLOCK,
    TRANSMIT,
    WAKEUP,
    Bus,
    Node,
    arbitration_lost,
    bus_error,
    clock_times,
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


@pytest.mark.parametrize(("has_clock", "is_clocked"), [(False, False), (True, False), (True, True)])
@pytest.mark.parametrize(("bit_rate", "elapsed", "notifies"), [(None, 0.005, False), (500e3, 0.006, True)])
def test_both_nodes_on_a_bus(bit_rate: float | None, elapsed: float, notifies: bool, has_clock: bool, is_clocked: bool) -> None:
    """The simulator lets the clock of the task tick if it `has_clock`; the task runs by it if it `is_clocked`."""
    check_run("tracking", SCENARIO, bit_rate, elapsed, notifies, has_clock=has_clock, is_clocked=is_clocked)


@pytest.mark.parametrize("frames", ["29 bits", "FD, 8 bytes"])
def test_other_frames_on_a_bus(frames: str) -> None:
    check_run(frames, "step-steer", None, 0.005, True)


def check_run(
    kind: str,
    scenario: str,
    bit_rate: float | None,
    elapsed: float,
    notifies: bool,
    *,
    has_clock: bool = False,
    is_clocked: bool = False,
) -> None:
    """Compare all frames of a scenario on a bus with those of the SIL."""
    wanted, cycles = recorded(kind, scenario, elapsed)
    given = driver(kind, scenario)
    start = {"CanChannel.BusNotifications": float(notifies)}
    plant = Node(Slave(made("bus_plant", "3", kind), event_mode=True)).start({**start, **given(0.0)})
    ecu = Node(Slave(made("ecu", "3", kind), event_mode=True), has_clock=has_clock)
    ecu.start({**start, "task_is_clocked": float(is_clocked)})
    bus = Bus((plant, ecu), bit_rate, notifies=notifies)
    simulate(bus, cycles * 0.01 - STEP, STEP, lambda number, time: given(time) if number == 0 else {})
    # Of the three frames of a cycle, the one with the lowest identifier is first. The command has the highest.
    arbitrated = [frame for k in range(0, len(wanted), 3) for frame in sorted(wanted[k : k + 3], key=lambda frame: frame.id)]
    assert [replace(frame, time=0.0) for frame in bus.frames] == [replace(frame, time=0.0) for frame in arbitrated]
    fast = 4_000_000 if kind == "FD, 8 bytes" else 2_000_000
    rates = {BAUDRATE: 500_000, **({FD_BAUDRATE: fast} if fmus.software(kind).config.can.is_fd else {})}
    assert bus.configuration == {(node, key): value for node in (0, 1) for key, value in {**rates, ARBITRATION: 1}.items()}
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


def started_ecu(notifies: bool = False, kind: str = "tracking", *, is_clocked: bool = False) -> Node:
    """Return an ECU that has sent its configuration."""
    values = {"CanChannel.BusNotifications": notifies, "task_is_clocked": is_clocked}
    ecu = Node(Slave(made("ecu", "3", kind), event_mode=True)).start(values)
    assert {code for code, _ in operations(ecu.finish_event())} == {CONFIGURATION}
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


@pytest.mark.parametrize("kind", ["tracking", "FD, 8 bytes", "29 bits"])
@pytest.mark.parametrize(("are_others", "early"), [(True, 1.0), (False, 0.0)])
def test_frames_of_other_kinds_are_ignored(are_others: bool, early: float, kind: str) -> None:
    node = PlantNode(fmus.software(kind).config, find(SCENARIO))
    motion, conditions = node.outgoing(0)
    xl = operation(0x12, struct.pack("<IBBBBIH", motion.id, motion.extended, 0, 0, 0, 0, 8) + motion.data)
    others = [replace(each, extended=not each.extended) for each in (motion, conditions)]
    others += [replace(each, fd=not each.fd) for each in (motion, conditions)]
    others += [replace(each, remote=True, fd=False) for each in (motion, conditions)]
    ecu = started_ecu(kind=kind)
    for each in others if are_others else (motion, conditions):
        ecu.event(transmit(each) + (xl if are_others else b""))
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


@pytest.mark.parametrize("is_clocked", [False, True])
def test_a_run_continues_from_a_saved_state(is_clocked: bool) -> None:
    wanted, _ = recorded("tracking", SCENARIO, 0.0)
    ecu = started_ecu(notifies=True, is_clocked=is_clocked)
    fmu = ecu.slave.fmu

    def drive(cycles: range) -> list[bytes]:
        sent = []
        for cycle in cycles:
            ecu.event(transmit(wanted[3 * cycle]) + transmit(wanted[3 * cycle + 1]))
            ecu.slave.step(0.01)
            sent.append(ecu.event(confirm(ECU_ID), ticks=is_clocked))
        return sent

    drive(range(50))
    time, state = ecu.slave.time, bytes(fmu.serializeFMUState(fmu.getFMUState()))
    first = drive(range(50, 200))
    ecu.slave.restore(fmu.deserializeFMUState(state), time)
    assert bytes(fmu.serializeFMUState(fmu.getFMUState())) == state
    assert drive(range(50, 200)) == first
    assert all(first)


# ---- the clock of the task ----


def test_the_task_runs_exactly_at_the_ticks() -> None:
    motion, conditions, _ = (transmit(frame) for frame in recorded("tracking", SCENARIO, 0.0)[0][:3])
    ecu = started_ecu(is_clocked=True)
    fmu, clock = ecu.slave.fmu, [ecu.slave.variables[TASK_CLOCK].valueReference]

    def counters() -> list[float]:
        return ecu.slave.row(("cycles", "early_cycles", "late_cycles"))

    ecu.slave.step(0.0203)
    assert not ecu.slave.has_event  # nothing runs without a tick
    fmu.enterEventMode()
    ecu.receive(motion + conditions)
    ecu.tick()
    assert counters() == [1.0, 1.0, 0.0]  # at once, and frames of the same event count in the next run
    assert fmu.getClock(clock) == [True]
    state = fmu.serializeFMUState(fmu.getFMUState())
    ecu.tick()  # set again: no other tick
    assert "cannot be deactivated" in refused(ecu.slave, fmu.setClock, clock, [False])
    assert [code for code, _ in operations(ecu.operations())] == [TRANSMIT]
    assert not any(fmu.updateDiscreteStates()[:5])
    assert fmu.getClock(clock) == [False]
    assert "cannot tick again within 0.01 s" in refused(ecu.slave, ecu.tick)
    fmu.enterStepMode()
    assert "only tick in an event" in refused(ecu.slave, ecu.tick)
    assert counters() == [1.0, 1.0, 0.0]
    ecu.slave.restore(fmu.deserializeFMUState(state), ecu.slave.time)
    assert fmu.getClock(clock) == [True]
    assert ecu.finish_event() != b""  # the command again

    ecu.slave.step(0.008)
    ecu.event(motion + conditions)
    ecu.slave.step(0.001)
    fmu.enterEventMode()
    assert "cannot tick again" in refused(ecu.slave, ecu.tick)  # after 9 ms
    ecu.leave_event()
    ecu.slave.step(0.001)
    assert ecu.event(ticks=True) != b""
    assert counters() == [2.0, 1.0, 1.0]  # two frames of each message since the first tick


def test_a_command_after_the_operations_were_read_is_announced_again() -> None:
    ecu = Node(Slave(made("ecu", "3"), event_mode=True)).start({"task_is_clocked": True})
    assert {code for code, _ in operations(ecu.operations())} == {CONFIGURATION}
    ecu.tick()
    ecu.leave_event()
    ecu.slave.step(0.001)
    assert ecu.slave.has_event
    assert [code for code, _ in operations(ecu.event())] == [TRANSMIT]


def test_the_clock_of_the_task_is_described() -> None:
    slave = Slave(made("ecu", "3"), event_mode=True).start()
    (clock,) = (
        each
        for each in ET.fromstring(text_of(slave.made, "modelDescription.xml")).iter("Clock")
        if each.get("name") == TASK_CLOCK
    )
    period = ecu_config().controller.sampling_time_s
    assert (float(clock.get("intervalDecimal", "")), float(clock.get("shiftDecimal", ""))) == (
        period,
        slave.get("task_offset_s"),
    )
    assert clock_times(slave) == (period, period / 2)
    assert (clock.get("causality"), clock.get("intervalVariability"), clock.get("clocks")) == ("input", "constant", None)
    depends = {
        each.variable.name for each in slave.made.description.outputs if TASK_CLOCK in {v.name for v in each.dependencies}
    }
    assert depends == {each.name for each in slave.variables.values() if each.causality == "output"}
    assert {each.intervalVariability for each in made("bus_plant", "3").description.modelVariables if each.type == "Clock"} == {
        "triggered"
    }


def test_misuse_of_events_is_refused() -> None:
    ecu = started_ecu()
    fmu, number = ecu.slave.fmu, {name: [each.valueReference] for name, each in ecu.slave.variables.items()}
    rx_clock, rx_data = number["CanChannel.Rx_Clock"], number["CanChannel.Rx_Data"]
    assert "no event to leave" in refused(ecu.slave, fmu.enterStepMode)
    assert "no event to update" in refused(ecu.slave, fmu.updateDiscreteStates)
    assert "computed" in refused(ecu.slave, fmu.setClock, number["CanChannel.Tx_Clock"], [True])
    assert "computed" in refused(ecu.slave, fmu.setBinary, number["CanChannel.Tx_Data"], [b"?"])
    assert "another type" in refused(ecu.slave, fmu.getClock, rx_data)
    assert "no variable with the value reference 1000" in refused(ecu.slave, fmu.setClock, [1000], [True])
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
    assert "Rx_Clock has no interval" in refused(silent, clock_times, silent, "CanChannel.Rx_Clock")
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
    messages = [refused(ecu.slave, ecu.slave.step, 0.01)]
    ecu.slave.fmu.enterEventMode()
    messages.append(refused(ecu.slave, ecu.tick))
    characteristic.value = before
    assert all("parameters of the build are not valid" in message for message in messages)


def ecu_config():
    return fmus.software("tracking").config


class _LinkMap(ctypes.Structure):
    _fields_ = (("l_addr", ctypes.c_void_p),)


def base_of(library: ctypes.CDLL) -> int:
    """Return the address at which a library is loaded. In the C library of Linux, a handle is the address of a link map."""
    return _LinkMap.from_address(library._handle).l_addr
