"""Exact solution of the steady-turn problem with linear tyres, for a whole grid at once.

With linear tyres r and beta are affine in delta_r (see `vehicle.single_track`). Every constraint is then an interval of
delta_r and the objective a parabola: the optimum is its vertex, clipped to the feasible interval, or the end with the larger
yaw rate where the parabola opens downwards (small weight).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from codegen.map_file.map import Binding
from codegen.optimum.problem import BINDING_TOLERANCE, FloatArray, SteadyTurnProblem

BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Solution:
    """Optimum on a grid; all arrays (n, m) for n speeds and m front angles, NaN where infeasible.

    Attributes:
        yaw_rate: rad/s. sideslip, rear_angle: rad.
        feasible: whether the constraints leave a solution.
        active: `Binding` flags, which constraints bind within BINDING_TOLERANCE.
        margin: rad of rear angle, how wide the feasible interval is (negative: by how much it is missed). Without rear
            steering: how far delta_r = 0 lies inside what the other constraints allow.
    """

    yaw_rate: FloatArray
    sideslip: FloatArray
    rear_angle: FloatArray
    feasible: BoolArray
    active: npt.NDArray[np.uint8]
    margin: FloatArray

    def reshaped(self, shape: tuple[int, ...]) -> Solution:
        """The same optima in arrays of another shape."""
        return Solution(*(getattr(self, entry.name).reshape(shape) for entry in fields(self)))


@dataclass(frozen=True)
class Edge:
    """Where the feasible set of front angles ends at each speed; arrays (n,).

    Attributes:
        front_angle: rad, the largest front angle with a feasible rear angle, on the continuous problem.
        yaw_rate: rad/s there, of the optimum. rear_angle: rad there.
        grip_limited: a slip or lateral-acceleration bound ends it (else sideslip and rear angle do).
    """

    front_angle: FloatArray
    yaw_rate: FloatArray
    rear_angle: FloatArray
    grip_limited: BoolArray


@dataclass(frozen=True)
class _Interval:
    """Bounds on delta_r that are affine in delta_f: low = low_slope * delta_f + low_offset, and so on; arrays (n,)."""

    low_slope: FloatArray
    low_offset: FloatArray
    high_slope: FloatArray
    high_offset: FloatArray


def _intervals(problem: SteadyTurnProblem, speed: FloatArray) -> tuple[_Interval, _Interval, _Interval]:
    """The intervals of delta_r that grip (ay and both slips), sideslip and the rear angle allow."""
    gain = problem.car.yaw_gain(speed)
    ratio = problem.car.sideslip_per_yaw_rate(speed) * gain  # beta = ratio delta_f + (1 - ratio) delta_r; 1 - ratio > 0
    zero, one = np.zeros_like(gain), np.ones_like(gain)
    reach = problem.lateral_acceleration_cap / (speed * gain)
    grip = _Interval(one, -reach, one, reach)
    slope = -ratio / (1.0 - ratio)
    offset = problem.sideslip_max / (1.0 - ratio)
    sideslip = _Interval(slope, -offset, slope, offset)
    limit = problem.rear_angle_max * one
    return grip, sideslip, _Interval(zero, -limit, zero, limit)


def solve(problem: SteadyTurnProblem, speed: FloatArray, front_angle: FloatArray) -> Solution:
    """Solve for speeds (n,) in m/s above zero and front angles (m,) in rad; speeds below the critical speed."""
    grip, sideslip_bound, rear_bound = _intervals(problem, speed)
    steers = problem.rear_angle_max > 0.0

    def column(values: FloatArray) -> FloatArray:
        return values[:, np.newaxis]

    def ends(interval: _Interval) -> tuple[FloatArray, FloatArray]:
        return (
            column(interval.low_slope) * front_angle + column(interval.low_offset),
            column(interval.high_slope) * front_angle + column(interval.high_offset),
        )

    (grip_low, grip_high), (sideslip_low, sideslip_high) = ends(grip), ends(sideslip_bound)
    low, high = np.maximum(grip_low, sideslip_low), np.minimum(grip_high, sideslip_high)
    if steers:
        low = np.maximum(low, column(rear_bound.low_offset))
        high = np.minimum(high, column(rear_bound.high_offset))
        margin = high - low
    else:
        margin = np.minimum(-low, high)
        low, high = np.zeros_like(low), np.zeros_like(high)
    feasible = margin >= 0.0

    gain = column(problem.car.yaw_gain(speed))
    per_yaw_rate = column(problem.car.sideslip_per_yaw_rate(speed))
    steepness = 1.0 / gain - per_yaw_rate  # beta = delta_f - steepness * r, above zero for every car
    weight = problem.sideslip_weight
    curvature = weight * steepness**2 - 1.0  # of the objective over delta_r, divided by 2 G^2
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = -front_angle * (1.0 + weight * steepness * per_yaw_rate) / curvature

    # Without curvature the objective falls all the way with the yaw rate (its slope over r is -2 r (1 - weight steepness^2)
    # - 2 weight steepness delta_f), and a turn to the other side costs at least as much as its mirror image: the low end.
    rear_angle = np.where(curvature > 0.0, np.clip(vertex, low, high), low)
    rear_angle = np.where(feasible, rear_angle, np.nan)
    yaw_rate = gain * (front_angle - rear_angle)
    sideslip = rear_angle + per_yaw_rate * yaw_rate
    return Solution(
        yaw_rate=yaw_rate,
        sideslip=sideslip,
        rear_angle=rear_angle,
        feasible=feasible,
        active=binding(problem, column(speed), yaw_rate, sideslip, rear_angle),
        margin=margin,
    )


def binding(
    problem: SteadyTurnProblem, speed: FloatArray, yaw_rate: FloatArray, sideslip: FloatArray, rear_angle: FloatArray
) -> npt.NDArray[np.uint8]:
    """Which constraints bind at given solutions (arrays that broadcast together; NaN binds nothing)."""
    lateral_acceleration = np.abs(speed * yaw_rate)
    slips = (
        lateral_acceleration * problem.car.front_slip_per_lateral_acceleration,
        lateral_acceleration * problem.car.rear_slip_per_lateral_acceleration,
    )
    return flags(problem, lateral_acceleration, sideslip, slips, rear_angle)


def flags(
    problem: SteadyTurnProblem,
    lateral_acceleration: FloatArray,
    sideslip: FloatArray,
    slips: tuple[FloatArray, FloatArray],
    rear_angle: FloatArray,
) -> npt.NDArray[np.uint8]:
    """Which constraints bind, from what they bound: arrays of one shape, of any sign; NaN binds nothing; slips front, rear."""
    used = (
        (Binding.SIDESLIP, sideslip, problem.sideslip_max),
        (Binding.LATERAL_ACCELERATION, lateral_acceleration, problem.lateral_acceleration_max),
        (Binding.SLIP_FRONT, slips[0], problem.front_slip_max),
        (Binding.SLIP_REAR, slips[1], problem.rear_slip_max),
        (Binding.REAR_ANGLE, rear_angle, problem.rear_angle_max),
    )
    active = np.zeros(lateral_acceleration.shape, dtype=np.uint8)
    for flag, value, bound in used:
        if bound > 0.0:
            active |= np.where(np.abs(value) >= (1.0 - BINDING_TOLERANCE) * bound, np.uint8(flag), np.uint8(0))
    return active


def edge(problem: SteadyTurnProblem, speed: FloatArray) -> Edge:
    """Where feasibility ends over the front angle, for speeds (n,) in m/s.

    A lower and an upper bound on delta_r meet there: the smallest such meeting point over all pairs is the edge. It is found
    on the continuous problem, so that it moves smoothly with speed and does not jump from cell to cell.
    """
    intervals = _intervals(problem, speed)
    grip = intervals[0]
    front_angle = np.full_like(speed, np.inf)
    rear_angle = np.zeros_like(speed)
    grip_limited = np.zeros(speed.shape, dtype=bool)
    for lower in intervals:
        for upper in intervals:
            closing = lower.low_slope - upper.high_slope
            with np.errstate(divide="ignore", invalid="ignore"):
                meeting = np.where(closing > 1e-12, (upper.high_offset - lower.low_offset) / closing, np.inf)
            first = meeting < front_angle
            front_angle = np.where(first, meeting, front_angle)
            with np.errstate(invalid="ignore"):
                rear_angle = np.where(first, lower.low_slope * meeting + lower.low_offset, rear_angle)
            grip_limited = np.where(first, (lower is grip) or (upper is grip), grip_limited)
    gain = problem.car.yaw_gain(speed)
    yaw_rate = gain * (front_angle - rear_angle)
    rear_angle = front_angle - yaw_rate / gain
    return Edge(
        front_angle, np.where(grip_limited, problem.lateral_acceleration_cap / speed, yaw_rate), rear_angle, grip_limited
    )
