"""Charts of runs: signals over time, handling diagram and frequency response; figures of each run; timing on the bus."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.figures.data import BLUE, GREEN, ORANGE, VERMILION, Chart, axis, layout, numbers
from codegen.figures.runs import column, is_passive, until_spin
from codegen.figures.scenarios import handling_chart, response_chart, time_chart
from codegen.report.html.inputs import BusTimes
from codegen.report.html.page import Block, Gallery, Table, Text
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


COLOURS = (BLUE, ORANGE, VERMILION)
BINS = 120
HISTOGRAM_SPAN_MIN_MS = 0.1
"""Minimum span of a histogram, in ms."""
ANSWER = "Command after the motion frame"


def bus_blocks(logs: Sequence[BusTimes]) -> Iterator[Block]:
    """Yield histograms and a table for each log."""
    for number, log in enumerate(logs, start=1):
        yield Text(f"{log.name}: period of the frames (nominal {log.cycle:g} ms), and time from a sample to its command.")
        if log.is_simulated:
            yield Text("These times are simulated. They do not measure the timing of the ECU.", "notice")
        for text in log.findings:
            yield Text(f"{text}.", "notice")
        yield Gallery(list(_histograms(log, number)))
        rows = [_times_row(f"{name}, period", values) for name, values in log.periods.items()]
        if log.answers.size:
            rows.append(_times_row(ANSWER, log.answers))
        yield Table(f"{log.name}: times in ms", ("", "number", "median", "99 %", "least", "largest"), rows)


def _times_row(what: str, values: FloatArray) -> tuple[str, ...]:
    shares = (np.median(values), np.percentile(values, 99.0), values.min(), values.max())
    return what, f"{values.size:,}", *(f"{float(value):.3f}" for value in shares)


def _histograms(log: BusTimes, number: int) -> Iterator[Chart]:
    if log.periods:
        edges = _edges(np.concatenate(list(log.periods.values())))  # the same for all, so that they can be compared
        for k, ((name, values), colour) in enumerate(zip(log.periods.items(), COLOURS, strict=False), start=1):
            yield _histogram(values, edges, f"Period of {name} (ms)", colour, f"can-{number}-{k}")
    if log.answers.size:
        yield _histogram(log.answers, _edges(log.answers), f"{ANSWER} (ms)", GREEN, f"can-{number}-answer")


def _edges(values: FloatArray) -> FloatArray:
    low, high = float(values.min()), float(values.max())
    if high - low < HISTOGRAM_SPAN_MIN_MS:  # centre times that are all equal
        low, high = (low + high - HISTOGRAM_SPAN_MIN_MS) / 2.0, (low + high + HISTOGRAM_SPAN_MIN_MS) / 2.0
    return np.linspace(low, high, BINS + 1)


def _histogram(values: FloatArray, edges: FloatArray, title: str, colour: str, name: str) -> Chart:
    counts, _ = np.histogram(values, edges)
    bars = {
        "type": "bar",
        "x": numbers((edges[:-1] + edges[1:]) / 2.0),
        "y": counts.tolist(),
        "width": float(edges[1] - edges[0]),
        "marker": {"color": colour, "line": {"width": 0}},
        "hovertemplate": "%{y} frames around %{x:.3f} ms<extra></extra>",
    }
    look = layout(
        bargap=0.0,
        showlegend=False,
        xaxis=axis(title, range=[float(edges[0]), float(edges[-1])], zeroline=False),
        yaxis=axis("Frames", type="log", dtick=1, range=[-0.3, float(np.log10(max(int(counts.max()), 2))) + 0.2]),
    )
    told = f"{title}: median {np.median(values):.3f}, largest {values.max():.3f}."
    return Chart(name, {"data": [bars], "layout": look}, told, f"Histogram. {told}", 300)
