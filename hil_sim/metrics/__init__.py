"""Metrics of runs: those that belong to each scenario, for several cars.

For a car that spins, the time of the spin is reported, and no metric that depends on what follows it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from codegen.arrays import FloatArray
from codegen.configuration import Config
from hil_sim.metrics import rows, steering_response
from hil_sim.metrics.rows import step_metrics
from hil_sim.metrics.run import LookUp, Metric, Run, column, spin_time
from hil_sim.metrics.verdict import coverage, verdict
from hil_sim.scenarios import Kind, Scenario

__all__ = [
    "Evaluation",
    "Metric",
    "Run",
    "RunMetrics",
    "column",
    "coverage",
    "evaluate",
    "spin_time",
    "step_metrics",
    "verdict",
]

MEASURES: Mapping[Kind, Callable[[Run], list[Metric]]] = {
    "step": rows.measure_step,
    "ramp": steering_response.measure_ramp,
    "sine-with-dwell": rows.measure_sine_with_dwell,
    "frequency": steering_response.measure_frequency_response,
    "speed-ramp": rows.measure_speed_ramp,
    "straight": rows.measure_straight,
    "corner": rows.measure_corner,
    "path": rows.measure_path,
    "recording": rows.measure_recording,
}

SPUN = "spun"
SPIN_TITLE = "spin"


@dataclass(frozen=True)
class RunMetrics:
    """Metrics of one run.

    Attributes:
        metrics: in the order of the table; those that a spin invalidates have no value.
        spun_at: s; None for a car that stays on the road.
        invalidated: keys of the metrics that a spin invalidates.
    """

    metrics: tuple[Metric, ...]
    spun_at: float | None
    invalidated: frozenset[str]

    def __getitem__(self, key: str) -> float | bool | None:
        """Return the value of a metric by its key."""
        return next(metric.value for metric in self.metrics if metric.key == key)

    def to_dict(self) -> dict[str, float | bool | None]:
        """Return the values by key, for JSON; `spun_at_s` first."""
        return {"spun_at_s": self.spun_at, **{metric.key: metric.value for metric in self.metrics}}

    def text(self, index: int) -> str:
        """Return the value of the metric in a row as a table prints it."""
        metric = self.metrics[index]
        if metric.key in self.invalidated:
            return SPUN
        if metric.value is None:
            return "-"
        if isinstance(metric.value, bool):
            return metric.words[metric.value]
        # Adding zero removes the sign of a zero: "-0.00" would be read as a direction.
        return f"{round(metric.value, metric.digits) + 0.0:.{metric.digits}f}"


@dataclass(frozen=True)
class Evaluation:
    """Metrics of several runs of one scenario, such as "controlled" and "passive"."""

    scenario: str
    runs: Mapping[str, RunMetrics]

    def to_dict(self) -> dict[str, dict[str, float | bool | None]]:
        """Return the metrics by name of the run, for JSON."""
        return {name: metrics.to_dict() for name, metrics in self.runs.items()}

    @property
    def rows(self) -> list[tuple[str, str, tuple[str, ...]]]:
        """Title, unit and a text for each run; where a car spins, the first row has the times of the spins."""
        runs = list(self.runs.values())
        first = runs[0].metrics
        rows = [
            (metric.title, metric.unit, tuple(run.text(index) for run in runs))
            for index, metric in enumerate(first)
            # A metric that no car has, such as the reference of passive cars, is left out.
            if any(run.metrics[index].value is not None or run.metrics[index].key in run.invalidated for run in runs)
        ]
        if any(run.spun_at is not None for run in runs):
            texts = tuple("no" if run.spun_at is None else f"{SPUN} at t = {run.spun_at:.2f} s" for run in runs)
            rows.insert(0, (SPIN_TITLE, "", texts))
        return rows


def evaluate(
    scenario: Scenario, config: Config, records: Mapping[str, FloatArray], look_up: LookUp | None = None
) -> Evaluation:
    """Return the metrics that belong to a scenario.

    Args:
        scenario: the scenario of all recordings.
        config: configuration of the car.
        records: name to recording (samples, 12), columns RECORD_COLUMNS, two samples or more; in the order of the table.
        look_up: the map, `Software.map_yaw_rate`; None leaves out the errors to it.

    Raises:
        ValueError: no recording, or one that is too short.
    """
    if not records or any(len(record) < 2 for record in records.values()):
        raise ValueError("at least one recording of at least two samples is needed")
    runs = {name: Run(record, scenario, config, look_up) for name, record in records.items()}
    return Evaluation(scenario.name, {name: _of_one(run) for name, run in runs.items()})


def _of_one(run: Run) -> RunMetrics:
    measured = MEASURES[run.scenario.kind](run)
    spun_at = spin_time(run.record)
    limit = math.inf if spun_at is None else spun_at
    invalidated = frozenset(metric.key for metric in measured if min(metric.until, float(run.time[-1])) >= limit)
    metrics = tuple(replace(metric, value=None) if metric.key in invalidated else metric for metric in measured)
    return RunMetrics(metrics, spun_at, invalidated)
