"""What the test set of rear-steering controllers has shown, as text that fits 120 columns. No printing, no plotting."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from itertools import groupby
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hil_sim.suite.loop_margins import MarginPoint
    from hil_sim.suite.price import SineTracking
    from hil_sim.suite.requirements import Requirement
    from hil_sim.suite.runs import CellResult
    from hil_sim.suite.summary import Summary
    from hil_sim.suite.tracking import SuiteResult

WIDTH = 120
SPUN, NONE = "spin", "-"
BASELINE = "pi"
"""What the price of a controller is told against."""

SECONDS, DEGREES, SHARE = 0.005, 0.5, 0.005
"""Differences that are worth telling."""


def sections(result: SuiteResult) -> Iterator[tuple[str, str]]:
    """Titles and texts, in the order in which they are read."""
    yield f"What is asked, and what {result.tested} shows", requirement_table(result.requirements)
    yield from condition_tables(result)
    yield "The paper's step, C1", c1_table(result)
    if result.margins:
        yield "Margins of the feedback over speed", margin_table(result)
    if result.rise_times:
        yield "Rise time to 90 % over the amplitudes, mean / largest (s)", rise_table(result)
    yield "Sine at the steering wheel, 10 % of the largest front angle: gain over the map's / phase (deg)", sine_table(result)
    if BASELINE in result.subjects and result.tested != BASELINE:
        yield f"Where {result.tested} is worse than {BASELINE}", worse_text(result)
    if result.third_party:
        yield "Third party's multi-body car: overshoot (%) / settling (s) / largest |sideslip| (deg)", third_party_table(result)
    yield "What was tuned on what", sets_text(result)


# --- laying out --------------------------------------------------------------------------------------------------------


def columns(headers: Sequence[Sequence[str]], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Text columns below one or more lines of headers: the first `left` flush left, the others flush right."""
    widths = [max(len(row[k]) for row in (*headers, *rows)) for k in range(len(rows[0]))]

    def line(cells: Sequence[str]) -> str:
        placed = [
            cell.ljust(width) if k < left else cell.rjust(width) for k, (cell, width) in enumerate(zip(cells, widths, strict=True))
        ]
        return "  ".join(placed).rstrip()

    return "\n".join([*map(line, headers), "  ".join("-" * width for width in widths), *map(line, rows)])


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, subsequent_indent="  ")


def _number(value: float | None, digits: int) -> str:
    return NONE if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


# --- requirements ------------------------------------------------------------------------------------------------------

VERDICTS = {True: "met", False: "NOT MET", None: "not measured"}
NOTE_WIDTH = 40


def verdict(row: Requirement) -> str:
    """In words; a goal that may be missed is told from what must be met."""
    return "goal, missed" if row.stretch and row.passed is False else VERDICTS[row.passed]


def requirement_table(rows: Sequence[Requirement]) -> str:
    """Each subject matter on a line of its own, and its figures below."""
    cells: list[tuple[str, ...]] = []
    for matter, group in groupby(rows, key=lambda row: row.subject_matter):
        cells.append((matter, "", "", "", ""))
        for row in group:
            note = "" if row.passed is None else textwrap.shorten(row.note, NOTE_WIDTH, placeholder=" ...")
            cells.append((f"  {row.figure}", row.asked, measured_text(row), verdict(row), note))
    return columns([("", "asked", "measured", "", "")], cells, left=5)


def measured_text(row: Requirement) -> str:
    """With its unit."""
    if row.measured is None:
        return NONE
    digits = 0 if row.measured == int(row.measured) and not row.unit else 2
    return f"{_number(row.measured, digits)} {row.unit}".rstrip()


def failures(rows: Sequence[Requirement]) -> list[str]:
    """The figures that are not as they must be, a text for each."""
    return [
        f"{row.subject_matter}: {row.figure} {measured_text(row)} ({row.asked})"
        for row in rows
        if row.passed is False and not row.stretch
    ]


# --- by condition ------------------------------------------------------------------------------------------------------


