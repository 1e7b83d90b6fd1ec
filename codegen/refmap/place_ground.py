"""What a table is measured against: the continuous total map behind a reference map, at any speed and front angle.

For a map that the exact solution made, this is the optimum itself, solved anew at every point. Within the bounds, the optimum
is the smaller of the optimum *without the grip bounds* and ay_cap / speed: the grip bounds are on |r| alone, and the objective
falls with |r|. The lookup applies ay_cap / speed by itself, so that a table of the optimum without the grip bounds, continued,
meets the kink between both exactly, wherever its cells lie. Where sideslip or the rear angle end it, and beyond the last angle
of the map, it goes on with the passive car's gain, as in `extend`; below the first speed and angle it is linear to zero.

For any other map nothing but its own table is known: its bilinear interpolation, extended, is what the new table is measured
against. `optimum_of` is the place for further kinds of optimum; `extended` makes one of a solver and its edges.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from codegen.config import Config
from codegen.refmap import exact
from codegen.refmap.extend import extend
from codegen.refmap.lookup import SteeringConstants, capped_rear_angle
from codegen.refmap.map import ReferenceMap
from codegen.refmap.problem import SteadyTurnProblem
from codegen.refmap.stack import layer_configs
from codegen.refmap.tables import PLAUSIBLE
from codegen.refmap.total import CapSteering, Rule, TotalMap
from codegen.refmap.turns import Edge, LinearTurns, Solution, passively_feasible

FloatArray = npt.NDArray[np.float64]
Pair = tuple[FloatArray, FloatArray]
Surface = Callable[[FloatArray, FloatArray], Pair]
"""Speeds (n,) in m/s and front angles (m,) in rad -> yaw rate in rad/s and rear angle in rad, (n, m) each, before the cap."""

Origin = Literal["optimum", "table"]

SAME_YAW_RATE = 1e-5
"""rad/s: how far the table of a map may lie from the exact optimum and still be it (IPOPT ends within 1e-7)."""

UNBOUNDED = 1e3
"""m/s^2 and rad: a grip bound that never acts."""

JUST_INSIDE = 1.0 - 1e-12
"""Of an edge: rounding decides whether the edge itself is feasible."""


@dataclass(frozen=True)
class GroundLayer:
    """One friction: the surface before the cap, the cap in m/s^2, and the total map that a build without a choice holds."""

    surface: Surface
    cap: float
    total: TotalMap


@dataclass(frozen=True)
class Ground:
    """The continuous total map, the layer of the lowest friction first, and where it is.

    Attributes:
        origin: "optimum": solved anew at every point; "table": the map's own bilinear interpolation.
        own_speed, own_front_angle: first and last breakpoint of the map (above zero), m/s and rad.
        front_angle_top: rad, the mechanical stop, or the map's last angle where that is larger.
        speed_kinks, front_angle_kinks: where the surfaces are not smooth by rule.
        steering: of the rear angle that goes with a capped yaw rate.
    """

    layers: tuple[GroundLayer, ...]
    origin: Origin
    own_speed: tuple[float, float]
    own_front_angle: tuple[float, float]
    front_angle_top: float
    speed_kinks: FloatArray
    front_angle_kinks: FloatArray
    steering: CapSteering

    @property
    def total(self) -> TotalMap:
        """What a build without a choice holds, with its layers."""
        return replace(self.layers[-1].total, layers=tuple(layer.total for layer in self.layers[:-1]))

    def truth(self, layer: GroundLayer, speed: FloatArray, front_angle: FloatArray) -> Pair:
        """Yaw rate and rear angle (n, m) after the cap, for speeds (n,) and front angles (m,) from zero."""
        yaw_rate, rear_angle = layer.surface(speed, front_angle)
        return capped(yaw_rate, rear_angle, layer.cap, speed, self.steering)


def capped(yaw_rate: FloatArray, rear_angle: FloatArray, cap: float, speed: FloatArray, steering: CapSteering) -> Pair:
    """Tables (n, m) after the cap at speeds (n,), in exact arithmetic: what the lookup makes of them."""
    v = np.maximum(speed, 1e-9)[:, np.newaxis]
    allowed = np.broadcast_to(cap / v, yaw_rate.shape)
    car = SteeringConstants.of(steering, np.float64)
    is_capped = yaw_rate > allowed
    turned = np.where(is_capped, capped_rear_angle(car, yaw_rate, rear_angle, allowed, v), rear_angle)
    return np.minimum(yaw_rate, allowed), turned


def ground_of(reference_map: ReferenceMap, config: Config) -> Ground:
    """The continuous total map of a map; `config` is the car for one that brings no configuration.

    Raises:
        MapError: see `extend`.
    """
    config = reference_map.config or config
    total = extend(reference_map, config, config.steering.front_angle_stop)
    maps = [*(layer.map for layer in reference_map.layers), reference_map]
    configs = [*layer_configs(reference_map, config), config]
    surfaces = [optimum_of(one, own) for one, own in zip(maps, configs, strict=True)]
    origin: Origin = "table" if any(surface is None for surface in surfaces) else "optimum"
    layers = tuple(
        GroundLayer(surface if origin == "optimum" and surface else _bilinear(layer), layer.lateral_acceleration_cap, layer)
        for surface, layer in zip(surfaces, total.stack, strict=True)
    )
    speed = reference_map.speed[reference_map.speed > 0.0]
    front_angle = reference_map.front_angle[reference_map.front_angle > 0.0]
    return Ground(
        layers=layers,
        origin=origin,
        own_speed=(float(speed[0]), float(speed[-1])),
        own_front_angle=(float(front_angle[0]), float(front_angle[-1])),
        front_angle_top=float(total.front_angle[-1]),
        speed_kinks=speed[:1] if origin == "optimum" else total.speed,
        front_angle_kinks=front_angle[[0, -1]] if origin == "optimum" else total.front_angle,
        steering=total.steering,
    )


def optimum_of(reference_map: ReferenceMap, config: Config) -> Surface | None:
    """The optimum behind a map, as a table is to hold it; None where it is not known or the map does not hold it."""
    if not reference_map.solved or reference_map.case is None:
        return None
    case = config.case(reference_map.case)
    if case.tyre_model != "linear":
        return None
    problem = SteadyTurnProblem.from_config(config, case)
    if not _holds(reference_map, problem, case.passive_safe):
        return None
    return continued(
        problem, reference_map.speed, reference_map.front_angle, case.passive_safe, CapSteering.from_config(config)
    )


def _holds(reference_map: ReferenceMap, problem: SteadyTurnProblem, passive_safe: bool) -> bool:
    """Whether a map is the exact optimum on its grid: another method's, or one that was edited, is not."""
    if reference_map.speed[0] <= 0.0:
        return False
    optimum = exact.solve(problem, reference_map.speed, reference_map.front_angle)
    feasible, margin = optimum.feasible, optimum.margin
    if passive_safe:
        passive = exact.solve(replace(problem, rear_angle_max=0.0), reference_map.speed, reference_map.front_angle)
        feasible, margin = feasible & passive.feasible, np.minimum(margin, passive.margin)
    clear = np.abs(margin) > SAME_YAW_RATE
    if np.any((feasible != reference_map.feasible) & clear):
        return False
    both = feasible & reference_map.feasible
    return bool(np.all(np.abs(optimum.yaw_rate - reference_map.yaw_rate)[both] <= SAME_YAW_RATE))


