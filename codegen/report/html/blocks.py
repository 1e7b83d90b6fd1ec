"""Content of a report as plain data: sections of paragraphs, tables and charts, and the parts that Plotly figures share.

`page` renders it as HTML. Plotly is not imported.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

Figure = Mapping[str, Any]
"""A figure of Plotly as plain data: `data` and `layout`. Colours may be the names below, which follow the page's theme."""

INK, MUTED, GRID, GROUND, EMPTY = "@ink", "@muted", "@grid", "@ground", "@empty"


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
class Chart:
    """A figure with its caption.

    Attributes:
        name: unique name; the id in the page is "chart-" and this name. figure: data for Plotly. caption: text below it.
        spoken: description for a screen reader. height: in px.
    """

    name: str
    figure: Figure
    caption: str
    spoken: str
    height: int = 420


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


STOPS = 11


def scale_of(name: str) -> list[list[Any]]:
    """Return a Matplotlib colour map in Plotly's format, so that pictures and report have the same colours."""
    import matplotlib

    shares = np.linspace(0.0, 1.0, STOPS)
    colours = (np.asarray(matplotlib.colormaps[name](shares))[:, :3] * 255.0).round().astype(int)
    return [[float(share), f"rgb({red},{green},{blue})"] for share, (red, green, blue) in zip(shares, colours, strict=True)]


def cell_edges(points: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return the edges (n + 1,) of the cells around n points: halfway between points, and at the first and the last point.

    Next to a much wider gap, as at the ends of an ECU's axes, a cell extends only as far as on its other side.
    """
    at = np.asarray(points, dtype=np.float64)
    gap = np.diff(at)
    middle = at[:-1] + gap / 2.0
    for k in range(gap.size):
        before = gap[k - 1] if k > 0 else np.inf
        after = gap[k + 1] if k + 1 < gap.size else np.inf
        if gap[k] > WIDE * min(before, after):
            middle[k] = at[k] + before / 2.0 if before <= after else at[k + 1] - after / 2.0
    return np.concatenate([at[:1], middle, at[-1:]])


WIDE = 3.0


def numbers(values: npt.ArrayLike) -> dict[str, Any]:
    """Return an array in Plotly's JSON encoding: single precision, little endian, base64. NaN are gaps."""
    return _packed(np.ascontiguousarray(values, dtype="<f4"), "f4")


def small(values: npt.ArrayLike) -> dict[str, Any]:
    """Return an array of whole numbers from 0 to 255 in the same encoding."""
    return _packed(np.ascontiguousarray(values, dtype=np.uint8), "u1")


def _packed(array: npt.NDArray[Any], kind: str) -> dict[str, Any]:
    packed: dict[str, Any] = {"dtype": kind, "bdata": base64.b64encode(array.tobytes()).decode("ascii")}
    if array.ndim > 1:
        packed["shape"] = ", ".join(map(str, array.shape))
    return packed


def axis(title: str, **more: Any) -> dict[str, Any]:
    """Return a Cartesian axis in the page's colours."""
    return {
        "title": {"text": title, "standoff": 8},
        "gridcolor": GRID,
        "linecolor": MUTED,
        "zerolinecolor": MUTED,
        "zerolinewidth": 1,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": MUTED,
        "automargin": True,
        **more,
    }


def layout(**more: Any) -> dict[str, Any]:
    """Return a layout in the page's colours, with the legend below the title."""
    return {
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"color": INK, "size": 13, "family": "system-ui, 'Segoe UI', 'Noto Sans', 'DejaVu Sans', sans-serif"},
        "hoverlabel": {"bgcolor": GROUND, "bordercolor": MUTED, "font": {"color": INK}},
        "margin": {"l": 60, "r": 20, "t": 30, "b": 50},
        "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.01, "xanchor": "left", "x": 0.0},
        "hovermode": "closest",
        **more,
    }


def line(x: Any, y: Any, name: str, colour: str, **more: Any) -> dict[str, Any]:
    """Return a line; `x` and `y` are arrays."""
    look = {"color": colour, "width": more.pop("width", 2), "dash": more.pop("dash", "solid")}
    return {"type": "scatter", "mode": "lines", "x": numbers(x), "y": numbers(y), "name": name, "line": look, **more}


def patches(names: Sequence[str], colours: Sequence[str], **more: Any) -> list[dict[str, Any]]:
    """Return legend entries for a heat map of named categories."""
    marker = {"symbol": "square", "size": 12, "line": {"color": MUTED, "width": 1}}
    return [
        {
            "type": "scatter",
            "mode": "markers",
            "x": [None],
            "y": [None],
            "name": name,
            "marker": {**marker, "color": colour},
            "hoverinfo": "skip",
            **more,
        }
        for name, colour in zip(names, colours, strict=True)
    ]
