"""Drives that bring counters to their limits: inputs held for an hour, and inputs chosen by the state.

A drive of an hour is a few samples that repeat. The lengths of losses lie around the powers of two at which a
counter would overflow.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from codegen.sil.software import Measurement, Software
from codegen.verify.traffic import Cycle, frames_of
from codegen.verify.unit_drives import Drive, Stretch, feedback_speeds
from hil_sim.codec import Codec, Frame

HOUR_S = 3_600.0
OVERFLOW = 70_000
"""Samples after which every 16-bit counter has overflowed; used where the C of an hour takes long."""
BYTE, WORD = 2**8, 2**16
"""Numbers of samples at which counters overflow."""
AROUND = range(-1, 6)
"""Lengths of a loss, relative to an overflow. A counter may begin with the loss or after the tolerated samples."""
SPEED_M_S = 8.0
YAW_RATE_NOISE = (0.0, 1e-3, 2e-3)
"""Changes of the yaw rate in rad/s. A constant yaw rate counts as frozen."""
NAN = math.nan
NOTHING = Measurement(NAN, NAN, NAN)
STANDING = Measurement(0.0, 0.0, 0.0)
SIGNALS = ("speed", "front_angle", "yaw_rate")
FRONT_AND_YAW = SIGNALS[1:]
"""Signals without which the fail-safe acts."""
COUNTS = {"missing_samples_max": 100, "recovery_samples": 300}
"""Limits of the counters beyond eight bits and far above those of drawn parameters."""
SILENCES = range(1, 19)
"""Lengths of silence on the bus, in cycles: the counters of the receiver saturate at 14."""
COUNTER_STEPS = 15
"""Steps of the counter after a silence: all of profile 1, and those around the window of the others."""
FRAME_COUNTS = (255, 256, 257)
"""Frames of one message in a cycle, around the overflow of eight bits."""
DAMAGED, SILENT = -2, -1
"""Samples of the receiver besides the advance of the sender's counter since the last frame."""
MEASURED = 0
"""Source of a signal that is measured, in the C."""


