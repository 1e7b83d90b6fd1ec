"""The arrays under the keys of the `.npz` file, checked one by one; messages name key and index.

The tables of the map are (n, m), those of its stack over friction or longitudinal acceleration (k, n, m): the same checks, with
one index more.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from codegen.arrays import AnyArray, BoolArray, FloatArray
from codegen.errors import MapError
from codegen.map_file.bounds import Binding

BindingArray = npt.NDArray[np.unsignedinteger[Any]]

LATERAL_ACCELERATION_MAX_G = 5.0  # far above any tyre: degrees taken for radians ask for more

REQUIRED = ("vx", "delta_f", "yaw_rate")
TABLE_UNITS = {
    "vx": "m/s",
    "delta_f": "rad",
    "yaw_rate": "rad/s",
    "beta": "rad",
    "delta_r": "rad",
    "feasible": "1",
    "active": "1",
}
TABLES = ("yaw_rate", "beta", "delta_r", "feasible", "active")
OPTIONAL_TABLES = ("beta", "delta_r", "active")
"""Tables without a default. Each is present in both the map and its stack, or in neither."""


class Stack(NamedTuple):
    """Quantity of a stack: the key of its values (k,), the least step between them, its words for messages, and its unit."""

    key: str
    step: float
    one: str
    many: str
    unit: str = ""

    @property
    def prefix(self) -> str:
        """Prefix of the keys of its tables."""
        return f"{self.key}_"

    @property
    def title(self) -> str:
        """Name in words."""
        return self.key.replace("_", " ")

    def text(self, value: float, of: str = "") -> str:
        """Return a value with its name and unit."""
        return f"{self.title}{of} {value:g}{' ' if self.unit else ''}{self.unit}"


FRICTION_STACK = Stack("friction", 0.01, "friction", "frictions")
"""Step: the resolution of an estimate, and large enough to interpolate in single precision."""
ACCELERATION_STACK = Stack("longitudinal_acceleration", 0.5, "acceleration", "accelerations", "m/s^2")
"""m/s^2; negative while the car brakes. Step: the grip of the preset's car changes by 1.5 %."""
STACKS = (FRICTION_STACK, ACCELERATION_STACK)
KEYS = (*TABLE_UNITS, *(key for stack in STACKS for key in (stack.key, *(stack.prefix + table for table in TABLES))), "meta")
KINDS = {"b": "boolean", "c": "complex", "U": "text", "S": "text", "V": "record", "M": "date", "m": "duration", "O": "object"}

MAX_LAYERS = 32
"""Limit on the layers of a file, far above what fits into an ECU."""
STEP_SLACK = 1e-9
"""Rounding of decimal values: 0.29 - 0.28 is a little less than 0.01."""


ALL_BINDING = sum(Binding)
BINDING_TYPE: Any = np.min_scalar_type(ALL_BINDING)


class _Plausible(NamedTuple):
    low: float
    high: float
    unit: str
    if_low: str
    if_high: str


_IN_DEGREES = "if it is in degrees, multiply by pi/180"
_IN_G = "no car with tyres alone brakes or accelerates so much"
_PEAK_FRICTION = "give the peak friction of the road, such as 0.3"
PLAUSIBLE = {
    "vx": _Plausible(0.0, 150.0, "m/s", "leave reverse out: the map is for forward speeds", "if it is in km/h, divide by 3.6"),
    "delta_f": _Plausible(0.0, 1.2, "rad", "leave right turns out: the map is symmetric", _IN_DEGREES),
    "yaw_rate": _Plausible(
        0.0, 10.0, "rad/s", "turn the sign: both are positive to the left", "if it is in deg/s, multiply by pi/180"
    ),
    "beta": _Plausible(-0.5, 0.5, "rad", _IN_DEGREES, _IN_DEGREES),
    "delta_r": _Plausible(-0.5, 0.5, "rad", _IN_DEGREES, _IN_DEGREES),
    "friction": _Plausible(0.05, 1.5, "", _PEAK_FRICTION, _PEAK_FRICTION),
    "longitudinal_acceleration": _Plausible(-15.0, 15.0, "m/s^2", _IN_G, _IN_G),
}
"""Plausible range of each quantity (SI), and the likely mistakes below and above it."""


@dataclass(frozen=True, eq=False)
class Tables:
    """The tables of a map, (n, m), or of a stack, (k, n, m); SI units, NaN where infeasible and only there; read-only."""

    yaw_rate: FloatArray
    feasible: BoolArray
    sideslip: FloatArray | None
    rear_angle: FloatArray | None
    active: BindingArray | None

    def layer(self, index: int) -> Tables:
        """The (n, m) tables of one layer of a stack."""
        own: dict[str, Any] = {name: None if table is None else table[index] for name, table in vars(self).items()}
        return Tables(**own)


