"""Exact solution of the steady-turn problem with linear tyres, for a whole grid at once.

With linear tyres r and beta are affine in delta_r (see `vehicle.single_track`). Every constraint is then an interval of
delta_r and the objective a parabola: the optimum is its vertex, clipped to the feasible interval, or the end with the larger
yaw rate where the parabola opens downwards (small weight). A law (`rear_law`) gives delta_r, which must lie in the interval.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import reduce

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.map_file.bounds import BOUNDS, Binding, TurnQuantities
from codegen.map_file.tables import BINDING_TYPE, BindingArray
from codegen.optimum.demand import Demand
from codegen.optimum.problem import BINDING_TOLERANCE, SteadyTurnProblem
from codegen.optimum.rear_law import RearLaw


@dataclass(frozen=True)
class Solution:
    """Optimum on a grid; all arrays (n, m) for n speeds and m front angles, NaN where infeasible.

    Attributes:
        yaw_rate: rad/s. sideslip, rear_angle: rad.
        feasible: whether the constraints leave a solution.
        active: `Binding` flags, which constraints bind within BINDING_TOLERANCE.
        margin: rad of rear angle, how wide the feasible interval is (negative: by how much it is missed). With a law, such as
        straight rear wheels: distance of its turn from the nearest other constraint, in rad.
    """

    yaw_rate: FloatArray
    sideslip: FloatArray
    rear_angle: FloatArray
    feasible: BoolArray
    active: BindingArray
    margin: FloatArray

    def reshaped(self, shape: tuple[int, ...]) -> Solution:
        """The same optima in arrays of another shape."""
        return Solution(*(getattr(self, entry.name).reshape(shape) for entry in fields(self)))


@dataclass(frozen=True)
class Edge:
    """Largest feasible front angle at each speed; arrays (n,).

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
    """Allowed delta_r: slope * delta_f - reach to slope * delta_f + reach; arrays (n,)."""

    slope: FloatArray
    reach: FloatArray


REAR_ANGLE = next(bound for bound in BOUNDS if bound.flag is Binding.REAR_ANGLE)
OTHERS = tuple(bound for bound in BOUNDS if not bound.is_grip and bound is not REAR_ANGLE)


def _intervals(problem: SteadyTurnProblem, speed: FloatArray) -> list[_Interval]:
    """Return the intervals of delta_r that all grip bounds together, each of OTHERS and REAR_ANGLE allow, in this order."""
    gain = problem.car.yaw_gain(speed)
    zero, one = np.zeros_like(gain), np.ones_like(gain)
    by_front, by_rear = _turn(problem, speed, one, zero), _turn(problem, speed, zero, one)
    intervals = [_Interval(one, problem.lateral_acceleration_cap / (speed * gain))]
    for bound in (*OTHERS, REAR_ANGLE):
        per_rear = bound.value(by_rear)
        intervals.append(_Interval(-bound.value(by_front) / per_rear, problem.limit_of(bound) / np.abs(per_rear)))
    return intervals


def _turn(problem: SteadyTurnProblem, speed: FloatArray, front_angle: FloatArray, rear_angle: FloatArray) -> TurnQuantities:
    yaw_rate = problem.car.yaw_gain(speed) * (front_angle - rear_angle)
    sideslip = rear_angle + problem.car.sideslip_per_yaw_rate(speed) * yaw_rate
    return problem.linear_turn(speed, front_angle, yaw_rate, sideslip, rear_angle)


def solve(problem: SteadyTurnProblem, speed: FloatArray, front_angle: FloatArray) -> Solution:
    """Solve for speeds (n,) in m/s above zero and front angles (m,) in rad; speeds below the critical speed."""
    law = problem.given

    def column(values: FloatArray) -> FloatArray:
        return values[:, np.newaxis]

    intervals = _intervals(problem, speed)
    kept = intervals if law is None else intervals[:-1]
    low = reduce(np.maximum, (column(each.slope) * front_angle - column(each.reach) for each in kept))
    high = reduce(np.minimum, (column(each.slope) * front_angle + column(each.reach) for each in kept))
    if law is None:
        margin = high - low
    else:
        limit = problem.rear_angle_max
        given = np.clip(column(_law_slope(problem, law, speed)) * front_angle, -limit, limit)
        margin = np.minimum(given - low, high - given)
        low = high = given
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
    asked = demand(problem, column(speed), front_angle)
    if asked is not None:
        rear_angle = np.clip(front_angle - asked.of_optimum(gain * (front_angle - rear_angle)) / gain, low, high)
    rear_angle = np.where(feasible, rear_angle, np.nan)
    turn = _turn(problem, column(speed), front_angle, rear_angle)
    return Solution(
        yaw_rate=turn.yaw_rate,
        sideslip=turn.sideslip,
        rear_angle=rear_angle,
        feasible=feasible,
        active=binding(problem, turn, asked),
        margin=margin,
    )


