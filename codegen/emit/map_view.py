"""View model of the map: everything that its templates print, as text."""

from __future__ import annotations

import math
import zlib
from dataclasses import astuple, dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from codegen.config import KM_H
from codegen.emit.text import Precision, lines_of, literal, numpy_type
from codegen.errors import MapError
from codegen.refmap.axis import Axis
from codegen.refmap.extend import TotalMap
from codegen.refmap.lookup import AxisConstants, Lookup

MAGNITUDE = "magnitude"
"""An argument that is never negative."""


@dataclass(frozen=True)
class CellsView:
    """Some cells of an even axis: of which kind, and when a value lies there, if it was in none of those before."""

    kind: Literal["core", "first", "last", "beyond"]
    condition: str


@dataclass(frozen=True)
class AxisView:
    """One axis. Fields that do not apply to its kind are empty."""

    name: str
    title: str
    argument: str
    unit: str
    locate: str
    size: int
    text: str
    top: str
    top_text: str
    even: bool
    has_first_cell: bool
    has_last_cell: bool
    last_cell: int
    cells: tuple[CellsView, ...]
    total_text: str
    start_text: str
    core_origin: str
    core_origin_is_zero: bool
    offset_text: str
    core_top: str
    inverse_step: str
    inverse_first: str
    inverse_last: str
    search_start: int
    lines: tuple[str, ...]


@dataclass(frozen=True)
class RowView:
    """The yaw rates at one speed."""

    text: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class LayerView:
    """One friction of a table."""

    text: str
    rows: tuple[RowView, ...]


@dataclass(frozen=True)
class TableView:
    """A table on the shared axes; `indices` are what picks each of its layers ("" where there is only one)."""

    name: str
    function: str
    unit: str
    layers: tuple[LayerView, ...]
    indices: tuple[str, ...]


@dataclass(frozen=True)
class SteeringView:
    """The linear car of `extend.CapSteering`."""

    wheelbase: str
    understeer_coefficient: str
    rear_arm: str
    rear_slip: str
    sideslip_max: str
    rear_angle_max: str


@dataclass(frozen=True)
class MapView:
    """The tables with their axes and caps."""

    speed: AxisView
    front_angle: AxisView
    tables: tuple[TableView, ...]
    table_size: str
    with_rear_angle: bool
    stacked: bool
    layer_count: int
    frictions: str
    frictions_text: str
    caps: str
    steering: SteeringView
    rear_angle_max_text: str
    cap: str
    cap_per_friction: str
    cap_text: str
    friction: str
    friction_text: str
    checksum: str
    checksum_value: int
    checksum_steps: int
    checksum_also: str
    bits: int
    bits_type: str
    flash_bytes: int


def map_view(total: TotalMap, precision: Precision, prefix: str, *, with_rear_angle: bool) -> MapView:
    """The view of a total map; `with_rear_angle` where the control law looks the optimum's rear angle up.

    Raises ValueError where a number has no literal (the map contract rules that out).
    """
    lookup = Lookup.from_map(total, numpy_type(precision))
    for key, constants in (("vx", lookup.speed_axis), ("delta_f", lookup.front_axis)):
        _check_apart(key, constants)
    stacked = bool(total.layers)
    named = [("yaw_rate_table", "uncapped_yaw_rate", "rad/s", lookup.tables)]
    if with_rear_angle:
        named.append(("rear_angle_table", "rear_angle_of_table", "rad", lookup.rear_tables))
    tables = tuple(
        TableView(name, function, unit, _layers(total, numbers, precision), _indices(len(numbers), stacked))
        for name, function, unit, numbers in named
    )
    bits = lookup.table.dtype.itemsize * 8
    uneven = [constants.table for constants in (lookup.speed_axis, lookup.front_axis) if not constants.axis.even]
    also = ([lookup.frictions] if stacked else []) + uneven
    numbers = np.concatenate([table.ravel() for *_, table in named] + also)
    checksum = zlib.crc32(numbers.astype(lookup.table.dtype.newbyteorder("<")).tobytes())
    points = f"[{prefix.upper()}_MAP_SPEED_POINTS][{prefix.upper()}_MAP_FRONT_ANGLE_POINTS]"
    return MapView(
        speed=_axis_view(lookup.speed_axis, "speed", "speed", "m/s", precision),
        front_angle=_axis_view(lookup.front_axis, "front_angle", MAGNITUDE, "rad", precision),
        tables=tables,
        table_size=f"[{prefix.upper()}_MAP_FRICTION_POINTS]{points}" if stacked else points,
        with_rear_angle=with_rear_angle,
        stacked=stacked,
        layer_count=len(lookup.frictions),
        frictions=", ".join(literal(value, precision) for value in lookup.frictions),
        frictions_text=", ".join(f"{layer.friction:g}" for layer in total.stack),
        caps=", ".join(literal(value, precision) for value in lookup.caps),
        steering=SteeringView(*(literal(value, precision) for value in astuple(lookup.steering))),
        rear_angle_max_text=_with_unit(total.steering.rear_angle_max, "rad"),
        cap=literal(lookup.lateral_acceleration_cap, precision),
        cap_per_friction=literal(lookup.lateral_acceleration_cap_per_friction, precision),
        cap_text=f"{total.lateral_acceleration_cap:.4g} m/s^2",
        friction=literal(total.friction, precision),
        friction_text=f"{total.friction:g}",
        checksum=f"0x{checksum:08X}u",
        checksum_value=checksum,
        checksum_steps=numbers.size * bits // 4,
        checksum_also=_checksum_also(stacked, bool(uneven)),
        bits=bits,
        bits_type=f"uint{bits}_t",
        flash_bytes=numbers.nbytes,
    )