def check_keys(keys: Iterable[str], where: object) -> None:
    """Reject a set of keys that lacks a required one, holds an incomplete stack, or has one that is no key of a map.

    A table of another tool may have keys of its own (see `unknown_keys`), unless it is one letter away from a known one: a
    flipped bit in a name would turn a solved map into a table without its configuration.

    Raises:
        MapError: with the key.
    """
    present = list(keys)
    _check_unknown_keys(present, where)
    for key in REQUIRED:
        if key not in present:
            raise MapError(
                "this key is missing",
                where=f"{where}: {key}",
                remedy=f"add it, in {TABLE_UNITS[key]}; the file holds {', '.join(present) or 'nothing'}",
            )
    for stack in STACKS:
        _check_stack_keys(present, stack, where)
    if all(stack.key in present for stack in STACKS):
        remedy = f"leave out the keys of one, such as {ACCELERATION_STACK.key}"
        raise MapError("a map has one stack at most", where=f"{where}: {ACCELERATION_STACK.key}", remedy=remedy)


def unknown_keys(keys: Iterable[str]) -> tuple[str, ...]:
    """Return the keys that are no keys of a map."""
    return tuple(key for key in keys if key not in KEYS)


def _check_unknown_keys(present: list[str], where: object) -> None:
    for key in unknown_keys(present):
        meant = next((known for known in KEYS if _one_letter_apart(key, known) or _one_letter_apart(key, f"{known}.npy")), None)
        if meant is not None or "meta" in present:
            remedy = "leave it out, or use the version that wrote it" if meant is None else f"did you mean {meant!r}?"
            raise MapError("not a key of a map", where=f"{where}: {key}", remedy=remedy)


def _one_letter_apart(word: str, known: str) -> bool:
    """Return whether replacing, adding or removing one letter turns a word into another one."""
    if len(word) == len(known):
        return sum(one != other for one, other in zip(word, known, strict=True)) == 1
    short, long = sorted((word, known), key=len)
    return len(long) == len(short) + 1 and any(long[:place] + long[place + 1 :] == short for place in range(len(long)))


def _check_stack_keys(present: list[str], stack: Stack, where: object) -> None:
    stacked = [key for key in KEYS if key.startswith(stack.prefix) and key in present]
    if stack.key not in present:
        if stacked:
            remedy = f"add it, the {stack.one} of each layer of {stacked[0]}, or leave out {', '.join(stacked)}"
            raise MapError("this key is missing", where=f"{where}: {stack.key}", remedy=remedy)
        return
    for key in ("yaw_rate", *OPTIONAL_TABLES):
        of_stack = stack.prefix + key
        if key in present and of_stack not in present:
            remedy = f"add it, {key} for each {stack.one}, or leave out {stack.key}" + (
                f" and {', '.join(stacked)}" if stacked else ""
            )
            raise MapError("this key is missing", where=f"{where}: {of_stack}", remedy=remedy)
        if of_stack in present and key not in present:
            remedy = f"add {key}, or leave out {of_stack}"
            raise MapError(f"the stack has it, but the map has no {key}", where=f"{where}: {of_stack}", remedy=remedy)


def read_axis(arrays: Mapping[str, AnyArray], key: str, where: object) -> FloatArray:
    """The breakpoints `vx` or `delta_f`. Raises MapError."""
    values = _numbers(arrays, key, None, where)
    if values.size < 2:
        raise MapError(f"{values.size} points", where=f"{where}: {key}", remedy="give at least two")
    for index in np.argwhere(~np.isfinite(values))[:1]:
        raise MapError(f"{values[index[0]]} on an axis", where=_at(where, key, index), remedy="give a finite breakpoint")
    for index in np.argwhere(np.diff(values) <= 0.0)[:1] + 1:
        left, right = values[index[0] - 1], values[index[0]]
        raise MapError(
            f"{right:.9g} is not above the breakpoint before it ({left:.9g})",
            where=_at(where, key, index),
            remedy="sort the axis, with the rows or columns of the tables, and remove doubles",
        )
    _check_plausible(values, key, key, where)
    values.setflags(write=False)
    return values


