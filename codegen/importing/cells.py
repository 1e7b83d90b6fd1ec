"""A text table as cells, and its cells as numbers.

Comma, semicolon, tab or white space between the cells; a decimal comma where the comma is not between them; comments after `#`
or `%`.
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass

from codegen.importing import quantities
from codegen.importing.source import ImportFault

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?\Z", re.ASCII)
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
    """

    head: Line | None
    body: tuple[Line, ...]
    decimal_comma: bool

    def value(self, line: Line, column: int, where: object) -> float:
        """Return the number in a cell; NaN where it is missing. Raises ImportFault with the line."""
        text = line.cells[column].strip()
        if text.lower() in MISSING:
            return math.nan
        plain = text.replace(",", ".", 1) if self.decimal_comma and "." not in text else text
        if not NUMBER.match(plain):
            raise ImportFault(
                f"{text!r} where a number is needed",
                where=f"{where}, line {line.number}",
                remedy="give a number, or leave the cell empty where the map is infeasible",
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
    lines = [(number, line) for number, line in enumerate(text.split("\n"), start=1) if not _is_empty(line)]
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
    rows = _without_empty_end([row for row in rows if any(row.cells)])
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
    return Cells(head, tuple(rows), decimal_comma)


def _is_empty(line: str) -> bool:
    """Whether a line holds nothing but white space, separators and quotes."""
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
    try:
        row = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    except csv.Error as error:
        remedy = "give a table with a separator between the cells"
        raise ImportFault(f"cannot be split into cells ({error})", where=f"line {number}", remedy=remedy) from None
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
    known = [quantities.unit_of(unit) for unit in units]
    if not any(known) or not all(unit or text in UNITLESS for unit, text in zip(known, units, strict=True)):
        return head, rows[1:]
    if len(units) != len(head.cells):
        return head, rows[1:]  # reported with the number of cells
    names = []
    for name, unit in zip(head.cells, known, strict=True):
        has = quantities.take_apart(name).unit
        if unit and has not in (None, unit):
            place = f"{where}, line {rows[1].number}"
            raise ImportFault(f"{unit} under the name {name!r}", where=place, remedy="give one unit for each column")
        names.append(f"{name} [{unit}]" if unit and has is None else name)
    return Line(head.number, tuple(names)), rows[2:]


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
