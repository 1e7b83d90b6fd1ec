"""From a solved or given map to a total one: a value for every speed and front angle that an ECU meets.

Rules, with G(vx) the steady yaw gain of the passive car and ay_cap the largest lateral acceleration that the constraints allow:

- zero at zero speed and at zero angle, linear up to the first breakpoints;
- beyond an edge that grip sets (slip angles, lateral acceleration): hold ay_cap / vx;
- beyond an edge that sideslip and the rear angle set, and beyond the last front angle: r_edge + G (delta_f - delta_edge);
- everything at most ay_cap / vx, which the lookup itself applies: the table holds the straight line of the second rule
  uncapped, so that the lookup meets the minimum of both exactly and not along a chord;
- a speed without a feasible cell takes its neighbours'.

Holding the last feasible yaw rate instead would, at 20 km/h, ask for less than the passive car does at larger angles, and
steer the rear wheels with the front ones just where the driver wants to turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from codegen.config import Config
from codegen.errors import MapError
from codegen.refmap import exact
from codegen.refmap.map import ReferenceMap
from codegen.refmap.problem import SteadyTurnProblem
from codegen.vehicle.single_track import SingleTrack

FloatArray = npt.NDArray[np.float64]


class Rule(StrEnum):
    """Where a cell of the total map comes from; one letter, as in the manifest."""

    SOLVED = "s"
    ZERO = "z"
    HOLD = "h"
    PASSIVE_SLOPE = "p"
    BETWEEN = "i"
    NEIGHBOUR = "n"


RULE_TEXT = {
    Rule.SOLVED: "as in the map",
    Rule.ZERO: "zero at zero speed or zero front angle",
    Rule.HOLD: "beyond an edge set by grip: ay_cap / speed",
    Rule.PASSIVE_SLOPE: "beyond an edge set by sideslip or rear angle, or beyond the last angle: on with the passive gain",
    Rule.BETWEEN: "infeasible between feasible cells: interpolated over the front angle",
    Rule.NEIGHBOUR: "no feasible cell at this speed: interpolated between the neighbouring speeds",
}


@dataclass(frozen=True)
class TotalMap:
    """A map over the whole domain of an ECU.

    Attributes:
        speed: (n,) m/s, from 0. front_angle: (m,) rad, from 0 to the mechanical stop or beyond.
        yaw_rate: (n, m) rad/s, before the cap.
        rule: (n, m) of `Rule` letters.
        lateral_acceleration_cap: ay_cap, m/s^2.
        friction: the road friction that the map assumes.
    """

    speed: FloatArray
    front_angle: FloatArray
    yaw_rate: FloatArray
    rule: npt.NDArray[np.str_]
    lateral_acceleration_cap: float
    friction: float


@dataclass(frozen=True)
class _Edges:
    """End of the usable front angles at each speed (n,): angle, yaw rate there, and whether grip ends it."""

    front_angle: FloatArray
    yaw_rate: FloatArray
    grip_limited: npt.NDArray[np.bool_]


def extend(reference_map: ReferenceMap, config: Config, front_angle_stop: float | None = None) -> TotalMap:
    """Extend a map over the whole domain.

    Args:
        reference_map: solved by this project (then its edges are found on the continuous problem) or a bare table.
        config: the car, for a map that does not bring its own configuration.
        front_angle_stop: rad, the mechanical stop to reach; by default the configuration's.

    Raises:
        MapError: no cell is feasible, or the car of the configuration is unstable at a speed of the map.
    """
    speed, front_angle = reference_map.speed, reference_map.front_angle
    config = reference_map.config or config
    if not reference_map.feasible.any():
        raise MapError("no cell is feasible", where="feasible", remedy="relax the limits or check the vehicle data")
    gain = _passive_gain(config, speed)
    cap = _lateral_acceleration_cap(reference_map)
    yaw_rate, rule = _fill_inside(reference_map)
    edges = _edges(reference_map, yaw_rate)
    stop = config.steering.front_angle_stop if front_angle_stop is None else front_angle_stop
    angles = np.concatenate([front_angle, [stop]]) if stop > front_angle[-1] * (1.0 + 1e-6) else front_angle
    filled = np.full((speed.size, angles.size), np.nan)
    filled[:, : front_angle.size] = yaw_rate
    letters = np.full(filled.shape, Rule.PASSIVE_SLOPE.value)
    letters[:, : front_angle.size] = rule
    slope_line = edges.yaw_rate[:, np.newaxis] + gain[:, np.newaxis] * (angles - edges.front_angle[:, np.newaxis])
    hold = np.where(speed > 0.0, cap / np.maximum(speed, 1e-9), 0.0)[:, np.newaxis]
    beyond = np.isnan(filled) & np.isfinite(edges.front_angle)[:, np.newaxis]
    grip = edges.grip_limited[:, np.newaxis]
    filled = np.where(beyond, np.where(grip, hold, slope_line), filled)
    letters = np.where(beyond & grip, Rule.HOLD.value, letters)
    filled, letters = _from_neighbours(speed, filled, letters)
    return _with_zeros(speed, angles, filled, letters, cap, config.road.friction)


def _passive_gain(config: Config, speed: FloatArray) -> FloatArray:
    car = SingleTrack.from_config(config)
    if speed[-1] >= car.critical_speed:
        raise MapError(
            f"the car is unstable from {car.critical_speed * 3.6:.0f} km/h and the map reaches {speed[-1] * 3.6:.0f} km/h",
            where="vx",
            remedy="build with the configuration of the car that the map is for (--config)",
        )
    return car.yaw_gain(speed)


def _problem(reference_map: ReferenceMap) -> SteadyTurnProblem | None:
    """The optimisation behind a solved map, None for a bare one."""
    if not reference_map.solved or reference_map.config is None or reference_map.case is None:
        return None
    config = reference_map.config
    return SteadyTurnProblem.from_config(config, config.case(reference_map.case))


def _lateral_acceleration_cap(reference_map: ReferenceMap) -> float:
    problem = _problem(reference_map)
    if problem is not None:
        return problem.lateral_acceleration_cap
    lateral_acceleration = reference_map.speed[:, np.newaxis] * reference_map.yaw_rate
    cap = float(np.max(lateral_acceleration[reference_map.feasible]))
    if cap <= 0.0:
        raise MapError("every yaw rate is zero", where="yaw_rate", remedy="check what the table holds")
    return cap


def _fill_inside(reference_map: ReferenceMap) -> tuple[FloatArray, npt.NDArray[np.str_]]:
    """Yaw rates with gaps between (or before) feasible cells filled; NaN only beyond the last feasible cell of a row."""
    front_angle, feasible = reference_map.front_angle, reference_map.feasible
    yaw_rate = np.where(feasible, reference_map.yaw_rate, np.nan)
    rule = np.where(feasible, Rule.SOLVED.value, Rule.PASSIVE_SLOPE.value)
    for row, known in enumerate(feasible):
        if not known.any():
            continue
        last = int(np.flatnonzero(known)[-1])
        gaps = np.flatnonzero(~known[: last + 1])
        points = np.concatenate([[0.0], front_angle[known]])
        values = np.concatenate([[0.0], yaw_rate[row, known]])
        yaw_rate[row, gaps] = np.interp(front_angle[gaps], points, values)
        rule[row, gaps] = Rule.BETWEEN.value
    return yaw_rate, rule


def _edges(reference_map: ReferenceMap, yaw_rate: FloatArray) -> _Edges:
    """For a solved map from the continuous problem; else, and beyond the last angle, the last known cell of each row."""
    front_angle = reference_map.front_angle
    known = np.isfinite(yaw_rate)
    last = known.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
    rows = np.arange(known.shape[0])
    some = known.any(axis=1)
    angle = np.where(some, front_angle[last], np.nan)
    value = np.where(some, yaw_rate[rows, last], np.nan)
    grip = np.zeros(angle.shape, dtype=bool)
    problem = _problem(reference_map)
    if problem is not None:
        found = exact.edge(problem, reference_map.speed)
        # The edge counts where the cells end at it. Beyond the last breakpoint it is not reached by the table; elsewhere the
        # user has taken cells out of a solved map, which then ends where its cells do.
        below = np.where(some, front_angle[last], 0.0)
        above = np.append(front_angle, -np.inf)[np.where(some, last + 1, 0)]
        slack = 1e-9 * front_angle[-1]
        inside = (found.front_angle >= below - slack) & (found.front_angle <= above + slack)
        angle = np.where(inside, found.front_angle, angle)
        value = np.where(inside, found.yaw_rate, value)
        grip = inside & found.grip_limited
    return _Edges(angle, value, grip)


def _from_neighbours(
    speed: FloatArray, filled: FloatArray, letters: npt.NDArray[np.str_]
) -> tuple[FloatArray, npt.NDArray[np.str_]]:
    empty: npt.NDArray[np.bool_] = np.any(np.isnan(filled), axis=1)
    if not empty.any():
        return filled, letters
    filled = filled.copy()
    for column in range(filled.shape[1]):
        filled[empty, column] = np.interp(speed[empty], speed[~empty], filled[~empty, column])
    return filled, np.where(empty[:, np.newaxis], Rule.NEIGHBOUR.value, letters)


def _with_zeros(
    speed: FloatArray,
    front_angle: FloatArray,
    yaw_rate: FloatArray,
    letters: npt.NDArray[np.str_],
    cap: float,
    friction: float,
) -> TotalMap:
    """Put the zero row and the zero column where the breakpoints do not start at zero; make them zero where they do."""
    zero = Rule.ZERO.value
    if speed[0] > 0.0:
        speed = np.concatenate([[0.0], speed])
        yaw_rate = np.vstack([np.zeros(yaw_rate.shape[1]), yaw_rate])
        letters = np.vstack([np.full(letters.shape[1], zero), letters])
    if front_angle[0] > 0.0:
        front_angle = np.concatenate([[0.0], front_angle])
        yaw_rate = np.hstack([np.zeros((yaw_rate.shape[0], 1)), yaw_rate])
        letters = np.hstack([np.full((letters.shape[0], 1), zero), letters])
    yaw_rate, letters = yaw_rate.copy(), letters.copy()
    yaw_rate[0, :], yaw_rate[:, 0] = 0.0, 0.0
    letters[0, :], letters[:, 0] = zero, zero
    return TotalMap(speed, front_angle, yaw_rate, letters, cap, friction)
