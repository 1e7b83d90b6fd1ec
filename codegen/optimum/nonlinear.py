"""Solution of the steady-turn problem on the plant's own steady turns, with Magic Formula tyres at four loaded wheels.

The problem is that of `problem`, the steady turn that of `vehicle.dynamics.two_track`, whose slip outputs are bounded. One
degree of freedom is left at each operating point: the yaw rate, inside the interval of `nonlinear_range`. The objective's
stationary points inside it and its ends are the candidates; the best of them is the optimum. A law (`rear_law`) gives one yaw
rate, which must lie in the interval.

Two additions that the linear car does not need: a turn must be stable, by the margin that the grid keeps from the critical
speed (`problem.STABILITY_MARGIN`), and a slip bound ends short of the tyre's peak
(`problem.PEAK_SHARE`).

r < 0 is left out: with the front wheels turned to the left it has as much slip as |r|, more sideslip and a larger rear angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Self

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray, IndexArray
from codegen.configuration import Case, Config
from codegen.errors import ConfigError
from codegen.map_file.bounds import TurnQuantities
from codegen.map_file.map import ReferenceMap
from codegen.optimum.demand import BELOW_GRIP, Demand
from codegen.optimum.exact import Edge, Solution, binding
from codegen.optimum.nonlinear_car import (
    SteadyCar,
    Turns,
    concatenate_turns,
    replace_turns,
    select_turns,
    shrink,
    unknown_turns,
)
from codegen.optimum.nonlinear_range import (
    CURVE_BOUNDS,
    END,
    GRIP,
    REAR_BOUND,
    SAMPLES,
    SIDESLIP,
    Curves,
    Points,
    Ranges,
    bounded,
    check,
    curves,
    meetings,
    ranges,
    yaw_rate_limit,
)
from codegen.optimum.problem import SteadyTurnProblem
from codegen.optimum.rear_law import RearLaw
from codegen.units import KM_H

BLOCK = 1200
"""Operating points at a time: their samples stay in the processor's cache."""

STATIONARY_TOLERANCE = 1e-5
"""Tolerance as a fraction of the sample distance; the error of the final secant step is about its square."""

PROBES = (17, 17)
"""Speeds and front angles at which the limit of grip is computed for the cap."""
FRONT_ANGLE_MAX = math.radians(60.0)
"""Default end of the search for an edge; no configuration allows a larger front angle."""
SCAN_POINTS = 25
INSIDE = 1e-9
"""Fraction by which the returned edge is reduced, so that rounding does not make it infeasible."""
BEYOND = 1e-6
"""Distance by which the search continues beyond its last angle, so that an edge at that angle is found."""
EDGE_TOLERANCE = 1e-13
"""Tolerance as a fraction of the distance between two scanned angles."""


@dataclass(frozen=True)
class _Found:
    """Optimum at p operating points; arrays (p,), NaN where infeasible.

    `grip`: whether grip sets the range's upper end; `grip_yaw_rate`: where grip ends the turns, rad/s, NaN where another bound
    does so before; `least`, `limit`: the demand, zero and infinite without one.
    """

    turns: Turns
    feasible: BoolArray
    margin: FloatArray
    grip: BoolArray
    grip_yaw_rate: FloatArray
    least: FloatArray
    limit: FloatArray


