"""Charts of maps: over speed and front angle, cases side by side, and cut at one front angle."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import preset
from codegen.figures.data import (
    BLACK,
    BLUE,
    EMPTY,
    FRONT_ANGLE_TITLE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    SKY,
    SPEED_TITLE,
    VERMILION,
    WHITE,
    Chart,
    Picture,
    PlotError,
    axis,
    cell_range,
    layout,
    level,
    line,
    numbers,
    patches,
    plain,
    points,
    scale_of,
    stacked,
    text,
    upright,
)
from codegen.figures.paper_tables import PAPER_TABLE, TABLE_FRONT_ANGLE_DEG, TABLE_SPEED_KM_H
from codegen.map_file.bounds import MARKS, Binding, binding_text
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ALL_BINDING, BindingArray
from codegen.units import KM_H

INFEASIBLE = "grey: no steady turn inside the limits"
INFEASIBLE_NAME = "no feasible steady turn"
PHASE_NAME = "phase conversion, δ<sub>r</sub> = 0"
SPECK = 0.15
"""Pieces of the phase line with at most this fraction of the points of the longest one are not drawn."""
CONTOUR_COUNT = 8
"""Approximate number of contour lines of a map."""


def tyre_note(tyre_model: str | None) -> str:
    """Suffix of a name in captions and legends; "" for the linear tyre, and if it is unknown."""
    return "" if tyre_model in (None, "linear") else f" ({tyre_model})"


@dataclass(frozen=True)
class NamedMap:
    """A map and its name in the report."""

    name: str
    map: ReferenceMap

    @property
    def title(self) -> str:
        """Name, with the tyre of the optimisation if it is not linear, for captions and legends."""
        return f"{self.name}{tyre_note(self.map.tyre_model)}"

    @property
    def speed_km_h(self) -> FloatArray:
        """Speeds (n,) in km/h."""
        return np.asarray(self.map.speed / KM_H)

    @property
    def front_angle_deg(self) -> FloatArray:
        """Front angles (m,) in deg."""
        return np.degrees(self.map.front_angle)


def colour_limits(tables: Sequence[FloatArray], diverging: bool = False) -> tuple[float, float]:
    """Return the ends of a colour scale that several tables share; `diverging` ones are centred at zero."""
    finite = [float(np.nanmax(np.abs(table))) for table in tables if np.isfinite(table).any()]
    largest = max([*finite, 1e-6])
    return (-largest if diverging else 0.0), largest


@dataclass(frozen=True)
class MapQuantity:
    """One table of a map and its display.

    Attributes:
        attribute: attribute of the map with the values in SI, (n, m), or None if the map lacks them.
        name: name with its symbol. unit: unit of the displayed values; "deg" or "deg/s" for angles and yaw rates.
        colours: name of the colour scale; a diverging one is centred at zero.
    """

    attribute: str
    name: str
    unit: str
    colours: str
    diverging: bool

    @property
    def label(self) -> str:
        """Name and unit, for axes and colour bars."""
        return f"{self.name} ({self.unit})"

    def displayed(self, reference_map: ReferenceMap) -> FloatArray | None:
        """Return the displayed values, (n, m) in `unit`; NaN where infeasible."""
        values = getattr(reference_map, self.attribute)
        if values is None:
            return None
        shown: FloatArray = np.where(reference_map.feasible, values, np.nan)
        return np.degrees(shown) if self.unit.startswith("deg") else shown

    def limits(self, maps: Iterable[ReferenceMap]) -> tuple[float, float]:
        """Return the ends of a colour scale that several maps share."""
        return colour_limits([table for one in maps if (table := self.displayed(one)) is not None], self.diverging)


YAW_RATE = MapQuantity("yaw_rate", "Yaw rate r", "deg/s", "viridis", False)
ACCELERATION = MapQuantity("lateral_acceleration", "Lateral acceleration a<sub>y</sub>", "m/s²", "viridis", False)
SIDESLIP = MapQuantity("sideslip", "Sideslip β", "deg", "PuOr_r", True)
REAR_STEER = MapQuantity("rear_angle", "Rear angle δ<sub>r</sub>", "deg", "RdBu_r", True)
MAP_QUANTITIES = (YAW_RATE, ACCELERATION, SIDESLIP, REAR_STEER)
"""Tables of a map in pictures and in the report."""


BINDING_COLOURS = {
    int(Binding.NONE): "#F4F1E6",
    int(Binding.SLIP_FRONT | Binding.SLIP_REAR): VERMILION,
    **{int(mark.flag): mark.colour for mark in MARKS},
}
OTHER_COLOURS = ("#999933", "#882255", "#44AA99", "#332288", "#DDCC77")
"""Colours of constraint sets without a colour of their own (P. Tol's muted scheme). Still rarer sets share grey."""


def binding_colours(known: Sequence[int]) -> list[str]:
    """Return the colours of sets of binding constraints. More sets at the end do not change the colours of the first."""
    others = iter(OTHER_COLOURS)
    return [BINDING_COLOURS.get(flags) or next(others, MUTED) for flags in known]


def phase_lines(reference_map: ReferenceMap) -> list[FloatArray]:
    """Return the pieces (k, 2) of the line delta_r = 0, with speed in km/h and front angle in deg.

    There the rear wheels change from the opposite to the same direction as the front wheels. Empty if there is no such line.
    Where another bound begins between two speeds, such as the floor of the yaw rate that keeps the angle near zero, it has a
    kink there. The zero is then extrapolated from the lower speeds; a straight line across the kink would follow the grid.
    """
    from contourpy import contour_generator

    rear_angle = REAR_STEER.displayed(reference_map)
    if rear_angle is None or not (np.any(rear_angle > 1e-6) and np.any(rear_angle < -1e-6)):
        return []
    speed, front_angle = reference_map.speed / KM_H, np.degrees(reference_map.front_angle)
    if reference_map.active is not None:
        before, last, first = rear_angle[:-2], rear_angle[1:-1], rear_angle[2:]
        steps = np.diff(speed)[:, np.newaxis]
        extrapolated = last + (last - before) * steps[1:] / steps[:-1]
        begins = reference_map.active[2:] != reference_map.active[1:-1]
        is_kink = begins & (last < 0.0) & (first >= 0.0) & (extrapolated > first)
        rear_angle[2:] = np.where(is_kink, extrapolated, first)
    pieces: Any = contour_generator(speed, front_angle, np.ma.masked_invalid(rear_angle.T)).lines(0.0)
    # Where the line runs into infeasible cells, it leaves short pieces.
    longest = max((len(piece) for piece in pieces), default=0)
    return [piece for piece in pieces if len(piece) > SPECK * longest]


def heat_map_charts(one: NamedMap) -> list[Chart]:
    """Return charts of the tables and binding constraints as far as available, with the line of phase conversion."""
    tables = ((quantity, quantity.displayed(one.map)) for quantity in MAP_QUANTITIES)
    charts = [_heat_map(one, quantity, quantity.limits([one.map])) for quantity, table in tables if table is not None]
    if one.map.active is not None:
        charts.append(_binding(one, one.map.active))
    return charts


def _heat_map(one: NamedMap, quantity: MapQuantity, limits: tuple[float, float]) -> Chart:
    """Return the chart of a table, with contour lines."""
    table, title = quantity.displayed(one.map), f"{quantity.name} ({quantity.unit})"
    if table is None:
        words = [text("not in this map", 0.5, 0.5, xref="paper", yref="paper")]
        return Chart("", {"data": [], "layout": {**map_layout(one), "annotations": words}}, title=quantity.name)
    finite = table[np.isfinite(table)]
    span = f"{finite.min():.3g} to {finite.max():.3g} {quantity.unit}" if finite.size else "nowhere feasible"
    name = unformatted(quantity.name)
    lines = _phase_traces(one.map)
    data = [heat_map(one, table, name, quantity.unit, quantity.colours, limits), *_contours(one, table), *lines]
    hidden = "" if one.map.feasible.all() else f"; {INFEASIBLE}"
    spoken = f"Heat map of {name} over speed and front angle: {span}."
    figure = {"data": data, "layout": map_layout(one, legend=bool(lines))}
    chart = f"map-{quantity.attribute.replace('_', '-')}"
    return Chart(chart, figure, f"{name}, {span}{hidden}.", spoken, 420, title)


def yaw_rate_chart(one: NamedMap, more: Sequence[Mapping[str, Any]]) -> Chart:
    """Return the chart of the yaw rate with further traces, and legend entries for a picture."""
    chart = _heat_map(one, YAW_RATE, YAW_RATE.limits([one.map]))
    return _with_entries(chart, [*more, *_infeasible_entry([one.map])])


def unformatted(words: str) -> str:
    """Return a text without subscripts, for captions."""
    return words.replace("<sub>", "").replace("</sub>", "")


def _contours(one: NamedMap, table: FloatArray) -> list[dict[str, Any]]:
    """Return contour lines at round values; none for a constant table."""
    finite = table[np.isfinite(table)]
    if not finite.size or np.ptp(finite) < 1e-6 or min(table.shape) < 2:
        return []
    rough = float(np.ptp(finite)) / CONTOUR_COUNT
    decade = 10.0 ** math.floor(math.log10(rough))
    step = next(decade * factor for factor in (1.0, 2.0, 5.0, 10.0) if decade * factor >= rough)
    first = math.ceil(float(finite.min()) / step) * step
    asked = {"start": first, "end": float(finite.max()), "size": step, "coloring": "none", "showlabels": True}
    axes = {"x": numbers(one.speed_km_h), "y": numbers(one.front_angle_deg), "z": numbers(table.T)}
    look = {"line": {"color": INK, "width": 0.7}, "showscale": False, "showlegend": False, "hoverinfo": "skip"}
    return [{"type": "contour", **axes, "contours": asked, **look}]


def heat_map(
    one: NamedMap, table: FloatArray, title: str, unit: str, colours: str, limits: tuple[float, float]
) -> dict[str, Any]:
    """Return a heat map of a table (n, m) over the axes of a map."""
    return {
        "type": "heatmap",
        "x": numbers(one.speed_km_h),
        "y": numbers(one.front_angle_deg),
        "z": numbers(table.T),
        "zmin": limits[0],
        "zmax": limits[1],
        "colorscale": scale_of(colours),
        "colorbar": colour_bar(unit),
        "hoverongaps": False,
        "hovertemplate": f"{title}: %{{z:.3f}} {unit}<br>vx %{{x:.1f}} km/h, δf %{{y:.2f}} deg<extra></extra>",
    }


def colour_bar(unit: str) -> dict[str, Any]:
    """Return the colour bar of a heat map."""
    return {"title": {"text": unit, "side": "top"}, "thickness": 14, "outlinewidth": 0, "len": 1.0}


def map_layout(one: NamedMap, legend: bool = True) -> dict[str, Any]:
    """Return the layout of a chart over speed and front angle. Its background shows infeasible cells."""
    return layout(
        xaxis=axis(SPEED_TITLE, range=cell_range(one.speed_km_h), showgrid=False, zeroline=False),
        yaxis=axis(FRONT_ANGLE_TITLE, range=cell_range(one.front_angle_deg), showgrid=False, zeroline=False),
        plot_bgcolor=EMPTY,
        showlegend=legend,
    )


def _phase_traces(one: ReferenceMap) -> list[dict[str, Any]]:
    """Return the line delta_r = 0, dark with a light rim, visible on any colour."""
    pieces = phase_lines(one)
    if not pieces:
        return []
    gap = np.full((1, 2), np.nan)
    points = np.concatenate([part for piece in pieces for part in (piece, gap)])
    common = {"type": "scatter", "mode": "lines", "x": numbers(points[:, 0]), "y": numbers(points[:, 1]), "hoverinfo": "skip"}
    return [
        {**common, "line": {"color": WHITE, "width": 4.5}, "showlegend": False},
        {**common, "line": {"color": BLACK, "width": 2}, "showlegend": False},
        {**common, "x": numbers([np.nan]), "y": numbers([np.nan]), "line": {"color": INK, "width": 2}, "name": PHASE_NAME},
    ]


def _binding(one: NamedMap, active: BindingArray) -> Chart:
    found, count = np.unique(active[one.map.feasible], return_counts=True)
    flags = found[np.argsort(-count, kind="stable")].tolist()
    names, colours = [binding_text(flag) for flag in flags], binding_colours(flags)
    index = np.zeros(ALL_BINDING + 1, dtype=np.uint8)
    index[flags] = np.arange(len(flags))
    codes = np.where(one.map.feasible, index[active], 0).astype(np.uint8)
    trace = category_trace(one.speed_km_h, one.front_angle_deg, codes, ~one.map.feasible, names, colours)
    figure = {"data": [trace, *patches(names, colours), *_phase_traces(one.map)], "layout": map_layout(one)}
    spoken = f"Which constraints bind over speed and front angle: {', '.join(names)}."
    return Chart("map-binding", figure, "Which constraints bind at the optimum.", spoken, 420, "Binding constraints")


def category_trace(
    speed: FloatArray,
    angle: FloatArray,
    codes: npt.NDArray[np.uint8],
    hidden: npt.NDArray[np.bool_],
    names: Sequence[str],
    colours: Sequence[str],
) -> dict[str, Any]:
    """Return a heat map of names: codes (speeds, front angles) into `names` and `colours`; gaps where `hidden`."""
    return {
        "type": "heatmap",
        "x": numbers(speed),
        "y": numbers(angle),
        "z": numbers(np.where(hidden, np.nan, codes.astype(float)).T),
        "zmin": -0.5,
        "zmax": len(names) - 0.5,
        "colorscale": [[edge / len(names), colours[k]] for k in range(len(names)) for edge in (k, k + 1)],
        "showscale": False,
        "codes": {"cells": codes.T, "names": list(names)},  # the page derives hover texts from them
        "hoverongaps": False,
        "hovertemplate": "%{text}<br>vx %{x:.1f} km/h, δf %{y:.2f} deg<extra></extra>",
    }


def _infeasible_entry(maps: Iterable[ReferenceMap]) -> list[dict[str, Any]]:
    return [] if all(one.feasible.all() for one in maps) else patches([INFEASIBLE_NAME], [EMPTY])


def _with_entries(chart: Chart, entries: Sequence[Mapping[str, Any]]) -> Chart:
    """Return a chart of a picture with further legend entries."""
    figure = {"data": [*chart.figure["data"], *entries], "layout": {**chart.figure["layout"], "showlegend": True}}
    return Chart(chart.name, figure, title=chart.title)


def map_picture(reference_map: ReferenceMap, title: str) -> Picture:
    """Return a map over speed and front angle: its tables and binding constraints. A bare map shows only what it has."""
    first, *others = heat_map_charts(NamedMap(title, reference_map))
    charts: list[Chart | None] = [_with_entries(first, _infeasible_entry([reference_map])), *others]
    columns = min(len(charts), 2)
    charts += [None] * (-len(charts) % columns)
    rows = [charts[k : k + columns] for k in range(0, len(charts), columns)]
    return Picture(rows, (4.6 * columns, 3.5 * len(rows) + 0.4), plain(title))


def three_maps_picture(maps: Mapping[str, ReferenceMap]) -> Picture:
    """Return cases (name -> map) as rows, with the tables as columns on shared scales. Raises PlotError: no maps."""
    if not maps:
        raise PlotError("no maps to show", remedy="give at least one")
    scales = {quantity: quantity.limits(maps.values()) for quantity in MAP_QUANTITIES}
    rows = []
    for name, one in maps.items():
        charts = [_heat_map(NamedMap(name, one), quantity, limits) for quantity, limits in scales.items()]
        rows.append([Chart("", each.figure, title=_case_name(name) if k == 0 else "") for k, each in enumerate(charts)])
    rows[0][0] = _with_entries(rows[0][0], _infeasible_entry(maps.values()))
    return Picture(rows, (13.2, 1.6 + 2.5 * len(maps)))


def _case_name(name: str) -> str:
    return name.upper() if name.lower() in CASE_LOOKS else plain(name)


CASE_LOOKS: Mapping[str, tuple[str, str]] = {"fws": (MUTED, "solid"), "4ws-1": (BLUE, "solid"), "4ws-2": (VERMILION, "dash")}
OTHER_LOOKS = tuple((colour, "dashdot") for colour in (GREEN, PURPLE, ORANGE, SKY, INK))
"""Colour and dash of each case."""

PAPER_SPEED = TABLE_SPEED_KM_H * KM_H
PAPER_FRONT_ANGLE = math.radians(TABLE_FRONT_ANGLE_DEG)
"""The paper's table at this point: yaw rate in deg/s and |beta| in deg."""


def at_front_angle(reference_map: ReferenceMap, values: FloatArray, front_angle: float) -> FloatArray:
    """Return a table (n, m) along the speeds (n,) at one front angle (rad): linear in between, NaN next to infeasible cells.

    Raises:
        PlotError: the angle is outside the map.
    """
    angles = reference_map.front_angle
    place = float(np.interp(front_angle, angles, np.arange(angles.size), left=-1.0, right=-1.0))
    if not place >= 0.0:  # NaN is outside too
        low, high = np.degrees(angles[[0, -1]])
        raise PlotError(
            f"{math.degrees(front_angle):.4g} deg is outside the map's front angles",
            where="front_angle",
            remedy=f"choose {low:.4g} to {high:.4g} deg",
        )
    nearest = round(place)
    if abs(place - nearest) < 1e-9:  # on a breakpoint, the next column has no influence
        return np.array(values[:, nearest])
    left = int(place)
    share = place - left
    result: FloatArray = (1.0 - share) * values[:, left] + share * values[:, left + 1]
    return result


def front_angle_cut_picture(maps: Mapping[str, ReferenceMap], front_angle: float) -> Picture:
    """Return yaw rate and sideslip over speed at one front angle (rad), one line for each case, at feasible speeds.

    If the cut is the paper's (its car, its cases, 4 deg), the values of its table are marked.

    Raises:
        PlotError: no map, or the angle is outside one.
    """
    if not maps:
        raise PlotError("no maps to show", remedy="give at least one")
    others, data, marks = iter(OTHER_LOOKS * len(maps)), [], []
    for name, one in maps.items():
        colour, dash = CASE_LOOKS.get(name.lower()) or next(others)
        for row, (y, quantity) in enumerate((("y", YAW_RATE), ("y2", SIDESLIP))):
            table = quantity.displayed(one)
            if table is None:
                continue
            values = at_front_angle(one, table, front_angle)
            data.append(line(one.speed / KM_H, values, _case_name(name), colour, dash=dash, yaxis=y))
            if is_paper(one) and one.case == name.lower() and math.isclose(front_angle, PAPER_FRONT_ANGLE, rel_tol=1e-6):
                marks.append(paper_mark(name.lower(), row, float(np.interp(PAPER_SPEED, one.speed, values)), colour, y))
    if marks:
        marks.append(paper_mark("fws", 0, 0.0, INK, "y", is_entry=True))
    look = layout(
        **stacked((YAW_RATE.label, SIDESLIP.label), gap=0.06),
        xaxis=axis(SPEED_TITLE, anchor="y2"),
        shapes=[level(0.0, "y2", INK, "solid", 0.8), *([upright(TABLE_SPEED_KM_H)] if marks else [])],
    )
    look["yaxis"]["rangemode"] = "tozero"
    title = f"Reference maps at δ<sub>f</sub> = {math.degrees(front_angle):.4g} deg"
    return Picture([[Chart("cut", {"data": [*data, *marks], "layout": look})]], (6.4, 5.6), title)


def paper_mark(case: str, row: int, here: float, colour: str, y: str, is_entry: bool = False) -> dict[str, Any]:
    """Return the mark of the paper's table, on the side of the map's value: the table has |beta|. `is_entry`: of the legend."""
    value = math.nan if is_entry else math.copysign(PAPER_TABLE[case][row], here)
    told = f"paper, {case.upper()}: %{{y}} {('deg/s', 'deg')[row]}<extra></extra>"
    more = {"legendgroup": "paper", "legendrank": 2000, "showlegend": is_entry, "hovertemplate": told}
    ring = {"line": {"color": colour, "width": 2}}
    name = f"paper's table, {TABLE_SPEED_KM_H:g} km/h"
    return points([TABLE_SPEED_KM_H], [value], name, WHITE, "circle", 9, yaxis=y, marker=ring, **more)


def is_paper(reference_map: ReferenceMap) -> bool:
    """Return whether a map is one of the paper's: its car, its limits, and one of its cases."""
    paper, own, case = preset(), reference_map.config, reference_map.case
    if own is None or case not in PAPER_TABLE or own.cases.get(case) != paper.cases[case]:
        return False
    return (own.vehicle, own.tyre, own.road, own.limits) == (paper.vehicle, paper.tyre, paper.road, paper.limits)
