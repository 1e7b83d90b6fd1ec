"""Maps as pictures: over speed and front angle, three cases side by side, and cut at one front angle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import preset
from codegen.map_file.bounds import MARKS, Binding, binding_text
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import BindingArray
from codegen.report import style
from codegen.report.paper_tables import PAPER_TABLE, TABLE_FRONT_ANGLE_DEG, TABLE_SPEED_KM_H
from codegen.units import KM_H

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BINDING_COLOURS = {
    int(Binding.NONE): "#F4F1E6",
    int(Binding.SLIP_FRONT | Binding.SLIP_REAR): style.VERMILION,
    **{int(mark.flag): mark.colour for mark in MARKS},
}
OTHER_COLOURS = ("#999933", "#882255", "#44AA99", "#332288", "#DDCC77")
"""Colours of constraint sets without a colour of their own (P. Tol's muted scheme). Still rarer sets share grey."""


def binding_colours(known: Sequence[int]) -> list[str]:
    """Return the colours of sets of binding constraints. More sets at the end do not change the colours of the first."""
    others = iter(OTHER_COLOURS)
    return [BINDING_COLOURS.get(flags) or next(others, style.GREY) for flags in known]


def map_figure(reference_map: ReferenceMap, title: str) -> Figure:
    """Draw a map over speed and front angle: yaw rate, sideslip, rear angle and binding constraints.

    A bare map shows only what it has.
    """
    shown = [quantity for quantity in style.QUANTITIES if quantity.degrees(reference_map) is not None]
    panels = len(shown) + (reference_map.active is not None)
    columns = panels if panels < 4 else 2
    rows = -(-panels // columns)
    with style.style():
        figure = style.new_figure(5.2 * columns if panels < 3 else 10.4, 3.9 * rows if panels < 3 else 3.55 * rows)
        figure.suptitle(style.plain(title))
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axes in grid.flat[panels:]:
            axes.set_visible(False)
        phase_line = False
        for axes, quantity in zip(grid.flat, shown, strict=False):
            scale = quantity.scale([reference_map])
            phase_line |= style.draw_quantity(axes, reference_map, quantity, scale)
            quantity.colour_bar(figure, axes, scale, label=quantity.unit)
            axes.set_title(quantity.name)
        _label_outer(grid)
        entries = style.map_legend(phase_line, not reference_map.feasible.all())
        if reference_map.active is not None:
            patches = _draw_binding(grid.flat[panels - 1], reference_map, reference_map.active)
            longest = max(len(str(patch.get_label())) for patch in patches)
            ncols = 3 if longest < 24 else 2 if longest < 48 else 1  # as many as fit next to the other legend
            figure.legend(handles=patches, loc="outside lower right", ncols=ncols, handlelength=1.3)
        if entries:
            figure.legend(handles=entries, loc="outside lower left")
    return figure


def _label_outer(grid: npt.NDArray[Any]) -> None:
    for axes in grid[-1]:
        axes.set_xlabel(style.SPEED_LABEL)
    for axes in grid[:, 0]:
        axes.set_ylabel(style.FRONT_ANGLE_LABEL)


def _draw_binding(axes: Axes, reference_map: ReferenceMap, active: BindingArray) -> list[Artist]:
    from matplotlib.colors import ListedColormap, Normalize

    found, count = np.unique(active[reference_map.feasible], return_counts=True)
    others = iter(OTHER_COLOURS)
    entries: dict[int, tuple[str, str]] = {}
    for flags in found[np.argsort(-count, kind="stable")].tolist():
        if (colour := BINDING_COLOURS.get(flags) or next(others, None)) is not None:
            entries[flags] = (binding_text(flags), colour)
    rarer = found.size - len(entries)
    names = [*entries.values(), *([(f"{rarer} rarer sets", style.GREY)] if rarer else [])]
    index = np.full(int(active.max()) + 1, len(entries))
    index[list(entries)] = np.arange(len(entries))
    table = np.where(reference_map.feasible, index[active].astype(float), np.nan)
    scale = Normalize(-0.5, len(names) - 0.5)
    style.draw_table(axes, reference_map, table, scale, ListedColormap([colour for _, colour in names]))
    axes.set_title("Binding constraints")
    return [style.patch_handle(facecolor=colour, edgecolor=style.GREY, linewidth=0.5, label=name) for name, colour in names]


def three_maps_figure(maps: Mapping[str, ReferenceMap]) -> Figure:
    """Draw cases (name -> map) as rows, with yaw rate, sideslip and rear angle as columns on shared scales."""
    if not maps:
        raise style.PlotError("no maps to show", remedy="give at least one")
    with style.style():
        figure = style.new_figure(10.4, 1.6 + 2.5 * len(maps))
        grid = figure.subplots(len(maps), len(style.QUANTITIES), sharex=True, sharey=True, squeeze=False)
        phase_line = False
        for axes_below, quantity in zip(grid.T, style.QUANTITIES, strict=True):
            scale = quantity.scale(maps.values())
            for axes, one in zip(axes_below, maps.values(), strict=True):
                phase_line |= style.draw_quantity(axes, one, quantity, scale)
            look = {"location": "top", "aspect": 30, "shrink": 0.9, "pad": 0.015}
            quantity.colour_bar(figure, axes_below, scale, label=quantity.label, **look)
        for axes, name in zip(grid[:, 0], maps, strict=True):
            axes.annotate(
                _case_name(name), (-0.22, 0.5), xycoords="axes fraction", rotation=90, ha="center", va="center", weight="bold"
            )
        _label_outer(grid)
        infeasible = not all(one.feasible.all() for one in maps.values())
        if entries := style.map_legend(phase_line, infeasible):
            figure.legend(handles=entries, loc="outside lower center", ncols=2)
    return figure


def _case_name(name: str) -> str:
    return name.upper() if name.lower() in CASE_LINES else style.plain(name)


CASE_LINES: Mapping[str, Mapping[str, Any]] = {
    "fws": {"color": style.GREY, "linestyle": "-"},
    "4ws-1": {"color": style.BLUE, "linestyle": "-"},
    "4ws-2": {"color": style.VERMILION, "linestyle": "--"},
}
OTHER_LINES = tuple(
    {"color": colour, "linestyle": "-."} for colour in (style.GREEN, style.PURPLE, style.ORANGE, style.SKY, style.BLACK)
)

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
        raise style.PlotError(
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


def front_angle_cut_figure(maps: Mapping[str, ReferenceMap], front_angle: float) -> Figure:
    """Draw yaw rate and sideslip over speed at one front angle (rad), one line for each case, at feasible speeds.

    If the cut is the paper's (its car, its cases, 4 deg), the values of its table are marked.

    Raises:
        PlotError: no map, or the angle is outside one.
    """
    if not maps:
        raise style.PlotError("no maps to show", remedy="give at least one")
    with style.style():
        figure = style.new_figure(6.4, 5.6)
        yaw_axes, sideslip_axes = figure.subplots(2, 1, sharex=True)
        lines = iter(OTHER_LINES * len(maps))
        marked = False
        for name, one in maps.items():
            look = CASE_LINES.get(name.lower()) or next(lines)
            for axes, quantity, entry in ((yaw_axes, style.YAW_RATE, 0), (sideslip_axes, style.SIDESLIP, 1)):
                table = quantity.degrees(one)
                if table is None:
                    continue
                values = at_front_angle(one, table, front_angle)
                axes.plot(one.speed / KM_H, values, label=_case_name(name), **look)
                if is_paper(one) and one.case == name.lower() and math.isclose(front_angle, PAPER_FRONT_ANGLE, rel_tol=1e-6):
                    here = np.interp(PAPER_SPEED, one.speed, values)
                    # The table gives |beta|; the mark is on the side of the map's value.
                    value = math.copysign(PAPER_TABLE[name.lower()][entry], here)
                    axes.plot([43.9], [value], "o", color=look["color"], markerfacecolor=style.WHITE, markersize=6, zorder=5)
                    marked = True
        _finish_cut(figure, yaw_axes, sideslip_axes, front_angle, marked)
    return figure


def is_paper(reference_map: ReferenceMap) -> bool:
    """Return whether a map is one of the paper's: its car, its limits, and one of its cases."""
    paper, own, case = preset(), reference_map.config, reference_map.case
    if own is None or case not in PAPER_TABLE or own.cases.get(case) != paper.cases[case]:
        return False
    return (own.vehicle, own.tyre, own.road, own.limits) == (paper.vehicle, paper.tyre, paper.road, paper.limits)


def _finish_cut(figure: Figure, yaw_axes: Axes, sideslip_axes: Axes, front_angle: float, marked: bool) -> None:
    handles: list[Any] = list(yaw_axes.get_lines())
    handles = [line for line in handles if not line.get_label().startswith("_")]
    if marked:
        for axes in (yaw_axes, sideslip_axes):
            axes.axvline(43.9, color=style.BLACK, linewidth=0.8, linestyle=":", zorder=0)
        ring: dict[str, Any] = {"marker": "o", "color": style.BLACK, "markerfacecolor": style.WHITE, "markersize": 6}
        handles.append(style.line_handle(linestyle=":", linewidth=0.8, label="paper's table, 43.9 km/h", **ring))
    sideslip_axes.axhline(0.0, color=style.BLACK, linewidth=0.6, zorder=1)
    for axes, quantity in ((yaw_axes, style.YAW_RATE), (sideslip_axes, style.SIDESLIP)):
        axes.set_ylabel(quantity.label)
        axes.grid(True)
    yaw_axes.set_ylim(bottom=0.0)
    sideslip_axes.set_xlabel(style.SPEED_LABEL)
    figure.align_ylabels()
    figure.suptitle(f"Reference maps at {style.FRONT_ANGLE} = {math.degrees(front_angle):.4g} deg")
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
