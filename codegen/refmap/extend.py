"""From a solved or given map to a total one: a value for every speed and front angle that an ECU meets.

Rules, with G(vx) the steady yaw gain of the passive car and ay_cap the largest lateral acceleration that the constraints allow:

- zero at zero speed and at zero angle, linear up to the first breakpoints;
- beyond an edge that grip sets (slip angles, lateral acceleration): hold ay_cap / vx;
- beyond an edge that sideslip and the rear angle set, and beyond the last front angle: r_edge + G (delta_f - delta_edge);
- everything at most ay_cap / vx, which the lookup itself applies: the table holds the straight line of the second rule
  uncapped, so that the lookup meets the minimum of both exactly and not along a chord;
- a speed without a feasible cell takes its neighbours'.

The rear angle that goes with it follows the same rules: the optimum's own inside, and beyond an edge the edge's, which is what the
linear car needs for the straight line of the third rule. A bare table brings no rear angles: they are delta_f - r/G then.

Holding the last feasible yaw rate instead would, at 20 km/h, ask for less than the passive car does at larger angles, and
steer the rear wheels with the front ones just where the driver wants to turn.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from codegen.config import Config
from codegen.errors import MapError
from codegen.refmap import exact
from codegen.refmap.map import ReferenceMap
from codegen.refmap.problem import SteadyTurnProblem
from codegen.refmap.stack import layer_configs
from codegen.vehicle.single_track import SingleTrack

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


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
class CapSteering:
    """Rear steering for the yaw rate that the cap takes away: the linear car turns by 1/G = L/vx + K vx rad less for each rad/s.

    Attributes:
        wheelbase: L, m. understeer_coefficient: K, s^2/m.
        rear_arm: m, and rear_slip_per_lateral_acceleration: rad s^2/m, of the sideslip beta = delta_r + r (lr/vx - slip vx).
        sideslip_max: rad; such steering ends where the steady sideslip would reach it.
        rear_angle_max: rad.
    """

    wheelbase: float
    understeer_coefficient: float
    rear_arm: float
    rear_slip_per_lateral_acceleration: float
    sideslip_max: float
    rear_angle_max: float

    @classmethod
    def from_config(cls, config: Config) -> CapSteering:
        """Of the car and the limits of a configuration."""
        car = SingleTrack.from_config(config)
        return cls(
            car.wheelbase,
            car.understeer_coefficient,
            car.rear_arm,
            car.rear_slip_per_lateral_acceleration,
            config.limits.sideslip_max,
            min(config.limits.rear_angle_max, config.rear_actuator.angle_max),
        )


@dataclass(frozen=True)
class TotalMap:
    """A map over the whole domain of an ECU.

    Attributes:
        speed: (n,) m/s, from 0. front_angle: (m,) rad, from 0 to the mechanical stop or beyond.
        yaw_rate: (n, m) rad/s, before the cap.
        rear_angle: (n, m) rad, within the actuator's range.
        rule: (n, m) of `Rule` letters.
        lateral_acceleration_cap: ay_cap, m/s^2.
        friction: the road friction that the map assumes.
        steering: what the lookup needs where the cap takes yaw rate away.
        layers: the total maps of lower frictions on the same axes, the lowest first.
    """

    speed: FloatArray
    front_angle: FloatArray
    yaw_rate: FloatArray
    rear_angle: FloatArray
    rule: npt.NDArray[np.str_]
    lateral_acceleration_cap: float
    friction: float
    steering: CapSteering
    layers: tuple[TotalMap, ...] = ()

    @property
    def stack(self) -> tuple[TotalMap, ...]:
        """All total maps, the one of the lowest friction first, this one last."""
        return (*self.layers, self)


@dataclass(frozen=True)
class _Edges:
    """End of the usable front angles at each speed (n,): angle, yaw rate and rear angle there, and whether grip ends it."""

    front_angle: FloatArray
    yaw_rate: FloatArray
    rear_angle: FloatArray
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
    yaw_rate, rule = _fill_inside(reference_map, reference_map.yaw_rate)
    rear_angle, _ = _fill_inside(reference_map, _rear_angle(reference_map, gain))
    edges = _edges(reference_map, yaw_rate, rear_angle, gain)
    stop = config.steering.front_angle_stop if front_angle_stop is None else front_angle_stop
    angles = np.concatenate([front_angle, [stop]]) if stop > front_angle[-1] * (1.0 + 1e-6) else front_angle
    filled, rear = (np.full((speed.size, angles.size), np.nan) for _ in range(2))
    filled[:, : front_angle.size], rear[:, : front_angle.size] = yaw_rate, rear_angle
    letters = np.full(filled.shape, Rule.PASSIVE_SLOPE.value)
    letters[:, : front_angle.size] = rule
    slope_line = edges.yaw_rate[:, np.newaxis] + gain[:, np.newaxis] * (angles - edges.front_angle[:, np.newaxis])
    hold = np.where(speed > 0.0, cap / np.maximum(speed, 1e-9), 0.0)[:, np.newaxis]
    beyond = np.isnan(filled) & np.isfinite(edges.front_angle)[:, np.newaxis]
    grip = edges.grip_limited[:, np.newaxis]
    filled = np.where(beyond, np.where(grip, hold, slope_line), filled)
    letters = np.where(beyond & grip, Rule.HOLD.value, letters)
    rear = np.where(beyond, edges.rear_angle[:, np.newaxis], rear)
    steering = CapSteering.from_config(config)
    empty: BoolArray = np.any(np.isnan(filled), axis=1)
    letters = np.where(empty[:, np.newaxis], Rule.NEIGHBOUR.value, letters)
    filled, rear = (_from_neighbours(speed, values, empty) for values in (filled, rear))
    rear = np.clip(rear, -steering.rear_angle_max, steering.rear_angle_max)
    layers = tuple(
        extend(layer.map, road, stop)
        for layer, road in zip(reference_map.layers, layer_configs(reference_map, config), strict=True)
    )
    zeros = _Zeros(speed, angles)
    return TotalMap(
        speed=zeros.speed,
        front_angle=zeros.front_angle,
        yaw_rate=zeros.table(filled),
        rear_angle=zeros.table(rear),
        rule=zeros.rule(letters),
        lateral_acceleration_cap=cap,
        friction=config.road.friction,
        steering=steering,
        layers=layers,
    )


def _rear_angle(reference_map: ReferenceMap, gain: FloatArray) -> FloatArray:
    """(n, m) rad: the map's own, else what the linear car needs for its yaw rate."""
    if reference_map.rear_angle is not None:
        return reference_map.rear_angle
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = reference_map.front_angle - reference_map.yaw_rate / gain[:, np.newaxis]
    return np.where(reference_map.feasible & np.isfinite(needed), needed, np.where(reference_map.feasible, 0.0, np.nan))


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