def condition_tables(result: SuiteResult) -> Iterator[tuple[str, str]]:
    """One table for each figure: a row for each condition, a column for each subject."""
    if not result.conditions:
        return
    count = len(result.cells)
    figures: tuple[tuple[str, Callable[[Summary], str]], ...] = (
        ("Overshoot over the cells, mean / largest (%)", _overshoot),
        ("Settling time to 2 %, slowest cell (s); or how many cells never settle", _settling),
        ("Largest |sideslip| (deg)", lambda each: _number(each.sideslip_max_deg and each.sideslip_max_deg.value, 2)),
        (f"Spins, of {count} cells", lambda each: str(len(each.spins)) if each.spins else NONE),
    )
    for title, text in figures:
        rows = [
            (condition.title, *(text(result.summary(name, condition.name)) for name in result.subjects))
            for condition in result.conditions
        ]
        yield title, columns([("", *result.subjects)], rows)
    more = [f"{condition.title}: {condition.what}." for condition in result.conditions if condition.what]
    told = f"Cells: {_cells_text(result)}. A cell in which the car spins counts in the last table alone."
    yield "How to read these four tables", _wrapped(" ".join([told, *more]))


def _overshoot(summary: Summary) -> str:
    if summary.overshoot_percent is None:
        return NONE
    return f"{_number(summary.overshoot_mean_percent, 1)} / {_number(summary.overshoot_percent.value, 1)}"


def _settling(summary: Summary) -> str:
    if summary.unsettled:
        return f"{len(summary.unsettled)} never"
    return _number(summary.settling_time_s and summary.settling_time_s.value, 2)


def _cells_text(result: SuiteResult) -> str:
    speeds = [f"{speed:g}" for speed in dict.fromkeys(cell.speed_km_h for cell in result.cells)]
    shares = [f"{100.0 * share:g}" for share in dict.fromkeys(cell.share for cell in result.cells) if share is not None]
    return (
        f"step steers at {_listed(speeds)} km/h with {_listed(shares)} % of the largest feasible front angle, "
        "one sample of delay in the computation"
    )


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def c1_table(result: SuiteResult) -> str:
    """A row for each lag and figure."""
    figures = (
        ("overshoot", "%", "overshoot_percent", 1),
        ("settling to 2 %", "s", "settling_time_s", 2),
        ("rise to 90 %", "s", "rise_time_s", 2),
        ("largest |sideslip|", "deg", "sideslip_max_deg", 2),
    )
    titles = {condition.name: condition.title for condition in _lags()}
    rows = []
    for name in next(iter(result.c1.values())):
        for place, (figure, unit, field, digits) in enumerate(figures):
            runs = [result.c1[subject][name] for subject in result.subjects]
            texts = [SPUN if run.spun else _number(getattr(run, field), digits) for run in runs]
            rows.append(("" if place else titles[name], f"{figure} ({unit})", *texts))
    return columns([("", "", *result.subjects)], rows, left=2)


def _lags() -> tuple[object, ...]:
    from hil_sim.suite.conditions import LAGS

    return LAGS


# --- margins -----------------------------------------------------------------------------------------------------------


def margin_table(result: SuiteResult) -> str:
    """For each subject with feedback: the configured car, and the worst of the family."""
    names = [name for name in result.subjects if name in result.margins and name in (result.tested, BASELINE)]
    header: list[tuple[str, ...]] = [("", *_spread(f"{name}: the car itself", f"{name}: worst of the family") )] if False else []
    del header
    first, second, third = ["speed"], [""], ["km/h"]
    for name in names:
        first += [name, "", name, "", ""]
        second += ["the car", "itself", "family's", "worst", ""]
        third += ["dB", "deg", "dB", "deg", "Ms"]
    points = [list(zip(result.margins[name].configured, result.margins[name].points, strict=True)) for name in names]
    rows = []
    for at in zip(*points, strict=True):
        row = [f"{at[0][0].speed_km_h:g}"]
        for own, worst in at:
            row += [*_margins(own)[:2], *_margins(worst)]
        rows.append(row)
    return columns([first, second, third], rows)


def _margins(point: MarginPoint) -> tuple[str, str, str]:
    if not point.stable:
        return "unstable", "unstable", NONE
    return f"{point.gain_margin_db:.1f}", f"{point.phase_margin_deg:.0f}", _number(point.sensitivity, 2)
