"""Faults on the bus: their entries in a scenario, and their effect on frames and signals."""

from __future__ import annotations

import math
import random
import sys
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from codegen.configuration.can import Can, Message, RealSignal
from codegen.errors import CodegenError, suggestion
from hil_sim.codec import Frame
from hil_sim.e2e import protect, received_counter

FaultKind = Literal[
    "drop",
    "delay",
    "duplicate",
    "reorder",
    "burst",
    "corrupt",
    "freeze-counter",
    "stuck-value",
    "not-a-number",
    "infinity",
    "offset",
    "noise",
    "foreign-traffic",
    "ecu-restart",
    "plant-restart",
    "bus-down",
]


@dataclass(frozen=True)
class Fault:
    """One fault of a scenario.

    Attributes:
        kind: kind of the fault.
        start, duration: s.
        message: name of the affected message; None for all of the plant's, or if not applicable.
        signal: affected field of that message ("speed", "yaw_rate", ...), for faults of values.
        cycles: number of cycles by which frames are delayed.
        amount: of an offset, or standard deviation of a noise, in SI units of the signal.
    """

    kind: FaultKind
    start: float
    duration: float
    message: str | None = None
    signal: str | None = None
    cycles: int = 0
    amount: float = 0.0


ADDED_KINDS: frozenset[str] = frozenset({"offset", "noise"})
"""Faults that add to a value."""
VALUE_KINDS: frozenset[str] = frozenset({"stuck-value", "not-a-number", "infinity"}) | ADDED_KINDS
"""Faults of a value, before packing."""
FRAME_KINDS: frozenset[str] = frozenset({"drop", "delay", "duplicate", "reorder", "burst", "corrupt", "freeze-counter"})
"""Faults of frames: of one message, or of all that the car sends."""
HELD_PLACES: Mapping[str, int] = {"reorder": sys.maxsize, "burst": 0}
"""Faults that hold every second frame for a cycle -> its new place: behind its successor, or before it."""

FRAME_BITS_MAX = 135
"""Bits on the wire of a frame with eight bytes and an 11-bit identifier: 111 with the interframe space, and at most 24 stuff
bits (ISO 11898-1)."""


