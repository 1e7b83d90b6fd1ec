"""Figures of n runs of one scenario, from signals (samples, n). One run is n = 1."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from codegen.arrays import FloatArray
from codegen.metrics.runs import Extremes, FigureTable, Runs, spin_times
from codegen.metrics.sine import SineWithDwell
from codegen.metrics.step import SlipOfBound, StepResponse

Figures = dict[str, FloatArray]
"""Name with its unit -> values (n,); NaN for runs without the figure. Yes and no are 1 and 0."""

METRIC_TABLES: Mapping[str, tuple[type[FigureTable], ...]] = {
    "step": (StepResponse, SlipOfBound),
    "sine-with-dwell": (SineWithDwell, Extremes),
}
"""Kind of scenario -> its tables of figures."""


def figures(kind: str, runs: Runs) -> Figures:
    """Return `spun_at_s` and the figures of a kind of scenario. Figures that a spin invalidates are NaN."""
    spun = spin_times(runs)
    found, limit = {"spun_at_s": spun}, np.where(np.isnan(spun), np.inf, spun)
    for table in (kind_of_table(runs) for kind_of_table in METRIC_TABLES[kind]):
        for figure in table.figures():
            is_valid = np.minimum(table.until(figure.name), runs.time[-1]) < limit
            found[figure.name] = np.where(is_valid, getattr(table, figure.name), np.nan)
    return found


__all__ = ["METRIC_TABLES", "Extremes", "Figures", "Runs", "SineWithDwell", "SlipOfBound", "StepResponse", "figures"]
