"""View model of the map, its axes and tables."""

from __future__ import annotations

import functools
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.ecu_map.extend import TotalMap
from codegen.ecu_map.lookup import GRIP_LEAST, AxisConstants, Lookup
from codegen.ecu_map.storage import Axis, raw_of
from codegen.emit.laws import Law, law_of
from codegen.emit.text import Precision, c_type, shortest
from codegen.errors import MapError
from codegen.map_file.tables import ACCELERATION_STACK, FRICTION_STACK, PLAUSIBLE, Stack
from codegen.units import M_S, M_S2, NONE, RAD, RAD_S, Unit

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
class AxisView:
    """One axis; `argument` is the C argument that is looked up on it."""

    constants: AxisConstants
    name: str
    argument: str
    unit: Unit
    prefix: str

    @property
    def axis(self) -> Axis:
        """The axis."""
        return self.constants.axis

    @property
    def title(self) -> str:
        """Name in words."""
        return self.name.replace("_", " ").capitalize()

    @property
    def locate(self) -> str:
        """Name of the C function that searches it."""
        return f"locate_{self.name}"

    @property
    def breakpoints(self) -> str:
        """Name of the C array of its breakpoints."""
        return f"{self.prefix}_map_{self.name}_breakpoints"

    @property
    def points(self) -> str:
        """Name of the C constant of their number."""
        return f"{self.prefix}_MAP_{self.name}_POINTS".upper()

    @property
    def size(self) -> int:
        """Number of breakpoints."""
        return self.axis.size

    @property
    def values(self) -> npt.NDArray[Any]:
        """Breakpoints as the C stores them."""
        return self.constants.table

    @property
    def text(self) -> str:
        """Number and range of the breakpoints, in words."""
        return _describe(self.axis, self.unit)

    @property
    def kind_text(self) -> str:
        """Kind of its spacing, in words."""
        return _kind_of(self.axis)

    @property
    def top_text(self) -> str:
        """Last breakpoint, in both units."""
        return _with_unit(float(self.axis.breakpoints[-1]), self.unit)

    @property
    def total_text(self) -> str:
        """Treatment of arguments below the axis, in words."""
        return "Not negative; NaN counts as zero" if self._is_magnitude else "NaN and what is below zero count as zero"

    @property
    def start_text(self) -> str:
        """Arguments that the search leaves at the start, in words."""
        return "NaN" if self._is_magnitude and not self.axis.has_first_cell else "zero, below it, or NaN"

    @property
    def _is_magnitude(self) -> bool:
        return self.argument == MAGNITUDE

    @property
    def core_cells(self) -> int:
        """Cells of equal width."""
        return self.axis.core_end - self.axis.core_start

    @property
    def counts_first(self) -> bool:
        """Whether the search counts the steps before it compares."""
        return self.axis.even and not self.axis.has_last_cell

    @property
    def search_start(self) -> int:
        """First stride of the search on an uneven axis."""
        return self.axis.search_steps[0] if self.axis.search_steps else 0

    def steps(self, count: str) -> str:
        """Return the C expression of the steps from the start of the core, whose number of cells has the literal `count`."""
        first, last = f"breakpoints[{self.axis.core_start}]", f"breakpoints[{self.axis.core_end}]"
        if self.axis.core_start:
            return f"(({self.argument} - {first}) / ({last} - {first})) * {count}"
        return f"({self.argument} / {last}) * {count}"

    @property
    def last_share(self) -> str:
        """C expression of the position in the last cell."""
        last = f"breakpoints[{self.axis.core_end}]"
        return f"({self.argument} - {last}) / (breakpoints[{self.size - 1}] - {last})"

    def cells(self, count: str, zero: str) -> tuple[tuple[str, str], ...]:
        """Return the cells of an even axis, in the order that finds the core with the fewest comparisons.

        Each is its kind, "core", "first", "last" or "beyond", and the condition for an argument to lie in it, given that no
        earlier one held. All conditions are false for NaN.
        """
        # The steps may round up to one cell too many. Where the table ends with the core, that cell does not exist, so the
        # condition is on the steps instead of the argument.
        axis = self.axis
        counted, end = (self.argument, f"breakpoints[{axis.core_end}]") if axis.has_last_cell else ("steps", count)
        beyond = ("last" if axis.has_last_cell else "beyond", f"{counted} >= {end}")
        if self._is_magnitude and not axis.has_first_cell:
            return ("core", f"{counted} < {end}"), beyond
        core = ("core", f"{self.argument} >= {f'breakpoints[{axis.core_start}]' if axis.has_first_cell else zero}")
        return beyond, core, *((("first", f"{self.argument} > {zero}"),) if axis.has_first_cell else ())


