"""Comparison of two maps: yaw rates side by side, their difference, and the figures of `map_difference`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from codegen.errors import MapError
from codegen.report.html.blocks import Block, Chart, Gallery, Table, Text
from codegen.report.html.charts import numbers, scale_of
from codegen.report.html.maps import YAW_RATE, NamedMap, colour_bar, map_layout
from codegen.report.map_difference import CAR_HEADER, DIFFERENCE_HEADER, POINT_HEADER, caveats, map_difference, on_axes_of

LEAST = 0.01
"""deg/s that the scale of a difference spans to both sides at least."""


def comparison(one: NamedMap, other: NamedMap, number: int = 1) -> Gallery:
    """Return the yaw rates of two maps and their difference on the axes of the first; NaN where one is infeasible.

    `number` distinguishes several comparisons in one report.
    """
    mine = YAW_RATE.degrees(one.map)
    theirs = np.degrees(on_axes_of(one.map, other.map))
    assert mine is not None
    low, high = YAW_RATE.limits([mine, theirs])
    gain = mine - theirs
    reach = max(float(np.nanmax(np.abs(gain))) if np.isfinite(gain).any() else 0.0, LEAST)
    shown = (
        (f"compare-first-{number}", one.title, mine, "viridis", low, high),
        (f"compare-second-{number}", other.title, theirs, "viridis", low, high),
        (f"compare-difference-{number}", f"{one.title} minus {other.title}", gain, "BrBG", -reach, reach),
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
    return Gallery(charts)


def difference_in_figures(one: NamedMap, other: NamedMap) -> Iterator[Block]:
    """Yield the tables of `codegen show --against`; a notice if the maps have no operating point in common."""
    try:
        found = map_difference(one.map, other.map)
    except MapError as error:
        yield Text(f"Not compared in figures: {error.what}.", "notice")
        return
    yield Text(
        f"First: {one.name}, second: {other.name}. Slip is that of the plant in the steady turn with the map's yaw rate."
        + "".join(f" {text[0].upper()}{text[1:]}." for text in caveats(one.map, other.map))
    )
    yield Table("Both maps in figures", CAR_HEADER, found.rows)
    yield Table("Where both are feasible", DIFFERENCE_HEADER, [found.difference_row])
    if found.points:
        yield Table("Yaw rate r (deg/s) and rear angle (deg) at a few operating points", POINT_HEADER, found.point_rows)
