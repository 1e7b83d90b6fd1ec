"""The language of all charts: figures of Plotly as plain data, with the palette and the parts that they share.

A page embeds them, and `codegen.figures.draw` draws them. Neither Plotly nor Matplotlib is imported.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.errors import CodegenError, one_line

Figure = Mapping[str, Any]
"""A figure of Plotly: `data` and `layout`. Values may be arrays, and colours the names below, which follow the page's theme."""

INK, MUTED, GRID, GROUND, EMPTY = "@ink", "@muted", "@grid", "@ground", "@empty"

# M. Okabe, K. Ito, Color Universal Design (2008): distinguishable with all common kinds of colour vision.
BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
BLACK, WHITE = "#000000", "#FFFFFF"
SERIES_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
"""Colours of lines without a meaning of their own."""
CONTROLLER_COLOURS = {"tracking": BLUE, "pi": VERMILION, "feedforward": GREEN, "proportional": PURPLE, "passive": INK}
"""Colour of each kind of controller, in all charts."""
SYMBOLS = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "star")

SPEED_TITLE, FRONT_ANGLE_TITLE = "Speed v<sub>x</sub> (km/h)", "Front angle δ<sub>f</sub> (deg)"
AFTER_STEP = "Time after the step (s)"
FREQUENCY_TICKS = {"type": "log", "tickvals": (0.2, 0.5, 1.0, 2.0, 3.0), "ticktext": ("0.2", "0.5", "1", "2", "3")}
"""Settings of a frequency axis in Hz."""


class PlotError(CodegenError):
    """A picture cannot be drawn from the given data, or cannot be written."""


@dataclass(frozen=True)
class Chart:
    """A figure with its caption.

    Attributes:
        name: unique name; the id in the page is "chart-" and this name. figure: data for Plotly. caption: text below it.
        spoken: description for a screen reader. height: in px.
        title: text above it in a picture, which has no caption.
    """

    name: str
    figure: Figure
    caption: str = ""
    spoken: str = ""
    height: int = 420
    title: str = ""


@dataclass(frozen=True)
class Picture:
    """Charts in rows under a title. They share one legend below, except charts with a `legend_at`.

    Attributes:
        rows: charts from left to right, which share the width of their row; None is an empty place.
        size: width and height, in inches. heights, widths: ratios of the rows, and of the charts if all rows have as many.
        font_scale: factor on all sizes of text.
    """

    rows: Sequence[Sequence[Chart | None]]
    size: tuple[float, float]
    title: str = ""
    heights: Sequence[float] | None = None
    widths: Sequence[float] | None = None
    font_scale: float = 1.0


def panel(
    data: Sequence[Mapping[str, Any]],
    x: Mapping[str, Any],
    y: Mapping[str, Any],
    *,
    title: str = "",
    shapes: Sequence[Mapping[str, Any]] = (),
    **more: Any,
) -> Chart:
    """Return a chart of a picture, of traces, axes and shapes. Further arguments are those of `layout`."""
    return Chart("", {"data": list(data), "layout": layout(xaxis=x, yaxis=y, shapes=list(shapes), **more)}, title=title)


def plain(text: object) -> str:
    """Return a user's text on one line, at most 80 characters."""
    return one_line(text, 80)


# --- values ---------------------------------------------------------------------------------------------------------


