"""Values of a calibration file, independent of its format, and their transfer to the objects of a build."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from codegen.emit.objects import CalibrationObject, Kind, Layout, Numbers, Values
from codegen.errors import CodegenError, suggestion
from codegen.files import decoded, refuse_utf16

CALIBRATION_BYTES_MAX = 64 * 2**20
READ_REMEDY = "give a DCM 2.0 or CDF 2.0 file that a calibration tool or codegen calibrate wrote"

KIND_NAMES: Mapping[Kind, str] = {"VALUE": "a value", "AXIS": "an axis", "CURVE": "a curve", "MAP": "a map"}
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]{1,4})?")

AXIS_TOLERANCE = 1e-5
"""Largest difference between an axis and its copy in a curve or map, as a fraction of the axis. Tools print the copy with fewer
digits, often six decimals."""


@dataclass(frozen=True)
class Label:
    """One value, axis, curve or map of a file.

    Attributes:
        name: its name.
        kind: its kind.
        place: location in the file, for messages.
        numbers: texts of its numbers; those of a map row by row.
        size: number of columns and rows, as far as the file states them.
        axes: name of each shared axis, that of the columns first; "" if the file does not name it.
        points: texts of the breakpoints of each axis; empty if they are not in the label.
        units: unit of the numbers, then that of each axis; "" if the file does not state it.
    """

    name: str
    kind: Kind
    place: str
    numbers: list[str]
    size: tuple[int, ...] = ()
    axes: tuple[str, ...] = ()
    points: tuple[list[str], ...] = field(default=())
    units: tuple[str, ...] = ()


def begins_with(name: str, start: str) -> bool:
    """Return whether a name belongs to the build. In other letters it does too, and is then reported as unknown."""
    return name.lower().startswith(start.lower())


def values_of(labels: Iterable[Label], layout: Layout) -> Values:
    """Return the values of labels in the precision of a build.

    An axis that the file contains only inside its curves and maps is taken from there.

    Raises:
        CodegenError: a label that the build does not have, or of another kind, size or unit, or a text that is not a number.
    """
    found: Values = {}
    copies: list[tuple[CalibrationObject, Label, list[str]]] = []
    for label in labels:
        each = _object(label, layout)
        if label.name in found:
            raise CodegenError("is in the file twice", where=_where(label), remedy="remove one of them")
        found[each.name] = _numbers(each, label, label.numbers)
        copies += [
            (layout.objects[axis], label, points) for axis, points in zip(each.axes, label.points, strict=False) if points
        ]
    for axis, label, points in copies:
        values = _numbers(axis, label, points)
        if axis.name not in found:
            found[axis.name] = values
            continue
        own = found[axis.name].astype(np.float64)
        if np.abs(own - values).max() > AXIS_TOLERANCE * np.abs(own).max():
            raise CodegenError(
                f"its breakpoints are not those of {axis.name} in this file",
                where=_where(label),
                remedy="correct one of them: the curves and maps of an axis share its breakpoints",
            )
    return found


def _object(label: Label, layout: Layout) -> CalibrationObject:
    each = layout.objects.get(label.name)
    if each is None:
        remedy = f"remove it, or give the build that has it{suggestion(label.name, layout.objects)}"
        raise CodegenError(f"the build {layout.build_id} does not have it", where=_where(label), remedy=remedy)
    if label.kind != each.kind:
        raise CodegenError(
            f"{KIND_NAMES[label.kind]} in the file, {KIND_NAMES[each.kind]} in the build",
            where=_where(label),
            remedy="give the file of this build",
        )
    size = each.shape[::-1]
    if label.size and label.size != size:
        stated, own = (" x ".join(map(str, sizes)) for sizes in (label.size, size))
        raise CodegenError(f"size {stated} in the file, {own} in the build", where=_where(label), remedy=_SIZE_REMEDY)
    for axis, name in zip(each.axes, label.axes, strict=False):
        if name and name != axis:
            raise CodegenError(
                f"over the axis {name} in the file, {axis} in the build",
                where=_where(label),
                remedy="give the file of this build",
            )
    _check_units(each, label, layout)
    return each


def _check_units(each: CalibrationObject, label: Label, layout: Layout) -> None:
    for one, unit in zip((each, *(layout.objects[name] for name in each.axes)), label.units, strict=False):
        if unit and one.unit and _spelled(unit) != _spelled(one.unit):
            of_axis = "" if one is each else f"breakpoints of {one.name} "
            raise CodegenError(
                f"{of_axis}in {unit} in the file, in {one.unit} in the build",
                where=_where(label),
                remedy=f"convert the numbers to {one.unit}",
            )


def _spelled(unit: str) -> str:
    """Return a unit in a spelling that does not depend on the tool: m/s2 for m/s^2 and m/s²."""
    return unit.translate({ord("²"): "2", ord("³"): "3", ord("^"): None, ord(" "): None})


_SIZE_REMEDY = "the number of breakpoints is fixed at build: build again to change it"


def _numbers(each: CalibrationObject, label: Label, texts: list[str]) -> Any:
    count = int(np.prod(each.shape))
    if len(texts) != count:
        raise CodegenError(f"{len(texts)} numbers for {each.name}, which has {count}", where=_where(label), remedy=_SIZE_REMEDY)
    for text in texts:
        if not _NUMBER.fullmatch(text):
            raise CodegenError(f"{text!r} is not a number", where=_where(label), remedy="correct the value")
    values = np.array([float(text) for text in texts])
    if each.dtype.kind == "u":
        limit = np.iinfo(each.dtype).max
        if not ((values == np.rint(values)) & (values >= 0) & (values <= limit)).all():
            raise CodegenError(f"not whole numbers from 0 to {limit}", where=_where(label), remedy="correct the value")
    with np.errstate(over="ignore"):
        return values.astype(each.dtype).reshape(each.shape)


def _where(label: Label) -> str:
    return f"{label.place}: {label.name}"


def number_text(value: Any) -> str:
    """Return the shortest text of a number that gives the same bits in its precision."""
    return np.format_float_scientific(value, unique=True, trim="-") if _is_long(value) else _plain(value)


def python_numbers(values: Numbers) -> Any:
    """Return values as Python numbers, in nested lists for an array. Floats are the shortest decimals; see `number_text`."""
    if values.dtype.kind == "u":
        return values.tolist()
    return np.array([float(number_text(value)) for value in values.reshape(-1)]).reshape(values.shape).tolist()


def _is_long(value: Any) -> bool:
    return value != 0 and not 1e-5 <= abs(float(value)) < 1e16


def _plain(value: Any) -> str:
    return str(int(value)) if isinstance(value, np.integer) else np.format_float_positional(value, unique=True, trim="0")


def text_of(content: bytes, where: Path) -> str:
    """Return the text of a DCM file; see `decoded`. Raises CodegenError: a binary file."""
    refuse_utf16(content, where)
    if b"\0" in content:
        raise CodegenError("not a text file", where=where, remedy=READ_REMEDY)
    return decoded(content)
