"""A small chart in characters: lines over time in braille, two by four dots to a character.

Samples are folded into bins as they come, each with the least and the greatest of what fell into it: a peak of one cycle shows,
and drawing costs the same however long the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from rich.text import Text

BINS = 200
DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of U+2800 by row and column of a character (Unicode, block Braille Patterns)."""

STEPS = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)

LONGEST = 30.0
"""Seconds that a chart shows at most; a longer run moves through."""


@dataclass(frozen=True)
class Window:
    """Time range of a chart: `start` to `start + length` in s, in bins."""

    start: float
    length: float

    @staticmethod
    def of(time: float, duration: float) -> Window:
        """All of a short run; of a longer or endless one the last 30 s."""
        length = duration if 0.0 < duration <= LONGEST else LONGEST
        width = length / BINS
        return Window(max(0.0, (math.floor(time / width) + 1) * width - length), length)


@dataclass
class Trace:
    """A signal over time: (least, greatest) by number of the bin; NaN leaves a gap."""

    bins: dict[int, tuple[float, float]] = field(default_factory=dict)

    def add(self, time: float, value: float, width: float) -> None:
        """Fold in a value; `width` of a bin (s). Bins that no chart shows any more are dropped."""
        if not math.isfinite(value):
            return
        number = math.floor(time / width)
        low, high = self.bins.get(number, (value, value))
        self.bins[number] = (min(low, value), max(high, value))
        if len(self.bins) > 2 * BINS:
            for old in sorted(self.bins)[:BINS]:
                del self.bins[old]

    def shown(self, window: Window) -> dict[int, tuple[float, float]]:
        """The bins inside a window."""
        first = round(window.start / window.length * BINS)
        return {number - first: pair for number, pair in self.bins.items() if 0 <= number - first < BINS}


def scale(traces: Sequence[Trace], window: Window, least: float) -> float:
    """The top of an axis from -top to top that holds all that is shown: a step times a power of ten, `least` or more."""
    extremes = [abs(value) for trace in traces for pair in trace.shown(window).values() for value in pair]
    needed = max([least, *extremes])
    power = 10.0 ** math.floor(math.log10(needed))
    return next(step * power for step in STEPS if needed <= step * power * (1 + 1e-9))


def columns_of(number: int, columns: int) -> range:
    """The columns, one at least, that a bin takes on a chart that is wider or narrower than there are bins."""
    first = number * columns // BINS
    return range(first, max(first + 1, (number + 1) * columns // BINS))


@dataclass(frozen=True)
class Line:
    """A trace and its style; `dotted` leaves every other dot out, for terminals without colour."""

    trace: Trace
    style: str
    dotted: bool = False


def chart(lines: Sequence[Line], window: Window, top: float, size: tuple[int, int], ascii_only: bool = False) -> list[Text]:
    """Rows of a chart, from the top.

    Args:
        lines: the last is on top.
        window: time along the width.
        top: the axis reaches from -top to top.
        size: columns and rows, in characters.
        ascii_only: stars in place of braille.
    """
    columns, rows = size
    cells: list[list[tuple[int, str]]] = [[(0, "")] * columns for _ in range(rows)]
    for line in lines:
        for column, first, last in _spans(line, window, top, (2 * columns, 4 * rows)):
            if line.dotted and column % 2:
                continue
            for row in range(first, last + 1):
                bits, _ = cells[row // 4][column // 2]
                cells[row // 4][column // 2] = (bits | DOTS[row % 4][column % 2], line.style)
    zero = _row(0.0, top, 4 * rows) // 4
    return [_row_of_text(row, number == zero, ascii_only) for number, row in enumerate(cells)]


def _spans(line: Line, window: Window, top: float, dots: tuple[int, int]) -> list[tuple[int, int, int]]:
    """(column, first row, last row) in dots, joined with the neighbour so that steep lines have no holes."""
    columns, rows = dots
    found: dict[int, tuple[int, int]] = {}
    for number, (low, high) in line.trace.shown(window).items():
        upper, lower = _row(high, top, rows), _row(low, top, rows)
        for column in columns_of(number, columns):
            first, last = found.get(column, (upper, lower))
            found[column] = (min(first, upper), max(last, lower))
    joined = []
    for column, (first, last) in sorted(found.items()):
        before = found.get(column - 1)
        if before is not None:
            first, last = min(first, before[1] + 1), max(last, before[0] - 1)
        joined.append((column, first, last))
    return joined


def _row(value: float, top: float, rows: int) -> int:
    return min(rows - 1, max(0, round((top - value) / (2.0 * top) * (rows - 1))))


def _row_of_text(cells: list[tuple[int, str]], zero: bool, ascii_only: bool) -> Text:
    text = Text(no_wrap=True)
    for bits, style in cells:
        if bits:
            text.append("*" if ascii_only else chr(0x2800 + bits), style)
        else:
            text.append(("-" if ascii_only else "┈") if zero else " ", "dim")
    return text
