"""Extension of a solved or given map to a total one: a value for every speed and front angle that an ECU meets.

Rules, with G(vx) the steady yaw gain of the passive car and ay_cap the largest lateral acceleration that the constraints allow:

- for a controller that runs from standstill, a solved map is solved down to walking speed (`from_walking_speed`);
- zero yaw rate at zero speed and zero angle, linear up to the first breakpoints; below the first speed, the rear angle of that;
- beyond an edge that grip sets (slip angles, lateral acceleration): hold the edge's yaw rate, ay_cap / vx with linear tyres;
- beyond an edge that sideslip and the rear angle set, and beyond the last front angle: r_edge + G (delta_f - delta_edge);
- a map that bends towards its cap (`optimum.demand`: nonlinear tyre with `limits.grip_use_max`) ends at no edge that grip sets:
  beyond every edge the yaw rate goes on with the passive gain up to the cap of its speed; it never falls;
- everything at most ay_cap / vx, which the lookup itself applies: the table holds the straight line of the second rule
  uncapped, so that the lookup meets the minimum of both exactly and not along a chord;
- a speed without a feasible cell takes its neighbours'.

The rear angle follows the same rules: the optimum inside, and the value at the edge beyond it, which the linear car needs for
the straight line of the third rule. A bare table has no rear angles: here they are delta_f - r/G. A law (`optimum.rear_law`)
meets the limit of grip with rear angle to spare. Beyond, the rear wheels steer in phase as the lookup does below its cap, so
that the car can hold the yaw rate.

Holding the last feasible yaw rate instead would demand less than the passive car reaches at 20 km/h and larger angles. The
rear wheels would then steer in phase just where the driver wants to turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.ecu_map.lookup import SteeringConstants, capped_rear_angle
from codegen.ecu_map.total import RULE_TEXT, CapSteering, Rule, TotalMap
from codegen.errors import MapError
from codegen.map_file.longitudinal import axle_shares
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ACCELERATION_STACK
from codegen.optimum.solve import from_walking_speed, layer_configs
from codegen.optimum.turns import Edge, SteadyTurns, turns_behind
from codegen.vehicle.single_track import SingleTrack

__all__ = ["RULE_TEXT", "CapSteering", "Rule", "TotalMap", "extend"]


@dataclass(frozen=True)
class _Edges:
    """Last usable front angle at each speed (n,), with its yaw rate and rear angle, and whether grip limits it."""

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
        MapError: no cell is feasible, the car of the configuration is unstable at a speed of the map.
    """
    slower = reference_map if config.controller.waits_for_speed else from_walking_speed(reference_map)
    return _extended(slower, reference_map.config or config, front_angle_stop)


def _extended(reference_map: ReferenceMap, config: Config, front_angle_stop: float | None) -> TotalMap:
    if not reference_map.feasible.any():
        raise MapError("no cell is feasible", where="feasible", remedy="relax the limits or check the vehicle data")
    speed, front_angle = reference_map.speed, reference_map.front_angle
    stop = config.steering.front_angle_stop if front_angle_stop is None else front_angle_stop
    angles = np.concatenate([front_angle, [stop]]) if stop > front_angle[-1] * (1.0 + 1e-6) else front_angle
    steering, gain = CapSteering.from_config(config), _passive_gain(config, speed)
    inside = _inside(reference_map, gain)
    turns = turns_behind(reference_map)
    edges = _edges(reference_map, inside, turns)
    follows_law = turns is not None and turns.problem.law is not None
    limit = np.full(speed.shape, np.inf) if turns is None else turns.cap(speed) / np.where(speed > 0.0, speed, 1.0)
    filled = _beyond_the_edges(inside, edges, speed, angles, gain, limit, steering if follows_law else None)
    zeros = _Zeros(speed, angles)
    return TotalMap(
        speed=zeros.speed,
        front_angle=zeros.front_angle,
        yaw_rate=zeros.table(filled.yaw_rate),
        rear_angle=zeros.held(np.clip(filled.rear_angle, -steering.rear_angle_max, steering.rear_angle_max)),
        rule=zeros.rule(filled.rule),
        lateral_acceleration_cap=_lateral_acceleration_cap(reference_map, turns, edges),
        friction=config.road.friction,
        steering=steering,
        layers=tuple(_layers(reference_map, config, stop)),
    )


def _layers(reference_map: ReferenceMap, config: Config, stop: float) -> Iterator[TotalMap]:
    for layer, car in zip(reference_map.layers, layer_configs(reference_map, config), strict=True):
        total = _extended(layer.map, car, stop)
        if layer.quantity is ACCELERATION_STACK:
            total = replace(total, acceleration=layer.value, axle_shares=axle_shares(config, layer.value))
        yield total


