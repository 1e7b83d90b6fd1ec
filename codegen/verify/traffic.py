"""CAN frames for the cyclic task, cycle by cycle: those of a whole scenario, and traffic with all kinds of bus faults."""

from __future__ import annotations

import random
from collections.abc import Collection, Sequence
from dataclasses import replace

from codegen.configuration import Config
from codegen.configuration.can import Can
from codegen.errors import CodegenError
from codegen.sil.software import Measurement, Software
from hil_sim.codec import Codec, Frame, VehicleConditions, VehicleMotion, frame_of
from hil_sim.e2e import next_counter, protect
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import DEFAULT_SCENARIO, SCENARIOS

Cycle = tuple[Frame, ...]

FRAMES = 4
"""Maximum frames of a cycle."""

EPISODE = (5, 60)
"""Cycles of one kind of traffic: shortest and longest."""

RESTART = 0.002
"""Probability that the task is initialised before a cycle."""

STANDING = {"standing car": 0.0, "standing car that turns": 2.0}
"""Yaw rate in rad/s that a standing car reports, by kind of traffic."""
SHARES = dict.fromkeys((*STANDING, "silent", "half", "late", "garbage"), 1) | {"good": 6, "noisy": 3, "random payload": 3}
"""Relative frequency of each kind of traffic."""

FAULT = 0.15
"""Probability of a fault for a frame of noisy traffic."""


GAPS, RECOVERY = (1, 2, 12, 40), 25
"""Lengths of the gaps of a directed drive, from one lost frame to the fail-safe, and the cycles after each."""
ANGLES = (1.0, 0.5, 1.3)
"""Measured rear angles of a directed drive, in turn, over the recorded ones: the actuator moves while the bus is silent."""
INHIBITED, LOST_EVERY = 40, 8
"""Cycles with Inhibit of a directed drive, and those from one lost frame to the next: the message stays valid."""


def frames_of(can: Can, codec: Codec, counter: int, sample: Measurement) -> Cycle:
    """Return the protected frames of a cycle, with the signals that the controller uses."""
    motion = VehicleMotion(sample.speed, sample.front_angle, sample.yaw_rate)
    conditions = VehicleConditions(
        sample.rear_angle, sample.friction, sample.lateral_acceleration, sample.inhibit, sample.longitudinal_acceleration
    )
    sent = ((can.vehicle_motion, motion), (can.vehicle_conditions, conditions))
    return tuple(
        Frame(each.id, protect(each.e2e_data_id, counter, codec.encode(contents), can.e2e.definition))
        for each, contents in sent
    )


def closed_loop(software: Software) -> tuple[str, list[Cycle]]:
    """Run a scenario in closed loop with the task on this machine. Return its name and the frames of the car in each cycle.

    The scenario is the step steer, or the first one that this car can drive.
    """
    for name in (DEFAULT_SCENARIO, *SCENARIOS):
        try:
            node = PlantNode(software.config, SCENARIOS[name], precision=software.precision)
        except CodegenError:
            continue
        task, cycles = software.task(), []
        for cycle in range(node.cycles):
            frames = tuple(node.outgoing(cycle))
            for frame in frames:
                task.on_can_frame(frame.id, frame.data)
            node.receive(frame_of(software.config.can, *task.run()))
            node.finish(cycle)
            cycles.append(frames)
        return name, cycles
    return "", []


def disturbed(config: Config, recorded: Sequence[Cycle], count: int, seed: int = 0) -> list[Cycle]:
    """Return cycles with good, damaged, lost, repeated and foreign frames, and valid ones with arbitrary content."""
    return _Traffic(config, recorded, seed).cycles(count)


def directed(config: Config, recorded: Sequence[Cycle]) -> list[Cycle]:
    """Return a recorded drive with gaps of each message and of both, frames of wrong length, and Inhibit with lost frames.

    No cycle if nothing was recorded.
    """
    return _Traffic(config, recorded, 0).directed() if recorded else []


def restarts_of(count: int, seed: int = 0) -> list[int]:
    """Return the cycles before which the task is initialised: the first, and a few more."""
    generator = random.Random(seed)
    return [cycle for cycle in range(count) if cycle == 0 or generator.random() < RESTART]


