"""Results of a campaign: tables for the terminal and for `summary.md`, and pictures of the distributions."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.report import style
from codegen.sweep.chunk import DRIVEN
from codegen.sweep.spec import FACTORS
from codegen.sweep.summary import BINS, QUANTILES, Figure, Outcome, Summary
from codegen.text import text_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Picture


TITLES = {
    "overshoot_percent": ("overshoot", "%"),
    "map_error_percent": ("steady error to the map", "%"),
    "map_overshoot_percent": ("overshoot of the map", "%"),
    "rise_time_s": ("rise time to 90 %", "s"),
    "settling_time_s": ("settling time to 2 %", "s"),
    "sideslip_abs_max_deg": ("|sideslip|, largest", "deg"),
    "slip_front_abs_max_deg": ("|front slip|, largest", "deg"),
    "slip_rear_abs_max_deg": ("|rear slip|, largest", "deg"),
    "slip_front_steady_of_bound_percent": ("steady front slip/bound", "%"),
    "slip_rear_steady_of_bound_percent": ("steady rear slip/bound", "%"),
    "lateral_acceleration_max_m_s2": ("|a_y|, largest", "m/s^2"),
    "yaw_rate_ratio_1_00_s_percent": ("yaw-rate ratio, 1 s", "%"),
    "yaw_rate_ratio_1_75_s_percent": ("yaw-rate ratio, 1.75 s", "%"),
    "lateral_displacement_m": ("lateral displacement", "m"),
}
"""Printed figures, in order; all are in summary.json."""

CRITERIA = {
    "spin": "spin",
    "yaw_rate_ratio_1_00_s": "ratio at 1 s",
    "yaw_rate_ratio_1_75_s": "ratio at 1.75 s",
    "lateral_displacement": "lateral displacement",
}
"""Criteria of FMVSS 126: name in summary.json, and in words."""

IN_TITLE = ("friction_estimate_error", "steering_percent")
"""Factors whose results, estimate and angle, are already in the title."""
UNITS = (
    ("percent", "%"),
    ("samples", "samples"),
    ("deg_s", "deg/s"),
    ("m_s", "m/s"),
    ("km_h", "km/h"),
    ("deg", "deg"),
    ("m", "m"),
    ("s", "s"),
)
"""Suffix of a factor's key, and its unit. Longer suffixes come first."""

OF_WHICH = "Figures are of the runs that did not spin before. Overshoot is over the mean of\nthe last second, settled or not."

HEADER = ("figure", "runs", "mean", *(f"{round(100 * share)} %" for share in QUANTILES), "min", "max")
WORST_HEADER = ("worst", "value", "run")
WIDTH, NUMBER_WIDTH = 80, 5
"""Width of the text, and of a number so that a table fits, in columns."""


def sections(summary: Summary) -> Iterator[tuple[str, str]]:
    """Yield heading and text, at most 80 columns wide, of each scenario and controller."""
    for (scenario, controller), outcome in summary.outcomes.items():
        yield f"{scenario}, {controller}", _text(outcome)


def factors_of(row: Mapping[str, float]) -> str:
    """Describe the factors of a run besides speed, steering and road: "mass +12.3 %, delay 2 samples" from its row.

    The keys of a measured car, which have a dot, are not listed.
    """
    told = ["drawn car"] if any("." in key for key in row) else []
    for key in FACTORS:
        if key in row and key not in DRIVEN and key not in IN_TITLE:
            name, unit = next((key.removesuffix(f"_{ending}"), unit) for ending, unit in UNITS if key.endswith(f"_{ending}"))
            # A factor whose range includes negative numbers is a change of the configured car: it has a sign.
            sign = "+" if FACTORS[key].low < 0.0 else ""
            told.append(f"{name.replace('_', ' ')} {round(row[key], 3) + 0.0:{sign}.3g}\N{NO-BREAK SPACE}{unit}")
    return ", ".join(told)


def again(replay: str) -> str:
    """Return how to repeat a run of the tables; `replay` is the command, up to the run's number."""
    return f"Repeat any of these runs by its number RUN:\n{replay} RUN"


def _text(outcome: Outcome) -> str:
    rows = [
        (f"{title} ({unit})", str(found.count), *map(short, (found.mean, *found.quantiles, found.low, found.high)))
        for name, (title, unit) in TITLES.items()
        if (found := outcome.figures.get(name)) is not None
    ]
    worst = [
        (TITLES[name][0], f"{one.value:.4g} {TITLES[name][1]}", str(one.run))
        for name, found in outcome.worst.items()
        for one in found[:1]
    ]
    worst += [("earliest spin", f"{one.value:.3g} s", str(one.run)) for one in outcome.first_spins[:1]]
    parts = [textwrap.fill(", ".join(_shares(outcome)), WIDTH)]
    if outcome.failed_by:
        told = ", ".join(f"{CRITERIA[name]} {count}" for name, count in outcome.failed_by.items())
        parts.append(textwrap.fill(f"Fail by: {told}", WIDTH))
    parts += [OF_WHICH, text_table(HEADER, rows)] if rows else []
    parts += [text_table(WORST_HEADER, worst)] if worst else []
    return "\n\n".join(parts)