def numbers(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return numbers of a chart; NaN are gaps."""
    return np.asarray(values, dtype=np.float64)


def symlog(value: float, linear: float = 1.0) -> float:
    """Return a number on an axis that is linear up to a threshold on either side, and logarithmic beyond: one per decade."""
    share = abs(value) / linear
    return math.copysign(share if share <= 1.0 else 1.0 + math.log10(share), value)


def packed(values: npt.NDArray[Any]) -> dict[str, Any]:
    """Return an array in Plotly's JSON encoding, base64: single precision, little endian, or bytes if it has bytes."""
    kind = "u1" if values.dtype == np.uint8 else "f4"
    content = np.ascontiguousarray(values, dtype=f"<{kind}").tobytes()
    encoded: dict[str, Any] = {"dtype": kind, "bdata": base64.b64encode(content).decode("ascii")}
    if values.ndim > 1:
        encoded["shape"] = ", ".join(map(str, values.shape))
    return encoded


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


def cell_range(breakpoints: npt.NDArray[np.float64]) -> list[float]:
    """Return the outer breakpoints, extended by half a step on even axes as the cells are drawn; not below zero."""
    steps = np.diff(breakpoints)
    margin = 0.5 * float(steps[0]) if np.allclose(steps, steps[0], rtol=1e-6) else 0.0
    return [max(0.0, float(breakpoints[0]) - margin), float(breakpoints[-1]) + margin]


# --- axes and layouts -------------------------------------------------------------------------------------------------


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


def legend_at(x: float, y: float) -> dict[str, Any]:
    """Return a chart's own legend, at fractions of its width and height; in a line below the chart if `y` is negative."""
    if y < 0.0:
        return {"orientation": "h", "x": x, "y": y, "xanchor": "center", "yanchor": "top"}
    sides = ("left", "center", "right")[round(2.0 * x)], ("bottom", "middle", "top")[round(2.0 * y)]
    return {"orientation": "v", "x": x, "y": y, "xanchor": sides[0], "yanchor": sides[1]}


def stacked(titles: Sequence[str], ratios: Sequence[float] | None = None, gap: float = 0.022) -> dict[str, Any]:
    """Return y axes one below the other by their key in a layout; `ratios` are those of their heights."""
    shares = np.array(ratios or [1.0] * len(titles))
    heights = shares / shares.sum() * (1.0 - gap * (len(titles) - 1))
    tops = 1.0 - np.concatenate([[0.0], np.cumsum(heights + gap)[:-1]])
    return {
        f"yaxis{k + 1 if k else ''}": axis(title, domain=[max(0.0, float(top - height)), float(top)], nticks=5)
        for k, (title, top, height) in enumerate(zip(titles, tops, heights, strict=True))
    }


def level(value: float, y: str = "y", colour: str = MUTED, dash: str = "dot", width: float = 1.2) -> dict[str, Any]:
    """Return a horizontal line across the panel of a y axis."""
    drawn = {"color": colour, "width": width, "dash": dash}
    return {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": y, "y0": value, "y1": value, "line": drawn}


def upright(value: float, colour: str = MUTED, dash: str = "dot", width: float = 1.2) -> dict[str, Any]:
    """Return a vertical line through all panels."""
    drawn = {"color": colour, "width": width, "dash": dash}
    return {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "x0": value, "x1": value, "line": drawn}


def span(first: float, last: float, colour: str, opacity: float = 1.0) -> dict[str, Any]:
    """Return a shaded range of x through all panels."""
    shade = {"fillcolor": colour, "opacity": opacity, "line": {"width": 0}, "layer": "below"}
    return {"type": "rect", "x0": first, "x1": last, "yref": "paper", "y0": 0, "y1": 1, **shade}


def text(words: str, x: float, y: float, **more: Any) -> dict[str, Any]:
    """Return an annotation."""
    return {"text": words, "x": x, "y": y, "showarrow": False, **more}


# --- traces -----------------------------------------------------------------------------------------------------------


def line(x: Any, y: Any, name: str, colour: str, **more: Any) -> dict[str, Any]:
    """Return a line; `x` and `y` are arrays."""
    look = {"color": colour, "width": more.pop("width", 2), "dash": more.pop("dash", "solid")}
    return {"type": "scatter", "mode": "lines", "x": numbers(x), "y": numbers(y), "name": name, "line": look, **more}


def points(x: Any, y: Any, name: str, colour: str, symbol: str = "circle", size: float = 8, **more: Any) -> dict[str, Any]:
    """Return markers without a line."""
    marker = {"symbol": symbol, "size": size, "color": colour, **more.pop("marker", {})}
    return {"type": "scatter", "mode": "markers", "x": numbers(x), "y": numbers(y), "name": name, "marker": marker, **more}


def entry(name: str, colour: str, dash: str, width: float = 1.5) -> dict[str, Any]:
    """Return a legend entry for a kind of line."""
    return line([np.nan], [np.nan], name, colour, dash=dash, width=width, hoverinfo="skip")


def patches(names: Sequence[str], colours: Sequence[str], **more: Any) -> list[dict[str, Any]]:
    """Return legend entries for areas, as of named categories."""
    edge = {"line": {"color": MUTED, "width": 1}}
    return [
        points([np.nan], [np.nan], name, colour, "square", 12, marker=edge, hoverinfo="skip", **more)
        for name, colour in zip(names, colours, strict=True)
    ]


SCALES = {
    "viridis": "440154 482475 414487 355f8d 2a788e 21918c 22a884 44bf70 7ad151 bddf26 fde725",
    "PuOr_r": "2d004b 532687 8073ac b1aad1 d8daeb f7f7f6 fee0b6 fcb761 e08214 b25706 7f3b08",
    "RdBu_r": "053061 2065ab 4393c3 90c4dd d1e5f0 f7f6f6 fddbc7 f3a481 d6604d b1182b 67001f",
    "coolwarm": "3b4cc0 5977e3 7b9ff9 9ebeff c0d4f5 dddcdc f2cbb7 f7ac8e ee8468 d65244 b40426",
    "BrBG": "543005 8b500a bf812d dec17b f6e8c3 f4f5f5 c7eae5 7fccc0 35978f 01655d 003c30",
    "RdYlBu_r": "313695 4574b3 74add1 aad8e9 e0f3f8 fffebe fee090 fdad60 f46d43 d62f27 a50026",
}
"""Eleven colours of each scale of Matplotlib (viridis, coolwarm) and C. Brewer."""


def scale_of(name: str, middle: float = 0.5) -> list[list[Any]]:
    """Return a colour scale in Plotly's format; a diverging one has its middle at that share of the range."""
    colours = SCALES[name].split()
    shares = np.interp(np.linspace(0.0, 1.0, len(colours)), [0.0, 0.5, 1.0], [0.0, middle, 1.0])
    return [[float(share), f"#{colour}"] for share, colour in zip(shares, colours, strict=True)]
