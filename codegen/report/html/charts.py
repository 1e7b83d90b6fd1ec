"""Parts of Plotly figures that the report's charts share. They are plain data; Plotly is not imported."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.report.html.blocks import GRID, GROUND, INK, MUTED

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


def categories(
    codes: npt.NDArray[np.uint8], names: Sequence[str], colours: Sequence[str], hidden: npt.NDArray[np.bool_]
) -> Mapping[str, Any]:
    """Return the parts of a heat map of named categories: codes (rows, columns) into both lists; gaps where `hidden`."""
    count = len(names)
    steps = [[edge, colours[k]] for k in range(count) for edge in (k / count, (k + 1) / count)]
    return {
        "z": numbers(np.where(hidden, np.nan, codes.astype(float))),
        "zmin": -0.5,
        "zmax": count - 0.5,
        "colorscale": steps,
        "showscale": False,
    }


def patches(names: Sequence[str], colours: Sequence[str], **more: Any) -> list[dict[str, Any]]:
    """Return legend entries for `categories`."""
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
