"""Multiple shooting: drives cut into segments, their inputs between the samples, and the simulation of one problem."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IntArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.identify.drive import Drive
from codegen.identify.model import (
    ACTUATOR_PARAMETERS,
    OUTPUTS,
    VEHICLE_PARAMETERS,
    ShootingModel,
    actuator_model,
    vehicle_constants,
    vehicle_model,
)
from codegen.identify.parameters import Prior
from codegen.identify.simulate import Simulation

SPEED_MIN = 3.0
"""Lowest speed in m/s of the samples that are used: slip angles have no meaning at rest."""
SEGMENT_S, SEGMENT_MIN_S = 4.0, 1.0
"""Length of a segment in s: many times the settling time of a car; and the shortest that is used."""
SETTLING_S = 0.2
"""Time in s at the start of a segment that is not compared where tyres have a relaxation length, because their initial slip is
taken as steady."""
STEP_STABLE = 1.0
"""Largest product of an integration step and a rate of the model. Runge-Kutta is stable up to 2.8; at 1 its error is below 1 %
of a transient of that rate."""
AVERAGE_S = 0.05
"""Time in s over which errors of the car are averaged. The lateral acceleration of tyres without relaxation length follows the
noise of the measured angles at once. So do its derivatives, which would lower the stiffnesses by 0.5 %."""
ACTUATOR_STEP_S = 0.002
"""Longest integration step of the actuator in s: the shortest lag."""


@dataclass(frozen=True, eq=False)
class DriveSamples:
    """All drives one after the other.

    Attributes:
        step: s, between samples.
        names: names of the drives.
        begin: (drives + 1,) first sample of each drive, and their number.
        signals: quantity -> (n,), NaN where unknown or not measured.
    """

    step: float
    names: tuple[str, ...]
    begin: IntArray
    signals: dict[str, FloatArray]

    @classmethod
    def of(cls, drives: Sequence[Drive]) -> DriveSamples:
        """Return the samples of some drives.

        Raises:
            CodegenError: they have different sampling times, or no samples.
        """
        if not drives:
            raise CodegenError("there is no drive", where="identify", remedy="name a log")
        for drive in drives:
            if drive.time.size < 2:
                raise CodegenError("has fewer than two samples", where=drive.name, remedy="record a longer drive")
        steps = [float(np.diff(drive.time).mean()) for drive in drives]
        for drive, step in zip(drives, steps, strict=True):
            if abs(step - steps[0]) > 1e-3 * steps[0]:
                what = f"has a sample every {1e3 * step:.4g} ms, and {drives[0].name} every {1e3 * steps[0]:.4g} ms"
                raise CodegenError(what, where=drive.name, remedy="resample all drives to one rate")
        known = {name for drive in drives for name in drive.signals}
        signals = {
            name: np.concatenate([drive.signals.get(name, np.full(drive.time.size, math.nan)) for drive in drives])
            for name in known
        }
        begin = np.concatenate([[0], np.cumsum([drive.time.size for drive in drives])])
        return cls(steps[0], tuple(drive.name for drive in drives), begin, signals)

    def __len__(self) -> int:
        return int(self.begin[-1])

    def signal(self, name: str) -> FloatArray:
        """Return a signal (n,), all NaN if it was not measured."""
        return self.signals.get(name, np.full(len(self), math.nan))

    def has(self, name: str) -> bool:
        """Return whether a signal has values."""
        return bool(np.isfinite(self.signal(name)).any())

    def shifted(self, name: str, count: int) -> FloatArray:
        """Return a signal moved forward by whole samples; NaN beyond the end of each drive."""
        signal, result = self.signal(name), np.full(len(self), math.nan)
        for low, high in pairwise(self.begin):
            part = signal[low:high]
            moved = part[count:] if count >= 0 else part[:count]
            result[low + max(-count, 0) : low + max(-count, 0) + moved.size] = moved
        return result

    def segments(self, usable: BoolArray, length: float = SEGMENT_S, shortest: float = SEGMENT_MIN_S) -> Segments:
        """Cut the usable samples (n,) into segments of `length` s; rests below `shortest` s are left out."""
        count, least = max(round(min(length / self.step, len(self))), 2), max(round(shortest / self.step), 2)
        first: list[int] = []
        lengths: list[int] = []
        edges = set(self.begin.tolist()) | set((np.flatnonzero(np.diff(usable.astype(int))) + 1).tolist())
        runs = sorted(edges | {0, len(self)})
        for low, high in pairwise(runs):
            if not usable[low]:
                continue
            for begin in range(low, high, count):
                if min(begin + count, high) - begin >= least:
                    first.append(begin)
                    lengths.append(min(begin + count, high) - begin)
        return Segments(np.array(first, dtype=np.int64), np.array(lengths, dtype=np.int64))


@dataclass(frozen=True, eq=False)
class Segments:
    """First sample and number of samples of each segment, (m,)."""

    first: IntArray
    length: IntArray

    @property
    def rows(self) -> IntArray:
        """DriveSamples of all segments, one after the other."""
        if not self.first.size:
            return np.zeros(0, dtype=np.int64)
        return np.concatenate([np.arange(a, a + n) for a, n in zip(self.first, self.length, strict=True)])

    @property
    def offsets(self) -> IntArray:
        """First row of each segment, and the number of rows (m + 1,)."""
        return np.concatenate([[0], np.cumsum(self.length)])


def filled(signal: FloatArray) -> FloatArray:
    """Return a signal whose gaps are bridged by straight lines; zero if it has no value."""
    known = np.isfinite(signal)
    if not known.any():
        return np.zeros_like(signal)
    at = np.arange(signal.size)
    return np.interp(at, at[known], signal[known])


def between(samples: DriveSamples, signals: Sequence[FloatArray], substeps: int) -> FloatArray:
    """Return inputs (n * substeps * 3, 2 k) at begin, middle and end of each substep, by cubic interpolation, and their rates.

    Straight lines would lower the amplitude of a steering input of 2 Hz by 0.1 % at 100 Hz, more than the stiffnesses' error.
    (E. Catmull, R. Rom, A class of local interpolating splines, 1974.)
    """
    share = (np.arange(substeps)[:, None] + np.array([0.0, 0.5, 1.0])).ravel() / substeps
    count = len(signals)
    result = np.empty((len(samples), share.size, 2 * count))
    for low, high in pairwise(samples.begin):
        at = np.arange(high - low)
        for column, signal in enumerate(signals):
            values = filled(signal[low:high])
            before, here, next_, after = (values[np.clip(at + k, 0, high - low - 1)][:, None] for k in (-1, 0, 1, 2))
            first, second = next_ - before, 2.0 * before - 5.0 * here + 4.0 * next_ - after
            third = 3.0 * (here - next_) + after - before
            result[low:high, :, column] = here + 0.5 * share * (first + share * (second + share * third))
            rate = 0.5 * (first + share * (2.0 * second + 3.0 * share * third))
            result[low:high, :, count + column] = rate / samples.step
    return result.reshape(-1, 2 * count)


def held(samples: DriveSamples, signal: FloatArray, delay: float, substeps: int) -> FloatArray:
    """Return the inputs (n * substeps * 3, 3) of `model.actuator_model` for a command that is held between samples.

    Args:
        delay: s, from a sample of the command to its effect.
        substeps: even; half of them lie before the step of the command in a sample, half after it.
    """
    whole = math.floor(delay / samples.step)
    share = delay / samples.step - whole
    half = substeps // 2
    result = np.empty((len(samples), substeps, 3))
    for low, high in pairwise(samples.begin):
        values = filled(signal[low:high])
        at = np.arange(values.size) - whole
        result[low:high, :half, 0] = values[np.clip(at - 1, 0, values.size - 1)][:, None]
        result[low:high, half:, 0] = values[np.clip(at, 0, values.size - 1)][:, None]
    result[:, :half, 1:] = 2.0 * share, 2.0 / samples.step
    result[:, half:, 1:] = 2.0 * (1.0 - share), -2.0 / samples.step
    return np.repeat(result.reshape(-1, 3), 3, axis=0)


@dataclass(frozen=True, eq=False)
class Problem:
    """One fit: a model, what is assumed about its parameters, and segments of measured outputs.

    Attributes:
        model: model that is driven by `inputs`.
        prior: prior of its parameters; with a delay of the input last, if `moves_input`.
        samples, segments: drives and their segments.
        measured: (rows, outputs), NaN where not compared.
        constants: known quantities of the model, without the delay of a moved input.
        substeps: integration steps in a sample.
        inputs: function from a delay in s to the model's inputs.
        starts: (m, starts) first guess of the free initial states. start_spread: (starts,) their spread around it.
        average: number of samples whose mean error counts, from the first of each segment on.
        moves_input: whether the last parameter is a delay of the input.
    """

    model: ShootingModel
    prior: Prior
    samples: DriveSamples
    segments: Segments
    measured: FloatArray
    constants: FloatArray
    substeps: int
    inputs: Callable[[float], FloatArray]
    starts: FloatArray
    start_spread: FloatArray
    average: int = 1
    moves_input: bool = False
    _kept: dict[str, Any] = field(default_factory=dict)

    def simulation(self, values: FloatArray, starts: FloatArray) -> Simulation:
        """Return the simulation for parameters (k,) in SI and initial states (m, starts)."""
        delay = float(values[-1]) if self.moves_input else 0.0
        if self._kept.get("delay") != delay:
            self._kept.update(delay=delay, inputs=np.ascontiguousarray(self.inputs(delay)))
        constants = self.constants
        if self.moves_input:
            constants = np.append(constants, delay)
        return Simulation(
            self.model,
            self.segments.first,
            self.segments.length,
            self.substeps,
            self.samples.step,
            values,
            constants,
            starts,
            self._kept["inputs"],
        )

    @property
    def blocks(self) -> tuple[IntArray, IntArray]:
        """First row of each block of averaged samples, and the first block of each segment with the number of blocks."""
        counts = -(-self.segments.length // self.average)
        offsets = np.concatenate([[0], np.cumsum(counts)])
        within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
        return np.repeat(self.segments.offsets[:-1], counts) + self.average * within, offsets

    def averaged(self, errors: FloatArray) -> FloatArray:
        """Return the mean errors (blocks, outputs) times the root of their number; NaN where nothing is compared.

        Args:
            errors: (rows, outputs), NaN where not compared.
        """
        first, _ = self.blocks
        known = np.isfinite(errors)
        count = np.add.reduceat(known, first, axis=0, dtype=np.int64)
        total = np.add.reduceat(np.where(known, errors, 0.0), first, axis=0)
        return np.where(count > 0, total / np.sqrt(np.maximum(count, 1)), math.nan)

    def part(self, every: int) -> Problem:
        """Return the problem over every `every`-th segment."""
        chosen = np.arange(0, len(self.segments.first), every)
        rows = np.concatenate([np.arange(*self.segments.offsets[[k, k + 1]]) for k in chosen])
        segments = Segments(self.segments.first[chosen], self.segments.length[chosen])
        return replace(self, segments=segments, measured=self.measured[rows], starts=self.starts[chosen])


def front_signal(samples: DriveSamples, config: Config) -> tuple[FloatArray, bool]:
    """Return the measured front angle (n,) in rad, and whether it is the angle of the steering wheel.

    The steering wheel's angle gets the lag of the steering.

    Raises:
        CodegenError: neither was measured.
    """
    if samples.has("delta_f"):
        return samples.signal("delta_f"), False
    if not samples.has("steering_wheel_angle"):
        raise CodegenError(
            "no drive has delta_f or steering_wheel_angle", where="identify", remedy="name one of them in the signals"
        )
    wheel = samples.signal("steering_wheel_angle")
    result = np.full(len(samples), math.nan)
    for low, high in pairwise(samples.begin):
        result[low:high] = lagged(filled(wheel[low:high]), samples.step, config.steering.lag_s)
    return np.where(np.isfinite(wheel), result, math.nan), True


def lagged(signal: FloatArray, step: float, lag: float) -> FloatArray:
    """Return the response of a first-order lag (s) from rest at the first sample, exact for a signal that is linear between
    samples of `step` s."""
    fall = math.exp(-step / lag)
    mean = (1.0 - fall) * lag / step
    result = np.empty(signal.size)
    before = state = float(signal[0])
    for k, value in enumerate(signal.tolist()):
        if k:
            state = fall * state + (mean - fall) * before + (1.0 - mean) * value
        result[k], before = state, value
    return result


def vehicle_problem(
    samples: DriveSamples,
    config: Config,
    centre: dict[str, float],
    values: dict[str, float],
    rear_angle: FloatArray,
    segment_s: float = SEGMENT_S,
) -> Problem:
    """Return the problem of the car.

    Args:
        centre: centre of the prior. values: current values, from which integration step, shifts of the outputs by whole samples
            and initial states follow; a relaxation length of zero leaves it out.
        rear_angle: (n,) rad, without the offset of its sensor.
        segment_s: length of the segments; infinite for each uninterrupted part.

    Raises:
        CodegenError: no drive is usable.
    """
    is_relaxed = values["relaxation_length"] > 0.0
    model, step = vehicle_model(config, is_relaxed), samples.step
    front, _ = front_signal(samples, config)
    speed, yaw_rate = samples.signal("vx"), samples.signal("yaw_rate")
    usable = np.isfinite(speed) & (speed > SPEED_MIN) & np.isfinite(front) & np.isfinite(rear_angle) & np.isfinite(yaw_rate)
    segments = samples.segments(usable, segment_s)
    if not segments.first.size:
        raise CodegenError(
            f"no drive has {SEGMENT_MIN_S:g} s with speed above {SPEED_MIN:g} m/s, front angle, rear angle and yaw rate",
            where="identify",
            remedy="check the signals and their units",
        )
    counts = [round(values[f"{output}_delay"] / step) for output in OUTPUTS]
    rows, offsets = segments.rows, segments.offsets
    measured = np.stack([samples.shifted(name, count)[rows] for name, count in zip(OUTPUTS, counts, strict=True)], axis=1)
    if is_relaxed:
        for begin in offsets[:-1]:
            measured[begin : begin + round(SETTLING_S / step)] = math.nan
    starts = steady_starts(config, values, speed, yaw_rate, rear_angle)[segments.first]
    slowest = float(np.nanmin(speed[rows]))
    rates = [step * _lateral_rate(config, values) / slowest]
    if is_relaxed:
        rates.append(step * float(np.nanmax(speed[rows])) / values["relaxation_length"])
    substeps = max(1, math.ceil(max(rates) / STEP_STABLE))
    return Problem(
        model,
        Prior.of(VEHICLE_PARAMETERS, centre),
        samples,
        segments,
        measured,
        vehicle_constants(config, np.array(counts) * step),
        substeps,
        lambda _: between(samples, (speed, front, rear_angle), substeps),
        starts,
        np.array([3.0, 0.5]),
        average=max(round(AVERAGE_S / step), 1),
    )


def _lateral_rate(config: Config, values: dict[str, float]) -> float:
    """Return the product of speed and rate of the faster lateral motion of the car, in m/s^2."""
    vehicle = config.vehicle
    stiffness = 2.0 * (values["front_stiffness"] + values["rear_stiffness"])
    arms = 2.0 * (
        values["front_stiffness"] * vehicle.cg_to_front_axle_m**2 + values["rear_stiffness"] * vehicle.cg_to_rear_axle_m**2
    )
    return max(stiffness / vehicle.mass_kg, arms / values["yaw_inertia"])


def steady_starts(
    config: Config, values: dict[str, float], speed: FloatArray, yaw_rate: FloatArray, rear_angle: FloatArray
) -> FloatArray:
    """Return lateral speed and yaw rate (n, 2) as in the steady turn of the linear car with the measured yaw rate."""
    vehicle = config.vehicle
    compliance = vehicle.mass_kg * vehicle.cg_to_front_axle_m / (2.0 * vehicle.wheelbase * values["rear_stiffness"])
    rate = yaw_rate - values["yaw_rate_offset"]
    lateral = speed * rear_angle + rate * (vehicle.cg_to_rear_axle_m - compliance * speed**2)
    return np.stack([lateral, rate], axis=1)


def actuator_problem(samples: DriveSamples, config: Config, centre: dict[str, float]) -> Problem | None:
    """Return the problem of the rear actuator; None if command and angle were not measured together."""
    command, angle = samples.signal("delta_r_command"), samples.signal("delta_r")
    segments = samples.segments(np.isfinite(command) & np.isfinite(angle))
    if not segments.first.size:
        return None
    substeps = 2 * math.ceil(samples.step / ACTUATOR_STEP_S)
    constants = np.array([config.rear_actuator.angle_max])
    return Problem(
        actuator_model(),
        Prior.of(ACTUATOR_PARAMETERS, centre),
        samples,
        segments,
        angle[segments.rows][:, None],
        constants,
        substeps,
        lambda delay: held(samples, command, delay, substeps),
        angle[segments.first][:, None],
        np.array([0.1]),
        moves_input=True,
    )
