"""Pictures of the results of the test set of rear-steering controllers. Each function returns a Matplotlib Figure.

Labels are in degrees and km/h, arguments in SI units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.report import style
from codegen.report.suite_step_plots import (
    LIMIT,
    MARGIN_PANELS,
    MOTION_SIGNALS,
    cell_title,
    draw_margins,
    draw_step,
    lines_of,
    margins_figure,
    markers_of,
    name_handles,
    price_figure,
    reference_handles,
    spin_handle,
    steps_figure,
)
from hil_sim.suite.requirements import sideslip_limit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hil_sim.suite.runs import CellResult
    from hil_sim.suite.tracking import SuiteResult


SMALL: dict[str, Any] = {"markersize": 4.5, "markeredgewidth": 0.0, "zorder": 3}
ROW_SHARE, ROW_FACE = 0.9, "#F2F2F2"
"""Fraction of the row height that its marks take; background of every other row."""
LEVELS = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0)
"""Bounds of the colours, in % of overshoot."""
OVERSHOOT_TICKS = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)


def cells_figure(result: SuiteResult) -> Figure:
    """Draw the overshoot in every cell as configured and with the largest actuator lag, one panel for each subject."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    names = {"nominal", "relaxation-300", *[each.name for each in result.conditions if each.group == "lag"][-1:]}
    wanted = [condition for condition in result.conditions if condition.name in names] or list(result.conditions[:1])
    colours = ListedColormap(["#F7FBFF", "#D6E6F4", "#ABD0E6", "#F9D1B0", "#F0935A", "#B8401A"])
    scale = BoundaryNorm([*LEVELS, 1e6], colours.N)
    with style.style():
        figure = style.new_figure(2.35 * len(result.subjects) + 0.6, 2.5 * len(wanted) + 1.1)
        panels = figure.subplots(len(wanted), len(result.subjects), sharex=True, sharey=True, squeeze=False)
        for row, condition in enumerate(wanted):
            for axes, name in zip(panels[row], result.subjects, strict=True):
                _draw_cells(axes, result.results[name][condition.name], colours, scale)
                if row == 0:
                    axes.set_title(style.plain(name))
                if row == len(wanted) - 1:
                    axes.set_xlabel("Share of the angle (%)")
            panels[row, 0].set_ylabel(f"{condition.title}\n{style.SPEED_LABEL}")
        figure.suptitle("Overshoot (%) of step steers over speed and share of the largest feasible front angle")
        figure.legend(handles=_level_handles(colours), loc="outside lower center", ncols=len(LEVELS) + 1)
    return figure


def _draw_cells(axes: Axes, results: Sequence[CellResult], colours: Any, scale: Any) -> None:
    speeds = list(dict.fromkeys(one.cell.speed_km_h for one in results))
    shares = list(dict.fromkeys(one.cell.share for one in results))
    table = np.full((len(speeds), len(shares)), np.nan)
    for one in results:
        place = speeds.index(one.cell.speed_km_h), shares.index(one.cell.share)
        table[place] = np.nan if one.overshoot_percent is None else one.overshoot_percent
        dark = not one.spun and table[place] >= LEVELS[-1]
        text = "spin" if one.spun else f"{table[place]:.1f}" if table[place] < 9.95 else f"{table[place]:.0f}"
        colour = style.WHITE if one.spun or dark else style.BLACK
        axes.text(place[1], place[0], text, ha="center", va="center", fontsize=8.5, color=colour)
    axes.patch.set_facecolor(SPIN_FACE)
    edges_x, edges_y = np.arange(len(shares) + 1) - 0.5, np.arange(len(speeds) + 1) - 0.5
    axes.pcolormesh(
        edges_x, edges_y, np.ma.masked_invalid(table), cmap=colours, norm=scale, edgecolors=style.WHITE, linewidth=1.0
    )
    axes.set_xticks(range(len(shares)), [f"{100.0 * (share or 0.0):g}" for share in shares])
    axes.set_yticks(range(len(speeds)), [f"{speed:g}" for speed in speeds])
    axes.tick_params(length=0)


SPIN_FACE = "#333333"


def _level_handles(colours: Any) -> list[Any]:
    bounds = [f"{level:g}" for level in LEVELS]
    names = [f"{low} to {high} %" for low, high in pairwise(bounds)] + [f"above {bounds[-1]} %"]
    patches = [
        style.patch_handle(facecolor=colours(k), edgecolor=style.GREY, linewidth=0.5, label=name)
        for k, name in enumerate(names)
    ]
    return [*patches, style.patch_handle(facecolor=SPIN_FACE, label="the car spins")]


