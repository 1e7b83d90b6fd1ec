"""Marks in the panels of a run: moments, time spans, and where a car spins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.report.style import GREY, WHITE

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FAULT_COLOUR = "#F3D9CC"
SPIN_NAME = "spin: the run ends here"
SPIN_MARKER: dict[str, Any] = {"linestyle": "", "marker": "X", "markersize": 8, "markeredgecolor": WHITE}


@dataclass(frozen=True)
class Mark:
    """A time (s) that is marked in every panel, and its label above the first one."""

    time: float
    label: str


@dataclass(frozen=True)
class Span:
    """A time range (s) that is shaded in every panel, and its name in the legend."""

    start: float
    end: float
    label: str


def until_spin(run: FloatArray) -> FloatArray:
    """Return a run up to the sample in which the car spins, at least two samples; the whole run if it does not spin."""
    from hil_sim.metrics import spin_time

    time = spin_time(run)
    return run if time is None else run[: max(int(np.searchsorted(run[:, 0], time)) + 1, 2)]


def spin_handles(runs: Mapping[str, FloatArray], spun: Mapping[str, FloatArray]) -> list[Any]:
    """Return the legend entry for the mark of a spin, if a run was cut at one."""
    from matplotlib.lines import Line2D

    if all(len(spun[name]) == len(run) for name, run in runs.items()):
        return []
    return [Line2D([], [], color=GREY, label=SPIN_NAME, **SPIN_MARKER)]


def draw_spans(panels: Sequence[Axes], spans: Sequence[Span]) -> list[Any]:
    """Shade time ranges and return their legend entry."""
    from matplotlib.patches import Patch

    for axes in panels:
        for span in spans:
            axes.axvspan(span.start, span.end, color=FAULT_COLOUR, linewidth=0.0, zorder=0.5)
    names = list(dict.fromkeys(span.label for span in spans))
    return [Patch(color=FAULT_COLOUR, label=", ".join(names))] if names else []


def draw_marks(panels: Sequence[Axes], marks: Sequence[Mark]) -> None:
    """Draw lines through all panels, labelled above the first one."""
    for axes in panels:
        for mark in marks:
            axes.axvline(mark.time, color=GREY, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=1.5, label="_")
    for mark in marks:
        panels[0].annotate(
            mark.label,
            (mark.time, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8.5,
        )
