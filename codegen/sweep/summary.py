"""A finished campaign in figures: what each controller did in each scenario, and its worst runs.

The file is read twice, batch of rows by batch: memory does not grow with the campaign. Quantiles come from histograms over the
range of each figure and are as fine as their bins.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.metrics.sine import RATIOS, displacement_min
from codegen.sweep.lanes import MASS_KEY
from codegen.sweep.plan import Plan
from codegen.sweep.store import YES_NO, read_batches

Group = tuple[str, str]
"""Scenario and controller."""

BINS = 4096
QUANTILES = (0.05, 0.5, 0.95)
WORST = 5
"""Number of worst runs reported for each figure."""

JUDGED: Mapping[str, bool] = {
    "overshoot_percent": True,
    "map_overshoot_percent": True,
    "sideslip_abs_max_deg": True,
    "slip_rear_abs_max_deg": True,
    "slip_front_steady_of_bound_percent": True,
    "slip_rear_steady_of_bound_percent": True,
    "settling_time_s": True,
    "yaw_rate_ratio_1_75_s_percent": True,
    "lateral_displacement_m": False,
}
"""Figures with a report of the worst runs. True: the largest value is the worst; False: the smallest."""


@dataclass
class Figure:
    """One figure of one group.

    Attributes:
        count: runs that have it. mean, deviation, low, high: over those.
        quantiles: at QUANTILES, to (high - low)/BINS.
        histogram: (BINS,) counts of equal bins between low and high.
    """

    count: int = 0
    mean: float = 0.0
    squares: float = 0.0
    low: float = math.inf
    high: float = -math.inf
    quantiles: tuple[float, ...] = ()
    histogram: npt.NDArray[np.int64] = field(default_factory=lambda: np.zeros(BINS, dtype=np.int64))

    @property
    def deviation(self) -> float:
        """Standard deviation."""
        return math.sqrt(self.squares / self.count) if self.count else math.nan

    @property
    def edges(self) -> FloatArray:
        """Bin edges, (BINS + 1,)."""
        return self.low + (self.high - self.low) * np.arange(BINS + 1) / BINS

    def add(self, values: FloatArray) -> None:
        """First pass: update count, mean, deviation and extremes (stable sums: Chan, Golub, LeVeque, 1979)."""
        if not values.size:
            return
        mean, count = float(values.mean()), self.count + values.size
        apart = mean - self.mean
        self.squares += float(((values - mean) ** 2).sum()) + apart**2 * self.count * values.size / count
        self.mean += apart * values.size / count
        self.count = count
        self.low, self.high = min(self.low, float(values.min())), max(self.high, float(values.max()))

    def sort_in(self, values: FloatArray) -> None:
        """Second pass: add the same runs to the histogram."""
        if values.size:
            width = (self.high - self.low) or 1.0
            self.histogram += np.bincount(
                np.clip(((values - self.low) / width * BINS).astype(int), 0, BINS - 1), minlength=BINS
            )

    def finish(self) -> None:
        """Compute the quantiles from the histogram, as the middle of their bins."""
        if not self.count:
            return
        reached = np.cumsum(self.histogram)
        bins = np.searchsorted(reached, np.array(QUANTILES) * self.count)
        width = self.high - self.low
        self.quantiles = tuple(float(self.low + width * (at + 0.5) / BINS) if width else self.low for at in bins)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        names = [f"quantile_{round(100 * share)}_percent" for share in QUANTILES]
        ends = {"low": self.low, "high": self.high} if self.count else {}
        mean = {"mean": self.mean, "deviation": self.deviation} if self.count else {}
        return {"count": self.count, **mean, **ends, **dict(zip(names, self.quantiles, strict=False))}


@dataclass(frozen=True)
class Worst:
    """One of the worst runs of a figure."""

    run: int
    value: float


@dataclass
class Outcome:
    """One controller in one scenario.

    Attributes:
        runs, spun: number of runs, and of runs that spin.
        figures: figures by name.
        worst: name of a figure -> its worst runs, the worst first.
        first_spins: runs that spin, the earliest spin first: (run, s).
        failed_by: for a sine with dwell, criterion of FMVSS 126 -> number of runs that fail it; a run may fail several.
    """

    runs: int = 0
    spun: int = 0
    figures: dict[str, Figure] = field(default_factory=dict)
    worst: dict[str, list[Worst]] = field(default_factory=dict)
    first_spins: list[Worst] = field(default_factory=list)
    failed_by: dict[str, int] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""

        def rows(found: list[Worst]) -> list[dict[str, Any]]:
            return [{"run": one.run, "value": one.value} for one in found]

        return {
            "runs": self.runs,
            "spun": self.spun,
            "figures": {
                name: {"count": figure.count, "share": figure.mean} if name in YES_NO else figure.to_dict()
                for name, figure in self.figures.items()
            },
            "worst": {name: rows(found) for name, found in self.worst.items()},
            "first_spins_s": rows(self.first_spins),
            **({"fmvss_126_failed_by": self.failed_by} if self.failed_by else {}),
        }


@dataclass(frozen=True)
class Summary:
    """Summary of a campaign: outcomes by scenario and controller, in the order of the spec."""

    outcomes: Mapping[Group, Outcome]
    runs: int

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values: scenario to controller to outcome."""
        found: dict[str, dict[str, Any]] = {}
        for (scenario, controller), outcome in self.outcomes.items():
            found.setdefault(scenario, {})[controller] = outcome.to_dict()
        return {"runs": self.runs, "scenarios": found}