@dataclass(frozen=True)
class _Filled:
    """Tables (n, k) over all angles without gaps, and the rule that gave each cell."""

    yaw_rate: FloatArray
    rear_angle: FloatArray
    rule: npt.NDArray[np.str_]


def _inside(reference_map: ReferenceMap, gain: FloatArray) -> _Filled:
    """The map on its own angles; NaN beyond the last feasible cell of a speed. `gain` (n,) of the passive car in 1/s."""
    yaw_rate, rule = _fill_inside(reference_map, reference_map.yaw_rate)
    rear_angle, _ = _fill_inside(reference_map, _rear_angle(reference_map, gain))
    return _Filled(yaw_rate, rear_angle, rule)


def _beyond_the_edges(
    inside: _Filled,
    edges: _Edges,
    speed: FloatArray,
    angles: FloatArray,
    gain: FloatArray,
    limit: FloatArray,
    steering: CapSteering | None,
) -> _Filled:
    """Return the map on `angles` (k,), which begin with its own. With `steering`, the rear wheels turn in phase beyond grip.

    `limit` (n,): rad/s beyond which the slope line does not lead; infinite without a cap of the speed.
    """
    points = inside.yaw_rate.shape[1]
    yaw_rate, rear_angle = (np.full((speed.size, angles.size), np.nan) for _ in range(2))
    yaw_rate[:, :points], rear_angle[:, :points] = inside.yaw_rate, inside.rear_angle
    rule = np.full(yaw_rate.shape, Rule.PASSIVE_SLOPE.value)
    rule[:, :points] = inside.rule
    at_edge = edges.yaw_rate[:, np.newaxis]
    slope_line = at_edge + gain[:, np.newaxis] * (angles - edges.front_angle[:, np.newaxis])
    slope_line = np.minimum(slope_line, np.maximum(at_edge, limit[:, np.newaxis]))
    beyond = np.isnan(yaw_rate) & np.isfinite(edges.front_angle)[:, np.newaxis]
    grip = edges.grip_limited[:, np.newaxis]
    yaw_rate = np.where(beyond, np.where(grip, at_edge, slope_line), yaw_rate)
    rear_beyond = np.broadcast_to(edges.rear_angle[:, np.newaxis], rear_angle.shape)
    if steering is not None:
        car = SteeringConstants.of(steering, np.float64)
        in_phase = capped_rear_angle(car, slope_line, rear_beyond, at_edge, speed[:, np.newaxis])
        rear_beyond = np.where(grip, in_phase, rear_beyond)
    rear_angle = np.where(beyond, rear_beyond, rear_angle)
    rule = np.where(beyond & grip, Rule.HOLD.value, rule)
    empty: BoolArray = np.any(np.isnan(yaw_rate), axis=1)
    rule = np.where(empty[:, np.newaxis], Rule.NEIGHBOUR.value, rule)
    return _Filled(_from_neighbours(speed, yaw_rate, empty), _from_neighbours(speed, rear_angle, empty), rule)


def _rear_angle(reference_map: ReferenceMap, gain: FloatArray) -> FloatArray:
    """Return rear angles (n, m) in rad: those of the map, else those with which the linear car reaches its yaw rate."""
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
            remedy="build with the configuration of the car that the map is for (`config=`)",
        )
    return car.yaw_gain(speed)


def _lateral_acceleration_cap(reference_map: ReferenceMap, turns: SteadyTurns | None, edges: _Edges) -> float:
    speed = reference_map.speed[:, np.newaxis]
    lateral_acceleration = np.where(reference_map.feasible, speed * reference_map.yaw_rate, np.nan)
    if turns is None:
        cap = float(np.nanmax(lateral_acceleration))
        if cap <= 0.0:
            raise MapError("every yaw rate is zero", where="yaw_rate", remedy="check what the table holds")
        return cap
    at_edges = np.where(edges.grip_limited, reference_map.speed * edges.yaw_rate, np.nan)
    return turns.lateral_acceleration_cap(np.column_stack([lateral_acceleration, at_edges]))


def _fill_inside(reference_map: ReferenceMap, table: FloatArray) -> tuple[FloatArray, npt.NDArray[np.str_]]:
    """Fill the gaps of a table (n, m) before and between feasible cells; NaN remains beyond the last feasible cell of a row."""
    front_angle, feasible = reference_map.front_angle, reference_map.feasible
    filled = np.where(feasible, table, np.nan)
    rule = np.where(feasible, Rule.SOLVED.value, Rule.PASSIVE_SLOPE.value)
    # None after the last of a row, none in a row without any.
    later = np.logical_or.accumulate(feasible[:, ::-1], axis=1)[:, ::-1]
    gap: BoolArray = ~feasible & later
    for row in np.flatnonzero(gap.any(axis=1)):
        known = feasible[row]
        points = np.concatenate([[0.0], front_angle[known]])
        values = np.concatenate([[0.0], filled[row, known]])
        filled[row, gap[row]] = np.interp(front_angle[gap[row]], points, values)
    rule[gap] = Rule.BETWEEN.value
    return filled, rule


