"""Figures of many runs at once: those of `hil_sim.metrics`, for signals (samples, n) of n runs of one scenario.

The definitions are there; a test compares each figure here with the one there, run by run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.sil.software import RECORD_COLUMNS, Status
from hil_sim.manoeuvres import DWELL_LENGTH
from hil_sim.metrics.run import SPIN_REAR_SLIP, SPIN_SIDESLIP
from hil_sim.metrics.sine_with_dwell import (
    BEGINNING_ANGLE,
    DISPLACEMENT_MIN,
    DISPLACEMENT_MIN_HEAVY,
    DISPLACEMENT_TIME,
    HEAVY_MASS,
    RATIO_TIMES,
    ZERO_ANGLE,
)
from hil_sim.metrics.step import SETTLING_BAND_FRACTION, STEADY_SWING_MAX_FRACTION, STEADY_WINDOW
from hil_sim.scenarios import Kind

Figures = dict[str, FloatArray]
"""Name with its unit -> values (n,); NaN for runs without the figure. Yes and no are 1 and 0."""

COLUMNS = tuple(name for name in RECORD_COLUMNS if name not in ("time_s", "speed_m_s", "rear_angle_command_rad"))
"""Columns from which the figures are computed."""


@dataclass(frozen=True, eq=False)
class Runs:
    """n runs of one scenario.

    Attributes:
        time: (samples,) s.
        signals: column of COLUMNS -> (samples, n), SI.
        steer_time: s, start of steering.
        steering_ratio: (n,) ratio of steering wheel to road wheel.
        mass: (n,) kg.
        slip_bounds: rad, of front and rear axle of the configured car; None for tyres without bounds.
        map_yaw_rate: (n,) rad/s, the map's steady yaw rate at the end of the run; None if unknown.
    """

    time: FloatArray
    signals: Mapping[str, FloatArray]
    steer_time: float
    steering_ratio: FloatArray
    mass: FloatArray
    slip_bounds: tuple[float, float] | None = None
    map_yaw_rate: FloatArray | None = None

    def __getitem__(self, name: str) -> FloatArray:
        return self.signals[name]

    def degrees(self, name: str) -> FloatArray:
        """Return a column of angles or angular rates in deg or deg/s."""
        result: FloatArray = np.rad2deg(self.signals[name])
        return result


def figures(kind: Kind, runs: Runs) -> Figures:
    """Return `spun_at_s` and the figures of the kind; figures that a spin invalidates are NaN."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        return MEASURES[kind](runs, spin_times(runs))


def spin_times(runs: Runs) -> FloatArray:
    """Return (n,) times in s of the first sample in which a car spins or its state is not finite; NaN if it does not spin."""
    spinning = (np.abs(runs["sideslip_rad"]) > SPIN_SIDESLIP) & (np.abs(runs["slip_rear_rad"]) > SPIN_REAR_SLIP)
    for name, values in runs.signals.items():
        if name != "status":
            spinning |= ~np.isfinite(values)
    return np.where(spinning.any(axis=0), runs.time[spinning.argmax(axis=0)], np.nan)


def _largest(values: FloatArray) -> FloatArray:
    result: FloatArray = np.abs(values).max(axis=0)
    return result