def read_stack_values(arrays: Mapping[str, AnyArray], stack: Stack, where: object) -> FloatArray:
    """Return the values (k,) of a stack, rising by its step or more; (0,) without that stack. Raises MapError."""
    if stack.key not in arrays:
        return np.empty(0)
    values = _numbers(arrays, stack.key, None, where)
    if not 1 <= values.size <= MAX_LAYERS:
        remedy = f"give 1 to {MAX_LAYERS}, or leave out all keys of the stack"
        raise MapError(f"{values.size} {stack.many}", where=f"{where}: {stack.key}", remedy=remedy)
    for index in np.argwhere(~np.isfinite(values))[:1]:
        remedy = f"give a finite {stack.one}"
        raise MapError(f"{values[index[0]]} on an axis", where=_at(where, stack.key, index), remedy=remedy)
    _check_plausible(values, stack.key, stack.key, where)
    for index in np.argwhere(np.diff(values) < stack.step - STEP_SLACK)[:1] + 1:
        left, right = values[index[0] - 1], values[index[0]]
        raise MapError(
            f"{right:.9g} is not at least {stack.step:g} above the {stack.one} before it ({left:.9g})",
            where=_at(where, stack.key, index),
            remedy=f"sort the {stack.many}, with the layers of the tables, and remove doubles",
        )
    values.setflags(write=False)
    return values


def check_not_zero(acceleration: FloatArray, where: object) -> None:
    """Reject accelerations (k,) of a stack at that of the map itself, zero. Raises MapError."""
    for index in np.argwhere(np.abs(acceleration) < ACCELERATION_STACK.step - STEP_SLACK)[:1]:
        raise MapError(
            f"{acceleration[index[0]]:.9g} is not at least {ACCELERATION_STACK.step:g} from zero, for which the map itself is",
            where=_at(where, ACCELERATION_STACK.key, index),
            remedy="leave that layer out",
        )


def check_below_design(friction: FloatArray, design: float, where: object) -> None:
    """Reject frictions (k,) of a stack unless all are below the design friction. Raises MapError."""
    for index in np.argwhere(friction > design - FRICTION_STACK.step + STEP_SLACK)[:1]:
        raise MapError(
            f"{friction[index[0]]:.9g} is not at least {FRICTION_STACK.step:g} below the friction of the map itself "
            f"(road.friction = {design:.9g})",
            where=_at(where, "friction", index),
            remedy="leave that layer out: the stack is for lower frictions",
        )


def read_tables(arrays: Mapping[str, AnyArray], shape: tuple[int, ...], where: object, stack: Stack | None = None) -> Tables:
    """Return the tables of the map, `shape` (n, m), or those of a stack, `shape` (k, n, m).

    Raises:
        MapError: the first fault, with its key and index.
    """
    prefix = stack.prefix if stack is not None else ""
    feasible = _feasible(arrays, f"{prefix}feasible", shape, where, stack)
    cells = {
        key: _cells(arrays, prefix + key, key, feasible, where, stack)
        for key in TABLES
        if key in PLAUSIBLE and prefix + key in arrays
    }
    active = _active(arrays, f"{prefix}active", shape, where, stack)
    return Tables(cells["yaw_rate"], feasible, cells.get("beta"), cells.get("delta_r"), active)


def check_lateral_acceleration(
    speed: FloatArray, yaw_rate: FloatArray, gravity: float, where: object, stack: Stack | None = None
) -> None:
    """Reject yaw rates, (n, m) or (k, n, m), that no tyre allows at their speed. Raises MapError."""
    in_g = speed[:, np.newaxis] * yaw_rate / gravity
    # A map on the bound itself may lie above it by rounding.
    for index in np.argwhere(in_g > LATERAL_ACCELERATION_MAX_G * (1.0 + 1e-9))[:1]:
        cell, i = tuple(index), index[-2]
        raise MapError(
            f"{yaw_rate[cell]:.4g} rad/s at vx[{i}] = {speed[i]:.4g} m/s is {in_g[cell]:.3g} g of lateral acceleration, "
            f"above {LATERAL_ACCELERATION_MAX_G:g} g",
            where=_at(where, "yaw_rate" if stack is None else f"{stack.prefix}yaw_rate", index),
            remedy="check whether vx is in km/h or yaw_rate in deg/s",
        )


def kind_of(array: AnyArray) -> str | None:
    """Return the kind of an array without real numbers; None for other kinds."""
    return KINDS.get(array.dtype.kind)


def _at(where: object, key: str, index: Iterable[np.intp]) -> str:
    return f"{where}: {key}[{', '.join(str(i) for i in index)}]"


