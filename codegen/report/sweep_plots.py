"""Pictures of a campaign: distributions of overshoot, sideslip and other figures for each controller."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.report.legend import fitted, height
from codegen.report.style import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, new_figure, plain, style
from codegen.sweep.summary import Figure, Outcome, Summary

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK)
LINES = ("-", "--", "-.", ":")
LOG_FROM = 20.0
"""Ratio of the largest value to the medians or a drawn limit above which the axis is logarithmic outside the usual range."""
FAR_FROM = 4.0
"""Ratio of the axis width with the limit to that of the data above which the limit is only named in the legend."""
TICKS_MAX = 4
"""Most ticks on each side of the linear part of such an axis."""

WIDTH, HEIGHT = 4.6, 4.4
"""Size of a panel, in inches."""
LEGEND_GAP_IN = 0.2
"""Gap between the legends of neighbouring panels, in inches."""
TITLE_LENGTH = 44
"""Number of characters that fit above a panel."""
LEGEND_HEIGHT = 0.9
"""Height of a panel's legend without enlarging the picture, in inches."""

PANELS = (
    ("overshoot", "overshoot_percent", "Overshoot of the yaw rate (%)"),
    ("map-error", "map_error_percent", "Steady error to the map (%)"),
    ("sideslip", "sideslip_abs_max_deg", r"Largest $|\beta|$ (deg)"),
    ("ratio", "yaw_rate_ratio_1_75_s_percent", "Yaw-rate ratio 1.75 s after steering (%)"),
    ("displacement", "lateral_displacement_m", "Lateral displacement at 1.07 s (m)"),
)
"""Name of the picture, figure, label."""

LIMITS = {"yaw_rate_ratio_1_75_s_percent": (20.0, "% at most"), "lateral_displacement_m": (1.83, "m at least")}
"""Value, unit and side, of FMVSS 126, S5.2.2 and S5.2.3 (for cars up to 3,500 kg)."""
OUT_FROM = 3.0
"""Ratio of the data's width to that of the usual runs and the limit above which the axis ends half the latter beyond them."""


def pictures(summary: Summary) -> Iterator[tuple[str, Picture]]:
    """Yield name and picture of each distribution in the campaign, with one panel for each scenario.

    Sideslip exists for every run that does not spin. Its picture also shows scenarios in which all runs spin.
    """
    for name, figure, label in PANELS:
        having = (
            scenario
            for (scenario, _), outcome in summary.outcomes.items()
            if figure in outcome.figures or (name == "sideslip" and 0 < outcome.spun == outcome.runs)
        )
        scenarios = list(dict.fromkeys(having))
        if scenarios:
            yield name, _picture(summary, scenarios, figure, label)


def _picture(summary: Summary, scenarios: list[str], figure: str, label: str) -> Picture:
    controllers = list(dict.fromkeys(controller for _, controller in summary.outcomes))
    with style():
        picture = new_figure(0.6 + WIDTH * len(scenarios), HEIGHT)
        below = 0.0
        for axes, scenario in zip(picture.subplots(1, len(scenarios), squeeze=False)[0], scenarios, strict=True):
            outcomes = {name: summary.outcomes[scenario, name] for name in controllers}
            shown = [found.figures[figure] for found in outcomes.values() if figure in found.figures]
            for place, (name, outcome) in enumerate(outcomes.items()):
                _draw(axes, outcome.figures.get(figure), outcome, plain(name), place)
            if shown:
                _scale(axes, shown, LIMITS.get(figure, (0.0, ""))[0])
            else:
                axes.text(0.5, 0.5, "all runs spin", transform=axes.transAxes, ha="center")
                axes.set_xticks([])
            axes.set_title("\n".join(textwrap.wrap(plain(scenario), TITLE_LENGTH)))
            axes.set_xlabel(label)
            axes.set_ylim(0.0, 100.0)
            axes.grid(visible=True)
            if figure in LIMITS:
                _draw_limit(axes, shown, *LIMITS[figure])
            legend = fitted(axes.get_legend_handles_labels()[0], WIDTH - LEGEND_GAP_IN, 2)
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), **legend)
            below = max(below, height(legend))
        picture.set_figheight(HEIGHT + max(0.0, below - LEGEND_HEIGHT))
        picture.axes[0].set_ylabel("Runs with at most that (%)")
        return picture


