"""View model of the map: everything that its templates print, as text."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.lookup import GRIP_LEAST, AxisConstants, Lookup
from codegen.ecu_map.storage import Axis, raw_of
from codegen.emit.laws import law_of
from codegen.emit.text import Precision, c_type, lines_of, literal, shortest
from codegen.errors import MapError
from codegen.map_file.tables import ACCELERATION, FRICTION, PLAUSIBLE, Stack
from codegen.units import KM_H, M_S, NONE, RAD, RAD_S, Unit

MAGNITUDE = "front_angle_magnitude"
"""Name of the C argument that is never negative."""

TABLE_RANGES = {quantity: PLAUSIBLE[key][:2] for quantity, key in (("yaw_rate", "yaw_rate"), ("rear_angle", "delta_r"))}
SPEED_TOP, FRONT_ANGLE_TOP = PLAUSIBLE["vx"].high, PLAUSIBLE["delta_f"].high
"""Calibration limits of tables (rad/s, rad) and axes (m/s, rad)."""

EVENNESS = 0.01
"""Largest deviation of a breakpoint of an even core from its even position, as a fraction of the step. The lookup assumes the
even position. The resulting error is far below the interpolation error of the map. A calibration that moves a breakpoint on
purpose moves it further."""


@dataclass(frozen=True)
class CellsView:
    """Cells of one kind on an even axis, and the condition for a value to lie in them, given that no earlier one held."""

    kind: Literal["core", "first", "last", "beyond"]
    condition: str


@dataclass(frozen=True)
class AxisView:
    """One axis. Fields that do not apply to its kind are empty."""

    name: str
    title: str
    argument: str
    unit: Unit
    locate: str
    size: int
    text: str
    kind_text: str
    top_text: str
    even: bool
    has_first_cell: bool
    last_cell: int
    cells: tuple[CellsView, ...]
    total_text: str
    start_text: str
    counts_first: bool
    steps: str
    first_share: str
    last_share: str
    search_start: int
    breakpoints: str
    points: str
    core_first: int
    core_cells: int
    lines: tuple[str, ...]


@dataclass(frozen=True)
class RowView:
    """The numbers of a table at one speed."""

    text: str
    lines: tuple[str, ...]


@dataclass(frozen=True)
class StackView:
    """Axis of a stack: `one` and `many` of its quantity, C expressions of its values and of their number, and the values.

    `strongest` is the strongest braking of a stack over acceleration, the value of one that is unknown.
    """

    one: str
    many: str
    values: str
    points: str
    text: str
    grip_least: str
    strongest: str


@dataclass(frozen=True)
class LayerView:
    """One layer of a stack, or the only table."""

    text: str
    rows: tuple[RowView, ...]


@dataclass(frozen=True)
class NumbersView:
    """The numbers of a table and the function that looks them up. For raw numbers `times` is a comment and `scale` the value of
    one step; both are empty for real numbers."""

    name: str
    function: str
    type: str
    unit: Unit
    times: str
    scale: float | None
    scale_name: str
    scale_argument: str
    layers: tuple[LayerView, ...]


@dataclass(frozen=True)
class TableView(NumbersView):
    """A table on the shared axes that may be calibrated. `indices` are the C subscripts of its layers ("" if there is only
    one). `are_between` and `crc_of` are the C functions for its numbers."""

    quantity: str
    are_between: str
    crc_of: str
    low: float
    high: float
    indices: tuple[str, ...]

    @property
    def title(self) -> str:
        """What it has, in words."""
        return self.quantity.replace("_", " ")


@dataclass(frozen=True)
class GripView:
    """Table of the share of the cap that grip allows, on axes of its own. Its numbers are constants, not calibration."""

    speed: AxisView
    front_angle: AxisView
    share: NumbersView
    size: str


@dataclass(frozen=True)
class MapView:
    """The tables with their axes and caps."""

    axis_tops = (SPEED_TOP, FRONT_ANGLE_TOP)

    speed: AxisView
    front_angle: AxisView
    evenness: str
    tables: tuple[TableView, ...]
    table_size: str
    with_rear_angle: bool
    is_raw: bool
    stack: StackView | None
    moving: bool
    takes_acceleration: bool
    with_axle_shares: bool
    more_parameter: str
    more_argument: str
    more_of_sample: str
    layer_names: tuple[str, ...]
    layer_texts: tuple[str, ...]
    layer_count: int
    grip: GripView | None
    rear_angle_max_text: str
    cap_text: str
    friction_text: str
    checksum: str
    checksum_value: int
    checksum_steps: int
    bits: int
    bits_type: str
    magnitude_bits: str
    flash_bytes: int

    @property
    def stacked(self) -> bool:
        """Whether there is a table for each layer of a stack."""
        return self.stack is not None


@dataclass(frozen=True)
class _Options:
    precision: Precision
    prefix: str


def map_view(total: TotalMap, lookup: Lookup, config: Config, precision: Precision, prefix: str) -> MapView:
    """Return the view of a total map and its lookup, with the tables that the configured law looks up.

    Raises:
        MapError: breakpoints are equal in the target's precision.
        ValueError: a number has no literal (a valid map excludes this).
    """
    options = _Options(precision, prefix)
    for key, constants in (("vx", lookup.speed_axis), ("delta_f", lookup.front_axis)):
        _check_apart(key, constants)
    law, moving = law_of(config), lookup.is_moving
    with_rear_angle = law.uses_rear_angle
    takes_acceleration = ACCELERATION.key in config.can.vehicle_conditions.signals()
    quantity, values = total.quantity or FRICTION, _values(total)
    tables = tuple(_tables(total, lookup, options, with_rear_angle))
    numbers = [*_calibration(total, lookup, with_rear_angle), *_grip_numbers(total, lookup)]
    bits = lookup.table.dtype.itemsize * 8
    checksum = zlib.crc32(b"".join(part.astype(part.dtype.newbyteorder("<")).tobytes() for part in numbers))
    size = sum(part.nbytes for part in numbers)
    grip = _grip_view(total, lookup, options)
    names = (f"{prefix}_map_speed_breakpoints", f"{prefix}_map_front_angle_breakpoints")
    speed = _axis_view(lookup.speed_axis, "speed", "speed", M_S, names[0], options)
    front_angle = _axis_view(lookup.front_axis, "front_angle", MAGNITUDE, RAD, names[1], options)
    return MapView(
        speed=speed,
        front_angle=front_angle,
        evenness=literal(EVENNESS, precision),
        tables=tables,
        table_size=_size(total, speed.points, front_angle.points, prefix),
        with_rear_angle=with_rear_angle,
        is_raw=total.scales is not None,
        stack=_stack_view(total.quantity, values, options) if total.quantity else None,
        moving=moving,
        with_axle_shares=moving and law.uses_reference_model,
        takes_acceleration=takes_acceleration,
        more_parameter=f", {c_type(precision)} {ACCELERATION.key}" if takes_acceleration else "",
        more_argument=f", {ACCELERATION.key}" if moving else "",
        more_of_sample=f", sample->{ACCELERATION.key}" if takes_acceleration else "",
        layer_names=tuple(f"{quantity.key}_{value:g}".replace("-", "minus_") for value in values),
        layer_texts=tuple(quantity.text(value, " of") for value in values),
        layer_count=len(values),
        grip=grip,
        rear_angle_max_text=_with_unit(total.steering.rear_angle_max, RAD),
        cap_text=f"{total.lateral_acceleration_cap:.4g} m/s^2",
        friction_text=f"{total.friction:g}",
        checksum=f"0x{checksum:08X}u",
        checksum_value=checksum,
        checksum_steps=2 * size,
        bits=bits,
        bits_type=f"uint{bits}_t",
        magnitude_bits=magnitude_bits(bits),
        flash_bytes=size,
    )


def magnitude_bits(bits: int) -> str:
    """Return all bits of a number of that many bits except its sign, as a C literal."""
    return "0x7FFFFFFFu" if bits == 32 else "0x7FFFFFFFFFFFFFFFu"


def _size(total: TotalMap, speeds: int | str, front_angles: int | str, prefix: str) -> str:
    """Return the size of a table in C; a stack has one more dimension."""
    layers = f"[{_points(total.quantity, prefix)}]" if total.quantity else ""
    return f"{layers}[{speeds}][{front_angles}]"


def _points(quantity: Stack, prefix: str) -> str:
    return f"{prefix}_MAP_{quantity.key}_POINTS".upper()


def _values(total: TotalMap) -> list[float]:
    """Return the friction or acceleration of each layer."""
    moving = total.quantity is ACCELERATION
    return [layer.acceleration if moving else layer.friction for layer in total.stack]


def _stack_view(quantity: Stack, values: Sequence[float], options: _Options) -> StackView:
    name = f"{options.prefix}_constants.{quantity.key}s"
    text = ", ".join(f"{value:g}" for value in values)
    return StackView(
        one=quantity.one,
        many=quantity.many,
        values=name,
        points=_points(quantity, options.prefix),
        text=f"{text}{' ' if quantity.unit else ''}{quantity.unit}",
        grip_least=literal(GRIP_LEAST, options.precision),
        strongest=literal(min(values), options.precision),
    )


def _grip_view(total: TotalMap, lookup: Lookup, options: _Options) -> GripView | None:
    if total.grip is None or lookup.grip is None:
        return None
    speed, front_angle, scale = lookup.grip.speed_axis, lookup.grip.front_axis, total.grip.scale
    prefix = f"{options.prefix}_map_grip"
    return GripView(
        speed=_axis_view(speed, "grip_speed", "speed", M_S, f"{prefix}_speed_breakpoints", options),
        front_angle=_axis_view(front_angle, "grip_front_angle", MAGNITUDE, RAD, f"{prefix}_front_angle_breakpoints", options),
        share=NumbersView(
            name=f"{prefix}_share_table",
            function="grip_share",
            layers=_layers(total, total.grip.speed, _grip_numbers(total, lookup)[0], options.precision),
            **_storage("grip_share", NONE, scale, options),
        ),
        size=_size(total, speed.axis.size, front_angle.axis.size, options.prefix),
    )


def _grip_numbers(total: TotalMap, lookup: Lookup) -> list[npt.NDArray[Any]]:
    """Return the grip table as the C stores it: shares (k, a, b), scale of raw shares, both axes. Empty if there is none."""
    if total.grip is None or lookup.grip is None:
        return []
    scale, axes = total.grip.scale, (lookup.grip.speed_axis.table, lookup.grip.front_axis.table)
    if scale is None:
        return [lookup.grip.shares, *axes]
    shares = np.stack([raw_of(layer.grip.share, scale) for layer in total.stack if layer.grip is not None])
    return [shares, np.array([scale], dtype=lookup.real), *axes]


def _tables(total: TotalMap, lookup: Lookup, options: _Options, with_rear_angle: bool) -> Iterator[TableView]:
    functions = [("yaw_rate", "uncapped_yaw_rate", RAD_S), ("rear_angle", "rear_angle_of_table", RAD)]
    stored = _stored(total, lookup, with_rear_angle)
    for (quantity, function, unit), (numbers, scale) in zip(functions, stored, strict=False):
        low, high = TABLE_RANGES[quantity]
        yield TableView(
            quantity=quantity,
            name=f"{options.prefix}_map_{quantity}_table",
            function=function,
            are_between="are_between" if scale is None else "are_values_between",
            crc_of="crc_of" if scale is None else "crc_of_raw",
            low=low,
            high=high,
            layers=_layers(total, total.speed, numbers, options.precision),
            indices=_indices(len(numbers), bool(total.layers)),
            **_storage(quantity, unit, scale, options),
        )


def _storage(quantity: str, unit: Unit, scale: float | None, options: _Options) -> dict[str, Any]:
    """Return the fields of a view that describe how the C stores a table's numbers."""
    factor = "" if scale is None else literal(scale, options.precision)
    name = f"{options.prefix}_constants.{quantity}_scale"
    return {
        "type": "int16_t" if factor else c_type(options.precision),
        "unit": unit,
        "times": f" = {factor} * raw" if factor else "",
        "scale": None if scale is None else shortest(scale, options.precision),
        "scale_name": name if factor else "",
        "scale_argument": f"{name}, " if factor else "",
    }