@dataclass(frozen=True)
class StackView:
    """Axis of a stack: its quantity, and the values of the layers, rising."""

    quantity: Stack
    numbers: tuple[float, ...]
    prefix: str

    grip_least = GRIP_LEAST

    @property
    def values(self) -> str:
        """C expression of the values."""
        return f"{self.prefix}_constants.{self.quantity.key}s"

    @property
    def points(self) -> str:
        """Name of the C constant of their number."""
        return f"{self.prefix}_MAP_{self.quantity.key}_POINTS".upper()

    @property
    def text(self) -> str:
        """The values with their unit."""
        return f"{', '.join(f'{value:g}' for value in self.numbers)} {self.quantity.unit}".rstrip()

    @property
    def strongest(self) -> float:
        """Strongest braking of a stack over acceleration, which counts while the acceleration is unknown."""
        return min(self.numbers)


@dataclass(frozen=True)
class TableView:
    """A table with the C function that looks it up.

    Attributes:
        quantity: its quantity; part of the names in C.
        numbers: as the C stores them, (layers, speeds, front angles).
        scale: value of a raw number 1; None for real numbers.
        speed, front_angle: axes of its rows and columns.
    """

    quantity: str
    function: str
    unit: Unit
    numbers: npt.NDArray[Any]
    scale: float | None
    speed: AxisView
    front_angle: AxisView
    prefix: str

    @property
    def title(self) -> str:
        """Quantity in words."""
        return self.quantity.replace("_", " ")

    @property
    def name(self) -> str:
        """Name of the C array."""
        return f"{self.prefix}_map_{self.quantity}_table"

    @property
    def kind(self) -> str:
        """Kind of the C type of a number."""
        return "real" if self.scale is None else "int16_t"

    @property
    def scale_name(self) -> str:
        """C expression of the scale; "" for real numbers."""
        return "" if self.scale is None else f"{self.prefix}_constants.{self.quantity}_scale"

    @property
    def scale_argument(self) -> str:
        """The scale as an argument before others."""
        return f"{self.scale_name}, " if self.scale_name else ""

    @property
    def are_between(self) -> str:
        """C function that checks its range."""
        return "are_between" if self.scale is None else "are_values_between"

    @property
    def crc_of(self) -> str:
        """C function that continues a checksum with it."""
        return "crc_of" if self.scale is None else "crc_of_raw"

    @property
    def low(self) -> float:
        """Smallest value that calibration may set."""
        return TABLE_RANGES[self.quantity][0]

    @property
    def high(self) -> float:
        """Largest value that calibration may set."""
        return TABLE_RANGES[self.quantity][1]