def conditions_figure(result: SuiteResult) -> Figure:
    """Draw the largest overshoot, map error and sideslip over the cells, and spins: rows are conditions, marks are subjects."""
    from matplotlib.ticker import FixedLocator, NullLocator

    with style.style():
        figure = style.new_figure(13.0, 0.34 * len(result.conditions) + 1.6)
        panels = figure.subplots(1, 4, sharey=True, width_ratios=(1.3, 1.0, 1.0, 0.8))
        _draw_conditions(panels[0], result, lambda each: each.overshoot_percent and each.overshoot_percent.value)
        _draw_conditions(panels[1], result, lambda each: each.sideslip_max_deg and each.sideslip_max_deg.value)
        _draw_conditions(panels[2], result, lambda each: each.map_error_percent and each.map_error_percent.value)
        _draw_conditions(panels[3], result, lambda each: float(len(each.spins)) or None)
        panels[0].set_xscale("symlog", linthresh=1.0)
        panels[0].xaxis.set(major_locator=FixedLocator(OVERSHOOT_TICKS), minor_locator=NullLocator())
        panels[0].xaxis.set_major_formatter("{x:g}")
        panels[0].set_xlim(left=-0.12)
        panels[0].set(xlabel="Largest overshoot (%)")
        panels[1].set(xlabel="Largest |sideslip| (deg)")
        panels[1].set_xlim(left=0.0)
        panels[2].set(xlabel="Error to the map, steady (%)")
        panels[2].axvline(0.0, color=style.GREY, linewidth=0.8, label="_")
        panels[3].set(xlabel=f"Spins, of {len(result.cells)} cells\n(no mark: none)", xlim=(0.0, None))
        panels[0].set_yticks(range(len(result.conditions)), [condition.title for condition in result.conditions])
        panels[0].set_ylim(len(result.conditions) - 0.5, -0.5)
        markers = markers_of(result)
        figure.suptitle("All cells under each condition; all but the spins are of those in which the car stays on the road")
        figure.legend(handles=name_handles(result, markers), loc="outside lower center", ncols=len(result.subjects))
    return figure


def _draw_conditions(axes: Axes, result: SuiteResult, figure_of: Callable[[Any], float | None]) -> None:
    markers = markers_of(result)
    for number, name in enumerate(result.subjects):
        # Shifted slightly, so that marks of equal values do not cover each other.
        shift = ROW_SHARE * ((number + 0.5) / len(result.subjects) - 0.5)
        found = [figure_of(result.summary(name, condition.name)) for condition in result.conditions]
        values = np.array([math.nan if value is None else value for value in found])
        axes.plot(values, np.arange(len(found)) + shift, label="_", clip_on=False, **{**markers[name], **SMALL})
    axes.grid(True, axis="x")
    for place in range(0, len(result.conditions), 2):
        axes.axhspan(place - 0.5, place + 0.5, color=ROW_FACE, linewidth=0.0, zorder=0.5, label="_")
    axes.tick_params(axis="y", length=0)


def slippery(result: SuiteResult) -> list[Any]:
    return [condition for condition in result.conditions if condition.group == "friction"]


def friction_figure(result: SuiteResult) -> Figure:
    """Draw the spins, and the largest sideslip of the other cells, on slippery roads with and without an estimate."""
    with style.style():
        figure = style.new_figure(1.6 * len(slippery(result)) + 1.4, 6.0)
        panels = figure.subplots(2, 1, sharex=True)
        draw_spins(panels[0], result)
        _draw_bars(panels[1], result, lambda each: each.sideslip_max_deg and each.sideslip_max_deg.value, "{:.1f}")
        panels[1].set(ylabel="Largest |sideslip| (deg)\nwhere the car stays on the road")
        limit = _draw_sideslip_limits(panels[1], result)
        figure.align_ylabels(panels)
        figure.suptitle(FRICTION_TITLE)
        looks = lines_of(result).items()
        handles = [*(style.patch_handle(color=_bar_colour(look), label=style.plain(name)) for name, look in looks), *limit]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


FRICTION_TITLE = "Slippery roads, with and without an estimate of the friction"


def _draw_sideslip_limits(axes: Axes, result: SuiteResult) -> list[Any]:
    """Draw the sideslip limit of the controller under test over each road that has one; return the legend entry."""
    for place, road in enumerate(slippery(result)):
        asked = sideslip_limit(result.limits, road)
        if asked is not None:
            axes.plot([place - 0.45, place + 0.45], [asked, asked], **LIMIT)
    return [style.line_handle(**{**LIMIT, "label": f"limit for {style.plain(result.tested)}"})]


