"""Verdict on a controlled run in one line: whether the car followed its map or course, and the reasons if it did not."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.ecu_map.total import Rule
from codegen.emit.limiter_view import limiter_bounds
from codegen.metrics.sine import MEETS_CRITERIA
from codegen.sil.software import Status
from codegen.units import KM_H
from codegen.vehicle.tyre import slip_bounds
from hil_sim.metrics.rows import CONE_CLEARANCE, missed_criteria
from hil_sim.metrics.run import Metric, Run

STEADY_ERROR_MAX_PERCENT = 2.0
"""Largest error to map or reference, in percent, of a car that follows it."""
OVERSHOOT_MAX_PERCENT = 5.0
SLIP_MAX_PERCENT = 101.0
"""Largest slip, in percent of its bound, that counts as kept."""
ANGLE_TOLERANCE_RAD = 1e-4
"""A command this close to a bound is at the bound; two codes of its CAN signal."""
RATE_TOLERANCE = 0.02
"""Tolerance of a rate limit, as a fraction of it."""
OTHER_STATES = {Status.DEGRADED: "a signal was replaced", Status.FAIL_SAFE: "the fail-safe acted"}
EXTENDED = {Rule.HOLD, Rule.PASSIVE_SLOPE, Rule.CONTINUED}
"""Rules by which a build extends its map beyond the edges."""

Covers = Callable[[FloatArray, FloatArray], BoolArray]
"""Function of speeds (n,) in m/s and front angles (n,) in rad: whether each is inside the map, not where a build extends it."""


def coverage(manifest: Mapping[str, Any]) -> Covers:
    """Return which operating points the map of a build covers, from the build's manifest."""
    facts = manifest["map"]
    axes = np.array(facts["speed_m_s"]), np.array(facts["front_angle_rad"])
    own = np.array([[rule not in EXTENDED for rule in row] for row in facts["rule_by_speed_and_front_angle"]])
    cells = own[:-1, :-1] & own[:-1, 1:] & own[1:, :-1] & own[1:, 1:]

    def covers(speed: FloatArray, front_angle: FloatArray) -> BoolArray:
        points = np.abs(speed), np.abs(front_angle)
        inside = np.logical_and(*(point <= axis[-1] * (1.0 + 1e-6) for point, axis in zip(points, axes, strict=True)))
        row, column = (
            np.clip(np.searchsorted(axis, point * (1.0 - 1e-6)) - 1, 0, axis.size - 2)
            for point, axis in zip(points, axes, strict=True)
        )
        result: BoolArray = inside & cells[row, column]
        return result

    return covers


def verdict(run: Run, metrics: tuple[Metric, ...], spun_at: float | None, covers: Covers | None = None) -> str:
    """Return the verdict on a controlled run. It begins with the criteria of a standard that the run misses.

    Args:
        metrics: figures of the run; those of a step steer show whether it follows its map, those of a path its course.
        spun_at: s, or None for a car that stays on the road.
        covers: see `coverage`; None where the extent of the map is not known.
    """
    values = {metric.key: metric.value for metric in metrics}
    status = run["status"]
    spin = [] if spun_at is None else [f"the car spins at t = {spun_at:.2f} s"]
    missed = [] if values.get(MEETS_CRITERIA) is not False else [*spin, *missed_criteria(values, run.config)]
    parts = [f"misses FMVSS 126: {', '.join(missed)}"] if missed else [*spin]
    if not spin:
        is_off = status[-1] == Status.STANDBY
        parts += ["the car stays on the road"] if is_off else [_following(values), *_excess(values), *_slip(run, values)]
    parts += [*_outside(run, covers), *_states(run)]
    return "verdict: " + "; ".join(parts)


def _following(values: Mapping[str, float | bool | None]) -> str:
    """Return whether the car keeps to its course, and whether its steady yaw rate is that of the map.

    Where no map is known, the yaw rate is compared with the reference.
    """
    clearance = values.get(CONE_CLEARANCE)
    if clearance is not None:
        return "keeps clear of the cones" if clearance >= 0.0 else f"hits a cone, by {-clearance:.2f} m"
    if "settled" not in values:
        return "the car stays on the road"
    if not values["settled"]:
        return "the yaw rate does not settle"
    error, of = values.get("map_error_percent"), "the map"
    if error is None:
        steady, reference = values.get("yaw_rate_steady_deg_s"), values.get("yaw_rate_reference_deg_s")
        if not reference or steady is None:
            return "settles; there is no reference to compare with"
        error, of = 100.0 * (steady / reference - 1.0), "the reference"
    if abs(error) <= STEADY_ERROR_MAX_PERCENT:
        return f"follows {of} in steady state"
    return f"steady yaw rate {abs(error):.0f} % {'above' if error > 0.0 else 'below'} {of}"


