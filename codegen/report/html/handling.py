"""Handling diagram, frequency response, and the work of the rear actuator."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.report.html.blocks import Block, Chart, Gallery, Table, Text
from codegen.report.html.charts import axis, layout, line
from codegen.report.html.runs import colours_of, is_passive
from codegen.report.run_marks import until_spin
from codegen.report.run_plots import column
from codegen.report.scenario_plots import title_of
from hil_sim.metrics import steering_response
from hil_sim.metrics.run import Run, spin_time
from hil_sim.scenarios import BUILT_IN

Runs = Mapping[str, FloatArray]

HANDLING, RESPONSE = BUILT_IN["ramp-steer"], BUILT_IN["sine-sweep"]
"""Scenarios of the handling diagram and of the frequency response."""
TICKS = [0.2, 0.5, 1.0, 2.0, 3.0]
"""Ticks of the frequency axis, in Hz."""


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
    ramp, sweep = driven[HANDLING.name], driven[RESPONSE.name]
    yield Gallery([_handling(ramp, config), *_response(sweep, config)])
    everything = (("", runs or {}), (HANDLING.name, ramp), (RESPONSE.name, sweep))
    rows = [row for name, each in everything for row in _rows(name, each)]
    header = ("run", "angle, largest (deg)", "rate, largest (deg/s)", "rate, RMS (deg/s)", "travel (deg)")
    limits = f"the actuator allows {config.rear_actuator.angle_max_deg:g} deg and {config.rear_actuator.rate_max_deg_s:g} deg/s"
    yield Table(f"The rear actuator: {limits}", header, rows)


def _handling(runs: Runs, config: Config) -> Chart:
    """Steering-wheel angle over lateral acceleration of slowly increasing steer (ISO 4138)."""
    data, colours = [], colours_of(runs)
    for name, whole in runs.items():
        run = Run(until_spin(whole), HANDLING, config)
        shown = run.after
        angle = np.degrees(run.steering_wheel_angle)[shown]
        data.append(line(run["lateral_acceleration_m_s2"][shown], angle, name, colours[name]))
    figure = {"data": data, "layout": layout(xaxis=axis("Lateral acceleration (m/s²)"), yaxis=axis("Steering wheel (deg)"))}
    caption = f"Handling diagram. {title_of(HANDLING)}: the steeper, the more the car understeers."
    return Chart("handling", figure, caption, "Steering-wheel angle over lateral acceleration of each car.", 400)


def _response(runs: Runs, config: Config) -> Iterator[Chart]:
    """Gain and phase of the yaw rate to the steering wheel (ISO 7401)."""
    colours, found = colours_of(runs), {}
    for name, record in runs.items():
        response = (
            None if spin_time(record) is not None else steering_response.frequency_response(Run(record, RESPONSE, config))
        )
        if response is not None:
            found[name] = response
    gain = {name: 20.0 * np.log10(one.gain) for name, one in found.items()}
    phase = {name: np.degrees(one.phase) for name, one in found.items()}
    for key, title, values in (("gain", "Yaw rate / steering wheel (dB)", gain), ("phase", "Phase (deg)", phase)):
        data = [line(one.frequency, values[name], name, colours[name]) for name, one in found.items()]
        ticks = {"type": "log", "tickvals": TICKS, "ticktext": [f"{tick:g}" for tick in TICKS]}
        look = layout(xaxis=axis("Frequency (Hz)", **ticks), yaxis=axis(title))
        caption = f"Frequency response, {key}. {title_of(RESPONSE)}."
        yield Chart(f"response-{key}", {"data": data, "layout": look}, caption, f"{title} over frequency of each car.", 400)


def _rows(scenario: str, runs: Runs) -> Iterator[tuple[str, ...]]:
    """Yield the largest angle and rate, the RMS rate and the travel of the rear axle in each controlled run."""
    for name, record in runs.items():
        if is_passive(name):
            continue
        run = until_spin(record)
        time, angle = column(run, "time_s"), column(run, "rear_angle_rad")
        rate = np.diff(angle) / np.diff(time)
        figures = (np.abs(angle).max(), np.abs(rate).max(), np.sqrt(np.mean(rate**2)), np.abs(np.diff(angle)).sum())
        yield (f"{name}, {scenario}" if scenario else name, *(f"{value:.2f}" for value in figures))