@dataclass(frozen=True)
class MapView:
    """A total map with its lookup, and the tables that the configured law looks up.

    Raises:
        MapError: breakpoints are equal in the target's precision.
    """

    total: TotalMap
    lookup: Lookup
    config: Config
    precision: Precision
    prefix: str

    axis_tops = (SPEED_TOP, FRONT_ANGLE_TOP)
    evenness = EVENNESS

    def __post_init__(self) -> None:
        for key, constants in (("vx", self.lookup.speed_axis), ("delta_f", self.lookup.front_axis)):
            _check_apart(key, constants)

    @functools.cached_property
    def law(self) -> Law:
        """The control law."""
        return law_of(self.config)

    @property
    def speed(self) -> AxisView:
        """Axis of the speeds, the rows."""
        return AxisView(self.lookup.speed_axis, "speed", "speed", M_S, self.prefix)

    @property
    def front_angle(self) -> AxisView:
        """Axis of the front angles, the columns."""
        return AxisView(self.lookup.front_axis, "front_angle", MAGNITUDE, RAD, self.prefix)

    @functools.cached_property
    def tables(self) -> tuple[TableView, ...]:
        """The tables on these axes."""
        total, lookup = self.total, self.lookup
        quantities = [("yaw_rate", "uncapped_yaw_rate", RAD_S), ("rear_angle", "rear_angle_of_table", RAD)]
        found = []
        for index, (quantity, function, unit) in enumerate(quantities[: 1 + self.with_rear_angle]):
            scale, numbers = None, (lookup.tables, lookup.rear_tables)[index]
            if total.scales is not None:
                scale = getattr(total.scales, quantity)
                numbers = np.stack([raw_of(getattr(layer, quantity), scale) for layer in total.stack])
            found.append(
                TableView(quantity, function, unit, numbers, self._stored(scale), self.speed, self.front_angle, self.prefix)
            )
        return tuple(found)

    def _stored(self, scale: float | None) -> float | None:
        return None if scale is None else shortest(scale, self.precision)

    @functools.cached_property
    def grip(self) -> TableView | None:
        """The table of the share of the cap that grip allows, on axes of its own; None if there is none.

        Its numbers are constants, not calibration.
        """
        total, lookup = self.total, self.lookup
        if total.grip is None or lookup.grip is None:
            return None
        scale, numbers = total.grip.scale, lookup.grip.shares
        if scale is not None:
            numbers = np.stack([raw_of(layer.grip.share, scale) for layer in total.stack if layer.grip is not None])
        speed = AxisView(lookup.grip.speed_axis, "grip_speed", "speed", M_S, self.prefix)
        front_angle = AxisView(lookup.grip.front_axis, "grip_front_angle", MAGNITUDE, RAD, self.prefix)
        name = "grip_share"
        return TableView(name, name, NONE, numbers, self._stored(scale), speed, front_angle, self.prefix)

    @property
    def stack(self) -> StackView | None:
        """Axis of the stack; None for a single map."""
        return StackView(self.total.quantity, self.layer_values, self.prefix) if self.total.quantity else None

    @property
    def stacked(self) -> bool:
        """Whether there is a table for each layer of a stack."""
        return self.total.quantity is not None

    @property
    def layer_values(self) -> tuple[float, ...]:
        """Friction or acceleration of each layer."""
        moving = self.total.quantity is ACCELERATION_STACK
        return tuple(layer.acceleration if moving else layer.friction for layer in self.total.stack)

    def layer_texts(self, of: str = "") -> tuple[str, ...]:
        """Return the quantity and value of each layer, in words."""
        return tuple((self.total.quantity or FRICTION_STACK).text(value, of) for value in self.layer_values)

    @property
    def layer_names(self) -> tuple[str, ...]:
        """Name of each layer."""
        key = (self.total.quantity or FRICTION_STACK).key
        return tuple(f"{key}_{value:g}".replace("-", "minus_") for value in self.layer_values)

    @property
    def indices(self) -> tuple[str, ...]:
        """C subscripts of the layers; "" if there is only one."""
        return tuple(f"[{layer}u]" for layer in range(len(self.layer_values))) if self.stacked else ("",)

    @property
    def layer_size(self) -> str:
        """C dimension of the layers; "" for a single map."""
        return f"[{self.stack.points}]" if self.stack else ""

    @property
    def with_rear_angle(self) -> bool:
        """Whether the law looks up rear angles."""
        return self.law.uses_rear_angle

    @property
    def is_raw(self) -> bool:
        """Whether the tables have raw numbers."""
        return self.total.scales is not None

    @property
    def moving(self) -> bool:
        """Whether the layers are longitudinal accelerations."""
        return self.lookup.is_moving

    @property
    def takes_acceleration(self) -> bool:
        """Whether the build has the signal of the longitudinal acceleration."""
        return ACCELERATION_STACK.key in self.config.can.vehicle_conditions.signals()

    @property
    def with_axle_shares(self) -> bool:
        """Whether the lookup returns the grip of each axle."""
        return self.moving and self.law.uses_reference_model

    @property
    def more_parameter(self) -> str:
        """Parameter of a C function after the friction."""
        return f", {c_type(self.precision)} {ACCELERATION_STACK.key}" if self.takes_acceleration else ""

    @property
    def more_argument(self) -> str:
        """Argument for it, where the lookup uses it."""
        return f", {ACCELERATION_STACK.key}" if self.moving else ""

    @property
    def more_of_sample(self) -> str:
        """Argument for it from a sample."""
        return f", sample->{ACCELERATION_STACK.key}" if self.takes_acceleration else ""

    @property
    def rear_angle_max_text(self) -> str:
        """Largest rear angle of the optimisation, in both units."""
        return _with_unit(self.total.steering.rear_angle_max, RAD)

    @property
    def cap_text(self) -> str:
        """Largest lateral acceleration, in words."""
        return f"{self.total.lateral_acceleration_cap:.4g} {M_S2}"

    @property
    def bits(self) -> int:
        """Bits of a real number."""
        return self.lookup.table.dtype.itemsize * 8

    @property
    def bits_type(self) -> str:
        """C type of its bits."""
        return f"uint{self.bits}_t"

    @property
    def magnitude_bits(self) -> str:
        """Its bits without the sign."""
        return magnitude_bits(self.bits)

    @functools.cached_property
    def _numbers(self) -> list[npt.NDArray[Any]]:
        """Numbers of the checksum, in its order."""
        real, lookup = self.lookup.real, self.lookup
        found = [each.numbers for each in self.tables]
        found += [np.array([each.scale], dtype=real) for each in self.tables if each.scale is not None]
        found += [lookup.values] if lookup.values.size > 1 else []
        found += [lookup.speed_axis.table, lookup.front_axis.table]
        if self.grip:
            scale = self.grip.scale
            found += [self.grip.numbers, *([] if scale is None else [np.array([scale], dtype=real)])]
            found += [self.grip.speed.values, self.grip.front_angle.values]
        return found

    @functools.cached_property
    def checksum(self) -> int:
        """CRC-32 of the map."""
        return zlib.crc32(b"".join(part.astype(part.dtype.newbyteorder("<")).tobytes() for part in self._numbers))

    @property
    def flash_bytes(self) -> int:
        """Bytes of its numbers."""
        return sum(part.nbytes for part in self._numbers)


def magnitude_bits(bits: int) -> str:
    """Return all bits of a number of that many bits except its sign, as a C literal."""
    return "0x7FFFFFFFu" if bits == 32 else "0x7FFFFFFFFFFFFFFFu"


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
