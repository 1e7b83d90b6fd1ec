"""The yaw rates at which a car with nonlinear tyres keeps all bounds, at many operating points at once.

At one speed and front angle the steady turns are a curve over the yaw rate, from straight travel (all forces zero, the rear
wheels parallel to the front ones) up to where one of these ends it: the bound on lateral acceleration, or the turn that
comes too near to the stability limit (`problem.STABILITY_MARGIN`). At that limit the rear angle stops to fall with r, and the
determinant of the plant's Jacobian over lateral speed and yaw rate is zero: it is the critical speed of the linear car, which
now depends on the turn.

Along the curve both slip angles, the sideslip and the rear angle fall with r. So each limit is crossed once,
and the feasible yaw rates are one interval: upper limits exclude the yaw rates below their crossing, lower limits those above.
Samples of the curve bracket every crossing; Newton's method on the turn and the limit together finds it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IndexArray
from codegen.errors import MapError
from codegen.map_file.bounds import BOUNDS, Binding, TurnQuantities
from codegen.optimum.nonlinear_car import ANGLE_MAX, SteadyCar, Turns, replace_turns, shrink
from codegen.optimum.problem import SteadyTurnProblem
from codegen.units import KM_H

SAMPLES = 9
BEYOND_GRIP = 1.08
"""The samples end at this multiple of the single-track car's grip, or farther out if the last sample is not beyond a bound."""
BEYOND_REACH = 1.02
"""The same for the angles."""
REACH_WITHOUT_STEERING = 0.2
"""rad of rear angle, to either side, up to which the turns of a car without rear steering are followed."""
ENLARGED = 1.3
ROUNDS_MAX = 40

SAMPLE_TOLERANCE = 1e-7
"""rad: samples bracket and start, and are no result."""
MEETING_TOLERANCE = 1e-13
"""Tolerance of the yaw rate (relative) and of slip angles (rad)."""
MEETING_ACCEPTED = 1e-11
MEETING_STEPS = 12
LIMIT_TOLERANCE = 1e-10
"""Tolerance of the end of a curve, as a fraction of the sample distance."""
SHORT_OF_BOUND = 1.0 - 1e-6
"""Fraction of the way from a sample to a slip bound, short enough that rounding does not exceed the bound."""
BRACKET_TOLERANCE = 1e-13

SIDESLIP, REAR_ANGLE = 2, 3
"""Rows of `Turns.values` and `Turns.rates`."""

CURVE_BOUNDS = tuple(sorted((bound for bound in BOUNDS if not bound.is_yaw_rate), key=lambda bound: not bound.is_grip))
"""Bounds that are met along the curve, those of grip first; the others end it."""
END = len(CURVE_BOUNDS)
"""The end of the curve, where an index into CURVE_BOUNDS is expected."""
GRIP = tuple(index for index, bound in enumerate(CURVE_BOUNDS) if bound.is_grip)
REAR_BOUND = next(index for index, bound in enumerate(CURVE_BOUNDS) if bound.flag is Binding.REAR_ANGLE)
NONE = -1


@dataclass(frozen=True)
class Points:
    """Operating points (p,): speeds in m/s, front angles in rad."""

    speed: FloatArray
    front_angle: FloatArray

    def __getitem__(self, chosen: IndexArray | BoolArray | slice) -> Points:
        return Points(self.speed[chosen], self.front_angle[chosen])

    @property
    def size(self) -> int:
        """p."""
        return int(self.speed.size)


