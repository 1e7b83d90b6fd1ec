"""Text tables in long form and matrix form, as the arrays of a map.

Long: a line with names, then a line for each point of the grid, in any order. Matrix: the first line holds the front angles,
the first column the speeds (or the other way round), the corner names and units.
"""

from __future__ import annotations

import csv
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
from codegen.importing.quantities import BRACKETED, LOGICAL_KIND, MAP_CHANNELS, Name
from codegen.importing.source import ImportFault, Source, text_of

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?\Z", re.ASCII)
CLOCK = re.compile(r"(?:\d{4}-\d\d?-\d\d?|\d\d?[./]\d\d?[./]\d{4}|\d+:\d\d)(?!\d)", re.ASCII)
"""Beginning of a date or of a time of day: 2024-05-06, 06.05.2024, 07:08:09."""
MISSING = ("", "nan", "na", "n/a")
"""A cell without a value, in small letters: there the map is infeasible."""
COMMENT = "#%"
SAID_SEPARATOR = re.compile(r"\s*\"?sep=([\t;, ])\"?[\s;,]*", re.IGNORECASE)
"""First line that declares the separator to Excel."""
UNITLESS = ("", "-", "1")
"""Cells of a line of units that mean no unit."""
NAMES_WANTED = "give a first line such as: vx_km_h, delta_f_deg, yaw_rate_deg_s"
NO_HEAD = "neither names for three columns nor a row of front angles"
A_TITLE = "put # before a title"


@dataclass(frozen=True)
class Line:
    """Cells of one line, and its number in the file, counted from one."""

    number: int
    cells: tuple[str, ...]


@dataclass(frozen=True)
class Cells:
    """A table of text.

    Attributes:
        head: the line with the names, or None where the first line is numbers.
        body: the other lines that are neither empty nor comment.
        decimal_comma: whether 1,5 is one and a half.
        others: kind of a line that is not in the body -> number of such lines.
    """

    head: Line | None
    body: tuple[Line, ...]
    decimal_comma: bool
    others: Mapping[str, int] = field(default_factory=dict)

    def value(self, line: Line, column: int, where: object) -> float:
        """Return the number in a cell; NaN where it is missing. Raises ImportFault with the line."""
        text = line.cells[column].strip()
        if text.lower() in MISSING:
            return math.nan
        plain = text.replace(",", ".", 1) if self.decimal_comma and "." not in text else text
        if CLOCK.match(text):
            raise ImportFault(
                f"{text!r} is a date or a time of day",
                where=f"{where}, line {line.number}",
                remedy="export times in seconds from the start",
            )
        if not NUMBER.match(plain):
            raise ImportFault(
                f"{text!r} where a number is needed",
                where=f"{where}, line {line.number}",
                remedy="give a number, or leave the cell empty where there is no value",
            )
        number = float(plain.lower().replace("d", "e"))
        if math.isinf(number):
            raise ImportFault(f"{text!r} is too large", where=f"{where}, line {line.number}", remedy="give a finite number")
        return number

    def is_number(self, text: str) -> bool:
        """Whether a cell holds a number or nothing."""
        text = text.strip()
        plain = text.replace(",", ".", 1) if self.decimal_comma and "." not in text else text
        return text.lower() in MISSING or bool(NUMBER.match(plain))


def split(text: str, where: object) -> Cells:
    """Split a text into cells. The first line that is no comment decides the separator, by "sep=;" or by its characters.

    Lines of empty cells are skipped. Units in a second line go to the names in the first.

    Raises:
        ImportFault: there is no table, or a line has another number of cells than the first, or a title stands above the names.
    """
    try:
        return _split(text, where)
    except csv.Error as error:
        remedy = "give a table with a separator between the cells"
        raise ImportFault(f"a line cannot be split into cells ({error})", where=where, remedy=remedy) from None


def _split(text: str, where: object) -> Cells:
    all_lines = text.removesuffix("\n").split("\n")
    lines = [(number, line) for number, line in enumerate(all_lines, start=1) if not _is_empty(line)]
    comments = [(number, line) for number, line in lines if line.lstrip()[0] in COMMENT]
    lines = [(number, line) for number, line in lines if line.lstrip()[0] not in COMMENT]
    said = SAID_SEPARATOR.fullmatch(lines[0][1]) if lines else None
    lines = lines[1:] if said else lines
    if len(lines) < 2:
        raise ImportFault("no table: less than two lines of it", where=where, remedy="give a line with names, then numbers")
    separator = said[1].strip(" ") or None if said else _separator(lines[0][1])
    decimal_comma = separator != ","
    _refuse_title(lines, where)
    rows = [_line(number, line, separator, head=index == 0) for index, (number, line) in enumerate(lines)]
    rows = with_cells = _without_empty_end([row for row in rows if any(row.cells)])
    if separator is None and all(len(row.cells) == len(rows[0].cells) + 1 for row in rows[1:]):
        rows[0] = Line(rows[0].number, ("", *rows[0].cells))  # a matrix whose corner is empty
    cells = Cells(None, tuple(rows), decimal_comma)
    head: Line | None = None
    if not all(cells.is_number(cell) for cell in rows[0].cells):
        head, rows = _head_with_units(rows, where)
    else:
        head = _commented_head(comments, rows[0], separator)
    width = len(rows[0].cells) if head is None else len(head.cells)
    for row in rows:
        if len(row.cells) != width:
            raise ImportFault(
                f"{len(row.cells)} cells, where the first line has {width}",
                where=f"{where}, line {row.number}",
                remedy=f"give each line the same number of cells, and {A_TITLE}",
            )
    names = len(with_cells) - len(rows)
    others = {
        "empty line": sum(map(_is_empty, all_lines)) + len(lines) - len(with_cells),
        "comment": len(comments),
        "line of the separator": int(bool(said)),
        "line of names": min(names, 1),
        "line of units": max(names - 1, 0),
    }
    return Cells(head, tuple(rows), decimal_comma, {kind: count for kind, count in others.items() if count})