@dataclass(frozen=True)
class NonlinearTurns:
    """The steady turns of a case with the nonlinear tyre: see `turns.SteadyTurns`."""

    problem: SteadyTurnProblem
    car: SteadyCar
    probed: tuple[tuple[float, float], tuple[float, float]]
    """Ends of the speeds in m/s and of the front angles in rad between which the cap must hold."""
    method = "newton"

    @classmethod
    def from_config(cls, config: Config, case: Case) -> Self:
        """Return the turns of one case, whatever its tyre model. Raises ConfigError (see `AxleTyres`)."""
        case = case.model_copy(update={"tyre_model": "magic-formula"})
        problem = SteadyTurnProblem.from_config(config, case)
        car = SteadyCar.from_config(config, (problem.front_slip_max, problem.rear_slip_max))
        (slow, fast), (first, last) = config.grid.speed_ends_km_h, config.grid.front_angle_ends_deg
        return cls(problem, car, ((slow * KM_H, fast * KM_H), (math.radians(first), math.radians(last))))

    def without_rear_steering(self) -> Self:
        """The same car with its rear wheels straight."""
        return replace(self, problem=self.problem.without_rear_steering())

    def cap(self, speed: FloatArray, /) -> FloatArray:
        """See `SteadyTurns`.

        At the same grip an axle carries less across the car, the larger its steering angle and the load transfer are. So the
        lateral acceleration at the limit of grip falls with the front angle, and a yaw rate that followed it would fall too.
        The cap is below it at every front angle of the map.
        """
        return np.interp(speed, *self._probed_cap) if self.problem.is_bent else np.full(speed.shape, math.inf)

    @cached_property
    def _probed_cap(self) -> tuple[FloatArray, FloatArray]:
        """Speeds (n,) in m/s, and the cap there in m/s^2."""
        speed, angle = (np.linspace(*ends, count) for ends, count in zip(self.probed, PROBES, strict=True))
        points = Points(*(values.ravel() for values in np.meshgrid(speed, angle, indexing="ij")))
        found = curves(self.problem, self.car, points)
        between = ranges(self.problem, self.car, found)
        margin = self._margin_of(points, between, self._at(found, between.low), self._at(found, between.high))
        feasible = (margin >= 0.0).reshape(PROBES)
        feasible[:, 1:] |= feasible[:, :-1]  # the last feasible angle lies before the first probe beyond
        # The bound on the lateral acceleration itself does not fall with the front angle.
        inside = between.high < yaw_rate_limit(self.problem, points.speed) * (1.0 - INSIDE)
        ended = feasible & (inside & np.isin(between.high_by, (*GRIP, END))).reshape(PROBES)
        reached = np.where(ended, (points.speed * between.high).reshape(PROBES), math.inf).min(axis=1)
        # Grip may end the turns between two speeds and at none of them: the smallest of three neighbours.
        around = np.pad(reached, 1, mode="edge")
        reached = np.minimum.reduce([around[:-2], reached, around[2:]])
        return speed, np.minimum(BELOW_GRIP * reached, self.problem.lateral_acceleration_max)

    def solve(self, speed: FloatArray, front_angle: FloatArray) -> Solution:
        """See `SteadyTurns`."""
        pairs = np.broadcast_arrays(speed[:, np.newaxis], front_angle)
        return self.at(*(values.ravel() for values in pairs)).reshaped(pairs[0].shape)

    def at(self, speed: FloatArray, front_angle: FloatArray) -> Solution:
        """See `SteadyTurns`."""
        return self.at_with_grip(speed, front_angle)[0]

    def at_with_grip(self, speed: FloatArray, front_angle: FloatArray) -> tuple[Solution, FloatArray]:
        """Return the result of `at`, and the grip limit of each pair: the yaw rates (n,) in rad/s at which its turns end.

        Grip ends them by a slip bound, the bound on lateral acceleration or the stability limit. Infeasible pairs have a limit
        too. It is NaN where another bound ends the turns first.
        """
        points = Points(speed, front_angle)
        found = self._found(points)
        turns = found.turns
        quantities = TurnQuantities(
            points.speed, points.front_angle, turns.yaw_rate, turns.sideslip, *turns.slips, turns.rear_angle
        )
        solution = Solution(
            yaw_rate=turns.yaw_rate,
            sideslip=turns.sideslip,
            rear_angle=turns.rear_angle,
            feasible=found.feasible,
            active=binding(self.problem, quantities, Demand(found.least, found.limit)),
            margin=found.margin,
        )
        return solution, found.grip_yaw_rate

    def edge(self, speed: FloatArray, front_angle_max: float = FRONT_ANGLE_MAX) -> Edge:
        """See `SteadyTurns`. Results are cached, because build and tuning need that of a map several times."""
        return _kept_edge(self, tuple(speed.tolist()), front_angle_max)

    def find_edge(self, speed: FloatArray, front_angle_max: float) -> Edge:
        """Return the edge: the root of the margin between the last feasible of some angles and the next one."""
        angles = front_angle_max * (1.0 + BEYOND) * np.linspace(0.0, 1.0, SCAN_POINTS)
        speeds, fronts = (values.ravel() for values in np.broadcast_arrays(speed[:, np.newaxis], angles))
        margins = np.concatenate([self._margin(block) for block in _blocks(Points(speeds, fronts))])
        margins = margins.reshape(speed.size, SCAN_POINTS)
        kept = margins >= 0.0
        last = SCAN_POINTS - 1 - kept[:, ::-1].argmax(axis=1)
        ends = last < SCAN_POINTS - 1
        front_angle = np.full(speed.shape, np.inf)
        rows = np.flatnonzero(ends)
        at = last[rows]
        front_angle[rows], _ = shrink(
            lambda some, angle: self._margin(Points(speed[rows[some]], angle)),
            angles[at],
            angles[at + 1],
            margins[rows, at],
            margins[rows, at + 1],
            EDGE_TOLERANCE,
        )
        front_angle *= 1.0 - INSIDE
        found = self._found(Points(speed, np.where(ends, front_angle, 0.0)))
        turns = found.turns
        values = (np.where(ends, turns.yaw_rate, np.nan), np.where(ends, turns.rear_angle, np.nan), ends & found.grip)
        for array in (front_angle, *values):
            array.setflags(write=False)  # shared through the cache
        return Edge(front_angle, *values)

    def lateral_acceleration_cap(self, asked: FloatArray, /) -> float:
        """Return the largest value of the map: grip depends on speed and front angle, and the cap must not cut an optimum."""
        return float(np.nanmax(asked))

    def quantities(self, speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray) -> TurnQuantities:
        """See `SteadyTurns`."""
        turns = self.turns_at(speed, front_angle, yaw_rate)
        values = (np.where(turns.converged, each, np.nan) for each in (turns.sideslip, *turns.slips, turns.rear_angle))
        return TurnQuantities(speed, front_angle, yaw_rate, *values)

    def turns_at(self, speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray) -> Turns:
        """The plant's own steady turns, rad, at speeds, front angles and yaw rates of one shape, up to the tyres' peak.

        `converged` is False where there is none (and for NaN).
        """
        car = self.car
        front, rear = (replace(axle, slip_max=min(axle.tyre.peak_slip, FRONT_ANGLE_MAX)) for axle in (car.front, car.rear))
        known = np.isfinite(yaw_rate)
        asked = np.where(known, yaw_rate, 0.0)
        turns = replace(car, front=front, rear=rear).turns(speed.ravel(), front_angle.ravel(), asked.ravel())
        there = (np.abs(turns.slip_front) <= front.slip_max) & (np.abs(turns.slip_rear) <= rear.slip_max)
        return replace(turns, converged=turns.converged & there & known.ravel()).reshaped(yaw_rate.shape)

    # --- one block of operating points ----------------------------------------------------------------------------------

    def _margin(self, points: Points) -> FloatArray:
        """(p,) rad; see `exact.Solution`."""
        found = curves(self.problem, self.car, points)
        between = ranges(self.problem, self.car, found)
        return self._margin_of(points, between, self._at(found, between.low), self._at(found, between.high))

    def _margin_of(self, points: Points, between: Ranges, low: Turns, high: Turns) -> FloatArray:
        """Return the width of the range in rad of rear angle; with a law, the distance of its turn from the ends."""
        law = self.problem.given
        if law is None:
            width = low.rear_angle - high.rear_angle
        else:
            width = np.minimum(self._beyond_law(law, points, low), -self._beyond_law(law, points, high))
        return np.where(between.missed > 0.0, np.minimum(width, -between.missed), width)

    def _beyond_law(self, law: RearLaw, points: Points, turns: Turns) -> FloatArray:
        """Return the distance of turns (..., p) from the law's in rad, positive at smaller yaw rates.

        All three parts fall with the yaw rate: the law's own value, and the rear angle over both ends of its range.
        """
        wanted, limit = law.value(points.speed, points.front_angle), self.problem.rear_angle_max
        own = bounded(points, turns)[CURVE_BOUNDS.index(law.bound)] - wanted
        result: FloatArray = np.maximum(turns.rear_angle - limit, np.minimum(own, turns.rear_angle + limit))
        return result

    def _at(self, found: Curves, yaw_rate: FloatArray, cells: IndexArray | None = None) -> Turns:
        """Return the turns at yaw rates (k,) of some operating points, by default of all."""
        chosen = np.arange(found.points.size) if cells is None else cells
        points = found.points[chosen]
        turns = self.car.turns(points.speed, points.front_angle, yaw_rate, found.between(chosen, yaw_rate))
        check(turns, points)
        return turns

    def _found(self, points: Points) -> _Found:
        """The optimum at any number of operating points."""
        parts = [self._found_in(block) for block in _blocks(points)]
        return _Found(
            concatenate_turns([part.turns for part in parts]),
            *(
                np.concatenate([getattr(part, name) for part in parts])
                for name in ("feasible", "margin", "grip", "grip_yaw_rate", "least", "limit")
            ),
        )

    def _found_in(self, points: Points) -> _Found:
        found = curves(self.problem, self.car, points)
        between = ranges(self.problem, self.car, found)
        low, high = self._at(found, between.low), self._at(found, between.high)
        margin = self._margin_of(points, between, low, high)
        feasible = margin >= 0.0
        cells = np.flatnonzero(feasible)
        # A yaw rate that bends does not end at the limit of grip.
        grip = np.isin(between.high_by, (*GRIP, END)) & (not self.problem.is_bent)
        grip_yaw_rate = np.where(grip, between.high, np.nan)
        law, demand = self.problem.given, self._demand(found, cells)
        least, limit = np.zeros(points.size), np.full(points.size, math.inf)
        if law is not None:
            best = self._given(law, found, cells)
            grip &= -self._beyond_law(law, points, high) <= self._beyond_law(law, points, low)
        else:
            best = self._best(found, cells, low, high)
        if demand is not None:
            least[cells], limit[cells] = demand.least, demand.limit
            asked = demand.of_optimum(best.yaw_rate)
            best = self._at(found, np.clip(asked, low.yaw_rate[cells], high.yaw_rate[cells]), cells)
        turns = replace_turns(unknown_turns(points.size), cells, best)
        return _Found(turns, feasible, margin, grip, grip_yaw_rate, least, limit)

    def demand(self, speed: FloatArray, front_angle: FloatArray) -> Demand | None:
        """See `SteadyTurns`."""
        parts = []
        for block in _blocks(Points(speed, front_angle)):
            asked = self._demand(curves(self.problem, self.car, block), np.arange(block.size))
            if asked is None:
                return None
            parts.append(asked)
        return Demand(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("least", "limit")))

    def _demand(self, found: Curves, cells: IndexArray) -> Demand | None:
        """Return the demand at some operating points (k,).

        For the floor, the yaw rate of the passive car is at most that at the end of the curves.
        """
        floor, points = self.problem.floor, found.points[cells]
        if self.problem.given is not None or (floor is None and not self.problem.is_bent):
            return None
        least = np.zeros(points.size)
        if floor is not None:
            passive = np.minimum(self._meeting(found, cells, REAR_BOUND, np.zeros(cells.shape)), found.end[cells])
            least = floor.yaw_rate(points.speed, points.front_angle, passive)
        return Demand(least, self.cap(points.speed) / points.speed)

    def _given(self, law: RearLaw, found: Curves, cells: IndexArray) -> Turns:
        """Return the turn of a law at some operating points. It is unique: sideslip and rear angle fall with the yaw rate."""
        points, limit = found.points[cells], self.problem.rear_angle_max
        yaw_rate = self._meeting(found, cells, CURVE_BOUNDS.index(law.bound), law.value(points.speed, points.front_angle))
        if limit > 0.0:
            lowest, highest = (self._meeting(found, cells, REAR_BOUND, np.full(cells.shape, end)) for end in (limit, -limit))
            yaw_rate = np.maximum(lowest, np.minimum(yaw_rate, highest))
        return self._at(found, yaw_rate, cells)

    def _meeting(self, found: Curves, cells: IndexArray, row: int, wanted: FloatArray) -> FloatArray:
        """Return the yaw rates (k,) at which a row of CURVE_BOUNDS takes values (k,); 0 or inf beyond an end of the curve."""
        above = bounded(found.points, found.turns)[row][:, cells] > wanted
        # The first meeting: beyond the stability limit of an oversteering car the values rise again.
        count = np.logical_and.accumulate(above, axis=0).sum(axis=0)
        inside = np.flatnonzero((count > 0) & (count < SAMPLES))
        yaw_rate = np.where(count > 0, np.inf, 0.0)
        rows = np.full(inside.shape, row)
        yaw_rate[inside] = meetings(self.car, found, cells[inside], rows, wanted[inside], count[inside] - 1)
        return yaw_rate

    def _best(self, found: Curves, cells: IndexArray, low: Turns, high: Turns) -> Turns:
        """Return the best turns of some operating points: at an end of their range or where the slope vanishes."""
        first, last = low.yaw_rate[cells], high.yaw_rate[cells]
        inner = found.turns.yaw_rate[:, cells]
        below, above = inner <= first, inner >= last
        slope, slope_low, slope_high = (self._slope(turns) for turns in (found.turns, low, high))
        slope = np.where(below, slope_low[cells], np.where(above, slope_high[cells], slope[:, cells]))
        slopes = np.vstack([slope_low[cells], slope, slope_high[cells]])
        places = np.vstack([first, np.clip(inner, first, last), last])
        best, objective = (select_turns(high, cells), self._objective(select_turns(high, cells)))
        best, objective = self._better(best, objective, np.arange(cells.size), select_turns(low, cells))
        # A minimum lies where the slope turns from falling to rising.
        left, which = np.nonzero((slopes[:-1] < 0.0) & (slopes[1:] > 0.0))
        if which.size:
            _, yaw_rate = shrink(
                lambda some, r: self._slope(self._at(found, r, cells[which[some]])),
                places[left, which],
                places[left + 1, which],
                slopes[left, which],
                slopes[left + 1, which],
                STATIONARY_TOLERANCE,
            )
            turns = self._at(found, yaw_rate, cells[which])
            # Several of one operating point, if there ever are, take their turns.
            for number in range(int(np.bincount(which).max())):
                once = _nth(which, number)
                best, objective = self._better(best, objective, which[once], select_turns(turns, once))
        return best

    def _better(self, best: Turns, objective: FloatArray, at: IndexArray, others: Turns) -> tuple[Turns, FloatArray]:
        """Return the better turn of each operating point. `others` are turns of the points `at`. The first of equals stays."""
        value = self._objective(others)
        chosen = np.flatnonzero(value < objective[at])
        improved = objective.copy()
        improved[at[chosen]] = value[chosen]
        return replace_turns(best, at[chosen], select_turns(others, chosen)), improved

    def _objective(self, turns: Turns) -> FloatArray:
        value: FloatArray = -(turns.yaw_rate**2) + self.problem.sideslip_weight * turns.sideslip**2
        return value

    def _slope(self, turns: Turns) -> FloatArray:
        """Half the derivative of the objective by the yaw rate."""
        slope: FloatArray = -turns.yaw_rate + self.problem.sideslip_weight * turns.sideslip * turns.rates[SIDESLIP]
        return slope