def _numbers(
    arrays: Mapping[str, AnyArray], key: str, shape: tuple[int, ...] | None, where: object, stack: Stack | None = None
) -> FloatArray:
    """Return a float64 copy of real numbers (any integer or floating type) of a shape (None: one axis of any length)."""
    array = np.asarray(arrays[key])
    place = f"{where}: {key}"
    if array.dtype.kind not in "iuf":
        kind = kind_of(array) or str(array.dtype)
        raise MapError(f"{kind} values, where real numbers are needed", where=place, remedy="save it as plain numbers")
    if shape is None and array.ndim != 1:
        raise MapError(f"shape {array.shape}, where one dimension is needed", where=place, remedy="save it with .ravel()")
    if shape is not None and array.shape != shape:
        axes, remedy = "vx by delta_f", "give a row for each vx and a column for each delta_f"
        if stack is not None:
            axes, remedy = f"{stack.key} by {axes}", f"for each {stack.one} {remedy}"
        remedy = "transpose it" if array.shape == shape[::-1] else remedy
        raise MapError(f"shape {array.shape}, where {shape} is needed ({axes})", where=place, remedy=remedy)
    with np.errstate(all="ignore"):  # an overflow is found as inf
        return np.array(array, dtype=np.float64, order="C")


def _check_plausible(values: FloatArray, key: str, quantity: str, where: object) -> None:
    limits = PLAUSIBLE[quantity]
    for index in np.argwhere((values < limits.low) | (values > limits.high))[:1]:
        value = values[tuple(index)]
        raise MapError(
            f"{value:.6g} is outside {limits.low:g} to {limits.high:g} {limits.unit}",
            where=_at(where, key, index),
            remedy=limits.if_low if value < limits.low else limits.if_high,
        )


def _feasible(
    arrays: Mapping[str, AnyArray], key: str, shape: tuple[int, ...], where: object, stack: Stack | None
) -> BoolArray:
    if key not in arrays:
        feasible = np.ones(shape, dtype=np.bool_)
    else:
        array = np.asarray(arrays[key])
        numbers = _numbers({key: array.view(np.uint8) if array.dtype == np.bool_ else array}, key, shape, where, stack)
        for index in np.argwhere((numbers != 0.0) & (numbers != 1.0))[:1]:
            raise MapError(
                f"{numbers[tuple(index)]:g} is neither true nor false",
                where=_at(where, key, index),
                remedy="give booleans, or 0 and 1",
            )
        feasible = numbers == 1.0
    _check_some_feasible(arrays, feasible, key, where, stack)
    feasible.setflags(write=False)
    return feasible


def _check_some_feasible(
    arrays: Mapping[str, AnyArray], feasible: BoolArray, key: str, where: object, stack: Stack | None
) -> None:
    some = feasible.any(axis=(-2, -1))
    if stack is None:
        if not some:
            raise MapError("infeasible everywhere", where=f"{where}: {key}", remedy="loosen the limits or move the grid")
        return
    for index in np.argwhere(~some)[:1]:
        raise MapError(
            f"infeasible everywhere at {stack.one} {np.asarray(arrays[stack.key])[index[0]]:g}",
            where=_at(where, key, index),
            remedy="leave that layer out, loosen the limits or move the grid",
        )


def _cells(
    arrays: Mapping[str, AnyArray], key: str, quantity: str, feasible: BoolArray, where: object, stack: Stack | None
) -> FloatArray:
    values = _numbers(arrays, key, feasible.shape, where, stack)
    for index in np.argwhere(feasible & ~np.isfinite(values))[:1]:
        raise MapError(
            f"{values[tuple(index)]} in a feasible cell",
            where=_at(where, key, index),
            remedy=f"give a number, or mark the cell false in an array '{key.removesuffix(quantity)}feasible'",
        )
    values[~feasible] = np.nan
    _check_plausible(values, key, quantity, where)
    values.setflags(write=False)
    return values


def _active(
    arrays: Mapping[str, AnyArray], key: str, shape: tuple[int, ...], where: object, stack: Stack | None
) -> BindingArray | None:
    if key not in arrays:
        return None
    numbers = _numbers(arrays, key, shape, where, stack)
    for index in np.argwhere(~np.isin(numbers, np.arange(ALL_BINDING + 1)))[:1]:
        raise MapError(
            f"{numbers[tuple(index)]:g} is no set of binding constraints",
            where=_at(where, key, index),
            remedy=f"give whole numbers from 0 to {ALL_BINDING}, or leave the key out",
        )
    active: BindingArray = numbers.astype(BINDING_TYPE)
    active.setflags(write=False)
    return active