def _is_empty(line: str) -> bool:
    """Return whether a line holds nothing but white space, separators and quotes."""
    return all(mark.isspace() or mark in ';,"' for mark in line)


def _separator(line: str) -> str | None:
    """Return the separator of the cells; None for white space."""
    return next((mark for mark in ("\t", ";", ",") if mark in line), None)


def _line(number: int, line: str, separator: str | None, *, head: bool) -> Line:
    if not head:
        line = re.split(f"[{COMMENT}]", line, maxsplit=1)[0]
    if separator is None:
        cells = line.split()
        return Line(number, tuple(_with_units(cells) if head else cells))
    row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    return Line(number, tuple(cell.strip() for cell in row))


def _with_units(words: list[str]) -> list[str]:
    """Join "speed [km/h]" and "speed in km/h" to one name in a head that was split at white space."""
    names: list[str] = []
    for word, after in zip(words, [*words[1:], ""], strict=True):
        is_in = word.lower() == "in" and quantities.unit_of(after) is not None
        if names and (word[0] in "[({" or is_in or names[-1].lower().endswith(" in")):
            names[-1] = f"{names[-1]} {word}"
        else:
            names.append(word)
    return names


def _head_with_units(rows: list[Line], where: object) -> tuple[Line, list[Line]]:
    """Return the head and the rest; a line of units under it ("km/h;deg;deg/s") goes into the names. Raises ImportFault."""
    head, units = rows[0], [cell.strip("[](){} ") for cell in rows[1].cells] if len(rows) > 1 else []
    known = [quantities.unit_of(unit) or quantities.time_unit_of(unit) for unit in units]
    if not any(known) or any(text not in UNITLESS and NUMBER.match(text.replace(",", ".", 1)) for text in units):
        return head, rows[1:]
    if not all(unit or text in UNITLESS or text.lower() not in MISSING for unit, text in zip(known, units, strict=True)):
        return head, rows[1:]
    if len(units) != len(head.cells):
        return head, rows[1:]  # reported with the number of cells
    place = f"{where}, line {rows[1].number}"
    names = tuple(_with_unit(name, unit, text, place) for name, unit, text in zip(head.cells, known, units, strict=True))
    return Line(head.number, names), rows[2:]


def _with_unit(name: str, unit: str | None, text: str, place: str) -> str:
    """Return a name with the unit below it: `text`, or `unit` if that is known. Raises ImportFault if it has another one."""
    is_time = quantities.is_time(name)
    if is_time and text not in UNITLESS:
        unit = quantities.time_unit_of(text) or text  # one that is not known is reported with the column of the time
    elif unit is None:
        if text in UNITLESS or text.lower() in MISSING or quantities.take_apart(name).unit is not None:
            return name
        return name if BRACKETED.search(name) else f"{name} [{text}]"  # reported if a quantity has it
    has: str | None = quantities.take_apart(name).unit
    if is_time or unit in quantities.TIME_UNITS:
        has = quantities.split_time(name)[1] or None
        has = (quantities.time_unit_of(has) or has) if has else None
    if unit is not None and has not in (None, unit):
        raise ImportFault(f"{unit} under the name {name!r}", where=place, remedy="give one unit for each column")
    return f"{name} [{unit}]" if unit is not None and has is None else name


def _refuse_title(lines: list[tuple[int, str]], where: object) -> None:
    """Raise ImportFault for a title above the line with the names or above the table."""
    (number, first), (_, second), (_, last) = lines[0], lines[1], lines[-1]
    below = _words(second, _separator(second))
    is_name = [word[0].isalpha() and word.lower() not in MISSING and quantities.unit_of(word) is None for word in below]
    above_names = len(below) >= 3 and all(is_name)
    words = _words(first, _separator(last))
    alone = len(words) < 3 <= len(_line(0, last, _separator(last), head=False).cells)
    alone = alone and not any(NUMBER.match(word.replace(",", ".")) or word.lower() in MISSING for word in words)
    # Between spaces a comma is a decimal one: as many cells in the first line as in the last are no title.
    alone = alone and len(_line(0, first, None, head=True).cells) != len(_line(0, last, None, head=False).cells)
    if above_names or alone:
        raise ImportFault(NO_HEAD, where=f"{where}, line {number}", remedy=f"{NAMES_WANTED}; {A_TITLE}")


