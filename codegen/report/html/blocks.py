"""Content of a report as plain data: sections of paragraphs, tables and charts. `page` renders it as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from codegen.figures.data import Chart


@dataclass(frozen=True)
class Text:
    """A paragraph; `kind` is "", "lead" or "notice". In `text`, words between backticks are code."""

    text: str
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """Rows of text under a header.

    Attributes:
        caption: what it shows. header: a text for each column.
        words: columns that hold words, counted from zero; the others are numbers, flush right.
        verdicts: text of a cell -> "good" or "bad", to highlight the cell.
        hashes: whether cells are hashes or paths, in small type.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    words: Sequence[int] = (0,)
    verdicts: Mapping[str, str] = field(default_factory=dict)
    hashes: bool = False


@dataclass(frozen=True)
class Tile:
    """A figure in large type: its title, the value with its unit, and a comparison; `look` is "", "good" or "bad"."""

    title: str
    value: str
    detail: str
    look: str = ""


@dataclass(frozen=True)
class Tiles:
    """Figures side by side."""

    tiles: Sequence[Tile]


@dataclass(frozen=True)
class Gallery:
    """Charts side by side if there is room, else below each other; `width` is the minimum width of each, in CSS."""

    charts: Sequence[Chart]
    width: str = "26rem"


@dataclass(frozen=True)
class Cuts:
    """The map cut at a front angle and at a speed, moved by sliders; `data` as `maps._cut_data` makes it."""

    data: Mapping[str, Any]
    caption: str


Block = Text | Table | Tiles | Chart | Gallery | Cuts


@dataclass(frozen=True)
class Section:
    """A heading and its content; `name` is the id in the page. The section is folded unless `is_open`."""

    name: str
    title: str
    blocks: Sequence[Block]
    is_open: bool = False
