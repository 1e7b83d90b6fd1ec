"""Solve one case of a configuration on its grid: one map, or a stack of maps over friction or longitudinal acceleration.

The map itself is the one for `road.friction` at constant speed. The layers of a stack are for lower frictions (see
`map_file.map`), each solved as if the road were like that (`map_file.map.on_road`), or for longitudinal accelerations, each
solved as if the car braked or accelerated (`map_file.longitudinal.under_acceleration`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.errors import CodegenError, ConfigError, MapError
from codegen.map_file import archive, tables
from codegen.map_file.map import ATTRIBUTES, Layer, ReferenceMap, changed, make_meta, on_road, own_value
from codegen.optimum.problem import breakpoints
from codegen.optimum.turns import Solution, passively_feasible, turns_behind, turns_of
from codegen.units import KM_H

Method = Literal["exact", "ipopt"]


def solve_case(
    config: Config, case: str, method: Method = "exact", progress: Callable[[int, int], None] | None = None
) -> ReferenceMap:
    """The map of a case: optimal, or of its law. Its configuration holds the case, also one of REFERENCE_CASES.

    A `passive_safe` case keeps of its operating points those that the car could drive without its rear steering as well.

    Args:
        method: "exact" (the whole grid at once: closed form, or Newton's method with the nonlinear tyre) or "ipopt" (point by
            point; the reference).
        progress: called with (cells done, cells in all); only "ipopt" takes long enough to call it.

    Raises:
        ConfigError: no such case, or a grid beyond the critical speed of an oversteering car.
        MapError: no operating point of the grid is feasible, or none is left of a passive_safe case; or a steady turn is not
            found.
    """
    config = config.with_case(case)
    chosen = config.case(case)
    turns = turns_of(config, chosen)
    speed, front_angle = breakpoints(config)
    if method == "exact":
        solution = turns.solve(speed, front_angle)
    else:
        from codegen.optimum import ipopt

        solution = ipopt.solve(config, turns, speed, front_angle, progress, chosen.tyre_model)
    if not solution.feasible.any():
        raise MapError(
            "no operating point of the grid is feasible",
            where=f"[cases.{case}]",
            remedy="relax [limits], start the grid at smaller front angles, or check the vehicle data",
        )
    if chosen.passive_safe:
        solution = _keep(solution, solution.feasible & passively_feasible(turns, speed, front_angle))
        if not solution.feasible.any():
            raise MapError(
                "no operating point of the grid is feasible without rear steering",
                where=f"[cases.{case}].passive_safe",
                remedy="set it to false, relax [limits], or start the grid at smaller front angles",
            )
    return ReferenceMap(
        speed=speed,
        front_angle=front_angle,
        **{name: getattr(solution, name) for name in ATTRIBUTES.values()},
        config=config,
        case=case,
        meta=make_meta(config, case, turns.method if method == "exact" else method),
    )


WALKING_SPEED = 3.0 * KM_H
"""m/s. From here on the ECU's map is solved; slower cars keep the rear angle of this speed."""


def from_walking_speed(reference_map: ReferenceMap) -> ReferenceMap:
    """Return a solved map that begins at `WALKING_SPEED` or less than a cell above it, on the same front angles.

    A map with a higher first speed demands, near the steering stop, the yaw rate that grip leaves there, with the rear wheels
    in phase: far from what a slow car needs. The added speeds have the distance of its first two. A bare table stays as it is.

    Raises:
        MapError: a steady turn is not found.
    """
    speed, turns = reference_map.speed, turns_behind(reference_map)
    cells = np.diff(speed)
    cell = cells.mean() if np.allclose(cells, cells[0]) else cells[0]  # an even axis stays even, to the last digit
    step = min(float(cell), 0.5 * float(speed[0]))
    count = math.floor((speed[0] - WALKING_SPEED) / step * (1.0 + 1e-9)) if step > 0.0 else 0
    if turns is None or count < 1:
        return reference_map
    added = speed[0] - step * np.arange(count, 0, -1)
    slow = turns.solve(added, reference_map.front_angle)
    if reference_map.config and reference_map.case and reference_map.config.case(reference_map.case).passive_safe:
        slow = _keep(slow, slow.feasible & passively_feasible(turns, added, reference_map.front_angle))
    tables_: dict[str, Any] = {
        name: np.concatenate([getattr(slow, name), getattr(reference_map, name)]) for name in ATTRIBUTES.values()
    }
    layers = tuple(replace(layer, map=from_walking_speed(layer.map)) for layer in reference_map.layers)
    return replace(reference_map, speed=np.concatenate([added, speed]), layers=layers, **tables_)