def _words(line: str, separator: str | None) -> list[str]:
    """Return the cells that are not empty."""
    return [cell for cell in _line(0, line, separator, head=False).cells if cell]


def _without_empty_end(rows: list[Line]) -> list[Line]:
    """Remove a last column that is empty everywhere, because spreadsheets end lines with a separator."""
    while all(len(row.cells) > 1 and not row.cells[-1] for row in rows):
        rows = [Line(row.number, row.cells[:-1]) for row in rows]
    return rows


def _commented_head(comments: list[tuple[int, str]], first: Line, separator: str | None) -> Line | None:
    """Return the last comment above the numbers if it names each column, as numpy.savetxt writes it."""
    above = [(number, line) for number, line in comments if number < first.number]
    if not above:
        return None
    number, line = above[-1]
    head = _line(number, line.lstrip().lstrip(COMMENT), separator, head=True)
    named = len(head.cells) == len(first.cells) and all(cell and not cell[0].isdigit() for cell in head.cells)
    return head if named else None


AxisName = Literal["vx", "delta_f"]

CORNER_SEPARATORS = re.compile(r"\s*[\\|:]\s*")


@dataclass(frozen=True)
class RawMap:
    """Contents of a file, in its own units.

    Attributes:
        values: quantity key -> (n,) for vx, (m,) for delta_f, (n, m) for the tables, NaN where there is no value.
        names: quantity key -> its name in the file.
        said: notes for the user on how it was read.
        assumes_rows: whether nothing in the file says that the rows are speeds.
    """

    values: dict[str, npt.NDArray[np.float64]]
    names: dict[str, Name]
    said: list[str] = field(default_factory=list)
    assumes_rows: bool = False


def read_table(source: Source, wanted: Mapping[str, str], rows: AxisName | None) -> RawMap:
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
            raise ImportFault("`rows=` is for a matrix, this is a list", where=source.path, remedy="leave it out")
        return _long(cells, head, wanted, source)
    if wanted:
        argument = MAP_CHANNELS[next(iter(wanted))].argument()
        raise ImportFault(f"{argument} is for a table with named columns", where=source.path, remedy=NAMES_WANTED)
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
    if MAP_CHANNELS[key].kind == LOGICAL_KIND and text in ("true", "false"):
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


def _matrix(cells: Cells, top: Line, body: tuple[Line, ...], rows: AxisName | None, source: Source) -> RawMap:
    place = f"{source.path}, line {top.number}"
    columns = range(1, len(top.cells))
    if len(top.cells) < 3 or not all(cells.is_number(top.cells[column]) for column in columns):
        raise ImportFault(NO_HEAD, where=place, remedy=f"{NAMES_WANTED}; {A_TITLE}")
    corner = top.cells[0].strip()
    if cells.is_number(corner) and corner and not math.isnan(cells.value(top, 0, source.path)):
        raise ImportFault(
            "the first line has no names", where=place, remedy=NAMES_WANTED + ", or leave the corner of a matrix empty"
        )
    names, found = _corner("" if cells.is_number(corner) else corner, place)
    if rows is not None and found is not None and rows != found:
        raise ImportFault(f"the corner says that the rows are {found}", where=place, remedy="leave `rows=` out")
    down = rows or found or "vx"
    across: AxisName = "delta_f" if down == "vx" else "vx"
    axes = {
        across: np.array([_axis_value(cells, top, column, across, source) for column in columns]),
        down: np.array([_axis_value(cells, line, 0, down, source) for line in body]),
    }
    table = np.array([[cells.value(line, column, source.path) for column in columns] for line in body])
    assumes = rows is None and found is None
    said = [f"a matrix with {down} down the rows" + (" (as the corner does not say)" if assumes else "")]
    if down == "delta_f":
        table = table.T
        said.append("transposed")
    values = {"vx": axes["vx"], "delta_f": axes["delta_f"], "yaw_rate": table}
    return RawMap(values, {key: names.get(key, Name(key, key)) for key in values}, said, assumes)


def _axis_value(cells: Cells, line: Line, column: int, key: str, source: Source) -> float:
    value = cells.value(line, column, source.path)
    if math.isnan(value):
        where = f"{source.path}, line {line.number}"
        raise ImportFault(f"no value for {key}", where=where, remedy="the first line and the first column need a number each")
    return value


def _corner(text: str, place: str) -> tuple[dict[str, Name], AxisName | None]:
    r"""Return names and units in the corner, "vx [km/h] \ delta_f [deg] : yaw_rate [deg/s]", and the axis that it puts down."""
    names: dict[str, Name] = {}
    for part in filter(None, CORNER_SEPARATORS.split(text)):
        unit = quantities.unit_of(part.strip("[]() "))
        kind = quantities.KIND_OF.get(unit or "")
        key = next((quantity.key for quantity in MAP_CHANNELS.values() if quantity.kind == kind), "")
        if key:
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
    order: list[AxisName] = [key for key in names if key in ("vx", "delta_f")]  # type: ignore[misc]
    return names, order[0] if len(order) == 2 else None
