"""A CAN bus by FMI-LS-BUS 1.0 and a simulator that connects FMUs with it, for tests.

The bus transmits one frame at a time, the one with the lowest identifier first, delivers it to the other nodes, and confirms
it to its sender. Operations are formatted and read here by the tables of the standard, section 4.5.1, and not by the
generated C.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from fmpy import fmi3

from hil_sim.codec import Frame
from tests.export.fmus import Slave

FORMAT_ERROR, TRANSMIT, FD_TRANSMIT, CONFIRM, ARBITRATION_LOST, BUS_ERROR, CONFIGURATION, STATUS, WAKEUP = (
    0x01, 0x10, 0x11, 0x20, 0x30, 0x31, 0x40, 0x41, 0x42,
)  # fmt: skip
BAUDRATE, FD_BAUDRATE, ARBITRATION = 1, 2, 4
FRAME_BITS = 47
"""Bits of a frame with an 11-bit identifier without its data and stuff bits, with the interframe space (ISO 11898-1)."""
MICROSECOND = 1e-6
TASK_CLOCK = "task_clock"


def operation(code: int, content: bytes = b"") -> bytes:
    return struct.pack("<II", code, 8 + len(content)) + content


def transmit(frame: Frame) -> bytes:
    if frame.fd:  # with bit-rate switching, of a node that is not error passive
        return operation(FD_TRANSMIT, struct.pack("<IBBBH", frame.id, frame.extended, 1, 0, len(frame.data)) + frame.data)
    head = struct.pack("<IBBH", frame.id, frame.extended, frame.remote, len(frame.data))
    return operation(TRANSMIT, head + frame.data)


def confirm(identifier: int) -> bytes:
    return operation(CONFIRM, struct.pack("<I", identifier))


def arbitration_lost(identifier: int) -> bytes:
    return operation(ARBITRATION_LOST, struct.pack("<I", identifier))


def bus_error(identifier: int, code: int, flag: int, is_sender: bool) -> bytes:
    return operation(BUS_ERROR, struct.pack("<IBBB", identifier, code, flag, is_sender))


def operations(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield code and content of each operation."""
    while content:
        code, length = struct.unpack_from("<II", content)
        assert 8 <= length <= len(content)
        yield code, content[8:length]
        content = content[length:]


def frame_of(content: bytes) -> Frame:
    """Return the frame of a Transmit operation."""
    identifier, extended, remote, length = struct.unpack_from("<IBBH", content)
    assert len(content) == 8 + length
    return Frame(identifier, content[8:], extended=bool(extended), remote=bool(remote))


def fd_frame_of(content: bytes) -> Frame:
    """Return the frame of a CAN FD Transmit operation."""
    identifier, extended, switches, is_passive, length = struct.unpack_from("<IBBBH", content)
    assert (switches, is_passive, len(content)) == (1, 0, 9 + length)
    return Frame(identifier, content[9:], extended=bool(extended), fd=True)


def clock_times(slave: Slave, clock: str = TASK_CLOCK) -> tuple[float, float]:
    """Return interval and shift of a periodic clock in s, from the FMU."""
    number = (fmi3.fmi3ValueReference * 1)(slave.variables[clock].valueReference)
    interval, shift, qualifier = (fmi3.fmi3Float64 * 1)(), (fmi3.fmi3Float64 * 1)(), (fmi3.fmi3IntervalQualifier * 1)()
    slave.fmu.getIntervalDecimal(number, interval, qualifier)
    slave.fmu.getShiftDecimal(number, shift)
    assert qualifier[0] == fmi3.fmi3IntervalUnchanged  # the only one that the standard allows for a constant clock
    return interval[0], shift[0]


class Node:
    """An FMU on the bus.

    Attributes:
        next_tick: time of the next tick of the clock of the task in us; None: the simulator does not know this clock.
    """

    def __init__(self, slave: Slave, *, has_clock: bool = False) -> None:
        self.slave = slave
        number = {name.rpartition(".")[2]: [each.valueReference] for name, each in slave.variables.items()}
        self._numbers = number
        self._has_clock = has_clock
        self.next_tick: int | None = None

    def start(self, values: Mapping[str, float] | None = None) -> Node:
        """Initialise the FMU; it is then in its first event."""
        self.slave.start(values)
        if self._has_clock:
            self._interval, self.next_tick = (round(time / MICROSECOND) for time in clock_times(self.slave))
        return self

    def tick(self) -> None:
        """Let the clock of the task tick, within an event."""
        self.slave.fmu.setClock(self._numbers[TASK_CLOCK], [True])
        if self.next_tick is not None:
            self.next_tick += self._interval

    def operations(self) -> bytes:
        """Return the operations to send, within an event."""
        (ticks,) = self.slave.fmu.getClock(self._numbers["Tx_Clock"])
        if not ticks:
            return b""
        assert self.slave.fmu.getClock(self._numbers["Tx_Clock"]) == [False]  # a tick is read once
        return bytes(self.slave.fmu.getBinary(self._numbers["Tx_Data"])[0])

    def receive(self, content: bytes) -> None:
        """Pass operations to the FMU, within an event."""
        self.slave.fmu.setClock(self._numbers["Rx_Clock"], [True])
        self.slave.fmu.setBinary(self._numbers["Rx_Data"], [content])

    def leave_event(self) -> None:
        assert not any(self.slave.fmu.updateDiscreteStates()[:5])
        self.slave.fmu.enterStepMode()

    def event(self, received: bytes = b"", values: Mapping[str, float] | None = None, *, ticks: bool = False) -> bytes:
        """Handle one event between two steps and return the operations to send."""
        self.slave.fmu.enterEventMode()
        return self.finish_event(received, values, ticks=ticks)

    def finish_event(self, received: bytes = b"", values: Mapping[str, float] | None = None, *, ticks: bool = False) -> bytes:
        self.slave.set(values or {})
        if ticks:
            self.tick()
        sent = self.operations()
        if received:
            self.receive(received)
        self.leave_event()
        return sent