def _keep(solution: Solution, kept: npt.NDArray[np.bool_]) -> Solution:
    """The solution with all cells but `kept` (n, m) infeasible."""
    tables_ = {name: getattr(solution, name) for name in ATTRIBUTES.values()}
    others = {name: np.where(kept, table, np.nan) for name, table in tables_.items() if table.dtype.kind == "f"}
    active = np.where(kept, solution.active, solution.active.dtype.type(0))
    return replace(solution, **others, feasible=kept, active=active)


__all__ = ["layer_configs", "lower_frictions", "on_road", "solve_acceleration_stack", "solve_stack", "stack_of"]

CELL_BYTES = 3 * 8 + 2
"""Size of a solved cell in a file: three tables of float64 and two of one byte."""

DESIGN_TOLERANCE = 1e-9

FRICTION_ARGUMENT = "`friction=`"
ACCELERATION_ARGUMENT = "`longitudinal_acceleration=`"
"""Arguments of `solve`, in messages."""


def solve_stack(
    config: Config,
    case: str,
    friction: Sequence[float],
    method: Method = "exact",
    progress: Callable[[int, int], None] | None = None,
) -> ReferenceMap:
    """The optimal maps of a case for several frictions: the map of `road.friction` with the others as its layers.

    Args:
        friction: in any order, two or more; the largest is `road.friction` (see `lower_frictions`).
        method, progress: as for `solve_case`; progress counts the cells of all maps.

    Raises:
        ConfigError: bad frictions; no such case; or a grid beyond the critical speed that an oversteering car has on one of the
            roads (it falls with the friction).
        MapError: no operating point of the grid is feasible at one of the frictions, or the file would be too large.
    """
    return _solve_layers(
        config, case, tables.FRICTION_STACK, FRICTION_ARGUMENT, lower_frictions(config, friction), method, progress
    )


def solve_acceleration_stack(
    config: Config,
    case: str,
    acceleration: Sequence[float],
    method: Method = "exact",
    progress: Callable[[int, int], None] | None = None,
) -> ReferenceMap:
    """The optimal maps of a case for several longitudinal accelerations: that at constant speed with the others as its layers.

    Args:
        acceleration: m/s^2, negative while the car brakes; in any order, two or more, zero among them.
        method, progress: as for `solve_stack`.

    Raises:
        ConfigError: bad accelerations; an axle has not enough grip for one (see `under_acceleration`); and as `solve_stack`.
        MapError: as `solve_stack`.
    """
    moving = moving_accelerations(acceleration)
    return _solve_layers(config, case, tables.ACCELERATION_STACK, ACCELERATION_ARGUMENT, moving, method, progress)


def _solve_layers(
    config: Config,
    case: str,
    stack: tables.Stack,
    option: str,
    values: Sequence[float],
    method: Method,
    progress: Callable[[int, int], None] | None,
) -> ReferenceMap:
    """Return the map with a layer for each value of a stack."""
    speed, front_angle = breakpoints(config)
    maps = len(values) + 1
    archive.check_size(maps * speed.size * front_angle.size * CELL_BYTES, archive.UNPACKED_BYTES_MAX, option)

    def part(index: int) -> Callable[[int, int], None] | None:
        return None if progress is None else lambda done, total: progress(index * total + done, maps * total)

    base, layers = solve_case(config, case, method, part(0)), []
    for index, value in enumerate(values, start=1):
        try:
            layers.append(Layer(stack, value, solve_case(changed(config, stack, value), case, method, part(index))))
        except CodegenError as error:
            remedy = f"{error.remedy}, or leave this {stack.one} out"
            raise type(error)(error.what, where=f"{stack.one} {value:g}: {error.where}", remedy=remedy) from error
    return replace(base, layers=tuple(layers))


