"""Rows of metrics of each scenario: those that a standard defines (see `codegen.metrics`), and all others.

The others are thresholds, straight driving, paths, faults and the user's own recordings.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.metrics.runs import Runs, cone_clearances, paths
from codegen.metrics.sine import DISPLACEMENT, RATIOS, SineWithDwell, displacement_min
from codegen.metrics.step import SlipOfBound, StepResponse
from codegen.sil.software import Status
from codegen.text import distinct
from codegen.units import KM_H
from hil_sim.metrics.run import Metric, Run, common, largest, rows_of

CONE_CLEARANCE = "cone_clearance_min_m"
BEFORE_FAULT_S = 0.5
"""Time before a fault over which the undisturbed values are averaged."""


def reference_error(run: Run, where: BoolArray) -> FloatArray:
    """Return yaw rate minus reference in deg/s, over those samples of `where` in which the controller is active."""
    chosen = where & run.controlled
    result: FloatArray = (run.degrees("yaw_rate_rad_s") - run.degrees("yaw_rate_reference_rad_s"))[chosen]
    return result


def map_error(run: Run, where: BoolArray) -> FloatArray:
    """Return yaw rate minus the map's steady one in deg/s, over the same samples; empty where no map is known."""
    if run.map_yaw_rate is None:
        return np.zeros(0)
    error: FloatArray = (run.degrees("yaw_rate_rad_s") - np.rad2deg(run.map_yaw_rate))[where & run.controlled]
    return error


def rear_rate(run: Run, where: BoolArray) -> float | None:
    """Return the largest rate of the rear angle between samples, in deg/s."""
    return largest(np.diff(run.degrees("rear_angle_rad"), prepend=run.degrees("rear_angle_rad")[:1]) / run.step, where)


def measure_speed_ramp(run: Run) -> list[Metric]:
    """Return the speeds at which control begins and ends, and the largest rates and errors on the way."""
    speed, controlled = run["speed_m_s"] / KM_H, np.flatnonzero(run.controlled)
    first, last = (int(controlled[0]), int(controlled[-1])) if controlled.size else (None, None)
    ended = last is not None and last < len(speed) - 1
    error = reference_error(run, run.after)
    return [
        Metric("control_begins_km_h", "control begins at", "km/h", None if first is None else float(speed[first]), 1),
        Metric(
            "control_ends_km_h", "control ends at", "km/h", float(speed[last + 1]) if last is not None and ended else None, 1
        ),
        Metric("rear_rate_abs_max_deg_s", "|rear angle rate|, largest", "deg/s", rear_rate(run, run.after)),
        Metric("yaw_rate_error_abs_max_deg_s", "|yaw rate - reference|, largest", "deg/s", largest(error)),
        Metric("map_error_abs_max_deg_s", "|yaw rate - map|, largest", "deg/s", largest(map_error(run, run.after))),
        *common(run),
    ]


def measure_straight(run: Run) -> list[Metric]:
    """Return how far a car deviates that should drive straight."""
    end = float(run.time[-1])
    heading, _, offset = path(run)
    return [
        Metric("heading_end_deg", "heading at the end", "deg", math.degrees(float(heading[-1])), 2, end),
        Metric("offset_end_m", "sideways offset at the end", "m", float(offset[-1]), 2, end),
        Metric("yaw_rate_rms_deg_s", "yaw rate, rms", "deg/s", _rms(run.degrees("yaw_rate_rad_s")[run.after]), 2, end),
        *common(run),
    ]


