"""Picture of the differences between two calibration sets: values, curves and maps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from codegen.arrays import FloatArray
from codegen.figures.data import BLUE, VERMILION, Chart, Picture, PlotError, axis, line, panel, plain, upright
from codegen.map_file.map import ReferenceMap
from codegen.report.map_difference import MAPS_SIZE, difference_rows

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


def calibration_picture(
    values: Sequence[ValueChange],
    curves: Sequence[CurveChange],
    maps: tuple[ReferenceMap, ReferenceMap] | None,
    names: tuple[str, str],
) -> Picture:
    """Return the picture of the differences between two sets.

    Args:
        values, curves: those that differ.
        maps: the maps of both sets, if they differ.
        names: names of the sets.

    Raises:
        PlotError: nothing differs.
    """
    rows: list[list[Chart | None]] = []
    heights: list[float] = []
    if values:
        rows.append([_values_chart(values, names)])
        heights.append(0.7 + BAR_HEIGHT * len(values))
    charts: list[Chart | None] = [_curve_chart(curve, names) for curve in curves]
    columns = min(len(charts), COLUMNS)
    for first in range(0, len(charts), COLUMNS):
        row = charts[first : first + COLUMNS]
        rows.append(row + [None] * (columns - len(row)))
        heights.append(PANEL_HEIGHT)
    if maps is not None:
        rows += difference_rows(maps, (None, None), names)
        heights += [MAPS_SIZE[1] / 2.0] * 2
    if not rows:
        raise PlotError("the sets do not differ", remedy="draw another set")
    return Picture(rows, (MAPS_SIZE[0], 0.4 + sum(heights)), heights=heights)


def _values_chart(values: Sequence[ValueChange], names: tuple[str, str]) -> Chart:
    labels = [f"{each.name}: {each.first:.4g} → {each.second:.4g} {each.unit}".rstrip() for each in values]
    places = list(range(len(values)))
    changes = [each.percent for each in values]
    bars = {"type": "bar", "orientation": "h", "x": changes, "y": places, "width": 0.6, "marker": {"color": BLUE}}
    return panel(
        [bars],
        axis("Change (% of the larger magnitude)", zeroline=True),
        axis("", tickvals=places, ticktext=labels, range=[len(values) - 0.5, -0.5], showgrid=False),
        title=f"Values, first ({plain(names[0])}) to second ({plain(names[1])})",
        shapes=[upright(0.0, dash="solid", width=0.9)],
    )


def _curve_chart(curve: CurveChange, names: tuple[str, str]) -> Chart:
    data = []
    looks = ((curve.first, BLUE, "circle", "first"), (curve.second, VERMILION, "diamond", "second"))
    for ((at, values), colour, symbol, which), name in zip(looks, names, strict=True):
        marker = {"mode": "lines+markers", "marker": {"symbol": symbol, "size": 5.5, "color": colour}}
        drawn = line(at, values, f"{which}: {plain(name)}", colour)
        data.append({**drawn, **marker} if at.size <= MARKED_POINTS_MAX else drawn)
    return panel(data, axis(curve.points_label), axis(curve.label), title=curve.name)
