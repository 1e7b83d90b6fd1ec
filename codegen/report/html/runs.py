"""Charts of runs: signals over time, handling diagram and frequency response; figures of each run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.figures.runs import column, is_passive, until_spin
from codegen.figures.scenarios import handling_chart, response_chart, time_chart
from codegen.report.html.blocks import Block, Gallery, Table, Text
from codegen.report.summary import metric_rows
from hil_sim.metrics import evaluate
from hil_sim.metrics.run import LookUp
from hil_sim.scenarios import BUILT_IN, Scenario


def run_blocks(
    runs: Mapping[str, FloatArray], config: Config, scenario: Scenario, look_up: LookUp | None = None
) -> Iterator[Block]:
    """Yield the chart of all runs, and a table of their figures.

    Args:
        runs: name to recording (samples, 12), columns RECORD_COLUMNS.
        config: configuration of the car, for its limits.
        scenario: scenario of the runs.
        look_up: map lookup, for the errors to the map.
    """
    if scenario.kind == "recording":
        yield Text("Evaluated as a recording. Name the scenario with `--scenario` to get its figures.", "notice")
    yield time_chart(scenario, config, runs)
    evaluation = evaluate(scenario, config, runs, look_up)
    yield Table(f"Figures of each run: {scenario.title}", ("", *evaluation.runs), metric_rows(evaluation))


Runs = Mapping[str, FloatArray]

HANDLING_SCENARIOS, RESPONSE = BUILT_IN["ramp-steer"], BUILT_IN["sine-sweep"]
"""Scenarios of the handling diagram and of the frequency response."""


def handling_blocks(driven: Mapping[str, Runs], runs: Runs | None, config: Config) -> Iterator[Block]:
    """Yield both diagrams, and the table of the actuator.

    Args:
        driven: runs by name of their scenario, HANDLING and RESPONSE; empty without a build.
        runs: runs of the report's own scenario.
        config: configuration of the car.
    """
    if not driven:
        yield Text("Not simulated: name a build with `--build`.", "notice")
        return
    ramp, sweep = driven[HANDLING_SCENARIOS.name], driven[RESPONSE.name]
    yield Gallery([handling_chart(HANDLING_SCENARIOS, config, ramp), response_chart(RESPONSE, config, sweep)])
    everything = (("", runs or {}), (HANDLING_SCENARIOS.name, ramp), (RESPONSE.name, sweep))
    rows = [row for name, each in everything for row in _actuator_rows(name, each)]
    header = ("run", "angle, largest (deg)", "rate, largest (deg/s)", "rate, RMS (deg/s)", "travel (deg)")
    limits = f"the actuator allows {config.rear_actuator.angle_max_deg:g} deg and {config.rear_actuator.rate_max_deg_s:g} deg/s"
    yield Table(f"The rear actuator: {limits}", header, rows)


def _actuator_rows(scenario: str, runs: Runs) -> Iterator[tuple[str, ...]]:
    """Yield the largest angle and rate, the RMS rate and the travel of the rear axle in each controlled run."""
    for name, record in runs.items():
        if is_passive(name):
            continue
        run = until_spin(record)
        time, angle = column(run, "time_s"), column(run, "rear_angle_rad")
        rate = np.diff(angle) / np.diff(time)
        figures = (np.abs(angle).max(), np.abs(rate).max(), np.sqrt(np.mean(rate**2)), np.abs(np.diff(angle)).sum())
        yield (f"{name}, {scenario}" if scenario else name, *(f"{value:.2f}" for value in figures))