def _stored(total: TotalMap, lookup: Lookup, with_rear_angle: bool) -> list[tuple[npt.NDArray[Any], float | None]]:
    """Return the tables (k, n, m) as the C stores them, each with its scale; None for real numbers."""
    count, scales = 1 + with_rear_angle, total.scales
    if scales is None:
        return [(table, None) for table in (lookup.tables, lookup.rear_tables)[:count]]
    named = (("yaw_rate", scales.yaw_rate), ("rear_angle", scales.rear_angle))[:count]
    return [(np.stack([raw_of(getattr(layer, name), scale) for layer in total.stack]), scale) for name, scale in named]


def _calibration(total: TotalMap, lookup: Lookup, with_rear_angle: bool) -> list[npt.NDArray[Any]]:
    """Return the numbers of the checksum in its order, without the grip table, which comes last."""
    values = [lookup.values] if lookup.values.size > 1 else []
    stored = _stored(total, lookup, with_rear_angle)
    scales = [np.array([scale], dtype=lookup.real) for _, scale in stored if scale is not None]
    return [*(table for table, _ in stored), *scales, *values, lookup.speed_axis.table, lookup.front_axis.table]


def _layers(
    total: TotalMap, speeds: npt.NDArray[np.float64], tables: npt.NDArray[Any], precision: Precision
) -> tuple[LayerView, ...]:
    return tuple(
        LayerView(
            text=(total.quantity or FRICTION).text(value),
            rows=tuple(
                RowView(f"{speed / KM_H:.4g} km/h", lines_of([_number(value, precision) for value in row]))
                for speed, row in zip(speeds, table, strict=True)
            ),
        )
        for value, table in zip(_values(total), tables, strict=True)
    )