@lru_cache(maxsize=8)
def _kept_edge(turns: NonlinearTurns, speed: tuple[float, ...], front_angle_max: float) -> Edge:
    return turns.find_edge(np.array(speed), front_angle_max)


def _blocks(points: Points) -> list[Points]:
    return [points[slice(start, start + BLOCK)] for start in range(0, max(points.size, 1), BLOCK)]


def _nth(values: IndexArray, number: int) -> IndexArray:
    """Return the indices at which each value occurs for the `number`-th time, counted from zero."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    rank = np.arange(values.size) - np.searchsorted(ordered, ordered)
    result: IndexArray = order[rank == number]
    return result


ABOVE = 100.0 * (1.0 + 1e-6)
"""Percent: a bound is exceeded by more than rounding."""


@dataclass(frozen=True)
class SlipUse:
    """Slip angles at the middle of both axles, in percent of their bounds.

    The bound is that of the steady-turn problem on the plant: the end of the linear range, at the latest short of the peak,
    without `[tightening]`.

    Attributes:
        front, rear: (n, m) percent, NaN where the map is infeasible or the plant has no such turn.
        unreached: (n, m) cells with a yaw rate for which the plant has no steady turn up to its tyres' peak.
    """

    front: FloatArray
    rear: FloatArray
    unreached: npt.NDArray[np.bool_]


def slip_use(reference_map: ReferenceMap) -> SlipUse | None:
    """Return the slip use of a map; None if it has no car, or if the linear range of its tyres has no end."""
    config, case = reference_map.config, reference_map.case
    if config is None or case is None:
        return None
    from codegen.optimum.nonlinear import NonlinearTurns

    try:
        steady = NonlinearTurns.from_config(config.with_whole_limits, config.case(case))
    except ConfigError:
        return None
    moving = reference_map.feasible & (reference_map.speed > 0.0)[:, np.newaxis]
    row, column = np.nonzero(moving)
    turns = steady.turns_at(reference_map.speed[row], reference_map.front_angle[column], reference_map.yaw_rate[moving])

    def percent_of_bound(slip: FloatArray, bound: float) -> FloatArray:
        percent = np.full(moving.shape, np.nan)
        percent[moving] = np.where(turns.converged, 100.0 * np.abs(slip) / bound, np.nan)
        return percent

    unreached = np.zeros(moving.shape, dtype=np.bool_)
    unreached[moving] = ~turns.converged
    problem = steady.problem
    return SlipUse(
        percent_of_bound(turns.slip_front, problem.front_slip_max),
        percent_of_bound(turns.slip_rear, problem.rear_slip_max),
        unreached,
    )