def continued(
    problem: SteadyTurnProblem, speed: FloatArray, front_angle: FloatArray, passive_safe: bool, steering: CapSteering
) -> Surface:
    """The optimum without the grip bounds, continued, of a map with breakpoints `speed` (n,) and `front_angle` (m,), and up to
    the first of them the plain rules, which are linear there."""
    without_grip = replace(problem, lateral_acceleration_max=UNBOUNDED, front_slip_max=UNBOUNDED, rear_slip_max=UNBOUNDED)
    ends_passively = passive_safe and problem.rear_angle_max > 0.0
    ending = replace(problem, rear_angle_max=0.0) if ends_passively else without_grip
    bounded = _PassivelySafe(LinearTurns(problem)) if ends_passively else LinearTurns(problem)
    cap, rear_max = problem.lateral_acceleration_cap, steering.rear_angle_max
    plain = extended(bounded.solve, bounded.edge, problem.car.yaw_gain, cap, speed, front_angle, steering)
    first_speed, first_angle = _first(speed), _first(front_angle)

    def surface(v: FloatArray, angle: FloatArray) -> Pair:
        v_inside = np.maximum(v, first_speed)
        end = np.minimum(exact.edge(ending, v_inside).front_angle * JUST_INSIDE, front_angle[-1])[:, np.newaxis]
        solved_at = np.minimum(angle, end)
        optimum = exact.solve(without_grip, v_inside, solved_at)
        gain = problem.car.yaw_gain(v_inside)[:, np.newaxis]
        yaw_rate = _plausible(optimum.yaw_rate + gain * (angle - solved_at))
        rear_angle = np.clip(optimum.rear_angle, -rear_max, rear_max)
        slow, ahead = v <= first_speed, angle <= first_angle
        yaw_rate[slow], rear_angle[slow] = plain(v[slow], angle)
        yaw_rate[:, ahead], rear_angle[:, ahead] = plain(v, angle[ahead])
        return yaw_rate, rear_angle

    return surface