@dataclass(frozen=True)
class LongDrives:
    """Long drives of a build.

    Attributes:
        software: the compiled C.
        turn: plausible turn at a speed in m/s.
    """

    software: Software
    turn: Callable[[float], Measurement]
    is_quick: bool

    def drives(self) -> Iterator[Drive]:
        """Yield all drives."""
        yield from self._controllers()
        yield from self._inputs()
        yield from self._limiters()
        yield from self._receivers()
        yield from self._tasks()

    @property
    def _turning(self) -> list[Measurement]:
        turn = self.turn(max(SPEED_M_S, 1.2 * feedback_speeds(self.software.parameters())[1]))
        return [replace(turn, yaw_rate=turn.yaw_rate + noise) for noise in YAW_RATE_NOISE]

    @property
    def _hour(self) -> int:
        return round(HOUR_S / self.software.config.controller.sampling_time_s)

    def _controllers(self) -> Iterator[Drive]:
        parameters = self.software.parameters()
        limits = parameters.inputs
        turning, nothing, tolerated = self._turning, [NOTHING], limits.missing_samples_max
        lost = _without(turning[0], FRONT_AND_YAW)
        recovery = Stretch(turning, limits.recovery_samples)
        held = {
            "no signal": nothing,
            "neither front angle nor yaw rate": [lost],
            "no yaw rate": [replace(turning[0], yaw_rate=math.inf)],
            "losses as long as tolerated": [lost] * tolerated + [*turning] * max(tolerated, 1),
            "recoveries too short by one": [lost] * (tolerated + 1)
            + [*itertools.islice(itertools.cycle(turning), limits.recovery_samples - 1)],
            "a turn": turning,
            "an inhibited turn": [replace(sample, inhibit=True) for sample in turning],
        }
        for name in [*held][:2] if self.is_quick else held:
            samples = held[name]
            stretches = (recovery, Stretch(samples, self._hour // len(samples)), recovery, Stretch(turning, 20))
            yield Drive(f"an hour of {name}", "controller", parameters, stretches)
        yield Drive("an hour at standstill", "controller", parameters, (Stretch([STANDING], self._hour), recovery))
        directed = self._directed(parameters, 400 if self.is_quick else 2_000)
        yield Drive("losses up to the limits", "controller", parameters, (Stretch(directed),))

    def _inputs(self) -> Iterator[Drive]:
        turning = self._turning
        lost = [_without(turning[0], FRONT_AND_YAW)]
        for counts in ({}, COUNTS):
            parameters = self.software.parameters()
            for name, value in counts.items():
                setattr(parameters.inputs, name, value)
            recovery = parameters.inputs.recovery_samples
            overflows = (BYTE,) if counts or self.is_quick else (BYTE, WORD)
            stretches = [Stretch(turning, recovery)]
            for overflow, around in itertools.product(overflows, AROUND):
                stretches += [Stretch(lost, overflow + around), Stretch(turning, recovery // 2 + 1)]
            name = f"recovery after {recovery} samples"
            yield Drive(f"losses around overflows, {name}", "inputs", parameters, stretches)
            directed = self._directed(parameters, 1_500 if self.is_quick else 5_000)
            yield Drive(f"input losses up to the limits, {name}", "inputs", parameters, (Stretch(directed),))
        parameters = self.software.parameters()
        subsets = [names for count in (1, 2, 3) for names in itertools.combinations(SIGNALS, count)]
        for names in () if self.is_quick else subsets:
            samples = [_without(sample, names) for sample in turning]
            stretches = [Stretch(turning, 10), Stretch(samples, OVERFLOW // len(samples)), Stretch(turning, 20)]
            yield Drive(f"no {', '.join(names)}", "inputs", parameters, stretches)

    def _directed(self, parameters: Any, count: int) -> list[Measurement]:
        """Return samples in which each signal is lost and returns. Whether a loss or a recovery goes on is drawn anew where
        one more sample would reach a limit."""
        generator = np.random.default_rng(7)
        controller = self.software.controller(0.0, parameters)
        is_lost, samples = dict.fromkeys(SIGNALS, False), []
        for sample in itertools.islice(itertools.cycle(self._turning), count):
            for name in SIGNALS:
                at_limit = _is_at_limit(getattr(controller.state.inputs, name), parameters.inputs)
                if generator.random() < (0.5 if at_limit else 0.01):
                    is_lost[name] = not is_lost[name]
            samples.append(_without(sample, [name for name in SIGNALS if is_lost[name]]))
            controller.step(samples[-1])
        return samples

    def _limiters(self) -> Iterator[Drive]:
        parameters = self.software.parameters()
        cases = {
            "demand": (SPEED_M_S, 0.05, NAN),
            "speed": (NAN, 0.05, 0.02),
            "input": (NAN, NAN, NAN),
        }
        begin, end = Stretch([(SPEED_M_S, 0.05, 0.03)], 100), Stretch([(SPEED_M_S, -0.05, -0.03)], 100)
        for name, sample in cases.items():
            stretches = (begin, Stretch([sample], OVERFLOW), end)
            yield Drive(f"limiter without {name}", "limiter", parameters, stretches, 0.01)

    def _receivers(self) -> Iterator[Drive]:
        good, around = Stretch([1], 8), [BYTE + each for each in AROUND]
        long = [WORD + each for each in AROUND][:: 6 if self.is_quick else 1]
        silences = [(length, step) for length in (*SILENCES, *around) for step in range(COUNTER_STEPS)]
        cases = {
            "silence": (SILENT, [*silences, *((length, 1) for length in long)]),
            "damaged frames": (DAMAGED, [(length, 1) for length in (*SILENCES, *around, OVERFLOW)]),
            "repeated frames": (0, [(length, 1) for length in (*SILENCES, *around, OVERFLOW)]),
        }
        for name in [*cases][:1] if self.is_quick else cases:
            sample, losses = cases[name]
            stretches = [good]
            for length, step in losses:
                stretches += [Stretch([sample], length), Stretch([step]), good]
            yield Drive(f"E2E, {name}", "receiver", None, stretches)

    def _tasks(self) -> Iterator[Drive]:
        parameters = self.software.parameters()
        limits, bus = parameters.inputs, _Bus(self.software, STANDING)
        wait = limits.recovery_samples + 10
        held: dict[str, list[Cycle]] = {
            "silence": [()],
            "damaged frames": [bus.damaged],
            "repeated frames": [bus.cycle(0)],
            "a stuck actuator": bus.cycles(rear_angle=-0.05),
            "two periods in a call": [(*bus.cycle(k), *bus.cycle(k + 1)) for k in range(0, 2 * bus.counters, 2)],
            "a disturbed bus": [each for k in range(0, 2 * bus.counters, 2) for each in (bus.cycle(k), ())],
            "an impossible rear angle": bus.cycles(rear_angle=1.5 * limits.rear_angle_max),
        }
        for name in [*held][:1] if self.is_quick else held:
            cycles = held[name]
            count = self._hour if name == "silence" and not self.is_quick else OVERFLOW
            begin = () if name == "an impossible rear angle" else (Stretch(bus.cycles(count=wait)),)
            stretches = (*begin, Stretch(cycles, count // len(cycles)), Stretch(bus.cycles(count=wait, first=wait)))
            yield Drive(f"task, {name}", "task", parameters, stretches)
        moving = _Bus(self.software, self.turn(SPEED_M_S))
        limits_of_task = [*self._bus_limits(moving, parameters)]
        yield Drive("task, limits of its counters", "task", parameters, (Stretch(limits_of_task),))

    def _bus_limits(self, bus: _Bus, parameters: Any) -> Iterator[Cycle]:
        """Yield cycles that bring each counter of the task to its limit and back."""
        recovery, most = parameters.inputs.recovery_samples, parameters.actuator_samples_max
        impossible = 1.5 * parameters.inputs.rear_angle_max
        counter = 0

        def good(count: int, rear_angle: float = 0.0) -> Iterator[Cycle]:
            nonlocal counter
            for _ in range(count):
                yield bus.cycle(counter, rear_angle)
                counter += 1

        # The start waits for a rear angle.
        yield from good(3 + recovery // 2, NAN)
        yield from good(1, impossible)
        yield from good(recovery, NAN)
        yield from good(1, impossible)
        yield from good(recovery + 2, NAN)
        for difference in (-1, 0, 1):
            yield from good(most + difference, -0.05 if difference else 0.05)
            yield from good(most + 3)
        for count in FRAME_COUNTS:
            yield tuple(bus.cycle(counter)[0] for _ in range(count))
            counter += 1
            yield from good(10)
        for late in (3, 4, 5, 6, 7, 8):
            yield tuple(itertools.chain(*good(late)))
            yield from good(70)
        for disturbances in (3, 4, 5, 6, 7, 8):
            for _ in range(disturbances):
                counter += 1
                yield ()
                yield from good(1)
            yield from good(60)
        generator = np.random.default_rng(8)
        for silence in [*SILENCES][:: 4 if self.is_quick else 1]:
            for step in generator.integers(COUNTER_STEPS, size=2).tolist():
                yield from [()] * silence
                counter += step
                yield from good(10)


def _without(sample: Measurement, names: Sequence[str]) -> Measurement:
    lost: dict[str, Any] = dict.fromkeys(names, NAN)
    return replace(sample, **lost)


def _is_at_limit(signal: Any, limits: Any) -> bool:
    if signal.source == MEASURED:
        return bool(signal.missing >= limits.missing_samples_max - 1)
    return bool(signal.good >= limits.recovery_samples - 2)


class _Bus:
    """Frames of a car whose motion is constant but for noise."""

    def __init__(self, software: Software, motion: Measurement) -> None:
        self._can, self._motion = software.config.can, motion
        self._codec = Codec(self._can, software.precision)
        self.counters = self._can.e2e.definition.counter_count

    def cycle(self, number: int, rear_angle: float = 0.0) -> Cycle:
        """Return both frames with the counter of a cycle."""
        yaw_rate = self._motion.yaw_rate + YAW_RATE_NOISE[number % len(YAW_RATE_NOISE)]
        sample = replace(self._motion, yaw_rate=yaw_rate, rear_angle=rear_angle)
        return frames_of(self._can, self._codec, number % self.counters, sample)

    def cycles(self, rear_angle: float = 0.0, count: int | None = None, first: int = 0) -> list[Cycle]:
        """Return consecutive cycles; the default number can be repeated."""
        return [self.cycle(first + number, rear_angle) for number in range(self.counters if count is None else count)]

    @property
    def damaged(self) -> Cycle:
        """Frames with a wrong CRC."""
        return tuple(Frame(frame.id, bytes((frame.data[0] ^ 1, *frame.data[1:]))) for frame in self.cycle(0))