def _draw_limit(axes: Axes, shown: list[Figure], limit: float, unit: str) -> None:
    """Draw a limit, or only its legend entry if the axis would have to reach far beyond the data."""
    look: Mapping[str, Any] = {"color": GREY, "linewidth": 1.0, "linestyle": (0, (2, 2))}
    label = f"limit of FMVSS 126,\n{limit:g} {unit}"
    if _is_near(shown, limit):
        axes.axvline(limit, label=label, **look)
    else:
        side = "left" if limit < min(one.low for one in shown) else "right"
        axes.plot([], [], label=f"{label}, far to the {side}", **look)


def _is_near(shown: list[Figure], limit: float) -> bool:
    low, high = min(one.low for one in shown), max(one.high for one in shown)
    return max(high, limit) - min(low, limit) <= FAR_FROM * (high - low)


def _window(axes: Axes, shown: list[Figure], limit: float) -> None:
    """Limit the axis to the usual runs and a drawn limit. The legend contains the fraction of runs beyond the axis."""
    drawn = [limit] if _is_near(shown, limit) else []
    low, high = (of([*(one.quantiles[at] for one in shown), *drawn]) for of, at in ((min, 0), (max, 2)))
    if max(one.high for one in shown) - min(one.low for one in shown) <= OUT_FROM * (high - low):
        return
    begin, end = low - 0.5 * (high - low), high + 0.5 * (high - low)
    beyond = sum(int(one.histogram[(one.edges[1:] < begin) | (one.edges[:-1] > end)].sum()) for one in shown)
    axes.set_xlim(begin, end)
    if beyond:
        percent = 100.0 * beyond / sum(one.count for one in shown)
        axes.plot([], [], " ", label=f"{percent:.2g} % of the runs\nlie beyond the axis")


def _scale(axes: Axes, shown: list[Figure], limit: float) -> None:
    """Set a linear scale, or one that is logarithmic beyond a power of ten if a few runs lie far out, with plain ticks."""
    furthest = max(max(abs(one.low), abs(one.high)) for one in shown)
    if furthest <= LOG_FROM * max(*(abs(one.quantiles[1]) for one in shown), limit, 1e-9):
        if limit:
            _window(axes, shown, limit)
        return
    usual = max(*(abs(value) for one in shown for value in (one.quantiles[0], one.quantiles[2])), limit)
    least = math.ceil(math.log10(usual)) if usual > 0.0 else 0
    most = max(math.ceil(math.log10(furthest)), least)
    decades = [10.0**power for power in range(least, most + 1, 1 + (most - least) // TICKS_MAX)]
    axes.set_xscale("symlog", linthresh=10.0**least)
    low, high = min(one.low for one in shown), max(limit, *(one.high for one in shown))
    below = [-value for value in reversed(decades) if low < -0.1 * value]
    ticks = [*below, 0.0, *(value for value in decades if high > 0.1 * value)]
    axes.set_xticks(ticks, [f"{value:g}" for value in ticks])
    axes.minorticks_off()


def _draw(axes: Axes, figure: Figure | None, outcome: Outcome, name: str, place: int) -> None:
    """Draw the cumulative distribution over all runs. A curve that ends below 100 % shows how many spun or lack the figure.

    If no run has the figure, the controller appears in the legend only, to show that it was simulated.
    """
    edges, share, end = np.empty(0), np.empty(0), ": none"
    if figure is not None:
        edges, share, end = figure.edges, np.concatenate([[0.0], 100.0 * np.cumsum(figure.histogram) / outcome.runs]), ""
    if outcome.spun:
        end = f", {100.0 * outcome.spun / outcome.runs:.3g} % spun"
    colour = GREY if name == "passive" else COLOURS[place % len(COLOURS)]
    line = LINES[(place // len(COLOURS)) % len(LINES)]
    axes.plot(edges, share, color=colour, linestyle=line, label=f"{name}{end}")