@dataclass(frozen=True)
class Curves:
    """SAMPLES turns at each of p operating points, arrays (SAMPLES, p), yaw rates rising from zero to the end of the curve."""

    points: Points
    turns: Turns

    @property
    def end(self) -> FloatArray:
        """(p,) rad/s."""
        end: FloatArray = self.turns.yaw_rate[-1]
        return end

    def between(self, cells: IndexArray, yaw_rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Both slip angles (k,) at yaw rates (k,) of some operating points (k,), by cubic interpolation between samples."""
        nodes = self.turns.yaw_rate[:, cells]
        before = np.clip((nodes <= yaw_rate).sum(axis=0) - 1, 0, SAMPLES - 2)
        low, width = nodes[before, np.arange(cells.size)], nodes[1, :] - nodes[0, :]
        t = np.where(width > 0.0, (yaw_rate - low) / np.where(width > 0.0, width, 1.0), 0.0)
        slips = []
        for row, values in enumerate((self.turns.slip_front, self.turns.slip_rear)):
            left, right = values[before, cells], values[before + 1, cells]
            rates = self.turns.rates[row]
            slope, end_slope = rates[before, cells] * width, rates[before + 1, cells] * width
            rise = right - left
            slips.append(left + t * (slope + t * (3.0 * rise - 2.0 * slope - end_slope + t * (slope + end_slope - 2.0 * rise))))
        return slips[0], slips[1]


@dataclass(frozen=True)
class Ranges:
    """The yaw rates between the bounds at p operating points; arrays (p,).

    Attributes:
        low, high: rad/s. No yaw rate is feasible where `high` is below `low`.
        low_by, high_by: index into CURVE_BOUNDS of the bound that sets it; END for the end of the curve, NONE for zero.
        missed: by how much even the end of the curve exceeds a bound that is met from above (rad), or, where that is more, by
            how much straight travel misses the stability margin; zero or below where neither does.
    """

    low: FloatArray
    high: FloatArray
    low_by: IndexArray
    high_by: IndexArray
    missed: FloatArray


def limits(problem: SteadyTurnProblem) -> FloatArray:
    """Return the limits (k,) of CURVE_BOUNDS; inf for the rear angle that a law gives, which holds it there itself."""
    found = np.array([problem.limit_of(bound) for bound in CURVE_BOUNDS])
    if problem.given is not None:
        found[REAR_BOUND] = math.inf
    return found


def bounded(points: Points, turns: Turns) -> FloatArray:
    """Return the values (k, ...) of CURVE_BOUNDS at turns (..., p)."""
    quantities = TurnQuantities(
        points.speed, points.front_angle, turns.yaw_rate, turns.sideslip, *turns.slips, turns.rear_angle
    )
    return np.stack([bound.value(quantities) for bound in CURVE_BOUNDS])


def bounded_rates(points: Points, turns: Turns) -> FloatArray:
    """Return the derivatives (k, ...) of `bounded` by the yaw rate."""
    front, rear, sideslip, rear_angle = turns.rates
    quantities = TurnQuantities(points.speed, 0.0, 1.0, sideslip, front, rear, rear_angle)
    return np.stack([bound.value(quantities) for bound in CURVE_BOUNDS])


def yaw_rate_limit(problem: SteadyTurnProblem, speed: FloatArray) -> FloatArray:
    """Return the yaw rate (p,) in rad/s at which the first of the bounds on it ends the curve."""
    unit = TurnQuantities(speed, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    result: FloatArray = np.minimum.reduce(
        [problem.limit_of(bound) / bound.value(unit) for bound in BOUNDS if bound.is_yaw_rate]
    )
    return result


def curves(problem: SteadyTurnProblem, car: SteadyCar, points: Points) -> Curves:
    """Samples of the steady turns. Raises MapError where one is not found, with its operating point."""
    # Beyond the second one the bounds on angles alone leave nothing.
    limit = np.minimum(yaw_rate_limit(problem, points.speed), BEYOND_REACH * _reach(problem, car, points))
    end = np.minimum(limit, BEYOND_GRIP * car.grip_yaw_rate(points.speed))
    found = _sampled(problem, car, points, end)
    lowest = -limits(problem)[:, np.newaxis]
    for _ in range(ROUNDS_MAX):
        short = np.flatnonzero((end < limit) & ~(bounded(points, found.turns)[:, -1] < lowest).any(axis=0))
        if not short.size:
            break
        end[short] = np.minimum(limit[short], ENLARGED * end[short])
        found = _with(found, short, _sampled(problem, car, points[short], end[short]))
    return _until_unstable(problem, car, found, lowest)


def _reach(problem: SteadyTurnProblem, car: SteadyCar, points: Points) -> FloatArray:
    """(p,) rad/s: the largest yaw rate that goes with slip angles, sideslip and rear angle inside their bounds."""
    front, rear, sideslip = problem.front_slip_max, problem.rear_slip_max, problem.sideslip_max
    rear_angle = problem.rear_angle_max or math.inf
    ahead = np.tan(np.minimum(points.front_angle + front, ANGLE_MAX))
    behind = math.tan(min(rear + min(rear_angle, REACH_WITHOUT_STEERING), ANGLE_MAX))
    rolling = np.maximum(points.speed, car.wheel_speed_min)
    result: FloatArray = rolling * np.minimum((ahead + behind) / car.wheelbase, (ahead + math.tan(sideslip)) / car.front_arm)
    return result


def _sampled(problem: SteadyTurnProblem, car: SteadyCar, points: Points, end: FloatArray) -> Curves:
    shares = np.linspace(0.0, 1.0, SAMPLES)[:, np.newaxis]
    shape = (SAMPLES, points.size)
    speed, front_angle = (np.broadcast_to(values, shape).ravel() for values in (points.speed, points.front_angle))
    turns = car.turns(speed, front_angle, (shares * end).ravel(), tolerance=SAMPLE_TOLERANCE)
    lost = np.flatnonzero(~turns.converged)
    if lost.size:
        turns = replace_turns(turns, lost, _out_of_reach(problem, car, Points(speed, front_angle)[lost], turns.yaw_rate[lost]))
    check(turns, Points(speed, front_angle))
    return Curves(points, turns.reshaped(shape))


def _out_of_reach(problem: SteadyTurnProblem, car: SteadyCar, points: Points, yaw_rate: FloatArray) -> Turns:
    """Stand-ins for turns (k,) that were not found, `converged` where that does no harm.

    It does none where not even without regard to forces a sideslip and a rear angle inside their bounds go with slip angles
    inside theirs. Any slip angles inside theirs then violate a bound, and on the side on which the turn itself would.
    """
    front, rear, sideslip = problem.front_slip_max, problem.rear_slip_max, problem.sideslip_max
    rear_angle = problem.rear_angle_max or math.inf
    corners = [
        car.geometry(points.speed, points.front_angle, yaw_rate, (np.full(points.size, a), np.full(points.size, b)))
        for a in (-front, front)
        for b in (-rear, rear)
    ]
    lowest, highest = (of([turns.values for turns in corners], axis=0) for of in (np.min, np.max))
    limit = np.array([sideslip, rear_angle])[:, np.newaxis]
    excluded = ((lowest[2:] > limit) | (highest[2:] < -limit)).any(axis=0)
    straight = (np.zeros(points.size), np.zeros(points.size))
    return replace(car.geometry(points.speed, points.front_angle, yaw_rate, straight), converged=excluded)


def check(turns: Turns, points: Points) -> None:
    """Raise MapError where a turn was not found, with its operating point."""
    for index in np.flatnonzero(~turns.converged)[:1]:
        raise MapError(
            f"no steady turn is found for a yaw rate of {math.degrees(turns.yaw_rate[index]):.6g} deg/s",
            where=f"{points.speed[index] / KM_H:.6g} km/h, {math.degrees(points.front_angle[index]):.6g} deg",
            remedy='check the vehicle data, or take tyre_model = "linear"',
        )


def _with(found: Curves, cells: IndexArray, others: Curves) -> Curves:
    """The curves with those of some operating points replaced."""
    return Curves(found.points, replace_turns(found.turns, cells, others.turns))


def _until_unstable(problem: SteadyTurnProblem, car: SteadyCar, found: Curves, lowest: FloatArray) -> Curves:
    """The curves, each ended where the turn comes too near to the stability limit, if that is inside the other bounds."""
    spare = car.stability(found.points.speed, found.turns.rates[REAR_ANGLE])
    below = bounded(found.points, found.turns) < lowest[:, np.newaxis]
    last = _first(below.any(axis=0) | (spare <= 0.0))
    cells = np.flatnonzero((last > 0) & (last < SAMPLES))
    last = last[cells]
    low, high = found.turns.yaw_rate[last - 1, cells], found.turns.yaw_rate[last, cells]
    left_low, left_high = spare[last - 1, cells], spare[last, cells]

    def left(some: IndexArray, yaw_rate: FloatArray) -> FloatArray:
        """Return the distance to the stability limit."""
        here = cells[some]
        points = found.points[here]
        turns = car.turns(points.speed, points.front_angle, yaw_rate, found.between(here, yaw_rate))
        check(turns, points)
        return car.stability(points.speed, turns.rates[REAR_ANGLE])

    # Beyond a slip bound the force goes on as no tyre's does: there the limit may be missed. It is asked for at the bound.
    rows, at = np.nonzero(below[list(GRIP)][:, last, cells])
    if at.size:
        met = meetings(car, found, cells[at], rows, lowest[rows, 0], last[at] - 1)
        np.minimum.at(high, at, low[at] + (met - low[at]) * SHORT_OF_BOUND)
        asked = np.unique(at)
        left_high[asked] = left(asked, high[asked])
    some = np.flatnonzero(left_high <= 0.0)
    if not some.size:
        return found
    end, _ = shrink(
        lambda k, yaw_rate: left(some[k], yaw_rate), low[some], high[some], left_low[some], left_high[some], LIMIT_TOLERANCE
    )
    return _with(found, cells[some], _sampled(problem, car, found.points[cells[some]], end))


def _first(there: BoolArray) -> IndexArray:
    """Return the index (p,) of the first true sample of each column of (SAMPLES, p); SAMPLES where there is none."""
    return np.where(there.any(axis=0), there.argmax(axis=0), SAMPLES)


def meetings(
    car: SteadyCar, found: Curves, cells: IndexArray, rows: IndexArray, target: FloatArray, left: IndexArray
) -> FloatArray:
    """Yaw rates (k,) at which a row of `bounded` meets a value, inside the cell of samples `left`, `left` + 1.

    Raises MapError where one is not found.
    """
    turns, points = found.turns, found.points[cells]
    low, high = turns.yaw_rate[left, cells], turns.yaw_rate[left + 1, cells]
    values = bounded(found.points, turns)
    here, there = values[rows, left, cells], values[rows, left + 1, cells]
    r = low + (high - low) * np.clip((target - here) / np.where(there == here, 1.0, there - here), 0.0, 1.0)
    front, rear = found.between(cells, r)
    picked = np.arange(cells.size)
    done = np.zeros(cells.shape, dtype=np.bool_)
    for _ in range(MEETING_STEPS):
        turn = car.corrected(points.speed, points.front_angle, r, (front, rear))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -(bounded(points, turn)[rows, picked] - target) / bounded_rates(points, turn)[rows, picked]
        moved = np.clip(np.where(np.isfinite(step), r + step, r), low, high)
        new_front = turn.slip_front + turn.rates[0] * (moved - r)
        new_rear = turn.slip_rear + turn.rates[1] * (moved - r)
        change = np.maximum(np.abs(new_front - front), np.abs(new_rear - rear))
        done = (np.abs(moved - r) <= MEETING_ACCEPTED * high) & (change <= MEETING_ACCEPTED)
        small = (np.abs(moved - r) <= MEETING_TOLERANCE * high) & (change <= MEETING_TOLERANCE)
        r, front, rear = moved, new_front, new_rear
        if small.all():
            return r
    rest = np.flatnonzero(~done)
    if rest.size:

        def above(some: IndexArray, yaw_rate: FloatArray) -> FloatArray:
            """Return the excess of the bounded values over their targets."""
            chosen = rest[some]
            turns = car.turns(
                points.speed[chosen], points.front_angle[chosen], yaw_rate, found.between(cells[chosen], yaw_rate)
            )
            check(turns, points[chosen])
            return bounded(points[chosen], turns)[rows[chosen], np.arange(some.size)] - target[chosen]

        ends = ((here - target)[rest], (there - target)[rest])
        r[rest] = shrink(above, low[rest], high[rest], *ends, BRACKET_TOLERANCE)[1]
    return r


def ranges(problem: SteadyTurnProblem, car: SteadyCar, found: Curves) -> Ranges:
    """Return the feasible part of the curves. Raises MapError if a meeting is not found."""
    bound = limits(problem)[:, np.newaxis, np.newaxis]
    values = bounded(found.points, found.turns)
    low, low_by = _ends(car, found, values > bound, bound.ravel(), from_below=True)
    high, high_by = _ends(car, found, values < -bound, -bound.ravel(), from_below=False)
    exceeded = (values[:, -1] - bound[:, 0]).max(axis=0)
    unstable = -car.stability(found.points.speed, found.turns.rates[REAR_ANGLE, 0])
    return Ranges(low, high, low_by, high_by, np.maximum(exceeded, unstable))


def _ends(
    car: SteadyCar, found: Curves, violated: BoolArray, target: FloatArray, *, from_below: bool
) -> tuple[FloatArray, IndexArray]:
    """One end of the intervals and what sets it: the last meeting with a bound from below, or the first one from above."""
    points = found.points.size
    # Index of the sample before the meeting; out of the samples where a bound is kept (or violated) all along.
    if from_below:
        left = SAMPLES - 1 - violated[:, ::-1].argmax(axis=1)
        left = np.where(violated.any(axis=1), left, NONE)
        critical = left.max(axis=0)
        inside = (critical >= 0) & (critical < SAMPLES - 1)
        end = np.where(critical >= SAMPLES - 1, found.end, 0.0)
        by = np.where(critical >= SAMPLES - 1, left.argmax(axis=0), NONE)
    else:
        left = np.where(violated.any(axis=1), violated.argmax(axis=1) - 1, SAMPLES - 1)
        critical = left.min(axis=0)
        inside = critical < SAMPLES - 1
        end, by = found.end.copy(), np.full(points, END)
    rows, cells = np.nonzero(inside & (left == critical))
    if cells.size:
        met = meetings(car, found, cells, rows, target[rows], np.maximum(critical[cells], 0))
        order = np.lexsort((rows, met if from_below else -met, cells))
        cells, rows, met = cells[order], rows[order], met[order]
        # The last of each operating point is the innermost.
        last = np.append(cells[1:] != cells[:-1], True)
        end[cells[last]], by[cells[last]] = met[last], rows[last]
    return end, by
