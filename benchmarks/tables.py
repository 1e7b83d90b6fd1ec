"""Tables as a terminal and as a page show them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """Line of a table; `met` is True without a requirement."""

    cells: tuple[str, ...]
    met: bool = True


@dataclass(frozen=True)
class CountReport:
    """Counted results: tables of text, and notes."""

    tables: tuple[tuple[str, tuple[str, ...], tuple[Row, ...]], ...]
    notes: tuple[str, ...]

    @property
    def comparisons(self) -> tuple[Row, ...]:
        """All rows, which may have requirements."""
        return tuple(row for _, _, rows in self.tables for row in rows)

    def __str__(self) -> str:
        lines: list[str] = []
        for title, header, rows in self.tables:
            lines += [*text_table(title, header, [row.cells for row in rows]), ""]
        return "\n".join([*lines, *self.notes])

    def markdown(self) -> str:
        """Format as Markdown."""
        parts = [f"## {title}\n\n{markdown_table(header, [row.cells for row in rows])}" for title, header, rows in self.tables]
        return "\n\n".join([*parts, "\n".join(f"- {note}" for note in self.notes)]).rstrip()


def text_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Format a table for a terminal."""
    cells = [header, *rows]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells]
    rule = "-" * max(map(len, lines))
    return [title, *(f"  {line}" for line in (rule, lines[0], rule, *lines[1:], rule))]


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table as Markdown."""
    return "\n".join([f"| {' | '.join(cells)} |" for cells in (header, ["---"] * len(header), *rows)])