def _number(value: Any, precision: Precision) -> str:
    return str(int(value)) if isinstance(value, np.integer) else literal(value, precision)


def _indices(layers: int, stacked: bool) -> tuple[str, ...]:
    return tuple(f"[{layer}u]" for layer in range(layers)) if stacked else ("",)


def _check_apart(key: str, constants: AxisConstants) -> None:
    """Reject breakpoints that are equal in the target's precision, or too close to divide by their difference."""
    with np.errstate(divide="ignore", over="ignore"):
        reciprocal = 1.0 / np.diff(constants.table)
    for index in np.flatnonzero(~(np.isfinite(reciprocal) & (reciprocal > 0.0)))[:1]:
        values = constants.axis.breakpoints[index : index + 2]
        raise MapError(
            f"the breakpoints {values[0]:.9g} and {values[1]:.9g} are equal in this precision",
            where=key,
            remedy="remove one of them, or build with `precision='double'`",
        )
    if constants.unevenness > 0.5 * EVENNESS:
        raise MapError(
            "steps too small for this precision: rounding makes them uneven",
            where=key,
            remedy="remove every second breakpoint, or build with `precision='double'`",
        )


def _axis_view(constants: AxisConstants, name: str, argument: str, unit: Unit, breakpoints: str, options: _Options) -> AxisView:
    axis: Axis = constants.axis
    first, last = f"breakpoints[{axis.core_start}]", f"breakpoints[{axis.core_end}]"
    count = literal(float(axis.core_end - axis.core_start), options.precision)
    return AxisView(
        name=name,
        title=name.replace("_", " ").capitalize(),
        argument=argument,
        unit=unit,
        locate=f"locate_{name}",
        size=axis.size,
        text=_describe(axis, unit),
        kind_text=_kind_of(axis),
        top_text=_with_unit(float(axis.breakpoints[-1]), unit),
        even=axis.even,
        has_first_cell=axis.has_first_cell,
        last_cell=axis.size - 2,
        cells=_cells(axis, argument, count, literal(0.0, options.precision)) if axis.even else (),
        total_text="Not negative; NaN counts as zero" if argument == MAGNITUDE else "NaN and what is below zero count as zero",
        start_text="NaN" if argument == MAGNITUDE and not axis.has_first_cell else "zero, below it, or NaN",
        counts_first=axis.even and not axis.has_last_cell,
        steps=(
            f"(({argument} - {first}) / ({last} - {first})) * {count}"
            if axis.core_start
            else f"({argument} / {last}) * {count}"
        ),
        first_share=f"{argument} / breakpoints[1]",
        last_share=f"({argument} - {last}) / (breakpoints[{axis.size - 1}] - {last})",
        search_start=axis.search_steps[0] if axis.search_steps else 0,
        breakpoints=breakpoints,
        points=f"{options.prefix.upper()}_MAP_{name.upper()}_POINTS",
        core_first=axis.core_start,
        core_cells=axis.core_end - axis.core_start,
        lines=lines_of([literal(value, options.precision) for value in np.asarray(constants.table)]),
    )


