"""Calibration sets: complete values of a build, merged from files and checked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from codegen.arrays import FloatArray
from codegen.emit.objects import CalibrationObject, Layout, Values
from codegen.errors import CodegenError
from codegen.export.calibration import cdf, dcm
from codegen.export.calibration.build import BuildCalibration
from codegen.export.calibration.labels import CALIBRATION_BYTES_MAX, READ_REMEDY, python_numbers, values_of
from codegen.files import read_file, refuse_empty
from codegen.limits import Limits

CALIBRATION_READERS = {".dcm": dcm, ".cdfx": cdf}
"""Module of each format by extension, with `read` and `write`."""


def read_set(path: Path, layout: Layout) -> Values:
    """Return the values of a file that belong to a build; see `values_of`. Raises CodegenError."""
    reader = CALIBRATION_READERS.get(path.suffix.lower())
    if reader is None:
        raise CodegenError(
            f"{path.suffix or 'no extension'} is not supported",
            where=path,
            remedy="give a .dcm or .cdfx file, or an image with `image=`",
        )
    content = read_file(path, CALIBRATION_BYTES_MAX, READ_REMEDY)
    refuse_empty(len(content), path)
    with Limits.of(len(content)).enforced(path):
        values = values_of(reader.read(content, path, f"{layout.prefix}."), layout)
    if not values:
        what = f"contains no value of this build: no name begins with {layout.prefix}."
        raise CodegenError(what, where=path, remedy="give the file of this build")
    return values


@dataclass(frozen=True, eq=False)
class CalibrationSet:
    """A complete set that the build accepts.

    Attributes:
        name: source of the values, for titles.
        values: values of all objects, with the checksum that belongs to them.
        stale_checksum: whether a file states another checksum, which was replaced.
    """

    name: str
    values: Values
    stale_checksum: bool = False


def merged(build: BuildCalibration, base: Values, base_name: str, files: Sequence[Path]) -> CalibrationSet:
    """Return `base` with the values of files, later ones over earlier ones.

    Raises:
        CodegenError: a file is rejected, or the build rejects the values; the message names the file and the object.
    """
    values, origins = dict(base), dict[str, object]()
    if base is not build.values:
        origins = dict.fromkeys(base, base_name)
    for path in files:
        found = read_set(path, build.layout)
        values |= found
        origins |= dict.fromkeys(found, path)
    checksum = build.layout.checksum.name
    stated = values[checksum]
    build.check(values, origins)
    is_stale = checksum in origins and not np.array_equal(stated, values[checksum])
    return CalibrationSet(", ".join(path.name for path in files) or base_name, values, is_stale)


@dataclass(frozen=True)
class Difference:
    """Difference of one object between two sets. Values are physical, in its unit.

    Attributes:
        object: the object.
        count: number of numbers that differ.
        first, second: the values where they differ most.
        at: coordinates of that number on the axes of the first set, that of the columns first; the index for an axis, () for a
            VALUE.
    """

    object: CalibrationObject
    count: int
    first: float
    second: float
    at: tuple[float, ...]


def differences(first: Values, second: Values, layout: Layout) -> list[Difference]:
    """Return the objects that differ, in the order of the layout, without the checksum."""
    found = []
    for each in layout.objects.values():
        one, two = first[each.name], second[each.name]
        differ = one != two
        if each.name == layout.checksum.name or not differ.any():
            continue
        index = np.unravel_index(int(np.abs(two.astype(np.float64) - one).argmax()), one.shape)
        at: tuple[float, ...] = (float(index[0]),) if each.kind == "AXIS" else ()
        if each.axes:
            at = tuple(python_numbers(first[axis][k]) for axis, k in zip(each.axes, reversed(index), strict=True))
        found.append(Difference(each, int(differ.sum()), python_numbers(one[index]), python_numbers(two[index]), at))
    return found


Line = tuple[FloatArray, FloatArray]
"""Breakpoints and numbers, both (n,)."""


def curves_of(
    found: Sequence[Difference], first: Values, second: Values, layout: Layout
) -> Iterator[tuple[str, str, str, Line, Line]]:
    """Yield name, unit, label of the axis and the lines of both sets for each curve or map that differs, alone or in an axis.

    The line of a map is its row with the largest difference.
    """
    differing = {each.object.name for each in found}
    for each in layout.objects.values():
        if not each.axes or not differing.intersection((each.name, *each.axes)):
            continue
        axis, title = layout.objects[each.axes[0]], each.name
        one, two = (values[each.name].astype(np.float64) for values in (first, second))
        if each.kind == "MAP":
            row = int(np.abs(two - one).max(axis=1).argmax())
            rows = layout.objects[each.axes[1]]
            one, two, title = one[row], two[row], f"{title} at {first[rows.name][row]:.4g} {rows.unit}"
        points = (values[axis.name].astype(np.float64) for values in (first, second))
        yield title, each.unit or "1", f"{axis.name} ({axis.unit})", (next(points), one), (next(points), two)