def _edges(reference_map: ReferenceMap, inside: _Filled, turns: SteadyTurns | None) -> _Edges:
    """Return edges from the continuous problem for a solved map; else, or beyond the last angle, each row's last known cell."""
    front_angle = reference_map.front_angle
    known = np.isfinite(inside.yaw_rate)
    last = known.shape[1] - 1 - np.argmax(known[:, ::-1], axis=1)
    rows = np.arange(known.shape[0])
    some = known.any(axis=1)
    angle = np.where(some, front_angle[last], np.nan)
    value = np.where(some, inside.yaw_rate[rows, last], np.nan)
    rear = np.where(some, inside.rear_angle[rows, last], np.nan)
    grip = np.zeros(angle.shape, dtype=bool)
    if turns is not None:
        found = _end_of_cells(reference_map, turns)
        # The edge counts where the cells end at it. Beyond the last breakpoint it is not reached by the table; elsewhere the
        # user has taken cells out of a solved map, which then ends where its cells do.
        below = np.where(some, front_angle[last], 0.0)
        above = np.append(front_angle, -np.inf)[np.where(some, last + 1, 0)]
        slack = 1e-9 * front_angle[-1]
        reached = (found.front_angle >= below - slack) & (found.front_angle <= above + slack)
        angle = np.where(reached, found.front_angle, angle)
        value = np.where(reached, found.yaw_rate, value)
        rear = np.where(reached, found.rear_angle, rear)
        grip = reached & found.grip_limited
    return _Edges(angle, value, rear, grip)


def _end_of_cells(reference_map: ReferenceMap, turns: SteadyTurns) -> Edge:
    """Return the edge of the continuous problem. A passive-safe map ends where the passive car does. It keeps the values of
    the optimum there, mostly below the grip limit, so that the slope continues from them."""
    assert reference_map.config is not None  # a solved map has both
    assert reference_map.case is not None
    speed = reference_map.speed
    if not reference_map.config.case(reference_map.case).passive_safe or turns.problem.rear_angle_max == 0.0:
        return turns.edge(speed, float(reference_map.front_angle[-1]))
    passive = turns.without_rear_steering().edge(speed, float(reference_map.front_angle[-1]))
    # Slightly inside, because rounding decides whether the edge itself is feasible. Without an edge, the value is unused.
    optimum = turns.at(speed, np.where(np.isfinite(passive.front_angle), passive.front_angle, 0.0) * (1.0 - 1e-12))
    return Edge(passive.front_angle, optimum.yaw_rate, optimum.rear_angle, np.zeros(speed.shape, dtype=bool))


def _from_neighbours(speed: FloatArray, table: FloatArray, empty: BoolArray) -> FloatArray:
    """Fill the `empty` rows (n,) of a table (n, m) from the rows around them."""
    filled = table.copy()
    if empty.any():
        for column in range(filled.shape[1]):
            filled[empty, column] = np.interp(speed[empty], speed[~empty], table[~empty, column])
    return filled


@dataclass(frozen=True)
class _Zeros:
    """Return a table with a zero row and column, inserted if the breakpoints do not start at zero, else overwritten."""

    given_speed: FloatArray
    given_front_angle: FloatArray

    @property
    def speed(self) -> FloatArray:
        return _from_zero(self.given_speed)

    @property
    def front_angle(self) -> FloatArray:
        return _from_zero(self.given_front_angle)

    def table(self, values: FloatArray) -> FloatArray:
        """Return a table of numbers (n, m) with zeros."""
        result = np.pad(values, self._padding)
        result[0, :], result[:, 0] = 0.0, 0.0
        return result

    def held(self, values: FloatArray) -> FloatArray:
        """Return a table of numbers (n, m) with zeros at the first angle, and the slowest speed's values at zero speed."""
        result = self.table(values)
        result[0, :] = result[1, :]
        return result

    def rule(self, letters: npt.NDArray[np.str_]) -> npt.NDArray[np.str_]:
        """Return a table of `Rule` letters (n, m) with zeros."""
        result = np.pad(letters, self._padding, constant_values=Rule.ZERO.value)
        result[0, :], result[:, 0] = Rule.ZERO.value, Rule.ZERO.value
        return result

    @property
    def _padding(self) -> tuple[tuple[int, int], tuple[int, int]]:
        return (int(self.given_speed[0] > 0.0), 0), (int(self.given_front_angle[0] > 0.0), 0)


def _from_zero(breakpoints: FloatArray) -> FloatArray:
    return breakpoints if breakpoints[0] == 0.0 else np.concatenate([[0.0], breakpoints])