def _step(runs: Runs, spun: FloatArray) -> Figures:
    """See `hil_sim.metrics.step.step_metrics` (ISO 7401:2011, clause 10)."""
    time, start = runs.time, runs.steer_time
    first_after = int(np.flatnonzero(time >= start - 1e-9)[0])
    first_steady = int(np.flatnonzero(time > time[-1] - STEADY_WINDOW)[0])
    after, steady = slice(first_after, None), slice(first_steady, None)
    yaw_rate, sideslip, rear = (runs.degrees(name) for name in ("yaw_rate_rad_s", "sideslip_rad", "rear_angle_rad"))
    controlled = runs["status"][steady] <= Status.LIMITED
    samples = controlled.sum(axis=0)
    reference = np.where(controlled, runs.degrees("yaw_rate_reference_rad_s")[steady], 0.0).sum(axis=0) / samples
    mean = yaw_rate[steady].mean(axis=0)
    sign = np.where(mean >= 0.0, 1.0, -1.0)
    turned = sign * yaw_rate
    peak = sign * turned[after].max(axis=0)
    risen = turned[after] >= 0.9 * np.abs(mean)
    first = np.where(risen.any(axis=0), first_after + risen.argmax(axis=0), time.size - 1)
    past_rise = np.arange(time.size)[:, np.newaxis] >= first
    size = np.maximum(np.abs(mean), 1e-9)
    settled = np.ptp(yaw_rate[steady], axis=0) <= STEADY_SWING_MAX_FRACTION * size
    outside = np.abs(yaw_rate - mean)[after] > SETTLING_BAND_FRACTION * size
    last_outside = time.size - 1 - outside[::-1].argmax(axis=0)
    inside_from = np.where(settled & outside.any(axis=0), time[np.minimum(last_outside + 1, time.size - 1)], start)
    slips = [runs.degrees(f"slip_{axle}_rad")[steady].mean(axis=0) for axle in ("front", "rear")]
    bounds = np.rad2deg((np.nan, np.nan) if runs.slip_bounds is None else runs.slip_bounds)
    of_map = np.full(mean.shape, np.nan) if runs.map_yaw_rate is None else np.rad2deg(runs.map_yaw_rate)
    divisor = np.where(of_map == 0.0, np.nan, of_map)
    wheel = runs.degrees("front_angle_rad")[steady].mean(axis=0) * runs.steering_ratio
    found = {
        "settled": settled.astype(np.float64),
        "yaw_rate_steady_deg_s": mean,
        "yaw_rate_peak_deg_s": peak,
        "yaw_rate_reference_deg_s": np.where(2 * samples > controlled.shape[0], reference, np.nan),
        "map_yaw_rate_deg_s": of_map,
        "map_error_percent": 100.0 * (mean / divisor - 1.0),
        "map_overshoot_percent": 100.0 * (peak / divisor - 1.0),
        "overshoot_percent": np.where(mean != 0.0, 100.0 * (peak / mean - 1.0), 0.0),
        "rise_time_s": time[first] - start,
        "settling_time_s": np.where(settled, inside_from - start, np.nan),
        "peak_time_s": time[first_after + turned[after].argmax(axis=0)] - start,
        "yaw_rate_gain_per_s": np.where(np.abs(wheel) > 1e-6, mean / wheel, np.nan),
        "sideslip_steady_deg": sideslip[steady].mean(axis=0),
        "sideslip_abs_min_deg": np.where(past_rise, np.abs(sideslip), np.inf).min(axis=0),
        "sideslip_abs_max_deg": _largest(sideslip[after]),
        "rear_angle_min_deg": rear[after].min(axis=0),
        "rear_angle_max_deg": rear[after].max(axis=0),
        "rear_angle_steady_deg": rear[steady].mean(axis=0),
        "slip_front_abs_max_deg": _largest(runs.degrees("slip_front_rad")[after]),
        "slip_rear_abs_max_deg": _largest(runs.degrees("slip_rear_rad")[after]),
        "slip_front_steady_deg": slips[0],
        "slip_rear_steady_deg": slips[1],
        "slip_front_steady_of_bound_percent": 100.0 * np.abs(slips[0]) / bounds[0],
        "slip_rear_steady_of_bound_percent": 100.0 * np.abs(slips[1]) / bounds[1],
        "lateral_acceleration_max_m_s2": _largest(runs["lateral_acceleration_m_s2"][after]),
    }
    return {"spun_at_s": spun} | {name: np.where(np.isnan(spun), values, np.nan) for name, values in found.items()}