def _fill_inside(reference_map: ReferenceMap, table: FloatArray) -> tuple[FloatArray, npt.NDArray[np.str_]]:
    """A table (n, m) with gaps between (or before) feasible cells filled; NaN only beyond the last feasible cell of a row."""
    front_angle, feasible = reference_map.front_angle, reference_map.feasible
    filled = np.where(feasible, table, np.nan)
    rule = np.where(feasible, Rule.SOLVED.value, Rule.PASSIVE_SLOPE.value)
    for row, known in enumerate(feasible):
        if not known.any():
            continue
        last = int(np.flatnonzero(known)[-1])
        gaps = np.flatnonzero(~known[: last + 1])
        points = np.concatenate([[0.0], front_angle[known]])
        values = np.concatenate([[0.0], filled[row, known]])
        filled[row, gaps] = np.interp(front_angle[gaps], points, values)
        rule[row, gaps] = Rule.BETWEEN.value
    return filled, rule


def _edges(reference_map: ReferenceMap, yaw_rate: FloatArray, rear_angle: FloatArray, gain: FloatArray) -> _Edges:
    """For a solved map from the continuous problem; else, and beyond the last angle, the last known cell of each row."""
    front_angle = reference_map.front_angle
    known = np.isfinite(yaw_rate)
    last = known.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
    rows = np.arange(known.shape[0])
    some = known.any(axis=1)
    angle = np.where(some, front_angle[last], np.nan)
    value = np.where(some, yaw_rate[rows, last], np.nan)
    rear = np.where(some, rear_angle[rows, last], np.nan)
    grip = np.zeros(angle.shape, dtype=bool)
    problem = _problem(reference_map)
    if problem is not None:
        found = _end_of_cells(reference_map, problem)
        # The edge counts where the cells end at it. Beyond the last breakpoint it is not reached by the table; elsewhere the
        # user has taken cells out of a solved map, which then ends where its cells do.
        below = np.where(some, front_angle[last], 0.0)
        above = np.append(front_angle, -np.inf)[np.where(some, last + 1, 0)]
        slack = 1e-9 * front_angle[-1]
        inside = (found.front_angle >= below - slack) & (found.front_angle <= above + slack)
        angle = np.where(inside, found.front_angle, angle)
        value = np.where(inside, found.yaw_rate, value)
        rear = np.where(inside, found.front_angle - found.yaw_rate / gain, rear)
        grip = inside & found.grip_limited
    return _Edges(angle, value, rear, grip)