def lower_frictions(config: Config, friction: Sequence[float]) -> tuple[float, ...]:
    """Return the frictions of the layers in rising order: all but the largest, which is that of the map itself.

    Raises:
        ConfigError: fewer than two or too many, one outside the plausible range, two too close together, or the largest is not
            `road.friction`.
    """
    rising = sorted(friction, key=lambda value: (math.isnan(value), value))
    design, limits = config.road.friction, tables.PLAUSIBLE["friction"]
    if len(rising) < 2:
        remedy = f"list lower ones with the map's own, such as 0.5,{design:g}, or leave {FRICTION_ARGUMENT} out"
        raise ConfigError(
            f"{len(rising) or 'no'} friction, where two or more make a stack", where=FRICTION_ARGUMENT, remedy=remedy
        )
    if len(rising) > tables.MAX_LAYERS + 1:
        raise ConfigError(f"{len(rising)} frictions", where=FRICTION_ARGUMENT, remedy=f"list at most {tables.MAX_LAYERS + 1}")
    for value in rising:
        if not limits.low <= value <= limits.high:
            raise ConfigError(
                f"{value:g} is outside {limits.low:g} to {limits.high:g}", where=FRICTION_ARGUMENT, remedy=limits.if_low
            )
    for left, right in pairwise(rising):
        if right - left < tables.FRICTION_STACK.step - tables.STEP_SLACK:
            what = f"{right:.9g} is there twice" if left == right else f"{left:.9g} and {right:.9g} are too close together"
            raise ConfigError(
                what, where=FRICTION_ARGUMENT, remedy=f"leave {tables.FRICTION_STACK.step:g} or more between two frictions"
            )
    if abs(rising[-1] - design) > DESIGN_TOLERANCE:
        raise ConfigError(
            f"the largest friction, {rising[-1]:.9g}, is not the one that the map itself is for, road.friction = {design:.9g}",
            where=FRICTION_ARGUMENT,
            remedy=f"set road.friction to {rising[-1]:.9g}, or let the list end with {design:.9g}",
        )
    return tuple(rising[:-1])


def moving_accelerations(acceleration: Sequence[float]) -> tuple[float, ...]:
    """Return the accelerations of the layers in m/s^2, rising: all but zero, which is that of the map itself.

    Raises:
        ConfigError: too few or too many, none is zero, one is outside the plausible range, or two are too close together.
    """
    rising = sorted(acceleration, key=lambda value: (math.isnan(value), value))
    stack, limits = tables.ACCELERATION_STACK, tables.PLAUSIBLE[tables.ACCELERATION_STACK.key]
    if not 2 <= len(rising) <= tables.MAX_LAYERS + 1:
        remedy = f"list 2 to {tables.MAX_LAYERS + 1} with zero among them, such as -4,0,3"
        raise ConfigError(f"{len(rising)} {stack.many}", where=ACCELERATION_ARGUMENT, remedy=remedy)
    for value in rising:
        if not limits.low <= value <= limits.high:
            what = f"{value:g} is outside {limits.low:g} to {limits.high:g} {limits.unit}"
            raise ConfigError(what, where=ACCELERATION_ARGUMENT, remedy="check the value and its unit, m/s^2")
    for left, right in pairwise(rising):
        if right - left < stack.step - tables.STEP_SLACK:
            remedy = f"leave {stack.step:g} m/s^2 or more between two"
            raise ConfigError(f"{left:.9g} and {right:.9g} are too close together", where=ACCELERATION_ARGUMENT, remedy=remedy)
    if 0.0 not in rising:
        what = "no zero, the acceleration for which the map itself is"
        raise ConfigError(what, where=ACCELERATION_ARGUMENT, remedy="add 0 to the list")
    return tuple(value for value in rising if value != 0.0)


def layer_configs(reference_map: ReferenceMap, config: Config) -> tuple[Config, ...]:
    """The configuration of each layer: its own, or for a map that brings none the car of `config` as the layer has it.

    Raises:
        MapError: a layer is not below the friction of `config`.
        ConfigError: see `on_road` and `under_acceleration`.
    """
    chosen = reference_map.config or config
    if reference_map.quantity is tables.FRICTION_STACK:
        values = np.array([layer.value for layer in reference_map.layers], dtype=np.float64)
        tables.check_below_design(values, chosen.road.friction, "the map")
    return tuple(changed(chosen, layer.quantity, layer.value) for layer in reference_map.layers)


def stack_of(reference_map: ReferenceMap, config: Config) -> tuple[tuple[float, ReferenceMap, Config], ...]:
    """Return value, map and configuration of each layer, rising, and of the map itself. Raises: see `layer_configs`."""
    chosen = reference_map.config or config
    of_layers = zip(reference_map.layers, layer_configs(reference_map, config), strict=True)
    own = (own_value(chosen, reference_map.quantity), reference_map, chosen)
    return tuple(sorted([*((layer.value, layer.map, of) for layer, of in of_layers), own], key=lambda one: one[0]))