def summarise(path: Path, plan: Plan) -> Summary:
    """Return the summary of a finished campaign's file. Raises the errors of reading it."""
    groups = [(profile.name, controller.name) for profile in plan.profiles for controller in plan.controllers]
    outcomes = {group: Outcome() for group in groups}
    dwells = {profile.name for profile in plan.profiles if profile.kind == "sine-with-dwell"}
    for group, names, table in _by_group(path, groups):
        _count(outcomes[group], names, table)
        if group[0] in dwells:
            _count_failures(outcomes[group].failed_by, table, plan)
    for group, names, table in _by_group(path, groups):
        for name in names:
            values = table[name]
            outcomes[group].figures[name].sort_in(values[~np.isnan(values)])
    for outcome in outcomes.values():
        outcome.figures = {name: figure for name, figure in outcome.figures.items() if figure.count}
        for figure in outcome.figures.values():
            figure.finish()
    return Summary(outcomes, plan.spec.run_count)


def _by_group(path: Path, groups: list[Group]) -> Iterator[tuple[Group, list[str], dict[str, npt.NDArray[Any]]]]:
    for table in read_batches(path):
        begin = list(table).index("spun_at_s") + 1
        names = list(table)[begin:]
        for scenario, controller in groups:
            rows = (table["scenario"] == scenario) & (table["controller"] == controller)
            yield (scenario, controller), names, {name: values[rows] for name, values in table.items()}


def _count(outcome: Outcome, names: list[str], table: Mapping[str, npt.NDArray[Any]]) -> None:
    run, spun = table["run"], table["spun_at_s"]
    outcome.runs += run.size
    outcome.spun += int(np.count_nonzero(~np.isnan(spun)))
    outcome.first_spins = _merged(outcome.first_spins, run, spun, largest=False)
    for name in names:
        values = table[name]
        outcome.figures.setdefault(name, Figure()).add(values[~np.isnan(values)])
        if name in JUDGED and not np.isnan(values).all():
            outcome.worst[name] = _merged(outcome.worst.get(name, []), run, values, largest=JUDGED[name])


def _count_failures(failed_by: dict[str, int], table: Mapping[str, npt.NDArray[Any]], plan: Plan) -> None:
    """Count the failures by criterion of `codegen.metrics.sine` (FMVSS 126, S5.2); a run that spins counts as a
    spin only."""
    spun = table["spun_at_s"]
    mass = table.get(MASS_KEY, np.full(spun.size, plan.config.vehicle.mass_kg))
    fails = {"spin": ~np.isnan(spun)}
    for name, (_, most) in RATIOS.items():
        fails[name.removesuffix("_percent")] = table[name] > most
    least = displacement_min(mass * (1.0 + table.get("mass_percent", np.zeros(spun.size)) / 100.0))
    fails["lateral_displacement"] = table["lateral_displacement_m"] < least
    for name, where in fails.items():
        failed_by[name] = failed_by.get(name, 0) + int(np.count_nonzero(where))


def _merged(found: list[Worst], run: npt.NDArray[Any], values: FloatArray, *, largest: bool) -> list[Worst]:
    """Return the WORST worst runs of those found and of more; of equal ones the first."""
    known = np.flatnonzero(~np.isnan(values))
    sign = -1.0 if largest else 1.0
    order = known[np.argsort(sign * values[known], kind="stable")[:WORST]]
    more = [Worst(int(run[index]), float(values[index])) for index in order]
    return heapq.nsmallest(WORST, [*found, *more], key=lambda one: (sign * one.value, one.run))
