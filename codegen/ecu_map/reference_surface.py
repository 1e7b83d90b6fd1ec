"""Reference for the error of tables: the continuous total map behind a reference map, at any speed and front angle.

For a map that the exact solution made, this is the optimum itself: with linear tyres solved anew at every point. Within the
bounds, the optimum is the smaller of the optimum *without the grip bounds* and ay_cap / speed: the grip bounds are on |r|
alone, and the objective falls with |r|. The lookup applies ay_cap / speed by itself, so that a table of the optimum without the
grip bounds, continued, meets the kink between both exactly, wherever its cells lie. With the nonlinear tyre, the limit of grip
is a surface too (`placement_grip`), with a table of its own; a map that bends towards its cap needs none. Where sideslip or the
rear angle end it, and beyond the last angle of the map, it continues with the passive car's gain, as in `extend`. Below the
first speed and the first front angle, the yaw rate falls linearly to zero. Below the first speed, the rear angle is constant.

For any other map only its own table is known. The reference is then its bilinear interpolation, extended.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.extend import extend
from codegen.ecu_map.lookup import SteeringConstants, capped_rear_angle
from codegen.ecu_map.placement_grip import grip_surfaces
from codegen.ecu_map.total import CapSteering, Rule, TotalMap
from codegen.map_file.bounds import BOUNDS
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import PLAUSIBLE
from codegen.optimum import exact
from codegen.optimum.demand import PASSIVE_TO, REFERENCE_FROM
from codegen.optimum.nonlinear import NonlinearTurns
from codegen.optimum.problem import SteadyTurnProblem
from codegen.optimum.solve import from_walking_speed, stack_of
from codegen.optimum.turns import Edge, LinearTurns, Solution, SteadyTurns, passively_feasible, turns_of

Pair = tuple[FloatArray, FloatArray]
Surface = Callable[[FloatArray, FloatArray], Pair]
"""Speeds (n,) in m/s and front angles (m,) in rad -> yaw rate in rad/s and rear angle in rad, (n, m) each, before the cap."""
Values = Callable[[FloatArray, FloatArray], FloatArray]
"""Speeds (n,) in m/s and front angles (m,) in rad -> one value at each, (n, m)."""

Origin = Literal["optimum", "surfaces", "table"]

SAME_YAW_RATE = 1e-5
"""rad/s: largest deviation at which a table counts as the exact optimum (IPOPT ends within 1e-7)."""

UNBOUNDED = 1e3
"""m/s^2 and rad: a grip bound that never acts."""

GAP_POINTS = 150
"""Number of speeds, and of front angles, at which surfaces are compared with the optimum."""
BESIDE_EDGE = np.array([1e-6, 5e-4, 1e-3, 2e-3, 4e-3])
"""Relative distances inside an edge at which surfaces are compared with the optimum."""

JUST_INSIDE = 1.0 - 1e-12
"""Factor on an edge, because rounding decides whether the edge itself is feasible."""


@dataclass(frozen=True)
class Gap:
    """Largest deviation of a surface from the optimum, rad/s and rad; `rear_yaw_rate`: the latter times G, rad/s."""

    yaw_rate: float = 0.0
    rear_angle: float = 0.0
    rear_yaw_rate: float = 0.0


@dataclass(frozen=True)
class SurfaceLayer:
    """One friction: the surface before the cap, the cap in m/s^2, and the total map that a build without a choice holds.

    `share` is the fraction of the cap that grip leaves, where it varies. `gap` is the error of the surfaces, where solving the
    optimum at every point takes too long.
    """

    surface: Surface
    cap: float
    total: TotalMap
    share: Values | None = None
    gap: Gap = Gap()

    def allowed(self, speed: FloatArray, front_angle: FloatArray) -> FloatArray:
        """Return the allowed lateral acceleration (n, m) in m/s^2."""
        if self.share is None:
            return np.full((speed.size, front_angle.size), self.cap)
        return self.cap * self.share(speed, front_angle)

    def limit(self, speed: FloatArray, front_angle: FloatArray) -> FloatArray:
        """Return the allowed yaw rate (n, m) in rad/s."""
        return self.allowed(speed, front_angle) / above_zero(speed)[:, np.newaxis]

    def with_share(self, share: Values) -> SurfaceLayer:
        """Return the layer with another share of the cap."""
        return replace(self, share=share)

    def truth(self, speed: FloatArray, front_angle: FloatArray) -> Pair:
        """Return yaw rate and rear angle (n, m) after the cap, for speeds (n,) and front angles (m,) from zero."""
        yaw_rate, rear_angle = self.surface(speed, front_angle)
        return capped(yaw_rate, rear_angle, self.allowed(speed, front_angle), speed, self.total.steering)


@dataclass(frozen=True)
class ReferenceSurface:
    """The continuous total map, the layers rising by friction or acceleration.

    Attributes:
        origin: "optimum": solved anew at every point; "surfaces": solved on a fine grid (`placement_grip`), with a `gap`
            for its error; "table": the map's own bilinear interpolation.
        own_speed, own_front_angle: first and last breakpoint of the map (above zero), m/s and rad.
        front_angle_top: rad, the mechanical stop, or the map's last angle where that is larger.
        speed_kinks, front_angle_kinks: kinks of the surfaces by rule, m/s and rad.
    """

    layers: tuple[SurfaceLayer, ...]
    origin: Origin
    own_speed: tuple[float, float]
    own_front_angle: tuple[float, float]
    front_angle_top: float
    speed_kinks: FloatArray
    front_angle_kinks: FloatArray

    @property
    def total(self) -> TotalMap:
        """Total map of a build without placed breakpoints, with its layers."""
        return TotalMap.of_stack(layer.total for layer in self.layers)


def capped(
    yaw_rate: FloatArray, rear_angle: FloatArray, cap: float | FloatArray, speed: FloatArray, steering: CapSteering
) -> Pair:
    """Return tables (n, m) after the cap (m/s^2, one or (n, m)) at speeds (n,): the lookup in exact arithmetic."""
    v = above_zero(speed)[:, np.newaxis]
    allowed = np.broadcast_to(cap / v, yaw_rate.shape)
    car = SteeringConstants.of(steering, np.float64)
    is_capped = yaw_rate > allowed
    turned = np.where(is_capped, capped_rear_angle(car, yaw_rate, rear_angle, allowed, v), rear_angle)
    return np.minimum(yaw_rate, allowed), np.clip(turned, -car.rear_angle_max, car.rear_angle_max)


def above_zero(speed: FloatArray) -> FloatArray:
    """Return speeds in m/s that are safe divisors."""
    return np.maximum(speed, 1e-9)


def reference_surface_of(reference_map: ReferenceMap, config: Config) -> ReferenceSurface:
    """Return the continuous total map of a map; `config` is the car for one without a configuration.

    Raises:
        MapError: see `extend`.
    """
    total = extend(reference_map, config, (reference_map.config or config).steering.front_angle_stop)
    reference_map = reference_map if config.controller.waits_for_speed else from_walking_speed(reference_map)
    config = reference_map.config or config
    stack = zip(stack_of(reference_map, config), total.stack, strict=True)
    layers = tuple(optimum_of(of_layer, car, extended) for (_, of_layer, car), extended in stack)
    known = tuple(layer for layer in layers if layer is not None)
    origin: Origin = "table"
    if len(known) == len(layers):
        origin = "optimum" if reference_map.tyre_model == "linear" else "surfaces"
    else:
        known = tuple(SurfaceLayer(_bilinear(layer), layer.lateral_acceleration_cap, layer) for layer in total.stack)
    speed, front_angle = _ends(reference_map.speed), _ends(reference_map.front_angle)
    return ReferenceSurface(
        layers=known,
        origin=origin,
        own_speed=speed,
        own_front_angle=front_angle,
        front_angle_top=float(total.front_angle[-1]),
        speed_kinks=total.speed if origin == "table" else _speed_kinks(config, speed),
        front_angle_kinks=total.front_angle if origin == "table" else np.array(front_angle),
    )


def _speed_kinks(config: Config, speed: tuple[float, float]) -> FloatArray:
    """Return the speeds in m/s at which the optimum of a map has a kink: its first one, and those of the floor inside."""
    of_floor = [at for at in (PASSIVE_TO, REFERENCE_FROM) if speed[0] < at < speed[1]]
    return np.array([speed[0], *(of_floor if config.limits.yaw_gain_floor > 0.0 else [])])


def optimum_of(reference_map: ReferenceMap, config: Config, total: TotalMap) -> SurfaceLayer | None:
    """Return the optimum behind a map; None where it is unknown or the map deviates from it.

    Args:
        total: total map of the same map.

    Raises:
        MapError: a steady turn is not found.
    """
    if not reference_map.solved or reference_map.case is None:
        return None
    case = config.case(reference_map.case)
    turns = turns_of(config, case)
    if not _holds(reference_map, turns, case.passive_safe):
        return None
    if isinstance(turns, NonlinearTurns):
        return _followed(turns, reference_map, total, passive_safe=case.passive_safe)
    axes = (reference_map.speed, reference_map.front_angle)
    surface = continued(turns.problem, *axes, case.passive_safe, total.steering)
    return SurfaceLayer(surface, total.lateral_acceleration_cap, total)


def _followed(turns: NonlinearTurns, reference_map: ReferenceMap, total: TotalMap, *, passive_safe: bool) -> SurfaceLayer:
    """Return the layer with its cap: the largest lateral acceleration on the continuous optimum, and its fraction at each
    point where the cap follows slip."""
    speed, front_angle = (_ends(axis) for axis in (reference_map.speed, reference_map.front_angle))
    found = grip_surfaces(
        turns, speed, front_angle, float(total.front_angle[-1]), total.lateral_acceleration_cap, passive_safe=passive_safe
    )
    axes, cap = (found.speed, found.front_angle), float(found.lateral_acceleration.max())
    share = None if turns.problem.is_bent else interpolated(*axes, found.lateral_acceleration / cap)
    # Near its peak the tyre slips more for the same lateral acceleration than the linear car's.
    slip = max(found.rear_slip, total.steering.rear_slip_per_lateral_acceleration)
    steering = replace(total.steering, rear_slip_per_lateral_acceleration=slip)
    layer = SurfaceLayer(
        # Before the cap the rear angle may leave its range, in which the laws hold it.
        surface=_surface(*axes, _plausible(found.yaw_rate), found.rear_angle),
        cap=cap,
        total=replace(total, lateral_acceleration_cap=cap, steering=steering),
        share=share,
    )
    return replace(layer, gap=_gap(layer, turns, speed, front_angle, passive_safe=passive_safe))


def _gap(
    layer: SurfaceLayer, turns: SteadyTurns, speed: tuple[float, float], front_angle: tuple[float, float], *, passive_safe: bool
) -> Gap:
    """Return the deviation of the surfaces from the optimum.

    It is measured at GAP_POINTS x GAP_POINTS points off the grid, between first and last speed (m/s) and front angle (rad), and
    just inside the edge at as many speeds."""
    source, rear_max = np.random.default_rng(0), layer.total.steering.rear_angle_max
    speeds, angles = (np.sort(source.uniform(*ends, GAP_POINTS)) for ends in (speed, front_angle))
    straight = turns.without_rear_steering() if passive_safe else turns
    edge = np.minimum(turns.edge(speeds).front_angle, straight.edge(speeds).front_angle)
    beside = edge[:, np.newaxis] * (1.0 - BESIDE_EDGE)
    known = (beside >= front_angle[0]) & (beside <= front_angle[1])
    speeds_beside = np.broadcast_to(speeds[:, np.newaxis], beside.shape)[known]
    found = [
        layer.truth(speeds, angles),
        *(layer.truth(v[np.newaxis], angle[np.newaxis]) for v, angle in zip(speeds_beside, beside[known], strict=True)),
    ]
    optima = [
        (turns.solve(speeds, angles), straight.solve(speeds, angles)),
        (turns.at(speeds_beside, beside[known]), straight.at(speeds_beside, beside[known])),
    ]
    feasible = np.concatenate([(optimum.feasible & passive.feasible).ravel() for optimum, passive in optima])
    off = []
    for channel, name in enumerate(("yaw_rate", "rear_angle")):
        have = np.concatenate([pair[channel].ravel() for pair in found])
        want = np.concatenate([getattr(optimum, name).ravel() for optimum, _ in optima])
        off.append(np.abs(have - (want if name == "yaw_rate" else np.clip(want, -rear_max, rear_max))))
    off.append(off[1] * turns.problem.car.yaw_gain(np.concatenate([np.repeat(speeds, angles.size), speeds_beside])))
    return Gap(*(float(error[feasible].max(initial=0.0)) for error in off))


def _holds(reference_map: ReferenceMap, turns: SteadyTurns, passive_safe: bool) -> bool:
    """Return whether a map is the optimum on its grid; an edited one is not."""
    if reference_map.speed[0] <= 0.0:
        return False
    axes = (reference_map.speed, reference_map.front_angle)
    optimum = turns.solve(*axes)
    feasible, margin = optimum.feasible, optimum.margin
    if passive_safe:
        passive = turns.without_rear_steering().solve(*axes)
        feasible, margin = feasible & passive.feasible, np.minimum(margin, passive.margin)
    clear = np.abs(margin) > SAME_YAW_RATE
    if np.any((feasible != reference_map.feasible) & clear):
        return False
    both = feasible & reference_map.feasible
    return bool(np.all(np.abs(optimum.yaw_rate - reference_map.yaw_rate)[both] <= SAME_YAW_RATE))


def continued(
    problem: SteadyTurnProblem, speed: FloatArray, front_angle: FloatArray, passive_safe: bool, steering: CapSteering
) -> Surface:
    """Return the continued optimum without the grip bounds, of a map with breakpoints `speed` (n,) and `front_angle` (m,).

    Up to the first breakpoints the rules of `extend` apply, which are linear there."""
    grip_limits: dict[str, Any] = {bound.limit: UNBOUNDED for bound in BOUNDS if bound.is_grip}
    without_grip = replace(problem, **grip_limits)
    ends_passively = passive_safe and problem.rear_angle_max > 0.0
    ending = replace(problem, rear_angle_max=0.0) if ends_passively else without_grip
    bounded = _PassivelySafe(LinearTurns(problem)) if ends_passively else LinearTurns(problem)
    cap = problem.lateral_acceleration_cap
    plain = extended(bounded.solve, bounded.edge, problem.car.yaw_gain, cap, speed, front_angle, steering)
    (first_speed, _), (first_angle, _) = _ends(speed), _ends(front_angle)

    def surface(v: FloatArray, angle: FloatArray) -> Pair:
        v_inside = np.maximum(v, first_speed)
        end = np.minimum(exact.edge(ending, v_inside).front_angle * JUST_INSIDE, front_angle[-1])[:, np.newaxis]
        solved_at = np.minimum(angle, end)
        optimum = exact.solve(without_grip, v_inside, solved_at)
        gain = problem.car.yaw_gain(v_inside)[:, np.newaxis]
        yaw_rate = _plausible(optimum.yaw_rate + gain * (angle - solved_at))
        rear_angle = optimum.rear_angle
        slow, ahead = v <= first_speed, angle <= first_angle
        yaw_rate[slow], rear_angle[slow] = plain(v[slow], angle)
        yaw_rate[:, ahead], rear_angle[:, ahead] = plain(v, angle[ahead])
        return yaw_rate, rear_angle

    return surface


@dataclass(frozen=True)
class _PassivelySafe:
    """Turns as far as the passive car reaches, continued with its slope."""

    turns: LinearTurns

    def solve(self, speed: FloatArray, front_angle: FloatArray) -> Solution:
        found = self.turns.solve(speed, front_angle)
        return replace(found, feasible=found.feasible & passively_feasible(self.turns, speed, front_angle))

    def edge(self, speed: FloatArray) -> Edge:
        end = self.turns.without_rear_steering().edge(speed).front_angle
        found = self.turns.at(speed, end * JUST_INSIDE)
        return Edge(end, found.yaw_rate, found.rear_angle, np.zeros(speed.shape, dtype=bool))


def _ends(axis: FloatArray) -> tuple[float, float]:
    """Return the first breakpoint above zero, and the last one."""
    return float(axis[axis > 0.0][0]), float(axis[-1])


def extended(
    solve: Callable[[FloatArray, FloatArray], Solution],
    edge: Callable[[FloatArray], Edge],
    passive_gain: Callable[[FloatArray], FloatArray],
    cap: float,
    speed: FloatArray,
    front_angle: FloatArray,
    steering: CapSteering,
) -> Surface:
    """Extend an optimum by the rules of `extend`, if no optimum without the grip bounds is known.

    Args:
        solve: at speeds (n,) and front angles (m,), inside the breakpoints of the map.
        edge: last feasible front angle at speeds (n,), rad.
        passive_gain: G of speeds (n,), 1/s. cap: ay_cap in m/s^2.
        speed, front_angle: breakpoints of the map, (n,) and (m,).
    """
    rear_max, (first_speed, _), (first_angle, last_angle) = steering.rear_angle_max, _ends(speed), _ends(front_angle)

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
        turned = np.minimum(angle / first_angle, 1.0)
        yaw_rate = np.minimum(v / first_speed, 1.0)[:, np.newaxis] * turned * yaw_rate
        return _plausible(yaw_rate), turned * np.clip(rear_angle, -rear_max, rear_max)

    return surface


def _plausible(yaw_rate: FloatArray) -> FloatArray:
    """Clip to the largest values that the C accepts in a calibration, far above any cap."""
    return np.minimum(yaw_rate, 0.999 * PLAUSIBLE["yaw_rate"].high)


def _bilinear(total: TotalMap) -> Surface:
    """Return the interpolated tables of a total map."""
    return _surface(total.speed, total.front_angle, total.yaw_rate, total.rear_angle)


def _surface(speed: FloatArray, front_angle: FloatArray, *tables: FloatArray) -> Surface:
    """Return the bilinear surface of both tables (n, m)."""
    yaw_rate, rear_angle = (interpolated(speed, front_angle, table) for table in tables)
    return lambda v, angle: (yaw_rate(v, angle), rear_angle(v, angle))


def interpolated(speed: FloatArray, front_angle: FloatArray, table: FloatArray) -> Values:
    """Interpolate a table (n, m) bilinearly; the last row and column hold beyond it."""

    def value(v: FloatArray, angle: FloatArray) -> FloatArray:
        return along(along(table, *cell_of(speed, v)).T, *cell_of(front_angle, angle)).T

    return value


def cell_of(axis: FloatArray, x: FloatArray) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """Return cell index and position in the cell, 0 to 1, of points (k,) on breakpoints (n,)."""
    cell = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, axis.size - 2)
    return cell, np.clip((x - axis[cell]) / (axis[cell + 1] - axis[cell]), 0.0, 1.0)


def along(table: FloatArray, cell: npt.NDArray[np.int64], share: FloatArray) -> FloatArray:
    """Interpolate rows of a table (..., n, m) at positions (k,): (..., k, m)."""
    low, high = table[..., cell, :], table[..., cell + 1, :]
    result: FloatArray = low + share[:, np.newaxis] * (high - low)
    return result


def rule_at(surface: ReferenceSurface, layer: SurfaceLayer, speed: FloatArray, front_angle: FloatArray) -> npt.NDArray[np.str_]:
    """Return the `Rule` letters (n, m) of a table of the surface on axes from zero."""
    total = layer.total
    i = np.clip(np.searchsorted(total.speed, speed * JUST_INSIDE), 0, total.speed.size - 1)
    j = np.clip(np.searchsorted(total.front_angle, front_angle * JUST_INSIDE), 0, total.front_angle.size - 1)
    rule = total.rule[np.ix_(i, j)]
    if surface.origin != "table":
        asked = layer.surface(speed, front_angle)[0] * speed[:, np.newaxis]
        above = asked > layer.allowed(speed, front_angle) * (1.0 + 1e-9)
        rule = np.where(above, Rule.CONTINUED.value, rule)
    rule[speed == 0.0, :] = Rule.ZERO.value
    rule[:, front_angle == 0.0] = Rule.ZERO.value
    return rule