def demand(problem: SteadyTurnProblem, speed: FloatArray, front_angle: FloatArray) -> Demand | None:
    """Return the floor at speeds and front angles that broadcast; None where there is none."""
    if problem.floor is None or problem.given is not None:
        return None
    return Demand(problem.floor.yaw_rate(speed, front_angle, problem.car.yaw_gain(speed) * front_angle), math.inf)


def _law_slope(problem: SteadyTurnProblem, law: RearLaw, speed: FloatArray) -> FloatArray:
    """Return the rear angle of a law for each rad of front angle, before the bound on it holds it; (n,) for speeds (n,)."""
    one, zero = np.ones_like(speed), np.zeros_like(speed)
    by_front, by_rear = _turn(problem, speed, one, zero), _turn(problem, speed, zero, one)
    result: FloatArray = (law.share(speed) - law.bound.value(by_front)) / law.bound.value(by_rear)
    return result


def binding(problem: SteadyTurnProblem, turn: TurnQuantities, demand: Demand | None) -> BindingArray:
    """Return the `Binding` flags of given turns, arrays that broadcast to the shape of the yaw rate; NaN binds nothing.

    `demand`: the demanded yaw rate, of the same shape; None for a law.
    """
    active: BindingArray = np.zeros(turn.yaw_rate.shape, dtype=BINDING_TYPE)

    def mark(flag: Binding, is_reached: BoolArray) -> None:
        active[is_reached] |= active.dtype.type(flag)

    for bound in BOUNDS:
        limit = problem.limit_of(bound)
        if limit > 0.0:
            mark(bound.flag, np.abs(bound.value(turn)) >= (1.0 - BINDING_TOLERANCE) * limit)
    if demand is not None:
        mark(Binding.LATERAL_ACCELERATION, demand.is_capped(turn.yaw_rate))
        mark(Binding.FLOOR, demand.is_floor(turn.yaw_rate, BINDING_TOLERANCE))
    return active


def edge(problem: SteadyTurnProblem, speed: FloatArray) -> Edge:
    """Find the largest feasible front angle for speeds (n,) in m/s.

    A lower and an upper bound on delta_r meet there: the smallest such meeting point over all pairs is the edge. It is found
    on the continuous problem, so that it moves smoothly with speed and does not jump from cell to cell.
    """
    if problem.given is not None:
        return _edge_of_law(problem, problem.given, speed)
    intervals = _intervals(problem, speed)
    grip = intervals[0]
    front_angle = np.full_like(speed, np.inf)
    rear_angle = np.zeros_like(speed)
    grip_limited = np.zeros(speed.shape, dtype=bool)
    for lower in intervals:
        for upper in intervals:
            closing = lower.slope - upper.slope
            with np.errstate(divide="ignore", invalid="ignore"):
                meeting = np.where(closing > 1e-12, (upper.reach + lower.reach) / closing, np.inf)
            first = meeting < front_angle
            front_angle = np.where(first, meeting, front_angle)
            with np.errstate(invalid="ignore"):
                rear_angle = np.where(first, lower.slope * meeting - lower.reach, rear_angle)
            grip_limited = np.where(first, (lower is grip) or (upper is grip), grip_limited)
    gain = problem.car.yaw_gain(speed)
    yaw_rate = gain * (front_angle - rear_angle)
    rear_angle = front_angle - yaw_rate / gain
    return Edge(
        front_angle, np.where(grip_limited, problem.lateral_acceleration_cap / speed, yaw_rate), rear_angle, grip_limited
    )


def _edge_of_law(problem: SteadyTurnProblem, law: RearLaw, speed: FloatArray) -> Edge:
    """Find the front angle at which the turn of a law first violates a bound on anything but the rear angle.

    The rear angle rises with its slope up to its own bound, and stays there.
    """
    slope, limit = _law_slope(problem, law, speed), problem.rear_angle_max
    held = np.copysign(limit, slope)
    front_angle = np.full_like(speed, np.inf)
    grip_limited = np.zeros(speed.shape, dtype=bool)
    with np.errstate(divide="ignore", invalid="ignore"):
        holds_from = np.where(slope != 0.0, held / slope, np.inf if limit > 0.0 else 0.0)
        for number, each in enumerate(_intervals(problem, speed)[:-1]):
            meeting = each.reach / np.abs(each.slope - slope)
            at_limit = (each.reach + np.sign(each.slope) * held) / np.abs(each.slope)
            meeting = np.where(meeting <= holds_from, meeting, at_limit)
            first = meeting < front_angle  # false for NaN: a bound that does not depend on the front angle
            front_angle = np.where(first, meeting, front_angle)
            grip_limited = np.where(first, number == 0, grip_limited)
    rear_angle = np.clip(slope * front_angle, -limit, limit)
    yaw_rate = problem.car.yaw_gain(speed) * (front_angle - rear_angle)
    return Edge(
        front_angle, np.where(grip_limited, problem.lateral_acceleration_cap / speed, yaw_rate), rear_angle, grip_limited
    )