def _end_of_cells(reference_map: ReferenceMap, problem: SteadyTurnProblem) -> exact.Edge:
    """The edge of the continuous problem. A passive-safe map ends where the passive car does, with the optimum's own values
    there: mostly below what grip allows, so that the slope goes on from them."""
    assert reference_map.config is not None and reference_map.case is not None  # a solved map has both
    speed = reference_map.speed
    if not reference_map.config.case(reference_map.case).passive_safe or problem.rear_angle_max == 0.0:
        return exact.edge(problem, speed)
    passive = exact.edge(replace(problem, rear_angle_max=0.0), speed)
    # A trifle inside, for rounding decides whether the edge itself is feasible.
    inside = passive.front_angle * (1.0 - 1e-12)
    yaw_rate = [exact.solve(problem, speed[i : i + 1], inside[i : i + 1]).yaw_rate[0, 0] for i in range(speed.size)]
    return exact.Edge(passive.front_angle, np.array(yaw_rate), np.zeros(speed.shape, dtype=bool))


def _from_neighbours(speed: FloatArray, table: FloatArray, empty: BoolArray) -> FloatArray:
    """A table (n, m) whose `empty` rows (n,) come from the rows around them."""
    filled = table.copy()
    for column in range(filled.shape[1]):
        filled[empty, column] = np.interp(speed[empty], speed[~empty], table[~empty, column])
    return filled


@dataclass(frozen=True)
class _Zeros:
    """Puts a zero row and a zero column where the breakpoints do not start at zero; makes them zero where they do."""

    given_speed: FloatArray
    given_front_angle: FloatArray

    @property
    def speed(self) -> FloatArray:
        return _from_zero(self.given_speed)

    @property
    def front_angle(self) -> FloatArray:
        return _from_zero(self.given_front_angle)

    def table(self, values: FloatArray) -> FloatArray:
        """Of numbers (n, m)."""
        result = np.pad(values, self._padding)
        result[0, :], result[:, 0] = 0.0, 0.0
        return result

    def rule(self, letters: npt.NDArray[np.str_]) -> npt.NDArray[np.str_]:
        """Of letters (n, m)."""
        result = np.pad(letters, self._padding, constant_values=Rule.ZERO.value)
        result[0, :], result[:, 0] = Rule.ZERO.value, Rule.ZERO.value
        return result

    @property
    def _padding(self) -> tuple[tuple[int, int], tuple[int, int]]:
        return (int(self.given_speed[0] > 0.0), 0), (int(self.given_front_angle[0] > 0.0), 0)


def _from_zero(breakpoints: FloatArray) -> FloatArray:
    return breakpoints if breakpoints[0] == 0.0 else np.concatenate([[0.0], breakpoints])