def _first(where: BoolArray, begin: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Return (n,) indices of the first true sample of each column from `begin` (n,) on; -1 if there is none."""
    allowed = where & (np.arange(where.shape[0])[:, np.newaxis] >= begin)
    return np.where(allowed.any(axis=0), allowed.argmax(axis=0), -1)


def _crossing(time: FloatArray, values: FloatArray, level: float, begin: npt.NDArray[np.intp]) -> FloatArray:
    """Return (n,) times in s at which each column, from `begin` on, first rises to `level`, interpolated; NaN if never."""
    index = _first(values >= level, begin)
    runs = np.arange(values.shape[1])
    at, before = values[index, runs], values[index - 1, runs]
    between = time[index - 1] + (level - before) / (at - before) * (time[index] - time[index - 1])
    return np.where(index < 0, np.nan, np.where((index == 0) | (index == begin), time[index], between))


def _at(runs: Runs, times: FloatArray, name: str) -> FloatArray:
    """Return (n,) values of a column at times (n,) in s, interpolated linearly."""
    values, time = runs[name], runs.time
    safe = np.where(np.isnan(times), time[0], times)
    index = np.clip(np.searchsorted(time, safe, side="right") - 1, 0, time.size - 2)
    each = np.arange(values.shape[1])
    low, high = values[index, each], values[index + 1, each]
    share = np.clip((safe - time[index]) / (time[index + 1] - time[index]), 0.0, 1.0)
    return low + share * (high - low)


def _steering_times(runs: Runs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return beginning, reversal and completion of steer in s, (n,) each; all three NaN for a run without such steering."""
    time, start = runs.time, runs.steer_time
    begun = int(np.searchsorted(time, start - 1e-9))
    half = int(np.searchsorted(time, start + 0.5 * DWELL_LENGTH))
    wheel = runs["front_angle_rad"] * runs.steering_ratio
    none = np.full(wheel.shape[1], np.nan)
    if half >= time.size or half <= begun:
        return none, none, none
    wheel = wheel * np.where(wheel[begun:half].sum(axis=0) >= 0.0, 1.0, -1.0)
    count, rows = wheel.shape[1], np.arange(wheel.shape[0])[:, np.newaxis]
    beginning = _crossing(time, wheel, BEGINNING_ANGLE, np.full(count, begun))
    peak = begun + wheel[begun:].argmax(axis=0)
    reversal = _crossing(time, -wheel, 0.0, peak)
    trough = np.where(rows >= peak, wheel, np.inf).argmin(axis=0)
    completion = _crossing(time, wheel, -ZERO_ANGLE, trough)
    good = (beginning < reversal) & (reversal < completion)
    return (
        np.where(good, beginning, np.nan),
        np.where(good, reversal, np.nan),
        np.where(good, completion, np.nan),
    )


def _second_peak(runs: Runs, reversal: FloatArray) -> FloatArray:
    """Return (n,) first peaks of the yaw rate in rad/s after the steering wheel changed sign, in its new direction."""
    sign = np.where(_at(runs, reversal + 0.05, "front_angle_rad") >= 0.0, 1.0, -1.0)
    yaw_rate = sign * runs["yaw_rate_rad_s"]
    inside = runs.time[:, np.newaxis] >= reversal
    falls = np.zeros_like(inside)
    falls[1:-1] = (yaw_rate[1:-1] > 0.0) & (yaw_rate[1:-1] >= yaw_rate[:-2]) & (yaw_rate[1:-1] > yaw_rate[2:])
    falls[1:-1] &= inside[:-2]  # the first sample inside has none before it
    each = np.arange(yaw_rate.shape[1])
    highest = np.where(inside, yaw_rate, -np.inf).argmax(axis=0)
    chosen = np.where(falls.any(axis=0), falls.argmax(axis=0), highest)
    result: FloatArray = sign * yaw_rate[chosen, each]
    return result


def _displacement(runs: Runs, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return (n,) displacements in m: the lateral acceleration integrated twice from `begin` to `end` (n,).

    The sum is exact for an acceleration that is linear between samples.
    """
    time, lateral = runs.time, runs["lateral_acceleration_m_s2"]
    first, last = _at(runs, begin, "lateral_acceleration_m_s2"), _at(runs, end, "lateral_acceleration_m_s2")
    # Each interval between samples, cut to what lies inside.
    left = np.clip(time[:-1, np.newaxis], begin, end)
    right = np.clip(time[1:, np.newaxis], begin, end)
    inside = lateral[:-1] + (lateral[1:] - lateral[:-1]) * (left - time[:-1, np.newaxis]) / np.diff(time)[:, np.newaxis]
    inside_right = lateral[:-1] + (lateral[1:] - lateral[:-1]) * (right - time[:-1, np.newaxis]) / np.diff(time)[:, np.newaxis]
    inside = np.where(left == begin, first, inside)
    inside_right = np.where(right == end, last, inside_right)
    step = right - left
    # A later non-finite value must not invalidate earlier ones: NaN times zero is NaN.
    taken = step > 0.0
    inside, inside_right = np.where(taken, inside, 0.0), np.where(taken, inside_right, 0.0)
    gained = 0.5 * step * (inside + inside_right)
    speed = np.cumsum(gained, axis=0) - gained
    result: FloatArray = np.sum(step * speed + step**2 * (2.0 * inside + inside_right) / 6.0, axis=0)
    return result


def _sine_with_dwell(runs: Runs, spun: FloatArray) -> Figures:
    """See `hil_sim.metrics.sine_with_dwell` (FMVSS 126, S5.2)."""
    beginning, reversal, completion = _steering_times(runs)
    end_of_run = runs.time[-1]
    limit = np.where(np.isnan(spun), np.inf, spun)
    found: Figures = {"spun_at_s": spun}
    peak = _second_peak(runs, reversal)
    failed, measured = ~np.isnan(spun), np.ones(spun.shape, dtype=bool)
    for after, most in RATIO_TIMES:
        at = completion + after
        ratio = np.where((peak != 0.0) & (at <= end_of_run), 100.0 * _at(runs, at, "yaw_rate_rad_s") / peak, np.nan)
        failed |= ratio > most
        measured &= ~np.isnan(ratio)
        found[f"yaw_rate_ratio_{after:.2f}_s_percent".replace(".", "_", 1)] = np.where(
            np.minimum(np.where(np.isnan(at), np.inf, at), end_of_run) >= limit, np.nan, ratio
        )
    end = beginning + DISPLACEMENT_TIME
    displacement = np.where(end <= end_of_run, np.abs(_displacement(runs, beginning, end)), np.nan)
    failed |= displacement < np.where(runs.mass <= HEAVY_MASS, DISPLACEMENT_MIN, DISPLACEMENT_MIN_HEAVY)
    measured &= ~np.isnan(displacement)
    until = np.minimum(np.where(np.isnan(end), np.inf, end), end_of_run)
    found["lateral_displacement_m"] = np.where(until >= limit, np.nan, displacement)
    # A spin or one figure beyond its limit is a failure whatever the others are; to pass, all three must have been measured.
    found["meets_fmvss_126"] = np.where(failed, 0.0, np.where(measured, 1.0, np.nan))
    after_start = slice(int(np.flatnonzero(runs.time >= runs.steer_time - 1e-9)[0]), None)
    rear = runs.degrees("rear_angle_rad")[after_start]
    common = {
        "yaw_rate_abs_max_deg_s": _largest(runs.degrees("yaw_rate_rad_s")[after_start]),
        "sideslip_abs_max_deg": _largest(runs.degrees("sideslip_rad")[after_start]),
        "rear_angle_min_deg": rear.min(axis=0),
        "rear_angle_max_deg": rear.max(axis=0),
        "lateral_acceleration_max_m_s2": _largest(runs["lateral_acceleration_m_s2"][after_start]),
    }
    return found | {name: np.where(np.isnan(spun), values, np.nan) for name, values in common.items()}


MEASURES: Mapping[Kind, Callable[[Runs, FloatArray], Figures]] = {"step": _step, "sine-with-dwell": _sine_with_dwell}
"""Kinds of scenario for which a campaign has figures."""
