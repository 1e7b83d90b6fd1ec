"""The force of one axle of the two-track plant in a steady turn, with its derivatives.

As in `vehicle.dynamics.two_track`: two wheels half a track from the middle, each with its own load, direction of travel and
slip angle, and the steering angle that both have. Tyre shifts are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IndexArray
from codegen.vehicle.tyre import MagicFormulaTyre

INVERSE_POINTS = 400

SLOPE_MIN = 0.05
"""Least slope of the force beyond the slip bound, as a fraction of the axle's cornering stiffness."""

_SIDES: Any = np.array([[1.0], [-1.0]])
"""Left (inner in a left turn) and right wheel."""


@dataclass(frozen=True)
class Axle:
    """One axle: its tyre without shifts, load transfer in N for each m/s^2, and the slip bound in rad."""

    tyre: MagicFormulaTyre
    load_transfer: float
    slip_max: float

    @property
    def stiffness(self) -> float:
        """N/rad, both tyres at their static load."""
        return 2.0 * self.tyre.cornering_stiffness

    def loads(self, lateral_acceleration: FloatArray, friction: float) -> tuple[FloatArray, FloatArray]:
        """Peak forces D (2, N) of the left and the right tyre in N, and their derivatives by the lateral acceleration."""
        tyre = self.tyre
        moved = self.load_transfer * lateral_acceleration
        lifted = np.abs(moved) >= tyre.static_load
        load = tyre.static_load - _SIDES * np.clip(moved, -tyre.static_load, tyre.static_load)
        by_load = np.where(lifted, 0.0, -_SIDES * self.load_transfer)
        if tyre.peak_load_sensitivity == 0.0:
            share = friction * tyre.peak_factor
            return share * load, share * by_load
        relative = tyre.peak_factor + tyre.peak_load_sensitivity * (load / tyre.static_load - 1.0)
        slope = np.where(relative > 0.0, relative + tyre.peak_load_sensitivity * load / tyre.static_load, 0.0)
        return friction * np.maximum(relative, 0.0) * load, friction * slope * by_load

    def onward(self, slope: FloatArray, inside: BoolArray) -> FloatArray:
        """Limit the slope of the force (N/rad, negative) beyond the slip bound to at least SLOPE_MIN in magnitude."""
        return np.where(inside, slope, np.minimum(slope, -SLOPE_MIN * self.stiffness))

    def slip_for(self, share: FloatArray) -> FloatArray:
        """Slip angle in rad, as a magnitude, at which the tyre gives a share of its peak; goes on along the tangent."""
        slips = np.linspace(0.0, self.slip_max, INVERSE_POINTS)
        shape, slope = curve(self.tyre, slips)
        rate = max(float(slope[-1]), SLOPE_MIN * float(slope[0]))
        slip = np.interp(share, np.maximum.accumulate(shape), slips)
        result: FloatArray = slip + np.maximum(share - shape[-1], 0.0) / rate
        return result


def curve(tyre: MagicFormulaTyre, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the value of the tyre's curve, from -1 to 1, and its derivative by the slip angle in 1/rad."""
    return tyre.curve.value_and_slope(tyre, tyre.stiffness_factor * slip)


@dataclass(frozen=True)
class AxleForce:
    """Y in N and M in N m (see `nonlinear_car`), each (N,), with derivatives by slip, lateral speed and yaw rate."""

    side: FloatArray
    side_by_slip: FloatArray
    side_by_speed: FloatArray
    side_by_yaw_rate: FloatArray
    moment: FloatArray
    moment_by_slip: FloatArray
    moment_by_speed: FloatArray
    moment_by_yaw_rate: FloatArray


@dataclass(frozen=True)
class Motion:
    """Motion of the car in SI units: speed and yaw rate (N,); `rolling` is the speed used for slip angles, m/s."""

    speed: FloatArray
    rolling: FloatArray
    yaw_rate: FloatArray
    half_track: float
    wheel_speed_min: float
    friction: float

    def of(self, some: IndexArray) -> Motion:
        """Return the motion of some of the cars."""
        return replace(self, speed=self.speed[some], rolling=self.rolling[some], yaw_rate=self.yaw_rate[some])


def axle_force(axle: Axle, motion: Motion, slip: FloatArray, lateral: FloatArray) -> AxleForce:
    """Return the force of an axle from the slip angle (N,) in rad and lateral speed (N,) in m/s at its middle."""
    half, rolling = motion.half_track, motion.rolling
    wheel = motion.speed - half * _SIDES * motion.yaw_rate
    turning = wheel > motion.wheel_speed_min
    wheel = np.maximum(wheel, motion.wheel_speed_min)
    square = wheel * wheel + lateral * lateral
    direction = np.arctan(lateral / rolling)
    by_speed_middle = rolling / (rolling * rolling + lateral * lateral)
    shape, slope = curve(axle.tyre, slip + (np.arctan(lateral / wheel) - direction))
    peak, peak_rate = axle.loads(motion.speed * motion.yaw_rate, motion.friction)
    force = -peak * shape
    by_slip = -peak * slope
    by_speed = by_slip * (wheel / square - by_speed_middle)
    by_yaw_rate = by_slip * (half * _SIDES * turning) * lateral / square - shape * peak_rate * motion.speed
    angle = direction - slip
    along, across = np.cos(angle), half * np.sin(angle)
    both, apart = force[0] + force[1], force[0] - force[1]
    return AxleForce(
        side=along * both,
        side_by_slip=along * (by_slip[0] + by_slip[1]) + across / half * both,
        side_by_speed=along * (by_speed[0] + by_speed[1]) - across / half * by_speed_middle * both,
        side_by_yaw_rate=along * (by_yaw_rate[0] + by_yaw_rate[1]),
        moment=across * apart,
        moment_by_slip=across * (by_slip[0] - by_slip[1]) - half * along * apart,
        moment_by_speed=across * (by_speed[0] - by_speed[1]) + half * along * by_speed_middle * apart,
        moment_by_yaw_rate=across * (by_yaw_rate[0] - by_yaw_rate[1]),
    )
