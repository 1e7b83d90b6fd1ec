"""A campaign in words: tables for the terminal and for `summary.md`."""

from __future__ import annotations

from collections.abc import Iterator

from codegen.report.summary import table
from codegen.sweep.summary import BINS, QUANTILES, Outcome, Summary

TITLES = {
    "overshoot_percent": ("overshoot", "%"),
    "rise_time_s": ("rise time to 90 %", "s"),
    "settling_time_s": ("settling time to 2 %", "s"),
    "sideslip_abs_max_deg": ("|sideslip|, largest", "deg"),
    "slip_front_abs_max_deg": ("|front slip|, largest", "deg"),
    "slip_rear_abs_max_deg": ("|rear slip|, largest", "deg"),
    "lateral_acceleration_max_m_s2": ("lateral acceleration, largest", "m/s^2"),
    "yaw_rate_ratio_1_00_s_percent": ("yaw-rate ratio at 1 s", "%"),
    "yaw_rate_ratio_1_75_s_percent": ("yaw-rate ratio at 1.75 s", "%"),
    "lateral_displacement_m": ("lateral displacement", "m"),
}
"""Figures that are told, in order; all are in summary.json."""
SHARES = {"settled": "settled", "meets_fmvss_126": "meets FMVSS 126"}

OF_WHICH = "Figures are of the runs that did not spin before. Overshoot is over the mean of the last second, settled or not."

HEADER = ("figure", "unit", "runs", "mean", *(f"{round(100 * share)} %" for share in QUANTILES), "smallest", "largest")
WORST_HEADER = ("worst", "value", "again by")


def sections(summary: Summary, replay: str) -> Iterator[tuple[str, str]]:
    """Heading and text of each scenario and controller.

    Args:
        replay: the command that drives a run again, up to its number.
    """
    for (scenario, controller), outcome in summary.outcomes.items():
        yield f"{scenario}, {controller}", _text(outcome, replay)


def _text(outcome: Outcome, replay: str) -> str:
    shares = [f"{outcome.runs} runs", f"{outcome.spun} spun ({100.0 * outcome.spun / max(outcome.runs, 1):.3g} %)"]
    shares += [
        f"{100.0 * outcome.figures[name].mean:.4g} % of the rest {title}"
        if name == "settled"
        else f"{100.0 * outcome.figures[name].mean:.4g} % {title}"
        for name, title in SHARES.items()
        if name in outcome.figures
    ]
    rows = [
        (title, unit, str(found.count), *(f"{value:.3g}" for value in (found.mean, *found.quantiles, found.low, found.high)))
        for name, (title, unit) in TITLES.items()
        if (found := outcome.figures.get(name)) is not None
    ]
    worst = [
        (f"{TITLES[name][0]}", f"{one.value:.4g} {TITLES[name][1]}", f"{replay} {one.run}")
        for name, found in outcome.worst.items()
        for one in found[:1]
    ]
    worst += [("earliest spin", f"{one.value:.3g} s", f"{replay} {one.run}") for one in outcome.first_spins[:1]]
    parts = [", ".join(shares)]
    if rows:
        parts.append(OF_WHICH)
    parts += [table(HEADER, rows)] if rows else []
    parts += [table(WORST_HEADER, worst)] if worst else []
    return "\n\n".join(parts)


def markdown(summary: Summary, replay: str) -> str:
    """`summary.md`."""
    parts = [f"# A campaign of {summary.runs} runs", f"Quantiles are as fine as 1/{BINS} of the range of their figure."]
    for heading, text in sections(summary, replay):
        parts.append(f"## {heading}\n\n```\n{text}\n```")
    return "\n\n".join(parts) + "\n"