@dataclass
class Bus:
    """The bus. `frames` are those on the wire, with their times at its end in s.

    Attributes:
        bit_rate: bits per second; None: frames take no time.
        fails: returns whether a transmission ends with a bus error.
    """

    nodes: Sequence[Node]
    bit_rate: float | None = 500e3
    fails: Callable[[Frame, int], bool] = lambda frame, number: False
    notifies: bool = False
    frames: list[Frame] = field(default_factory=list)
    configuration: dict[tuple[int, int], int] = field(default_factory=dict)
    statuses: list[tuple[int, int]] = field(default_factory=list)
    errors: list[bytes] = field(default_factory=list)
    free_at: int = 0  # us
    waiting: list[tuple[int, Frame]] = field(default_factory=list)
    moving: tuple[int, Frame] | None = None
    count: int = 0

    def accept(self, sender: int, content: bytes) -> None:
        """Accept the operations of a node."""
        for code, data in operations(content):
            if code == TRANSMIT:
                self.waiting.append((sender, frame_of(data)))
            elif code == FD_TRANSMIT:
                self.waiting.append((sender, fd_frame_of(data)))
            elif code == CONFIGURATION:
                self.configuration[sender, data[0]] = int.from_bytes(data[1:], "little")
            elif code == STATUS:
                self.statuses.append((sender, data[0]))
            else:
                assert code == FORMAT_ERROR
                self.errors.append(data)

    def begin(self, now: int) -> None:
        """Start the next transmission, if the bus is free."""
        if self.moving is None and self.waiting:
            self.moving = min(self.waiting, key=lambda each: each[1].id)  # of two that are equal, the older one
            self.waiting.remove(self.moving)
            bits = FRAME_BITS + 8 * len(self.moving[1].data)
            self.free_at = now + (round(bits / self.bit_rate / MICROSECOND) if self.bit_rate else 0)

    def end(self, now: int) -> dict[int, bytes]:
        """End the present transmission and return the operations for each node."""
        assert self.moving is not None
        sender, frame = self.moving
        self.moving = None
        failed, self.count = self.fails(frame, self.count), self.count + 1
        if failed:
            return {k: bus_error(frame.id, 4, 1 if k == sender else 2, k == sender) for k in range(len(self.nodes))}
        self.frames.append(replace(frame, time=now * MICROSECOND))
        found = {k: transmit(frame) for k in range(len(self.nodes)) if k != sender}
        return {**found, sender: confirm(frame.id)} if self.notifies else found


def simulate(bus: Bus, duration: float, step: float, values: Callable[[int, float], Mapping[str, float]]) -> None:
    """Simulate initialised nodes. `values` returns the inputs of a node at a time in s.

    All nodes step together to the next multiple of `step`, the end of a transmission, or the next tick of a clock of a task,
    whichever comes first.
    """
    now, grid, stop = 0, round(step / MICROSECOND), round(duration / MICROSECOND)
    for number, node in enumerate(bus.nodes):
        bus.accept(number, node.finish_event(values=values(number, 0.0), ticks=node.next_tick == now))
    while True:
        bus.begin(now)
        while bus.moving is not None and bus.free_at == now:
            for number, content in bus.end(now).items():
                bus.accept(number, bus.nodes[number].event(content))
            bus.begin(now)
        if now == stop:
            return
        following = (now // grid + 1) * grid
        following = min(following, bus.free_at) if bus.moving is not None else following
        following = min([following, *(node.next_tick for node in bus.nodes if node.next_tick is not None)])
        for number, node in enumerate(bus.nodes):
            node.slave.set(values(number, now * MICROSECOND))
            node.slave.step((following - now) * MICROSECOND)
        now = following
        for number, node in enumerate(bus.nodes):
            ticks = node.next_tick == now
            if node.slave.has_event or ticks:
                bus.accept(number, node.event(values=values(number, now * MICROSECOND), ticks=ticks))