def path(run: Run) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heading (rad) and position forward and to the left (m) of the centre of gravity, (samples,) each, from zero."""
    heading, forward, left = (values[:, 0] for values in paths(run.runs))
    return heading, forward, left


def measure_path(run: Run) -> list[Metric]:
    """Return the distances from the driver's path and from the cones, and the driver's steering effort."""
    followed = run.scenario.road_path(run.config)
    assert followed is not None  # every scenario of this kind has one
    _, forward, left = path(run)
    clearance = float(cone_clearances(followed.cones, forward[:, np.newaxis], left[:, np.newaxis])[0])
    on_path = (forward >= followed.start) & (forward <= followed.start + followed.length)
    error = (left - followed.lateral(forward))[on_path]
    wheel = np.rad2deg(run.steering_wheel_angle)
    end = float(run.time[-1])
    return [
        Metric("path_error_rms_m", "path error, rms", "m", _rms(error), 3, end),
        Metric("path_error_max_m", "path error, largest", "m", largest(error), 3, end),
        Metric(CONE_CLEARANCE, "clearance to the cones, smallest", "m", None if math.isnan(clearance) else clearance, 3, end),
        Metric("steering_wheel_max_deg", "|steering wheel|, largest", "deg", largest(wheel, run.after), 1),
        Metric("steering_wheel_rate_rms_deg_s", "steering wheel rate, rms", "deg/s", _rms(np.diff(wheel) / run.step), 1),
        *common(run),
    ]


def measure_corner(run: Run) -> list[Metric]:
    """Return the deviations that a fault causes in a steady corner, and the time until the controller is active again."""
    faults = run.scenario.faults
    start = faults[0].start if faults else run.scenario.steer_time
    end = max((fault.start + fault.duration for fault in faults), default=start)
    before, after = run.within(start - BEFORE_FAULT_S, start), run.time >= start - 1e-9
    back = np.flatnonzero((run.time >= end - 1e-9) & run.controlled)
    lost = after & ~run.controlled
    rows = []
    for key, title, name in (
        ("yaw_rate_deviation_deg_s", "yaw rate, largest deviation", "yaw_rate_rad_s"),
        ("sideslip_deviation_deg", "sideslip, largest deviation", "sideslip_rad"),
        ("rear_angle_deviation_deg", "rear angle, largest deviation", "rear_angle_rad"),
    ):
        values = run.degrees(name)
        deviation = largest(values[after] - values[before].mean()) if before.any() else None
        rows.append(Metric(key, title, "deg/s" if key.endswith("_s") else "deg", deviation))
    return [
        *rows,
        Metric("rear_rate_abs_max_deg_s", "|rear angle rate|, largest", "deg/s", rear_rate(run, after)),
        Metric("not_controlled_s", "not controlled for", "s", float(lost.sum()) * run.step),
        Metric(
            "recovery_s", "control back after the end of the fault", "s", float(run.time[back[0]]) - end if back.size else None
        ),
        *common(run),
    ]


def measure_recording(run: Run) -> list[Metric]:
    """Return the extremes and the tracking errors of a whole drive."""
    everything = np.ones(len(run.time), dtype=np.bool_)
    error = reference_error(run, everything)
    in_state = run["status"]
    return [
        Metric("speed_max_km_h", "speed, largest", "km/h", float(run["speed_m_s"].max() / KM_H), 1),
        Metric("controlled_percent", "controlled", "%", 100.0 * float(run.controlled.mean()), 1),
        Metric("limited_percent", "limited", "%", 100.0 * float((in_state == Status.LIMITED).mean()), 1),
        Metric("yaw_rate_error_rms_deg_s", "yaw rate - reference, rms", "deg/s", _rms(error)),
        Metric("map_error_rms_deg_s", "yaw rate - map, rms", "deg/s", _rms(map_error(run, everything))),
        Metric("rear_rate_abs_max_deg_s", "|rear angle rate|, largest", "deg/s", rear_rate(run, everything)),
        *common(run, -math.inf),
    ]


def _rms(values: FloatArray) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def step_metrics(
    record: FloatArray, steer_time: float, steering_ratio: float = 1.0, map_yaw_rate: float | None = None
) -> dict[str, Any]:
    """Return the figures of a recording (samples, 12), see `StepResponse`; None for those that the run does not have.

    Args:
        steer_time: time in s at which the driver starts to steer.
        steering_ratio: ratio of steering wheel to road wheel; 1 gives the gain of the front angle.
        map_yaw_rate: steady yaw rate of the map at the end of the run, in rad/s; None where it is not known.
    """
    runs = Runs.of_record(record, steer_time, steering_ratio=steering_ratio, map_yaw_rate=map_yaw_rate)
    return StepResponse(runs).of_one()


def measure_step(run: Run) -> list[Metric]:
    """Return the step response."""
    return [*rows_of(StepResponse(run.runs)), *rows_of(SlipOfBound(run.runs))]


def measure_sine_with_dwell(run: Run) -> list[Metric]:
    """Return the yaw-rate ratios, the lateral displacement, and whether they meet the criteria."""
    rows = rows_of(SineWithDwell(run.runs))
    needed = f" (at least {displacement_min(run.config.vehicle.mass_kg):g})"
    return [*(replace(row, title=row.title + needed) if row.key == DISPLACEMENT else row for row in rows), *common(run)]


def missed_criteria(values: Mapping[str, float | bool | None], config: Config) -> Iterator[str]:
    """Yield each criterion that figures of a sine with dwell, by key, miss: the measured value and its limit."""
    displacement, needed = values.get(DISPLACEMENT), float(displacement_min(config.vehicle.mass_kg))
    if displacement is not None and displacement < needed:
        yield f"displacement {distinct(displacement, needed, 3)} m (at least {needed:g} m)"
    for key, (after, limit) in RATIOS.items():
        ratio = values.get(key)
        if ratio is not None and ratio > limit:
            yield f"yaw-rate ratio {distinct(ratio, limit, 3)} % after {after:g} s (at most {limit:g} %)"
