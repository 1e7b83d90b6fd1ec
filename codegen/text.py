"""Aligned tables and rounded numbers, for the terminal and for text files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from codegen.errors import printable

_ONE_LINE = str.maketrans("\n\t", "  ")


def text_table(header: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Return a header and rows as aligned columns, the first `left` flush left and the others flush right. See `printable`."""
    header, *rows = ([printable(cell).translate(_ONE_LINE) for cell in row] for row in (header, *rows))
    widths = [max(len(row[k]) for row in (header, *rows)) for k in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        aligned = (
            cell.ljust(width) if k < left else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(cells, widths, strict=True))
        )
        return "  ".join(aligned).rstrip()

    return "\n".join([line(header), "  ".join("-" * width for width in widths), *map(line, rows)])


def distinct(value: float, limit: float, digits: int = 2) -> str:
    """Return a value rounded to the fewest digits, at least `digits`, that still show on which side of a limit it lies."""
    for count in range(digits, 17):
        rounded = float(f"{value:.{count}g}")
        if (rounded > limit) == (value > limit) and (rounded < limit) == (value < limit):
            break
    return np.format_float_positional(rounded, trim="-")