def draw_spins(axes: Axes, result: SuiteResult) -> None:
    _draw_bars(axes, result, lambda each: float(len(each.spins)), "{:.0f}")
    axes.set(ylabel=f"Spins, of {len(result.cells)} cells")


def _draw_bars(axes: Axes, result: SuiteResult, figure_of: Callable[[Any], float | None], text: str) -> None:
    looks, roads = lines_of(result), slippery(result)
    width = 0.82 / len(result.subjects)
    for place, name in enumerate(result.subjects):
        values = [figure_of(result.summary(name, road.name)) or 0.0 for road in roads]
        at = np.arange(len(roads)) + (place - 0.5 * (len(result.subjects) - 1)) * width
        bars = axes.bar(at, values, 0.92 * width, color=_bar_colour(looks[name]), label="_", zorder=3)
        ground = {"facecolor": style.WHITE, "edgecolor": "none", "pad": 0.6}  # a line of a limit may pass there
        axes.bar_label(bars, [text.format(value) for value in values], padding=2.0, fontsize=8.0, bbox=ground)
    axes.set_xticks(*road_ticks(result, (", ",)))
    axes.tick_params(axis="x", length=0)
    axes.margins(y=0.12)
    axes.grid(True, axis="y")


def road_ticks(result: SuiteResult, ends: Iterable[str]) -> tuple[range, list[str]]:
    """Return positions and names of the roads; lines end after each of `ends`."""
    names = [road.title for road in slippery(result)]
    for end in ends:
        names = [name.replace(end, end.strip(", ") + "\n") for name in names]
    return range(len(names)), names


def _bar_colour(look: Mapping[str, Any]) -> str:
    return style.GREY if look["color"] == style.BLACK else str(look["color"])


def figures(result: SuiteResult) -> dict[str, Figure]:
    """Return name -> picture, with the file name without extension, for everything that was simulated."""
    made: dict[str, Figure] = {"overview": overview_figure(result), "steps": steps_figure(result)}
    if result.conditions:
        made["cells"] = cells_figure(result)
        made["conditions"] = conditions_figure(result)
    if result.margins:
        made["margins"] = margins_figure(result)
    if slippery(result):
        made["friction"] = friction_figure(result)
    if result.rise_times:
        made["price"] = price_figure(result)
    return made


def overview_figure(result: SuiteResult) -> Figure:
    """Draw the paper's step and a fast one with the motion of the car, and below them margins and slippery roads."""
    looks = lines_of(result)
    with style.style():
        figure = style.new_figure(12.0, 14.6)
        panels = figure.subplots(len(MOTION_SIGNALS) + 2, 2, height_ratios=(1.5, 1.0, 1.0, 1.3, 1.3))
        spun = False
        for column, shown in zip(panels[:-2].T, (result.shown[0], result.shown[-1]), strict=True):
            for axes, (label, name) in zip(column, MOTION_SIGNALS, strict=True):
                spun |= draw_step(axes, result, shown, name, looks)
                axes.sharex(column[0])
                axes.tick_params(labelbottom=axes is column[-1])
                axes.set_ylabel(label)
            column[0].set_title(f"Step steer, {cell_title(shown)}")
            column[-1].set_xlabel(style.AFTER_STEP)
        for axes, (label, field, warning) in zip(panels[-2], MARGIN_PANELS, strict=False):
            draw_margins(axes, result, label, field, warning)
            levels = ((getattr(result.limits, field), "required of the worst car"), (warning, "a build warns below"))
            for level, text in levels:
                place = {"xytext": (4, -4), "textcoords": "offset points", "va": "top", "fontsize": 8.5}
                axes.annotate(text, (axes.get_xlim()[0], level), **place)
        panels[-2, 0].set_title("Margins of the car itself (thin), and the worst of the family without slow cars")
        for column in panels[:-1].T:
            figure.align_ylabels(column)
        below = panels[-1, 0].get_gridspec()[-1, :]  # the roads need the whole width
        for axes in panels[-1]:
            axes.remove()
        if slippery(result):
            spins = figure.add_subplot(below)
            draw_spins(spins, result)
            spins.set_xticks(*road_ticks(result, (", ", "estimated ")))
            spins.set_title(FRICTION_TITLE)
        figure.suptitle(f"The controller under test ({style.plain(result.tested)}) beside its baselines")
        handles = [*name_handles(result, looks), *reference_handles(result), *([spin_handle()] if spun else [])]
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure
