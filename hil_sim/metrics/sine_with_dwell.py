"""Metrics of the sine with dwell: the criteria of FMVSS 126 (49 CFR 571.126), S5.2, computed according to S7.11.

BOS, the beginning of steer, is where the steering wheel first reaches 5 deg; COS, its completion, where it is back at zero.
Times and values are interpolated between samples. The signals of a simulation are free of noise, so nothing is filtered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.plausibility.car import distinct
from hil_sim.manoeuvres import DWELL_LENGTH
from hil_sim.metrics.run import Metric, Run, common, spin_time

BEGINNING_ANGLE = math.radians(5.0)
"""Angle of the steering wheel, in rad, at which the steer begins (S7.11)."""
ZERO_ANGLE = math.radians(0.1)
"""Angle of the steering wheel, in rad, that counts as zero, which the wheel approaches with a lag; the resolution of S6.3."""
RATIO_TIMES = ((1.0, 35.0), (1.75, 20.0))
"""Times after COS, in s, and the largest ratio of the yaw rate to its second peak there, in % (S5.2.1 and S5.2.2)."""
DISPLACEMENT_TIME = 1.07
"""Time after BOS, in s, at which the displacement is read (S5.2.3)."""
HEAVY_MASS = 3500.0
"""Mass in kg above which less displacement is required. The standard uses the gross rating; this uses the car's mass."""
DISPLACEMENT_MIN, DISPLACEMENT_MIN_HEAVY = 1.83, 1.52
"""Smallest lateral displacement, in m, of a light and of a heavy car."""

DISPLACEMENT, MEETS_CRITERIA = "lateral_displacement_m", "meets_fmvss_126"
"""Keys of the displacement and of the outcome in the figures."""


@dataclass(frozen=True)
class SteeringTimes:
    """Beginning of steer, change of sign in the middle, and completion of steer, in s."""

    beginning: float
    reversal: float
    completion: float


def _crossing(time: FloatArray, values: FloatArray, level: float, first: int) -> float | None:
    """Return the time at which `values`, from sample `first` on, first rise to `level`; None where they do not."""
    reached = np.flatnonzero(values[first:] >= level)
    if not reached.size:
        return None
    index = first + int(reached[0])
    if index == 0 or index == first:
        return float(time[index])
    low, high = values[index - 1], values[index]
    return float(time[index - 1] + (level - low) / (high - low) * (time[index] - time[index - 1]))


def steering_times(run: Run) -> SteeringTimes | None:
    """Return the times at which the steering begins, reverses and ends; None where the wheel makes no such movement."""
    time, start = run.time, run.scenario.steer_time
    begun = int(np.searchsorted(time, start - 1e-9))
    half = int(np.searchsorted(time, start + 0.5 * DWELL_LENGTH))
    wheel = run.steering_wheel_angle
    if half >= len(time) or not wheel[begun:half].size:
        return None
    wheel = wheel * (1.0 if wheel[begun:half].sum() >= 0.0 else -1.0)
    beginning = _crossing(time, wheel, BEGINNING_ANGLE, begun)
    peak = begun + int(np.argmax(wheel[begun:]))
    reversal = _crossing(time, -wheel, 0.0, peak)
    trough = peak + int(np.argmin(wheel[peak:]))
    completion = _crossing(time, wheel, -ZERO_ANGLE, trough)
    if beginning is None or reversal is None or completion is None or not beginning < reversal < completion:
        return None
    return SteeringTimes(beginning, reversal, completion)


def second_peak(run: Run, times: SteeringTimes) -> tuple[float, float]:
    """Return time (s) and value (rad/s) of the first peak of the yaw rate towards the side to which the wheel has reversed."""
    wheel = run.at(times.reversal + 0.05, "front_angle_rad")
    sign = 1.0 if wheel >= 0.0 else -1.0
    yaw_rate = sign * run["yaw_rate_rad_s"]
    inside = np.flatnonzero(run.time >= times.reversal)
    values = yaw_rate[inside]
    # The first local maximum on the new side; the largest value where there is none.
    falls = np.flatnonzero((values[1:-1] > 0.0) & (values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:]))
    chosen = int(falls[0]) + 1 if falls.size else int(np.argmax(values))
    return float(run.time[inside[chosen]]), sign * float(values[chosen])


def lateral_displacement(run: Run, beginning: float, end: float) -> float:
    """Return the lateral acceleration integrated twice from `beginning`, where both integrals are zero, to `end` (s), in m."""
    inside = (run.time > beginning) & (run.time < end)
    time = np.concatenate([[beginning], run.time[inside], [end]])
    lateral = np.interp(time, run.time, run["lateral_acceleration_m_s2"])
    step = np.diff(time)
    speed = np.concatenate([[0.0], np.cumsum(0.5 * step * (lateral[1:] + lateral[:-1]))])
    # This sum is exact for an acceleration that is linear between samples.
    return float(np.sum(step * speed[:-1] + step**2 * (2.0 * lateral[:-1] + lateral[1:]) / 6.0))


def missed_criteria(values: Mapping[str, float | bool | None], config: Config) -> Iterator[str]:
    """Yield each criterion that figures of `measure`, by key, miss: the measured value and its limit."""
    displacement, needed = values.get(DISPLACEMENT), _displacement_min(config)
    if displacement is not None and displacement < needed:
        yield f"displacement {distinct(displacement, needed, 3)} m (at least {needed:g} m)"
    for after, limit in RATIO_TIMES:
        ratio = values.get(_ratio_key(after))
        if ratio is not None and ratio > limit:
            yield f"yaw-rate ratio {distinct(ratio, limit, 3)} % after {after:g} s (at most {limit:g} %)"


def _displacement_min(config: Config) -> float:
    return DISPLACEMENT_MIN if config.vehicle.mass_kg <= HEAVY_MASS else DISPLACEMENT_MIN_HEAVY


def _ratio_key(after: float) -> str:
    return f"yaw_rate_ratio_{after:.2f}_s_percent".replace(".", "_", 1)


def measure(run: Run) -> list[Metric]:
    """Return the yaw-rate ratios, the lateral displacement, and whether they meet the criteria."""
    needed = _displacement_min(run.config)
    times = steering_times(run)
    displacement, displacement_end = None, math.inf
    ratios: list[float | None] = [None, None]
    ends = [math.inf, math.inf]
    if times is not None:
        ends = [times.completion + after for after, _ in RATIO_TIMES]
        displacement_end = times.beginning + DISPLACEMENT_TIME
        peak = second_peak(run, times)[1]
        if peak != 0.0:
            # Relative to the second peak with its sign: a yaw rate to the other side is negative.
            ratios = [100.0 * run.at(end, "yaw_rate_rad_s") / peak if end <= run.time[-1] else None for end in ends]
        if displacement_end <= run.time[-1]:
            displacement = abs(lateral_displacement(run, times.beginning, displacement_end))
    rows = [
        Metric(
            _ratio_key(after),
            f"yaw-rate ratio {after:.2f} s after steering (at most {limit:g})",
            "%",
            ratio,
            1,
            end,
        )
        for (after, limit), ratio, end in zip(RATIO_TIMES, ratios, ends, strict=True)
    ]
    within = [None if displacement is None else displacement >= needed]
    within += [None if ratio is None else ratio <= limit for (_, limit), ratio in zip(RATIO_TIMES, ratios, strict=True)]
    failed = spin_time(run.record) is not None or False in within
    # One value beyond its limit is a failure; to pass, all three must have been measured.
    met = False if failed else None if None in within else True
    return [
        *rows,
        Metric(
            DISPLACEMENT,
            f"lateral displacement {DISPLACEMENT_TIME:g} s after its start (at least {needed:g})",
            "m",
            displacement,
            2,
            displacement_end,
        ),
        # A spin is a failure and never invalidates this metric.
        Metric(MEETS_CRITERIA, "meets these three", "", met, until=-math.inf),
        *common(run),
    ]
