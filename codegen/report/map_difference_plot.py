"""Picture of two maps: both yaw rates, their difference, where each is feasible, and the slip that each uses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import one_line
from codegen.map_file.map import ReferenceMap
from codegen.optimum.nonlinear import ABOVE, SlipUse
from codegen.report.map_difference import on_axes_of
from codegen.report.run_plots import YAW_RATE_SIGNAL, column, draw_signal, looks_of, run_handles, run_window
from codegen.report.style import (
    BLACK,
    BLUE,
    FRONT_ANGLE_LABEL,
    GREY,
    ORANGE,
    SPEED_LABEL,
    VERMILION,
    WHITE,
    YAW_RATE,
    PlotError,
    draw_quantity,
    draw_table,
    map_legend,
    new_figure,
    phase_lines,
    plain,
    style,
)
from codegen.units import KM_H

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def overview_figure(config: Config, maps: Mapping[str, ReferenceMap], runs: Mapping[str, FloatArray]) -> Figure:
    """Draw the 4WS-2 map and its closed-loop step response in one wide picture, 1600 by 620 pixels.

    Raises:
        PlotError: there is no map "4ws-2", or the runs cannot be drawn.
    """
    by_name = {name.lower(): one for name, one in maps.items()}
    if "4ws-2" not in by_name:
        raise PlotError("no map 4ws-2", where=f"maps {', '.join(maps)}", remedy="solve the case 4ws-2 first")
    looks, window, reference_map = looks_of(runs), run_window(runs), by_name["4ws-2"]
    with style(1.3):
        figure = new_figure(1600 / 130, 620 / 130, dpi=130)
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.05))
        _draw_overview_map(figure, left, reference_map, runs)
        left.set_title(f"Optimal yaw-rate map 4WS-2, road friction {config.road.friction:g}")
        draw_signal(right, runs, looks, YAW_RATE_SIGNAL, window)
        right.set(xlabel="Time (s)", ylabel=YAW_RATE.label, title="Generated C in the loop: step steer")
        right.legend(handles=run_handles(right, "reference"), loc="lower right")
    return figure


def _draw_overview_map(figure: Figure, axes: Axes, reference_map: ReferenceMap, runs: Mapping[str, FloatArray]) -> None:
    scale = YAW_RATE.scale([reference_map])
    entries = map_legend(draw_quantity(axes, reference_map, YAW_RATE, scale), not reference_map.feasible.all())
    YAW_RATE.colour_bar(figure, axes, scale, label=YAW_RATE.label)
    last = next(iter(runs.values()))[-1:]
    speed, front_angle = column(last, "speed_m_s")[0], column(last, "front_angle_rad")[0]
    point: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 9, "color": VERMILION, "markeredgecolor": WHITE}
    label = f"the step: {speed:.4g} km/h, {front_angle:.3g} deg"
    entries += axes.plot([speed], [front_angle], label=label, zorder=4, **point)
    for piece in phase_lines(reference_map)[:1]:
        foot = float(piece[np.argmin(piece[:, 1]), 0])
        for side, name, align in ((-2.0, "rear wheels opposite", "right"), (2.0, "same direction", "left")):
            axes.text(foot + side, 0.35, name, color=WHITE, ha=align, va="center")
    axes.set(xlabel=SPEED_LABEL, ylabel=FRONT_ANGLE_LABEL)
    axes.legend(handles=entries, loc="upper right", frameon=True, framealpha=1.0)


COLOUR_RANGE_MIN, ABOVE_BOUND_MIN = 0.01, 10.0
"""Minimum span of a diverging scale: deg/s to both sides, and percent above the bound."""

NAME_MAX = 20
"""Largest number of characters of a map's name in a title."""

BOUND = 100.0
"""Percent."""

BOTH, DIVERGING, USE = "#D9D4C5", "BrBG", "RdYlBu_r"


def map_difference_figure(
    maps: tuple[ReferenceMap, ReferenceMap], used: tuple[SlipUse | None, SlipUse | None], names: tuple[str, str]
) -> Figure:
    """Draw two maps over speed and front angle: each on its own breakpoints, comparisons on those of the first.

    Args:
        used: `slip_use` of each map; without it, its two panels are omitted.
    """
    from matplotlib.lines import Line2D
    from matplotlib.ticker import MaxNLocator

    known = any(used)
    titles = [f"{which}: {plain(one_line(name, NAME_MAX))}" for which, name in zip(("first", "second"), names, strict=True)]
    with style():
        figure = new_figure(13.2, 7.2) if known else new_figure(9.6, 7.2)
        grid = figure.subplots(2, 3 if known else 2, sharex=True, sharey=True)
        _draw_yaw_rates(figure, grid[0][:2], maps, titles)
        gain, where = grid[:, 2] if known else grid[1]
        limits = {"xlim": grid[0][0].get_xlim(), "ylim": grid[0][0].get_ylim()}
        _draw_gain(figure, gain, maps)
        entries = _draw_where(where, maps)
        if known and _draw_use(figure, grid[1][:2], maps, used, titles):
            entries.append(Line2D([], [], color=BLACK, linewidth=1.0, label="slip meets its bound"))
        grid[0][0].set(**limits)
        for axes in grid[-1]:
            axes.set_xlabel(SPEED_LABEL)
        grid[0][0].xaxis.set_major_locator(
            MaxNLocator(5, prune="upper")
        )  # the last label would touch the first of the next panel
        for axes in grid[:, 0]:
            axes.set_ylabel(FRONT_ANGLE_LABEL)
        figure.legend(handles=entries, loc="outside lower center", ncols=len(entries))
    return figure


