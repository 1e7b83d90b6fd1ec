"""Two maps compared: yaw rates beside each other, and what the first has more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from codegen.refmap.map import ReferenceMap
from codegen.report.html.blocks import Chart, Gallery
from codegen.report.html.charts import numbers, scale_of
from codegen.report.html.maps import YAW_RATE, NamedMap, colour_bar, map_layout, surfaces

FloatArray = npt.NDArray[np.float64]

LEAST = 0.01
"""deg/s that the scale of a difference spans to both sides at least."""


def comparison(one: NamedMap, other: NamedMap, number: int = 1) -> Gallery:
    """Yaw rate of two maps, and what the first has more, on the first one's axes; NaN where one of them is infeasible.

    `number` tells several comparisons in one report apart.
    """
    mine = YAW_RATE.degrees(one.map)
    theirs = on_axes_of(one.map, other.map)
    assert mine is not None
    low, high = YAW_RATE.limits([mine, theirs])
    gain = mine - theirs
    reach = max(float(np.nanmax(np.abs(gain))) if np.isfinite(gain).any() else 0.0, LEAST)
    shown = (
        (f"compare-first-{number}", one.name, mine, "viridis", low, high),
        (f"compare-second-{number}", other.name, theirs, "viridis", low, high),
        (f"compare-difference-{number}", f"{one.name} minus {other.name}", gain, "BrBG", -reach, reach),
    )
    charts = []
    for name, title, table, scale, smallest, largest in shown:
        trace = {
            "type": "heatmap",
            "x": numbers(one.speed_km_h),
            "y": numbers(one.front_angle_deg),
            "z": numbers(table.T),
            "zmin": smallest,
            "zmax": largest,
            "colorscale": scale_of(scale),
            "colorbar": colour_bar("deg/s"),
            "hoverongaps": False,
            "hovertemplate": f"{title}: %{{z:.3f}} deg/s<br>vx %{{x:.1f}} km/h, δf %{{y:.2f}} deg<extra></extra>",
        }
        figure = {"data": [trace], "layout": map_layout(one, legend=False)}
        charts.append(Chart(name, figure, f"Yaw rate: {title}.", f"Heat map of the yaw rate: {title}.", 360))
    (both,) = surfaces([one, other]).charts
    return Gallery([*charts, replace(both, name=f"{both.name}-{number}")])


def on_axes_of(one: ReferenceMap, other: ReferenceMap) -> FloatArray:
    """The other's yaw rate in deg/s, (n, m) at the first one's breakpoints: linear between its own, NaN outside.

    On a breakpoint of the other its neighbours, feasible or not, have no say.
    """
    table = YAW_RATE.degrees(other)
    assert table is not None
    row, along = _places(other.speed, one.speed)
    column, across = _places(other.front_angle, one.front_angle)
    lower, upper = (_between(table[at][:, column], table[at][:, column + 1], across) for at in (row, row + 1))
    return _between(lower, upper, along[:, np.newaxis])


ON_BREAKPOINT = 1e-9
"""Of the width of a cell: nearer than this to a breakpoint is on it."""


def _places(axis: FloatArray, at: FloatArray) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Cell and share of the way through it of each value; NaN for the share outside of the axis."""
    cell = np.clip(np.searchsorted(axis, at, side="right") - 1, 0, axis.size - 2)
    share = (at - axis[cell]) / (axis[cell + 1] - axis[cell])
    nearest = np.round(share)
    share = np.where(np.abs(share - nearest) < ON_BREAKPOINT, nearest, share)
    return cell, np.where((share >= 0.0) & (share <= 1.0), share, np.nan)


def _between(first: FloatArray, second: FloatArray, share: FloatArray) -> FloatArray:
    mixed = first + share * (second - first)
    return np.where(share == 0.0, first, np.where(share == 1.0, second, mixed))