def _cells(axis: Axis, argument: str, count: str, zero: str) -> tuple[CellsView, ...]:
    """Return the cells in the order that finds the core with the fewest comparisons. All conditions are false for NaN."""
    # The steps may round up to one cell too many. Where the table ends with the core, that cell does not exist, so the
    # condition is on the steps instead of the argument.
    counted, end = (argument, f"breakpoints[{axis.core_end}]") if axis.has_last_cell else ("steps", count)
    beyond = CellsView("last" if axis.has_last_cell else "beyond", f"{counted} >= {end}")
    if argument == MAGNITUDE and not axis.has_first_cell:
        return CellsView("core", f"{counted} < {end}"), beyond
    core = CellsView("core", f"{argument} >= {f'breakpoints[{axis.core_start}]' if axis.has_first_cell else zero}")
    first = (CellsView("first", f"{argument} > {zero}"),) if axis.has_first_cell else ()
    return beyond, core, *first


def _with_unit(value: float, unit: Unit) -> str:
    return f"{value:.4g} {unit} ({unit.as_shown(value)})"


def _kind_of(axis: Axis) -> str:
    if not axis.even:
        return "uneven, searched"
    wider = [text for holds, text in ((axis.has_first_cell, "first"), (axis.has_last_cell, "last")) if holds]
    return "even" + (f" but for the {' and the '.join(wider)} cell" if wider else "")


def _describe(axis: Axis, unit: Unit) -> str:
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