def _checksum_also(stacked: bool, uneven: bool) -> str:
    also = (["the frictions"] if stacked else []) + (["the uneven breakpoints"] if uneven else [])
    return f", then over {' and '.join(also)}" if also else ""


def _layers(total: TotalMap, tables: npt.NDArray[Any], precision: Precision) -> tuple[LayerView, ...]:
    return tuple(
        LayerView(
            text=f"{layer.friction:g}",
            rows=tuple(
                RowView(f"{speed / KM_H:.4g} km/h", lines_of([literal(value, precision) for value in row]))
                for speed, row in zip(total.speed, table, strict=True)
            ),
        )
        for layer, table in zip(total.stack, tables, strict=True)
    )


def _indices(layers: int, stacked: bool) -> tuple[str, ...]:
    return tuple(f"[{layer}u]" for layer in range(layers)) if stacked else ("",)


def _check_apart(key: str, constants: AxisConstants) -> None:
    """Breakpoints that differ in the file may be one number in the target's precision, or too close to divide by."""
    with np.errstate(divide="ignore", over="ignore"):
        reciprocal = 1.0 / np.diff(constants.table)
    for index in np.flatnonzero(~(np.isfinite(reciprocal) & (reciprocal > 0.0)))[:1]:
        values = constants.axis.breakpoints[index : index + 2]
        raise MapError(
            f"the breakpoints {values[0]:.9g} and {values[1]:.9g} are one in this precision",
            where=key,
            remedy="take one of them out, or build with --precision double",
        )


def _axis_view(constants: AxisConstants, name: str, argument: str, unit: str, precision: Precision) -> AxisView:
    axis: Axis = constants.axis
    origin_is_zero = bool(axis.breakpoints[axis.core_start] == 0.0)
    return AxisView(
        name=name,
        title=name.replace("_", " ").capitalize(),
        argument=argument,
        unit=unit,
        locate=f"locate_{name}",
        size=axis.size,
        text=_describe(axis, unit),
        top=literal(constants.top, precision),
        top_text=_with_unit(float(axis.breakpoints[-1]), unit),
        even=axis.even,
        has_first_cell=axis.has_first_cell,
        has_last_cell=axis.has_last_cell,
        last_cell=axis.size - 2,
        cells=_cells(constants, name, argument, precision) if axis.even else (),
        total_text="Not negative; NaN counts as zero" if argument == MAGNITUDE else "NaN and what is below zero count as zero",
        start_text="NaN" if argument == MAGNITUDE else "zero, below it, or NaN",
        core_origin=literal(constants.core_origin, precision),
        core_origin_is_zero=origin_is_zero,
        offset_text=argument if origin_is_zero else f"({argument} - {name}_core_first)",
        core_top=literal(constants.core_top, precision),
        inverse_step=literal(constants.inverse_step, precision) if axis.even else "",
        inverse_first=literal(constants.inverse_first, precision) if axis.has_first_cell else "",
        inverse_last=literal(constants.inverse_last, precision) if axis.has_last_cell else "",
        search_start=axis.search_steps[0] if axis.search_steps else 0,
        lines=() if axis.even else lines_of([literal(value, precision) for value in np.asarray(constants.table)]),
    )


def _cells(constants: AxisConstants, name: str, argument: str, precision: Precision) -> tuple[CellsView, ...]:
    """In the order in which the fewest comparisons find the core. Every comparison is false for NaN."""
    axis, zero = constants.axis, literal(0.0, precision)
    # Of the steps where the table ends with the core: they may round up to one cell too many, which a last cell may be.
    counted, end = argument, f"{name}_core_last"
    if not axis.has_last_cell:
        counted, end = "steps", literal(float(axis.core_end - axis.core_start), precision)
    beyond = CellsView("last" if axis.has_last_cell else "beyond", f"{counted} >= {end}")
    if argument == MAGNITUDE and not axis.has_first_cell:
        return CellsView("core", f"{counted} < {end}"), beyond
    core = CellsView("core", f"{argument} >= {name}_core_first" if axis.has_first_cell else f"{argument} >= {zero}")
    first = (CellsView("first", f"{argument} > {zero}"),) if axis.has_first_cell else ()
    return beyond, core, *first


def _with_unit(value: float, unit: str) -> str:
    other = f"{value / KM_H:.4g} km/h" if unit == "m/s" else f"{math.degrees(value):.4g} deg"
    return f"{value:.4g} {unit} ({other})"


def _describe(axis: Axis, unit: str) -> str:
    first, last = axis.breakpoints[0], axis.breakpoints[-1]
    span = f"{axis.size} breakpoints from {first:.4g} to {last:.4g} {unit}"
    if not axis.even:
        return f"{span}, uneven"
    cells = [
        f"one of {axis.breakpoints[1]:.4g}" if axis.has_first_cell else "",
        f"{axis.core_end - axis.core_start} cells of {axis.step:.6g}",
        f"one of {axis.breakpoints[-1] - axis.breakpoints[-2]:.4g}" if axis.has_last_cell else "",
    ]
    return f"{span}: " + ", ".join(part for part in cells if part)