def _excess(values: Mapping[str, float | bool | None]) -> Iterator[str]:
    """Yield the overshoot of the car's own steady yaw rate; the error of that to the map is reported elsewhere."""
    peak = values.get("overshoot_percent") or 0.0
    if values.get("settled") and peak > OVERSHOOT_MAX_PERCENT:
        yield f"overshoots its steady yaw rate by {peak:.0f} %"


def _slip(run: Run, values: Mapping[str, float | bool | None]) -> Iterator[str]:
    """Yield the slip beyond its bound: the steady one of a step steer, else the largest one under control."""
    found = []
    for axle, bound in zip(("front", "rear"), slip_bounds(run.config) or (math.inf, math.inf), strict=True):
        if "settled" in values:
            percent, name = values.get(f"slip_{axle}_steady_of_bound_percent") or 0.0, f"steady {axle} slip at"
        else:
            largest = np.abs(run[f"slip_{axle}_rad"][run.after & run.controlled]).max(initial=0.0)
            percent, name = 100.0 * float(largest) / bound, f"{axle} slip up to"
        if percent > SLIP_MAX_PERCENT:
            found.append(f"{name} {percent:.0f} %")
    if found:
        yield f"{' and '.join(found)} of its bound"


def _outside(run: Run, covers: Covers | None) -> Iterator[str]:
    """Yield in how many samples the operating point is outside the map, and the farthest such point."""
    if covers is None:
        return
    speed, front_angle = run["speed_m_s"], run["front_angle_rad"]
    outside = (run["status"] != Status.STANDBY) & ~covers(speed, front_angle)
    if count := int(np.count_nonzero(outside)):
        at = int(np.argmax(np.where(outside, np.abs(front_angle), -1.0)))
        point = f"{speed[at] / KM_H:.0f} km/h, {abs(math.degrees(front_angle[at])):.1f} deg"
        yield f"outside the map in {count} of {len(outside)} samples (up to {point})"


def _states(run: Run) -> Iterator[str]:
    """Yield in how many samples the controller was in each state but tracking, and what brought it there."""
    status = run["status"]

    def samples(state: Status) -> str:
        count = int(np.count_nonzero(status == state))
        return f"in {count} of {len(status)} samples" if count else ""

    if limited := samples(Status.LIMITED):
        yield f"a limit acted {limited} ({', '.join(f'{name} {count}' for name, count in _limits(run))})"
    for state, text in OTHER_STATES.items():
        if counted := samples(state):
            yield f"{text} {counted}"
    if standby := samples(Status.STANDBY):
        controller, (ends, starts) = run.config.controller, run.config.controller.feedback_speeds_km_h
        on = f"from {starts:g} km/h until below {ends:g} km/h" if controller.waits_for_speed else "from the first speed on"
        yield f"control was off {standby}; it is meant to be on {on}"


def _limits(run: Run) -> Iterator[tuple[str, int]]:
    """Yield each limit that acted and in how many of the LIMITED samples, by the first bound that the command is at."""
    config, command, front_angle = run.config, run["rear_angle_command_rad"], run["front_angle_rad"]
    size = np.abs(command)
    rates = [rate for rate in (config.controller.rear_rate_max_deg_s, config.limiter.rear_rate_max_deg_s) if rate != "off"]
    step = math.radians(min(rates)) * run.step if rates else math.inf
    moved = np.abs(np.diff(command, prepend=run["rear_angle_rad"][:1]))
    against, along = limiter_bounds(config, run["speed_m_s"], np.abs(front_angle))
    with_front = command * front_angle > 0.0
    lead = math.radians(config.controller.rear_angle_error_max_deg)
    left: BoolArray = run["status"] == Status.LIMITED
    for name, where in (
        ("rate", moved >= (1.0 - RATE_TOLERANCE) * step),
        ("rear angle", size >= config.rear_actuator.angle_max - ANGLE_TOLERANCE_RAD),
        ("opposite phase", ~with_front & (size >= against - ANGLE_TOLERANCE_RAD)),
        ("in phase", with_front & (size >= along - ANGLE_TOLERANCE_RAD)),
        ("distance to the measured angle", np.abs(command - run["rear_angle_rad"]) >= lead - ANGLE_TOLERANCE_RAD),
        ("range of the feedback", np.ones(size.shape, dtype=np.bool_)),
    ):
        if count := int(np.count_nonzero(left & where)):
            yield name, count
        left = left & ~where
