"""Row 15 of the benchmark `law`: the car from reverse over standstill to 30 km/h."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator

import numpy as np

from benchmarks.law_car import Drives, LawCar, Setting
from benchmarks.law_figures import Figure
from codegen.arrays import FloatArray
from codegen.metrics import Runs
from codegen.units import KM_H

CIRCLE_KM_H, CIRCLE_S, CIRCLE_SHARE = 5.0, 20.0, 0.03
"""Speed of the turning circle, time to reach it, and the share that it may be wider than kinematics say."""
REVERSE_KM_H, LAST_KM_H, ACCELERATION = -10.0, 30.0, 1.0
"""Speeds from and to which the car accelerates, and m/s^2."""
SETTLED_S, STEERED_S = 8.0, 0.5
"""s until the car accelerates; s in which the driver turns the wheel."""
CHANGES = {"through standstill": ((10.0, 0.10), (25.0, 0.10)), "started with turned wheels": ((10.0, 0.20), (25.0, 0.10))}
"""Drive -> front angles in deg with the largest share by which the curvature may change in a second."""
STARTS = {
    "started with turned wheels": "swing-out of the rear corner over the first metre",
    "started after a stop in the circle": "the same after a stop in the circle, rear wheels still turned",
}
"""Drive -> its swing-out in words."""
BRAKED_S = 6.0
"""s until a car in the circle brakes to a stop."""
SLOWEST = 0.1
"""m/s. The curvature of a slower car is not defined."""
SWING_OUT_M, OVERHANG_M = 0.05, 0.9
"""m by which the rear corner may swing out more than that of the passive car over the first metre; m of the body behind the
rear axle."""


def slow(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield row 15: turning circle, change of the curvature with the wheel held, and swing-out."""
    yield from _circles(car, plant)
    for title, angles in CHANGES.items():
        for degrees, most in angles:
            passive, own = (_changes(_accelerated(car, plant, title, degrees, is_on)) for is_on in (False, True))
            text = f"{100.0 * own:.1f} % (passive {100.0 * passive:.1f} %)"
            goal = f"{100.0 * most:g} % in a second"
            figure = f"{title}, front {degrees:g} deg: change of the curvature"
            yield Figure(15, figure, plant, goal, car.letter, text, own <= most)
    stop = math.degrees(car.config.steering.front_angle_stop)
    for drive, title in STARTS.items():
        passive, own = (_corner(car, _accelerated(car, plant, drive, stop, is_on)) for is_on in (False, True))
        more, goal = own - passive, f"at most {100.0 * SWING_OUT_M:g} cm more than passive"
        text = f"{100.0 * more:+.1f} cm ({100.0 * own:.1f} cm)"
        yield Figure(15, title, plant, goal, car.letter, text, more <= SWING_OUT_M)


def _drive(
    car: LawCar, plant: str, degrees: float, duration: float, speed: Callable[[FloatArray], FloatArray], is_on: bool
) -> Runs:
    """Return a run with a course of the speed in m/s. The driver turns the wheel at the start."""

    def course(time: FloatArray) -> FloatArray:
        return np.clip(time / STEERED_S, 0.0, 1.0)

    drives = Drives("slow", course, duration, 0.0, np.ones(1), np.radians([degrees]), speed_course=speed)
    return car.drive(drives, plant, (Setting(controlled=is_on),))


def _circles(car: LawCar, plant: str) -> Iterator[Figure]:
    """Yield the curvature at the stop over that of the passive car, as a share of the same ratio without slip."""
    stop, actuator = car.config.steering.front_angle_stop, car.config.rear_actuator.angle_max
    kinematic = 1.0 + math.tan(actuator) / math.tan(stop)
    for direction, speed in (("forwards", CIRCLE_KM_H * KM_H), ("backwards", -CIRCLE_KM_H * KM_H)):
        held = functools.partial(np.full_like, fill_value=speed)
        runs = [_drive(car, plant, math.degrees(stop), CIRCLE_S, held, is_on) for is_on in (False, True)]
        passive, own = (_curvature(each)[-1] for each in runs)
        share, angle = own / passive / kinematic, math.degrees(runs[1].signals["rear_angle_rad"][-1, 0])
        text = f"{share:.3f} (rear {angle:.2f} of {math.degrees(actuator):g} deg)"
        title = f"turning circle at the stop, {direction}: curvature of the kinematic one"
        yield Figure(15, title, plant, f"at least {1.0 - CIRCLE_SHARE:g}", car.letter, text, share >= 1.0 - CIRCLE_SHARE)


def _accelerated(car: LawCar, plant: str, title: str, degrees: float, is_on: bool) -> Runs:
    """Return the run of a drive of CHANGES or STARTS."""
    first = REVERSE_KM_H * KM_H if title == "through standstill" else 0.0
    last = LAST_KM_H * KM_H
    circle = CIRCLE_KM_H * KM_H if title == "started after a stop in the circle" else 0.0

    def speed(time: FloatArray) -> FloatArray:
        braked = np.clip(circle - ACCELERATION * (time - BRAKED_S), 0.0, circle)
        return braked + np.clip(first + ACCELERATION * (time - SETTLED_S), first, last)

    return _drive(car, plant, degrees, SETTLED_S + (last - first) / ACCELERATION, speed, is_on)


def _curvature(run: Runs) -> FloatArray:
    """Return the curvature (samples,) of the path in 1/m; NaN for a car that stands."""
    speed = run.signals["speed_m_s"][:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        result: FloatArray = np.where(np.abs(speed) < SLOWEST, np.nan, run.signals["yaw_rate_rad_s"][:, 0] / speed)
    return result


def _changes(run: Runs) -> float:
    """Return the largest share by which the curvature grows or falls in a second, from the start of the acceleration on."""
    curvature = _curvature(run)[run.time >= SETTLED_S]
    second = round(1.0 / (run.time[1] - run.time[0]))
    windows = np.lib.stride_tricks.sliding_window_view(curvature, second + 1)
    windows = windows[np.isfinite(windows).sum(axis=1) > 1]
    return float((np.nanmax(windows, axis=1) / np.nanmin(windows, axis=1)).max() - 1.0)


def _corner(car: LawCar, run: Runs) -> float:
    """Return how far in m the outer rear corner moves outwards over the first metre of the centre of gravity."""
    vehicle, period = car.config.vehicle, run.time[1] - run.time[0]
    names, started = ("speed_m_s", "sideslip_rad", "yaw_rate_rad_s"), run.time >= SETTLED_S
    speed, sideslip, yaw_rate = (run.signals[name][started, 0] for name in names)
    heading = np.cumsum(yaw_rate) * period
    lateral = np.cumsum(speed * np.tan(sideslip) * np.cos(heading) + speed * np.sin(heading)) * period
    behind, aside = vehicle.cg_to_rear_axle_m + OVERHANG_M, 0.5 * vehicle.track_m
    corner = lateral - behind * np.sin(heading) - aside * np.cos(heading)
    first_metre = np.cumsum(np.abs(speed)) * period <= 1.0
    return float(corner[0] - corner[first_metre].min())


ROWS = {15: slow}
"""Number of a row -> its figures of a car on a plant."""