@dataclass(frozen=True)
class _PassivelySafe:
    """Turns as far as the passive car goes: from there on with its slope, whatever ends it."""

    turns: LinearTurns

    def solve(self, speed: FloatArray, front_angle: FloatArray) -> Solution:
        found = self.turns.solve(speed, front_angle)
        return replace(found, feasible=found.feasible & passively_feasible(self.turns, speed, front_angle))

    def edge(self, speed: FloatArray) -> Edge:
        end = self.turns.without_rear_steering().edge(speed).front_angle
        found = self.turns.at(speed, end * JUST_INSIDE)
        return Edge(end, found.yaw_rate, found.rear_angle, np.zeros(speed.shape, dtype=bool))


def _first(axis: FloatArray) -> float:
    return float(axis[axis > 0.0][0])


def extended(
    solve: Callable[[FloatArray, FloatArray], Solution],
    edge: Callable[[FloatArray], Edge],
    passive_gain: Callable[[FloatArray], FloatArray],
    cap: float,
    speed: FloatArray,
    front_angle: FloatArray,
    steering: CapSteering,
) -> Surface:
    """An optimum extended by the plain rules of `extend`, where none is known without the grip bounds.

    Args:
        solve: at speeds (n,) and front angles (m,), inside the breakpoints of the map.
        edge: where the feasible front angles end at speeds (n,).
        passive_gain: G of speeds (n,), 1/s. cap: ay_cap in m/s^2.
        speed, front_angle: breakpoints of the map, (n,) and (m,).
    """
    rear_max, first_speed = steering.rear_angle_max, _first(speed)
    first_angle, last_angle = _first(front_angle), front_angle[-1]

    def surface(v: FloatArray, angle: FloatArray) -> Pair:
        v_inside = np.maximum(v, first_speed)
        inside = np.clip(angle, first_angle, last_angle)
        optimum, end = solve(v_inside, inside), edge(v_inside)
        gain = passive_gain(v_inside)[:, np.newaxis]
        edge_angle, edge_yaw_rate = end.front_angle[:, np.newaxis], end.yaw_rate[:, np.newaxis]
        rear_at_edge = edge_angle - edge_yaw_rate / gain
        line = edge_yaw_rate + gain * (np.maximum(angle, first_angle) - edge_angle)
        beyond = np.where(end.grip_limited[:, np.newaxis], (cap / v_inside)[:, np.newaxis], line)
        solved = optimum.yaw_rate + gain * np.maximum(angle - last_angle, 0.0)
        yaw_rate = np.where(optimum.feasible, solved, beyond)
        rear_angle = np.where(optimum.feasible, optimum.rear_angle, rear_at_edge)
        share = np.minimum(v / first_speed, 1.0)[:, np.newaxis] * np.minimum(angle / first_angle, 1.0)
        return _plausible(share * yaw_rate), share * np.clip(rear_angle, -rear_max, rear_max)

    return surface


def _plausible(yaw_rate: FloatArray) -> FloatArray:
    """Held where no car's map goes: far above any cap, and the most that the C lets a calibration hold."""
    return np.minimum(yaw_rate, 0.999 * PLAUSIBLE["yaw_rate"].high)


def _bilinear(total: TotalMap) -> Surface:
    """A total map's own tables, interpolated; the last row and column hold beyond."""

    def surface(v: FloatArray, angle: FloatArray) -> Pair:
        i, u = cell_of(total.speed, v)
        j, w = cell_of(total.front_angle, angle)
        yaw_rate, rear_angle = (along(along(table, i, u).T, j, w).T for table in (total.yaw_rate, total.rear_angle))
        return yaw_rate, rear_angle

    return surface


def cell_of(axis: FloatArray, x: FloatArray) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Cell index and share of the cell, 0 to 1, of points (k,) on breakpoints (n,)."""
    cell = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, axis.size - 2)
    return cell, np.clip((x - axis[cell]) / (axis[cell + 1] - axis[cell]), 0.0, 1.0)


def along(table: FloatArray, cell: npt.NDArray[np.int64], share: FloatArray) -> FloatArray:
    """Rows of a table (n, m) interpolated at positions (k,): (k, m)."""
    result: FloatArray = table[cell] + share[:, np.newaxis] * (table[cell + 1] - table[cell])
    return result


def rule_at(ground: Ground, layer: GroundLayer, speed: FloatArray, front_angle: FloatArray) -> npt.NDArray[np.str_]:
    """(n, m) `Rule` letters of a table of the surface on any axes from zero."""
    total = layer.total
    i = np.clip(np.searchsorted(total.speed, speed * JUST_INSIDE), 0, total.speed.size - 1)
    j = np.clip(np.searchsorted(total.front_angle, front_angle * JUST_INSIDE), 0, total.front_angle.size - 1)
    rule = total.rule[np.ix_(i, j)]
    if ground.origin == "optimum":
        above = layer.surface(speed, front_angle)[0] * speed[:, np.newaxis] > layer.cap * (1.0 + 1e-9)
        rule = np.where(above, Rule.CONTINUED.value, rule)
    rule[speed == 0.0, :] = Rule.ZERO.value
    rule[:, front_angle == 0.0] = Rule.ZERO.value
    return rule
