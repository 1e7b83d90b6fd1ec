"""Picture of the differences between two calibration sets: values, curves and maps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from codegen.arrays import FloatArray
from codegen.map_file.map import ReferenceMap
from codegen.report.map_difference import MAPS_SIZE, draw_map_difference
from codegen.report.style import BLUE, GREY, VERMILION, PlotError, new_figure, plain, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS, PANEL_HEIGHT, BAR_HEIGHT = 3, 2.4, 0.16
"""Panels in a row; height of a panel and of a bar in inches."""
MARKED_POINTS_MAX = 32
"""Largest number of breakpoints that have a mark each."""


@dataclass(frozen=True)
class ValueChange:
    """A value in both sets, in its unit."""

    name: str
    unit: str
    first: float
    second: float

    @property
    def percent(self) -> float:
        """Change in percent of the larger magnitude."""
        return 100.0 * (self.second - self.first) / max(abs(self.first), abs(self.second))


@dataclass(frozen=True)
class CurveChange:
    """A curve in both sets: breakpoints and numbers, (n,), with their labels."""

    name: str
    label: str
    points_label: str
    first: tuple[FloatArray, FloatArray]
    second: tuple[FloatArray, FloatArray]


def calibration_figure(
    values: Sequence[ValueChange],
    curves: Sequence[CurveChange],
    maps: tuple[ReferenceMap, ReferenceMap] | None,
    names: tuple[str, str],
) -> Figure:
    """Draw the differences between two sets.

    Args:
        values, curves: those that differ.
        maps: the maps of both sets, if they differ.
        names: names of the sets.

    Raises:
        PlotError: nothing differs.
    """
    rows = math.ceil(len(curves) / COLUMNS)
    heights = [
        *([0.7 + BAR_HEIGHT * len(values)] if values else []),
        *([0.4 + PANEL_HEIGHT * rows] if curves else []),
        *([MAPS_SIZE[1]] if maps is not None else []),
    ]
    if not heights:
        raise PlotError("the sets do not differ", remedy="draw another set")
    with style():
        figure = new_figure(MAPS_SIZE[0], sum(heights))
        parts = iter(figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0])
        if values:
            _draw_values(next(parts).subplots(), values, names)
        if curves:
            part = next(parts)
            panels = part.subplots(rows, min(len(curves), COLUMNS), squeeze=False).ravel()
            for axes, curve in zip(panels, curves, strict=False):
                _draw_curve(axes, curve)
            for axes in panels[len(curves) :]:
                axes.set_axis_off()
            handles = panels[0].get_lines()
            labels = [f"{which}: {plain(name)}" for which, name in zip(("first", "second"), names, strict=True)]
            part.legend(handles, labels, loc="outside lower center", ncols=2)
        if maps is not None:
            draw_map_difference(next(parts), maps, (None, None), names)
    return figure


def _draw_values(axes: Axes, values: Sequence[ValueChange], names: tuple[str, str]) -> None:
    places = range(len(values))
    axes.barh(places, [each.percent for each in values], color=BLUE, height=0.6)
    axes.set_yticks(places, [f"{each.name}: {each.first:.4g} → {each.second:.4g} {each.unit}".rstrip() for each in values])
    axes.invert_yaxis()
    axes.axvline(0.0, color=GREY, linewidth=0.7)
    axes.set_xlabel("change (% of the larger magnitude)")
    axes.set_title(f"Values, first ({plain(names[0])}) to second ({plain(names[1])})")


def _draw_curve(axes: Axes, curve: CurveChange) -> None:
    for (points, numbers), colour, mark in ((curve.first, BLUE, "o"), (curve.second, VERMILION, "x")):
        axes.plot(points, numbers, color=colour, marker=mark if points.size <= MARKED_POINTS_MAX else None, markersize=3.5)
    axes.set(title=curve.name, xlabel=curve.points_label, ylabel=curve.label)
