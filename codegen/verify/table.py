"""The checks of a build as a table for the terminal."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator

from rich import box
from rich.console import Console
from rich.table import Table

from codegen.verify.check import Outcome, Verdict
from codegen.verify.runner import CHECKS, LEFT_OUT, VerificationReport

WIDTH_MIN, WIDTH_USUAL, WIDTH_MAX = 80, 120, 160
"""Columns; as wide as the terminal, the usual where there is none."""
WIDTH_FOR_ALL = 100
"""Minimum width for the column with the property that a check shows."""

FINDINGS_PRINTED_MAX = 10
"""Maximum findings printed for a check; the JSON has all."""

TITLES = {check.name: check.title for check in CHECKS}


def table(report: VerificationReport, columns: int | None = None) -> str:
    """Return rows of check, property, figure and verdict, limited to a number of columns (default: the terminal's)."""
    width = min(max(columns or shutil.get_terminal_size((WIDTH_USUAL, 0)).columns, WIDTH_MIN), WIDTH_MAX)
    is_wide = width >= WIDTH_FOR_ALL
    drawn = Table(box=box.SIMPLE_HEAD, pad_edge=False, width=width, show_edge=False)
    drawn.add_column("check", ratio=2)
    if is_wide:
        drawn.add_column("what it shows", ratio=6)
    drawn.add_column("figure", ratio=5)
    drawn.add_column("verdict", no_wrap=True, min_width=8)
    for name, outcome in report.outcomes.items():
        shows = (outcome.shows,) if is_wide else ()
        # A partial result is not a figure of the check.
        figure = "" if outcome.verdict is Verdict.NOT_RUN else outcome.figure
        drawn.add_row(TITLES.get(name, name), *shows, figure or "-", str(outcome.verdict))
    page = io.StringIO()
    Console(file=page, width=width, force_terminal=False, no_color=True, highlight=False, markup=False, emoji=False).print(
        drawn
    )
    return "\n".join(line.rstrip() for line in page.getvalue().rstrip("\n").split("\n"))


def findings(report: VerificationReport) -> Iterator[str]:
    """Return one line for each check that failed or lacks a tool. Checks that `--quick` skips are omitted."""
    for name, outcome in report.outcomes.items():
        if outcome.verdict is not Verdict.PASSED and not _was_left_out(outcome):
            for finding in outcome.findings[:FINDINGS_PRINTED_MAX]:
                yield f"{TITLES.get(name, name)}: {finding}"
            if len(outcome.findings) > FINDINGS_PRINTED_MAX:
                yield f"{TITLES.get(name, name)}: and {len(outcome.findings) - FINDINGS_PRINTED_MAX} more"


def _was_left_out(outcome: Outcome) -> bool:
    return outcome.findings == (LEFT_OUT,)