class Injector:
    """The faults of one run, between car and bus.

    Args:
        faults: faults of the scenario.
        can: names and identifiers of the messages.
        sampling_time: duration of a cycle in s.
        seed: seed of the flipped bits and of the noise.

    Raises:
        CodegenError: a fault names an unknown message or signal, or one that its kind does not affect.
    """

    def __init__(self, faults: Sequence[Fault], can: Can, sampling_time: float, seed: int = 0) -> None:
        self.faults = tuple(faults)
        self._can, self._sampling_time = can, sampling_time
        self._random = random.Random(seed)
        self._messages = {message.name: message for message in can.messages().values()}
        for fault in self.faults:
            _check(fault, self._messages, can.rear_steer_command.name)
        self._stuck: dict[tuple[int, str], float] = {}
        self._frozen: dict[tuple[int, int], int] = {}
        self._later: list[tuple[int, Frame]] = []
        self._held: dict[int, tuple[int, Frame]] = {}

    def _active(self, cycle: int, kinds: Iterable[str]) -> list[tuple[int, Fault]]:
        now = cycle * self._sampling_time
        tolerance = 1e-6 * self._sampling_time
        return [
            (index, fault)
            for index, fault in enumerate(self.faults)
            if fault.kind in kinds and fault.start - tolerance <= now < fault.start + fault.duration - tolerance
        ]

    def ecu_off(self, cycle: int) -> bool:
        """Return whether the ECU has no power."""
        return bool(self._active(cycle, ("ecu-restart",)))

    def plant_off(self, cycle: int) -> bool:
        """Return whether the car's node has no power; the car drives on."""
        return bool(self._active(cycle, ("plant-restart",)))

    def bus_down(self, cycle: int) -> bool:
        """Return whether the bus is down."""
        return bool(self._active(cycle, ("bus-down",)))

    def signals(self, cycle: int, message: str, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values of a message with the active faults, before packing."""
        result = dict(values)
        for index, fault in self._active(cycle, VALUE_KINDS):
            if fault.message not in (None, message):
                continue
            for name in values if fault.signal is None else [fault.signal]:
                if name not in values:
                    continue
                if fault.kind == "stuck-value":
                    result[name] = self._stuck.setdefault((index, name), values[name])
                elif fault.kind in ADDED_KINDS:
                    result[name] += fault.amount if fault.kind == "offset" else self._random.gauss(0.0, fault.amount)
                else:
                    result[name] = math.nan if fault.kind == "not-a-number" else math.inf
        return result

    def outgoing(self, cycle: int, frames: Sequence[Frame]) -> list[Frame]:
        """Apply the faults to the frames that the car's node sends."""
        sent = self._through(cycle, frames, from_car=True)
        if self.bus_down(cycle):
            return []
        return self._among_strangers(sent) if self._active(cycle, ("foreign-traffic",)) else sent

    def incoming(self, cycle: int, frames: Sequence[Frame]) -> list[Frame]:
        """Apply the faults to the ECU's frames that the car's node receives."""
        received = self._through(cycle, frames, from_car=False)
        return [] if self.bus_down(cycle) else received

    def _through(self, cycle: int, frames: Sequence[Frame], *, from_car: bool) -> list[Frame]:
        command = self._can.rear_steer_command.id
        is_due = [time <= cycle and (frame.id != command) == from_car for time, frame in self._later]
        due = [frame for (_, frame), now in zip(self._later, is_due, strict=True) if now]
        self._later = [entry for entry, now in zip(self._later, is_due, strict=True) if not now]
        for frame in frames:
            due += self._changed(cycle, frame)
        return due

    def _changed(self, cycle: int, frame: Frame) -> list[Frame]:
        """Return the frames that one frame becomes in this cycle."""
        result = [frame]
        active = [pair for pair in self._active(cycle, FRAME_KINDS) if self._concerns(pair[1], frame)]
        if not any(fault.kind in HELD_PLACES for _, fault in active) and frame.id in self._held:
            result.insert(*self._held.pop(frame.id))
        for index, fault in active:
            if fault.kind == "drop":
                result = []
            elif fault.kind == "duplicate":
                result = [copy for one in result for copy in (one, one)]
            elif fault.kind == "delay":
                self._later += [(cycle + fault.cycles, one) for one in result]
                result = []
            elif fault.kind in HELD_PLACES:
                if frame.id in self._held:
                    result.insert(*self._held.pop(frame.id))
                elif result:
                    self._held[frame.id] = HELD_PLACES[fault.kind], result.pop()
            elif fault.kind == "corrupt":
                result = [self._flipped(one) for one in result]
            else:
                result = [self._frozen_counter(index, one) for one in result]
        return result

    def _concerns(self, fault: Fault, frame: Frame) -> bool:
        if fault.message is None:
            return frame.id != self._can.rear_steer_command.id
        return self._messages[fault.message].id == frame.id

    def _flipped(self, frame: Frame) -> Frame:
        bit = self._random.randrange(8 * len(frame.data))
        data = bytearray(frame.data)
        data[bit // 8] ^= 1 << bit % 8
        return replace(frame, data=bytes(data))

    def _frozen_counter(self, index: int, frame: Frame) -> Frame:
        """Repeat the counter with a correct CRC: the sender hangs, its protection does not."""
        message, profile = next(each for each in self._messages.values() if each.id == frame.id), self._can.e2e.definition
        counter = self._frozen.setdefault(
            (index, frame.id), (received_counter(frame.data, profile) - 1) % profile.counter_count
        )  # previous
        return replace(frame, data=protect(message.e2e_data_id, counter, frame.data, profile))

    def _among_strangers(self, frames: Sequence[Frame]) -> list[Frame]:
        """Add as many foreign frames as the bus has room for in a cycle, of higher and lower priority."""
        room = int(self._sampling_time * self._can.bitrate_kbit_s * 1e3 / FRAME_BITS_MAX) - len(frames) - 1
        own = {message.id for message in self._messages.values()}
        ids = [number for number in (0x001, 0x0FF, 0x300, 0x7FE) if number not in own]
        strangers = []
        for number in range(max(room, 0)):
            extended = number % 7 == 6
            identifier = (
                next(number for number in (one ^ 0x10000 for one in own) if number not in own)
                if extended
                else ids[number % len(ids)]
            )
            data = self._random.randbytes(8)
            strangers.append(Frame(identifier, data, extended=extended, remote=number % 11 == 10))
        middle = len(strangers) // 2
        return [*strangers[:middle], *frames, *strangers[middle:]]


def _check(fault: Fault, messages: Mapping[str, Message], command: str) -> None:
    of_values = fault.kind in VALUE_KINDS
    if fault.message is not None and not of_values and fault.kind not in FRAME_KINDS:
        raise CodegenError(f"a fault {fault.kind} takes no message", where="faults", remedy="remove it")
    if fault.signal is not None and not of_values:
        raise CodegenError(f"a fault {fault.kind} takes no signal", where="faults", remedy="remove it")
    if fault.message == command and of_values:
        what = f"a fault {fault.kind} acts on what the car sends, and {command} is the controller's"
        raise CodegenError(what, where="faults", remedy="name a message of the car")
    if fault.kind == "delay" and fault.cycles < 1:
        raise CodegenError(f"a fault delay of {fault.cycles} cycles", where="faults", remedy="give at least 1")
    if fault.kind in ADDED_KINDS and not (math.isfinite(fault.amount) and fault.amount):
        what = f"a fault {fault.kind} of the amount {fault.amount:g}"
        raise CodegenError(what, where="faults", remedy="give a finite one that is not zero")
    if fault.message is not None and fault.message not in messages:
        raise _unknown("message", fault.message, messages)
    if fault.signal is not None:
        chosen = [messages[fault.message]] if fault.message is not None else list(messages.values())
        known = [role for message in chosen for role, signal in message.signals().items() if isinstance(signal, RealSignal)]
        if fault.signal not in known:
            raise _unknown("signal", fault.signal, known)


def _unknown(what: str, name: str, known: Collection[str]) -> CodegenError:
    remedy = f"known: {', '.join(known)}{suggestion(name, known)}"
    return CodegenError(f"a fault names the unknown {what} {name!r}", where="faults", remedy=remedy)
