"""Text tables in long form and matrix form, as the arrays of a map.

Long: a line with names, then a line for each point of the grid, in any order. Matrix: the first line holds the front angles,
the first column the speeds (or the other way round), the corner names and units.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal

import numpy as np
import numpy.typing as npt

from codegen.configuration.section import MAX_CELLS
from codegen.importing import quantities
from codegen.importing.cells import A_TITLE, NAMES_WANTED, NO_HEAD, Cells, Line, split
from codegen.importing.quantities import LOGICAL, QUANTITIES, Name
from codegen.importing.source import ImportFault, Source, text_of

Axis = Literal["vx", "delta_f"]

CORNER_SEPARATORS = re.compile(r"\s*[\\|:]\s*")


@dataclass(frozen=True)
class RawMap:
    """Contents of a file, in its own units.

    Attributes:
        values: quantity key -> (n,) for vx, (m,) for delta_f, (n, m) for the tables, NaN where there is no value.
        names: quantity key -> its name in the file.
        said: notes for the user on how it was read.
    """

    values: dict[str, npt.NDArray[np.float64]]
    names: dict[str, Name]
    said: list[str] = field(default_factory=list)


def read_table(source: Source, wanted: Mapping[str, str], rows: Axis | None) -> RawMap:
    """Read a text table of either form.

    Args:
        source: the file.
        wanted: quantity key -> column, where the user named it (long form only).
        rows: axis that runs down the lines of a matrix; None: the axis named in the corner, else vx.

    Raises:
        ImportFault: with the line.
    """
    cells = split(text_of(source), source.path)
    head = cells.head
    if head is not None and len(head.cells) >= 3 and not any(cells.is_number(cell) for cell in head.cells):
        if rows is not None:
            raise ImportFault("--rows is for a matrix, this is a list", where=source.path, remedy="leave --rows out")
        return _long(cells, head, wanted, source)
    if wanted:
        option = QUANTITIES[next(iter(wanted))].option
        raise ImportFault(f"{option} is for a table with named columns", where=source.path, remedy=NAMES_WANTED)
    if head is None:
        return _matrix(cells, cells.body[0], cells.body[1:], rows, source)
    return _matrix(cells, head, cells.body, rows, source)


# --- long form -----------------------------------------------------------------------------------------------------------


def _long(cells: Cells, head: Line, wanted: Mapping[str, str], source: Source) -> RawMap:
    columns = list(head.cells)
    twice = next((name for index, name in enumerate(columns) if name in columns[:index]), None)
    if twice is not None:
        where = f"{source.path}, line {head.number}"
        raise ImportFault(f"the column {twice!r} is there twice", where=where, remedy="give each column a name of its own")
    names = quantities.choose(columns, wanted, f"{source.path}, line {head.number}")
    column_of = {key: columns.index(name.text) for key, name in names.items()}
    numbers = {key: [_cell(cells, line, column, key, source) for line in cells.body] for key, column in column_of.items()}
    speed, front = numbers["vx"], numbers["delta_f"]
    order = _grid(speed, front, cells.body, source)
    axes = {"vx": np.unique(speed), "delta_f": np.unique(front)}
    shape = (axes["vx"].size, axes["delta_f"].size)
    tables = {key: np.array(column)[order].reshape(shape) for key, column in numbers.items() if key not in axes}
    left_out = [name for name in columns if name not in {name.text for name in names.values()}]
    said = [f"columns left out: {', '.join(left_out)}"] if left_out else []
    return RawMap({**axes, **tables}, names, [f"a list of {len(cells.body)} points", *said])


def _cell(cells: Cells, line: Line, column: int, key: str, source: Source) -> float:
    text = line.cells[column].strip().lower()
    if QUANTITIES[key].kind == LOGICAL and text in ("true", "false"):
        return float(text == "true")
    value = cells.value(line, column, source.path)
    if key in ("vx", "delta_f") and math.isnan(value):
        where = f"{source.path}, line {line.number}"
        raise ImportFault(f"no value for {key}", where=where, remedy="every line needs its speed and its front angle")
    return value


def _grid(speed: list[float], front: list[float], lines: tuple[Line, ...], source: Source) -> npt.NDArray[np.intp]:
    """Return the order that sorts the points by speed, then by front angle. Raises ImportFault for a duplicate or a gap."""
    order = np.lexsort((front, speed))
    for before, after in pairwise(order):
        if (speed[before], front[before]) == (speed[after], front[after]):
            first, second = sorted((lines[before].number, lines[after].number))
            raise ImportFault(
                f"the point vx = {speed[after]:.9g}, delta_f = {front[after]:.9g} is there twice (first in line {first})",
                where=f"{source.path}, line {second}",
                remedy="leave one out",
            )
    speeds, angles = sorted(set(speed)), sorted(set(front))
    if len(speeds) * len(angles) == len(lines):
        return order
    if len(speeds) * len(angles) > max(2 * len(lines), MAX_CELLS):
        remedy = "give every speed the same front angles, not measured ones"
        raise ImportFault(f"{len(speeds)} speeds and {len(angles)} front angles are no grid", where=source.path, remedy=remedy)
    grid = [(one, other) for one in speeds for other in angles]
    present = [(speed[index], front[index]) for index in order]
    place = next((place for place, point in enumerate(present) if point != grid[place]), len(present))
    beside = lines[order[max(place - 1, 0)]].number
    raise ImportFault(
        f"a gap in the grid: no point vx = {grid[place][0]:.9g}, delta_f = {grid[place][1]:.9g} beside that of this line",
        where=f"{source.path}, line {beside}",
        remedy="add it, with an empty yaw rate where the map is infeasible",
    )


# --- matrix form ---------------------------------------------------------------------------------------------------------


def _matrix(cells: Cells, top: Line, body: tuple[Line, ...], rows: Axis | None, source: Source) -> RawMap:
    place = f"{source.path}, line {top.number}"
    columns = range(1, len(top.cells))
    if len(top.cells) < 3 or not all(cells.is_number(top.cells[column]) for column in columns):
        raise ImportFault(NO_HEAD, where=place, remedy=f"{NAMES_WANTED}; {A_TITLE}")
    corner = top.cells[0].strip()
    if cells.is_number(corner) and corner and not math.isnan(cells.value(top, 0, source.path)):
        raise ImportFault("the first line has no names", where=place, remedy=NAMES_WANTED + ", or leave a matrix' corner empty")
    names, found = _corner("" if cells.is_number(corner) else corner, place)
    if rows is not None and found is not None and rows != found:
        raise ImportFault(f"the corner says that the rows are {found}", where=place, remedy="leave --rows out")
    down = rows or found or "vx"
    across: Axis = "delta_f" if down == "vx" else "vx"
    axes = {
        across: np.array([_axis_value(cells, top, column, across, source) for column in columns]),
        down: np.array([_axis_value(cells, line, 0, down, source) for line in body]),
    }
    table = np.array([[cells.value(line, column, source.path) for column in columns] for line in body])
    said = [f"a matrix with {down} down the rows" + ("" if rows or found else " (as the corner does not say)")]
    if down == "delta_f":
        table = table.T
        said.append("transposed")
    values = {"vx": axes["vx"], "delta_f": axes["delta_f"], "yaw_rate": table}
    return RawMap(values, {key: names.get(key, Name(key, key)) for key in values}, said)


def _axis_value(cells: Cells, line: Line, column: int, key: str, source: Source) -> float:
    value = cells.value(line, column, source.path)
    if math.isnan(value):
        where = f"{source.path}, line {line.number}"
        raise ImportFault(f"no value for {key}", where=where, remedy="the first line and the first column need a number each")
    return value


def _corner(text: str, place: str) -> tuple[dict[str, Name], Axis | None]:
    r"""Return names and units in the corner, "vx [km/h] \ delta_f [deg] : yaw_rate [deg/s]", and the axis that it puts down."""
    names: dict[str, Name] = {}
    for part in filter(None, CORNER_SEPARATORS.split(text)):
        unit = quantities.unit_of(part.strip("[]() "))
        if unit is not None:
            kind = quantities.KIND_OF[unit]
            key = next(quantity.key for quantity in QUANTITIES.values() if quantity.kind == kind)
            name = Name(part, key, unit)
        else:
            name = quantities.take_apart(part)
            quantity = quantities.quantity_named(name)
            if quantity is None or not quantity.required:
                remedy = r"write it as: vx [km/h] \ delta_f [deg] : yaw_rate [deg/s]"
                raise ImportFault(f"the corner {part!r} is no name or unit of a map", where=place, remedy=remedy)
            key = quantity.key
        if key in names:
            raise ImportFault(f"the corner names {key} twice", where=place, remedy="name each once")
        names[key] = name
    order: list[Axis] = [key for key in names if key in ("vx", "delta_f")]  # type: ignore[misc]
    return names, order[0] if len(order) == 2 else None