def _draw_yaw_rates(
    figure: Figure, panels: Sequence[Axes], maps: tuple[ReferenceMap, ReferenceMap], titles: Sequence[str]
) -> None:
    """Draw both on one scale. The first is drawn last, because its limits are those of the picture."""
    scale = YAW_RATE.scale(maps)
    for axes, one, title in reversed(list(zip(panels, maps, titles, strict=True))):
        table = YAW_RATE.degrees(one)
        assert table is not None
        draw_table(axes, one, table, scale, YAW_RATE.colours)
        axes.set_title(f"{YAW_RATE.name}, {title}")
    YAW_RATE.colour_bar(figure, list(panels), scale, label=f"yaw rate ({YAW_RATE.unit})")


def _draw_gain(figure: Figure, axes: Axes, maps: tuple[ReferenceMap, ReferenceMap]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    first, second = maps
    gain = np.degrees(first.yaw_rate - on_axes_of(first, second))
    reach = max(float(np.nanmax(np.abs(gain), initial=0.0)), COLOUR_RANGE_MIN)
    scale = Normalize(-reach, reach)
    draw_table(axes, first, gain, scale, DIVERGING)
    figure.colorbar(ScalarMappable(scale, DIVERGING), ax=axes, label=f"yaw rate ({YAW_RATE.unit})")
    axes.set_title("First less second")


def _draw_where(axes: Axes, maps: tuple[ReferenceMap, ReferenceMap]) -> list[Artist]:
    """Draw which map is feasible at the breakpoints of the first; return the legend entries."""
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.patches import Patch

    first, second = maps
    theirs = np.isfinite(on_axes_of(first, second))
    kinds = (
        (first.feasible & theirs, BOTH, "both"),
        (first.feasible & ~theirs, BLUE, "the first alone"),
        (theirs & ~first.feasible, ORANGE, "the second alone"),
    )
    table = np.full(first.feasible.shape, np.nan)
    for index, (cells, _, _) in enumerate(kinds):
        table[cells] = index
    draw_table(axes, first, table, Normalize(-0.5, len(kinds) - 0.5), ListedColormap([colour for _, colour, _ in kinds]))
    axes.set_title("Where feasible")
    patches = [
        Patch(facecolor=colour, edgecolor=GREY, linewidth=0.5, label=name) for cells, colour, name in kinds if cells.any()
    ]
    return [*patches, *map_legend(phase_line=False, infeasible=bool(np.isnan(table).any()))]


def _draw_use(
    figure: Figure,
    panels: Sequence[Axes],
    maps: tuple[ReferenceMap, ReferenceMap],
    used: tuple[SlipUse | None, SlipUse | None],
    titles: Sequence[str],
) -> bool:
    """Draw the slip of the axle that is nearer to its bound, in percent of the bound, with a line where it meets the bound.
    Return whether there is such a line."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import TwoSlopeNorm

    tables = [None if use is None else np.fmax(use.front, use.rear) for use in used]
    highest = max((float(np.nanmax(table, initial=0.0)) for table in tables if table is not None), default=0.0)
    top = max(highest, BOUND + ABOVE_BOUND_MIN)
    scale = TwoSlopeNorm(BOUND, 0.0, top)
    lines = 0
    for axes, one, table, title in zip(panels, maps, tables, titles, strict=True):
        if table is None:
            axes.text(0.5, 0.5, "contains no car", transform=axes.transAxes, ha="center")
        else:
            draw_table(axes, one, table, scale, USE)
            if (table > ABOVE).any():
                lines += 1
                held = np.ma.masked_invalid(table.T)
                axes.contour(one.speed / KM_H, np.degrees(one.front_angle), held, [ABOVE], colors=BLACK, linewidths=1.0)
        axes.set_title(f"Slip used, {title}")
    ticks = [*np.arange(0.0, BOUND, 25.0), *np.linspace(BOUND, top, 3)]
    label = "slip, of its bound on the plant (%)"
    figure.colorbar(ScalarMappable(scale, USE), ax=list(panels), label=label, ticks=ticks, format="%.0f")
    return lines > 0
