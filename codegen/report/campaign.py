"""Results of a campaign: tables for the terminal and for `summary.md`, and pictures of the distributions."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from codegen.figures.data import (
    INK,
    MUTED,
    SERIES_COLOURS,
    Chart,
    Picture,
    axis,
    entry,
    legend_at,
    line,
    panel,
    plain,
    symlog,
    text,
    upright,
)
from codegen.sweep.chunk import DRIVEN
from codegen.sweep.spec import FACTORS
from codegen.sweep.summary import BINS, QUANTILES, Figure, Outcome, Summary
from codegen.text import text_table

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
    for shown in (f"{value:.3g}", f"{round(value, 2) + 0.0:.2f}" if abs(value) < 1.0 else f"{value:.0f}"):
        if len(shown) <= NUMBER_WIDTH:
            return shown
    return f"{value:.0e}"


def markdown(summary: Summary, replay: str) -> str:
    """Return the content of `summary.md`; `replay` as in `again`."""
    parts = [f"# A campaign of {summary.runs} runs", f"Quantiles have a resolution of 1/{BINS} of the range of their figure."]
    parts += [f"## {heading}\n\n```\n{text}\n```" for heading, text in sections(summary)]
    sentence, command = again(replay).split("\n")
    return "\n\n".join([*parts, f"{sentence}\n\n```\n{command}\n```"]) + "\n"


LINE_COLOURS = (*SERIES_COLOURS, INK)
DASHES = ("solid", "dash", "dashdot", "dot")
LOG_FROM = 20.0
"""Ratio of the largest value to the medians or a drawn limit above which the axis is logarithmic outside the usual range."""
FAR_FROM = 4.0
"""Ratio of the axis width with the limit to that of the data above which the limit is only named in the legend."""
TICKS_MAX = 4
"""Most ticks on each side of the linear part of such an axis."""

BELOW_AXIS = -0.16
"""Place of a legend, as a fraction of the height of its chart."""
PANEL_WIDTH, PANEL_HEIGHT = 4.6, 4.4
"""Size of a panel, in inches."""
TITLE_LENGTH = 44
"""Number of characters that fit above a panel."""
PANELS = (
    ("overshoot", "overshoot_percent", "Overshoot of the yaw rate (%)"),
    ("map-error", "map_error_percent", "Steady error to the map (%)"),
    ("sideslip", "sideslip_abs_max_deg", "Largest |β| (deg)"),
    ("ratio", "yaw_rate_ratio_1_75_s_percent", "Yaw-rate ratio 1.75 s after steering (%)"),
    ("displacement", "lateral_displacement_m", "Lateral displacement at 1.07 s (m)"),
)
"""Name of the picture, figure, label."""

LIMITS = {"yaw_rate_ratio_1_75_s_percent": (20.0, "% at most"), "lateral_displacement_m": (1.83, "m at least")}
"""Value, unit and side, of FMVSS 126, S5.2.2 and S5.2.3 (for cars up to 3,500 kg)."""
OUT_FROM = 3.0
"""The axis is shortened if the data are wider than this multiple of the usual range, which includes a drawn limit."""


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
    charts: list[Chart | None] = []
    for scenario in scenarios:
        outcomes = {name: summary.outcomes[scenario, name] for name in controllers}
        charts.append(_distributions(scenario, outcomes, figure, label))
    return Picture([charts], (0.6 + PANEL_WIDTH * len(scenarios), PANEL_HEIGHT))


def _distributions(scenario: str, outcomes: Mapping[str, Outcome], figure: str, label: str) -> Chart:
    """Return the distributions of a figure for all controllers in one scenario."""
    shown = [found.figures[figure] for found in outcomes.values() if figure in found.figures]
    x, shapes, notes = axis(label), [], []
    limit, unit = LIMITS.get(figure, (0.0, ""))
    linear, data = math.inf, []
    if shown:
        linear = _linear_range(shown, limit)
        x |= _ticks(shown, limit, linear) if math.isfinite(linear) else {}
    else:
        notes = [text("all runs spin", 0.5, 50.0, xref="paper")]
        x |= {"tickvals": [], "range": [0.0, 1.0]}
    data = [_curve(outcome.figures.get(figure), outcome, name, k, linear) for k, (name, outcome) in enumerate(outcomes.items())]
    if figure in LIMITS and shown:
        told = f"limit of FMVSS 126,<br>{limit:g} {unit}"
        if _is_near(shown, limit):
            shapes = [upright(symlog(limit, linear) if math.isfinite(linear) else limit, dash="dash")]
        else:
            told += f", far to the {'left' if limit < min(one.low for one in shown) else 'right'}"
        data.append(entry(told, MUTED, "dash", 1.2))
        if not math.isfinite(linear) and (window := _window(shown, limit)) is not None:
            x["range"], beyond = window
            data += [entry(f"{beyond:.2g} % of the runs<br>lie beyond the axis", "#FFFFFF00", "solid")] if beyond else []
    y = axis("Runs with at most that (%)", range=[0.0, 100.0])
    title = "<br>".join(textwrap.wrap(plain(scenario), TITLE_LENGTH))
    return panel(data, x, y, title=title, shapes=shapes, annotations=notes, legend=legend_at(0.5, BELOW_AXIS))


def _is_near(shown: list[Figure], limit: float) -> bool:
    low, high = min(one.low for one in shown), max(one.high for one in shown)
    return max(high, limit) - min(low, limit) <= FAR_FROM * (high - low)


def _window(shown: list[Figure], limit: float) -> tuple[list[float], float] | None:
    """Return the ends of an axis with the usual runs and a drawn limit, and the percentage of runs beyond; None for all."""
    drawn = [limit] if _is_near(shown, limit) else []
    low, high = (of([*(one.quantiles[at] for one in shown), *drawn]) for of, at in ((min, 0), (max, 2)))
    if max(one.high for one in shown) - min(one.low for one in shown) <= OUT_FROM * (high - low):
        return None
    begin, end = low - 0.5 * (high - low), high + 0.5 * (high - low)
    beyond = sum(int(one.histogram[(one.edges[1:] < begin) | (one.edges[:-1] > end)].sum()) for one in shown)
    return [begin, end], 100.0 * beyond / sum(one.count for one in shown)


def _linear_range(shown: list[Figure], limit: float) -> float:
    """Return the power of ten beyond which the scale is logarithmic, if a few runs lie far out; else infinity."""
    furthest = max(max(abs(one.low), abs(one.high)) for one in shown)
    if furthest <= LOG_FROM * max(*(abs(one.quantiles[1]) for one in shown), limit, 1e-9):
        return math.inf
    usual = max(*(abs(value) for one in shown for value in (one.quantiles[0], one.quantiles[2])), limit)
    return 10.0 ** (math.ceil(math.log10(usual)) if usual > 0.0 else 0)


def _ticks(shown: list[Figure], limit: float, linear: float) -> dict[str, Any]:
    """Return plain ticks of a scale that is logarithmic beyond `linear`."""
    furthest = max(max(abs(one.low), abs(one.high)) for one in shown)
    least = round(math.log10(linear))
    most = max(math.ceil(math.log10(furthest)), least)
    decades = [10.0**power for power in range(least, most + 1, 1 + (most - least) // TICKS_MAX)]
    low, high = min(one.low for one in shown), max(limit, *(one.high for one in shown))
    below = [-value for value in reversed(decades) if low < -0.1 * value]
    ticks = [*below, 0.0, *(value for value in decades if high > 0.1 * value)]
    return {"tickvals": [symlog(value, linear) for value in ticks], "ticktext": [f"{value:g}" for value in ticks]}


def _curve(figure: Figure | None, outcome: Outcome, name: str, place: int, linear: float) -> dict[str, Any]:
    """Return the cumulative distribution over all runs. A curve that ends below 100 % shows how many spun or lack the figure.

    If no run has the figure, the controller appears in the legend only, to show that it was simulated.
    """
    edges, share, end = np.array([np.nan]), np.array([np.nan]), ": none"
    if figure is not None:
        edges, share, end = figure.edges, np.concatenate([[0.0], 100.0 * np.cumsum(figure.histogram) / outcome.runs]), ""
        edges = np.array([symlog(edge, linear) for edge in edges]) if math.isfinite(linear) else edges
    if outcome.spun:
        end = f", {100.0 * outcome.spun / outcome.runs:.3g} % spun"
    colour = MUTED if name == "passive" else LINE_COLOURS[place % len(LINE_COLOURS)]
    return line(edges, share, f"{plain(name)}{end}", colour, dash=DASHES[(place // len(LINE_COLOURS)) % len(DASHES)])