def _shares(outcome: Outcome) -> Iterator[str]:
    yield f"{outcome.runs} runs"
    yield f"{outcome.spun} spun ({100.0 * outcome.spun / max(outcome.runs, 1):.3g} %)"
    if (settled := outcome.figures.get("settled")) is not None:
        yield f"{100.0 * settled.mean:.4g} % of the rest settled"
    if (met := outcome.figures.get("meets_fmvss_126")) is not None:
        of = "" if met.count == outcome.runs else f" of the {met.count} measured"
        yield f"{100.0 * met.mean:.4g} %{of} meet FMVSS 126"
    elif "lateral_displacement_m" in outcome.figures:
        yield "FMVSS 126 not measured"


def short(value: float) -> str:
    """Return a number with three digits, or fewer if they would not fit into NUMBER_WIDTH."""
    # Adding zero removes the sign of a zero.
    for text in (f"{value:.3g}", f"{round(value, 2) + 0.0:.2f}" if abs(value) < 1.0 else f"{value:.0f}"):
        if len(text) <= NUMBER_WIDTH:
            return text
    return f"{value:.0e}"


def markdown(summary: Summary, replay: str) -> str:
    """Return the content of `summary.md`; `replay` as in `again`."""
    parts = [f"# A campaign of {summary.runs} runs", f"Quantiles have a resolution of 1/{BINS} of the range of their figure."]
    parts += [f"## {heading}\n\n```\n{text}\n```" for heading, text in sections(summary)]
    sentence, command = again(replay).split("\n")
    return "\n\n".join([*parts, f"{sentence}\n\n```\n{command}\n```"]) + "\n"


COLOURS = (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY, style.BLACK)
LINES = ("-", "--", "-.", ":")
LOG_FROM = 20.0
"""Ratio of the largest value to the medians or a drawn limit above which the axis is logarithmic outside the usual range."""
FAR_FROM = 4.0
"""Ratio of the axis width with the limit to that of the data above which the limit is only named in the legend."""
TICKS_MAX = 4
"""Most ticks on each side of the linear part of such an axis."""

PANEL_WIDTH, PANEL_HEIGHT = 4.6, 4.4
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
    with style.style():
        picture = style.new_figure(0.6 + PANEL_WIDTH * len(scenarios), PANEL_HEIGHT)
        below = 0.0
        for axes, scenario in zip(picture.subplots(1, len(scenarios), squeeze=False)[0], scenarios, strict=True):
            outcomes = {name: summary.outcomes[scenario, name] for name in controllers}
            shown = [found.figures[figure] for found in outcomes.values() if figure in found.figures]
            for place, (name, outcome) in enumerate(outcomes.items()):
                _draw(axes, outcome.figures.get(figure), outcome, style.plain(name), place)
            if shown:
                _scale(axes, shown, LIMITS.get(figure, (0.0, ""))[0])
            else:
                axes.text(0.5, 0.5, "all runs spin", transform=axes.transAxes, ha="center")
                axes.set_xticks([])
            axes.set_title("\n".join(textwrap.wrap(style.plain(scenario), TITLE_LENGTH)))
            axes.set_xlabel(label)
            axes.set_ylim(0.0, 100.0)
            axes.grid(visible=True)
            if figure in LIMITS:
                _draw_limit(axes, shown, *LIMITS[figure])
            legend = style.fitted(axes.get_legend_handles_labels()[0], PANEL_WIDTH - LEGEND_GAP_IN, 2)
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), **legend)
            below = max(below, style.height(legend))
        picture.set_figheight(PANEL_HEIGHT + max(0.0, below - LEGEND_HEIGHT))
        picture.axes[0].set_ylabel("Runs with at most that (%)")
        return picture


def _draw_limit(axes: Axes, shown: list[Figure], limit: float, unit: str) -> None:
    """Draw a limit, or only its legend entry if the axis would have to reach far beyond the data."""
    look: Mapping[str, Any] = {"color": style.GREY, "linewidth": 1.0, "linestyle": (0, (2, 2))}
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
    colour = style.GREY if name == "passive" else COLOURS[place % len(COLOURS)]
    line = LINES[(place // len(COLOURS)) % len(LINES)]
    axes.plot(edges, share, color=colour, linestyle=line, label=f"{name}{end}")