class _Traffic:
    """Frames of a car on a faulty bus."""

    def __init__(self, config: Config, recorded: Sequence[Cycle], seed: int) -> None:
        messages = (config.can.vehicle_motion, config.can.vehicle_conditions)
        self._data_ids = {message.id: message.e2e_data_id for message in messages}
        self._profile, self._frame_bytes = config.can.e2e.definition, config.can.frame_bytes
        self._counters = dict.fromkeys(self._data_ids, 0)
        self._random = random.Random(seed)
        self._recorded = [cycle for cycle in recorded if len(cycle) == len(messages)]
        self._codec = codec = Codec(config.can)
        self._standing = {}
        for kind, yaw_rate in STANDING.items():
            contents = (codec.encode(VehicleMotion(0.0, 0.0, yaw_rate)), codec.encode(VehicleConditions(0.0)))
            self._standing[kind] = {message.id: data for message, data in zip(messages, contents, strict=True)}

    def cycles(self, count: int) -> list[Cycle]:
        found: list[Cycle] = []
        kinds, weights = list(SHARES), list(SHARES.values())
        while len(found) < count:
            (kind,) = self._random.choices(kinds, weights)
            length = self._random.randint(*EPISODE)
            start = self._random.randrange(max(len(self._recorded) - length, 1)) if self._recorded else 0
            found += [self._cycle(kind, start + place) for place in range(length)]
        return found[:count]

    def directed(self) -> list[Cycle]:
        found: list[Cycle] = []
        motion, conditions = self._data_ids
        both, none = (motion, conditions), ()

        def drive(count: int, lost: Collection[int] = none, *, short: Collection[int] = none, inhibit: bool = False) -> None:
            for _ in range(count):
                frames = [self._recorded_frame(each, len(found), factor, inhibit) for each in both]
                frames = [replace(each, data=each.data[:-1]) if each.id in short else each for each in frames]
                found.append(tuple(each for each in frames if each.id not in lost))

        events = [(length, lost) for length in GAPS for lost in ((motion,), (conditions,), both)]
        factor = ANGLES[0]
        drive(RECOVERY)
        for number in range(INHIBITED):  # first, while the actuator still follows
            drive(1, (conditions,) if number % LOST_EVERY == LOST_EVERY - 1 else none, inhibit=True)
        drive(RECOVERY)
        for number, (length, lost) in enumerate(events):
            drive(length, lost)
            factor = ANGLES[(number + 1) % len(ANGLES)]
            drive(RECOVERY)
        factor = ANGLES[0]
        for short in ((motion,), (conditions,), both):
            drive(1, short=short)
            drive(RECOVERY)
        return found

    def _recorded_frame(self, identifier: int, place: int, factor: float, inhibit: bool) -> Frame:
        """Return a frame of the recorded turn with the next counter, and with another rear angle and Inhibit if it has them."""
        turn = self._recorded[len(self._recorded) * 2 // 3 :]
        data = next(frame.data for frame in turn[place % len(turn)] if frame.id == identifier)
        contents = self._codec.decode(identifier, data)
        if isinstance(contents, VehicleConditions):
            changed = replace(contents, rear_angle=factor * contents.rear_angle, inhibit=inhibit or contents.inhibit)
            data = self._codec.encode(changed)
        return self._protected(identifier, data)

    def _cycle(self, kind: str, place: int) -> Cycle:
        if kind == "garbage":
            return tuple(self._garbage() for _ in range(self._random.randint(0, FRAMES)))
        sets = 2 if kind == "late" else 1  # of frames since the last cycle of the task
        frames = [self._frame(identifier, kind, place) for _ in range(sets) for identifier in self._data_ids]
        if kind == "silent":
            frames = []
        elif kind == "half":
            frames = [self._random.choice(frames)]
        elif kind == "noisy":
            frames = [changed for frame in frames for changed in self._faulty(frame)]
            if self._random.random() < FAULT:
                self._random.shuffle(frames)
        return tuple(frames[:FRAMES])

    def _frame(self, identifier: int, kind: str, place: int) -> Frame:
        """Return the next protected frame of a message: recorded, of a standing car, or with arbitrary content."""
        data = self._random.randbytes(self._frame_bytes)
        if kind in STANDING:
            data = self._standing[kind][identifier]
        elif self._recorded and kind != "random payload":
            cycle = self._recorded[place % len(self._recorded)]
            data = next((frame.data for frame in cycle if frame.id == identifier), data)
        return self._protected(identifier, data)

    def _protected(self, identifier: int, data: bytes) -> Frame:
        """Return the frame with the next counter of its message."""
        counter = self._counters[identifier]
        self._counters[identifier] = next_counter(counter, self._profile)
        return Frame(identifier, protect(self._data_ids[identifier], counter, data, self._profile))

    def _faulty(self, frame: Frame) -> list[Frame]:
        if self._random.random() >= FAULT:
            return [frame]
        fault = self._random.randrange(7)
        if fault == 0:
            return []
        if fault == 1:
            return [frame, frame]
        if fault == 2:  # one bit, anywhere
            number = int.from_bytes(frame.data, "little") ^ 1 << self._random.randrange(8 * self._frame_bytes)
            return [Frame(frame.id, number.to_bytes(self._frame_bytes, "little"))]
        if fault == 3:
            return [Frame(frame.id, frame.data[: self._random.randrange(self._frame_bytes)])]
        if fault == 4:
            return [self._garbage(), frame]
        if fault == 5:  # under the other message's identifier
            return [Frame(self._random.choice(list(self._data_ids)), frame.data)]
        counter = self._random.randrange(self._profile.counter_count)
        self._counters[frame.id] = next_counter(counter, self._profile)
        return [Frame(frame.id, protect(self._data_ids[frame.id], counter, frame.data, self._profile))]

    def _garbage(self) -> Frame:
        """Return a frame with arbitrary content and id."""
        identifier = self._random.choice([*self._data_ids, self._random.getrandbits(32)])
        return Frame(identifier, self._random.randbytes(self._frame_bytes))
