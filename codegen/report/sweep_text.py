"""A campaign as text: tables for the terminal and for `summary.md`."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping

from codegen.sweep.chunk import DRIVEN
from codegen.sweep.spec import FACTORS
from codegen.sweep.summary import BINS, QUANTILES, Outcome, Summary
from codegen.text_table import text_table

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
    """Describe the factors of a run besides speed, steering and road: "mass +12.3 %, delay 2 samples" from its row."""
    told = []
    for key in FACTORS:
        if key in row and key not in DRIVEN and key not in IN_TITLE:
            name, unit = next((key.removesuffix(f"_{ending}"), unit) for ending, unit in UNITS if key.endswith(f"_{ending}"))
            # A percentage of this kind, and a shift, is a change of the configured car.
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
