"""Picture of a scenario: over time, or in the form that its standard uses."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import one_line
from codegen.metrics.sine_with_dwell import DISPLACEMENT_TIME, RATIOS, SineWithDwell
from codegen.report import style
from codegen.report.run_plots import Mark, Span, heading, looks_of, run_figure, signal_limits, until_spin

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hil_sim.metrics.run import LookUp, Run
    from hil_sim.scenarios import Scenario

FIT_LINE: dict[str, Any] = {"linestyle": (0, (4, 2)), "linewidth": 1.1}
GUIDE: dict[str, Any] = {"color": style.GREY, "linewidth": 0.9, "linestyle": (0, (1, 1.5)), "zorder": 1.5, "label": "_"}
CONTROLLED = "controlled"
"""Name of the build's run in `runs`."""
TITLE_LENGTH = 64
"""Largest number of characters of name and title on one line."""
LINE_LENGTH = 78
"""Largest number of characters on one line."""


def scenario_figure(
    scenario: Scenario,
    config: Config,
    runs: Mapping[str, FloatArray],
    name: str = "",
    details: str = "",
    look_up: LookUp | None = None,
) -> Figure:
    """Draw the runs of a scenario.

    Args:
        scenario: scenario of the runs.
        config: configuration of the car.
        runs: name -> array with columns RECORD_COLUMNS; see `run_figure`.
        name: name of the build, for the title.
        details: details of the car and the run, below the title; long lines are wrapped.
        look_up: map lookup, to draw the map's steady yaw rate over time; None omits it.

    Raises:
        PlotError: no run, or an array of another shape.
    """
    from hil_sim.metrics.run import Run

    title, runs = _title(scenario, name, details), _named(runs, config)
    if scenario.kind == "frequency":
        return bode_figure(scenario, config, runs, title)
    if scenario.kind == "ramp":
        return steady_state_figure(scenario, config, runs, title)
    of_map = Run(next(iter(runs.values())), scenario, config, look_up).map_yaw_rate if runs else None
    spans = [Span(fault.start, fault.start + fault.duration, f"fault: {fault.kind}") for fault in scenario.faults]
    if scenario.kind == "sine-with-dwell":
        marks = _dwell_marks(scenario, config, runs)
        return run_figure(runs, title, marks=marks, spans=spans, window=_whole(runs), of_map=of_map)
    if scenario.kind == "recording" or scenario.faults:
        return run_figure(runs, title, spans=spans, window=_whole(runs), of_map=of_map)
    limits = signal_limits(config)
    if scenario.kind != "step":
        return run_figure(runs, title, of_map=of_map, limits=limits)
    return run_figure(after_step(runs, scenario), title, of_map=of_map, limits=limits, time_label=style.AFTER_STEP)


def after_step(runs: Mapping[str, FloatArray], scenario: Scenario) -> dict[str, FloatArray]:
    """Return the runs with the time of the step as zero."""
    return {run: np.column_stack([record[:, 0] - scenario.steer_time, record[:, 1:]]) for run, record in runs.items()}


def _named(runs: Mapping[str, FloatArray], config: Config) -> dict[str, FloatArray]:
    """Name the controlled run after its kind of controller."""
    kind = config.controller.kind
    own = kind if kind not in runs else f"{kind} (this build)"
    return {own if name == CONTROLLED else name: run for name, run in runs.items()}


def title_of(scenario: Scenario) -> str:
    """Return the title of a scenario with typographic units."""
    return scenario.title.replace("m/s^2", "m/s²")


def _title(scenario: Scenario, name: str, details: str) -> str:
    title = title_of(scenario)
    named = f"{one_line(name)} – {title}"
    # Wrap what does not fit on one line.
    first = [] if not name else [named] if len(named) <= TITLE_LENGTH else [one_line(name)]
    rest = [details] if named in first else [title, details]
    return "\n".join([*first, *(part for line in rest for part in textwrap.wrap(line, LINE_LENGTH, break_on_hyphens=False))])


def _whole(runs: Mapping[str, FloatArray]) -> tuple[float, float]:
    looks_of(runs)  # rejects runs without times
    return float(min(run[0, 0] for run in runs.values())), float(max(run[-1, 0] for run in runs.values()))


def _runs(scenario: Scenario, config: Config, runs: Mapping[str, FloatArray]) -> dict[str, Run]:
    from hil_sim.metrics.run import Run

    return {name: Run(run, scenario, config) for name, run in runs.items()}


def _dwell_marks(scenario: Scenario, config: Config, runs: Mapping[str, FloatArray]) -> list[Mark]:
    """Return the evaluation times of FMVSS 126: beginning and completion of steer of the first car, and times after them."""
    looks_of(runs)
    first = next(iter(_runs(scenario, config, runs).values()))
    beginning, _, completion = (float(times[0]) for times in SineWithDwell(first.runs).times)
    if math.isnan(completion):
        return []
    marks = [
        Mark(beginning, "begin"),
        Mark(beginning + DISPLACEMENT_TIME, f"+{DISPLACEMENT_TIME:g} s"),
        Mark(completion, "end"),
    ]
    return marks + [Mark(completion + after, f"+{after:g} s") for after, _ in RATIOS.values()]


def bode_figure(scenario: Scenario, config: Config, runs: Mapping[str, FloatArray], title: str) -> Figure:
    """Draw gain and phase of the yaw rate over the steering wheel angle; a car that spins has neither."""
    from hil_sim.metrics import spin_time, steering_response

    looks = looks_of(runs)
    with style.style():
        figure = style.new_figure(7.2, 6.2)
        gain, phase = figure.subplots(2, 1, sharex=True)
        lowest = -90.0
        for name, run in _runs(scenario, config, runs).items():
            found = None if spin_time(run.record) is not None else steering_response.frequency_response(run)
            if found is None:
                gain.plot([], [], label=f"{style.RUN_NAMES.get(name, style.plain(name))}: none", **looks[name])
                continue
            level, degrees = 20.0 * np.log10(found.gain / found.gain[0]), np.degrees(found.phase)
            gain.plot(found.frequency, level, label=style.RUN_NAMES.get(name, style.plain(name)), **looks[name])
            phase.plot(found.frequency, degrees, **looks[name])
            lowest = min(lowest, float(degrees.min()))
            _dot(gain, found.where_gain_falls(steering_response.BANDWIDTH_SHARE), -3.0, looks[name])
            _dot(phase, found.where_phase_falls(steering_response.BANDWIDTH_PHASE), -45.0, looks[name])
        gain.axhline(-3.0, **GUIDE)
        phase.axhline(-45.0, **GUIDE)
        gain.set(ylabel=f"Yaw rate / steering wheel,\ngain over that at {steering_response.LOW:g} Hz (dB)")
        phase.set(ylabel="Phase (deg)", yticks=np.arange(45.0 * math.floor(lowest / 45.0), 46.0, 45.0), xlabel="Frequency (Hz)")
        phase.set_xscale("log")
        phase.set_xticks(style.FREQUENCY_TICKS, [f"{tick:g}" for tick in style.FREQUENCY_TICKS])
        phase.set_xticks([], minor=True)
        phase.set_xlim(steering_response.LOW, steering_response.HIGH)
        dot = style.line_handle(marker="o", linestyle="", color=style.GREY, label="bandwidth: -3 dB, -45 deg")
        _finish(figure, (gain, phase), gain, title, dot)
    return figure


def _dot(axes: Axes, frequency: float | None, level: float, look: Mapping[str, Any]) -> None:
    if frequency is not None:
        axes.plot([frequency], [level], marker="o", linestyle="", color=look["color"], zorder=4, label="_")


def steady_state_figure(scenario: Scenario, config: Config, runs: Mapping[str, FloatArray], title: str) -> Figure:
    """Draw front angle, sideslip and rear angle over lateral acceleration, with the lines whose slopes are the gradients."""
    from hil_sim.metrics import steering_response

    looks = looks_of(runs)
    with style.style():
        figure = style.new_figure(7.2, 8.0)
        panels = figure.subplots(3, 1, sharex=True, height_ratios=(1.5, 1.0, 1.0))
        reached = 0.0
        for name, whole in runs.items():
            run = _runs(scenario, config, {name: until_spin(whole)})[name]
            lateral = run["lateral_acceleration_m_s2"]
            reached = max(reached, float(lateral[run.after].max(initial=0.0)))
            for axes, angle in zip(panels, ("front_angle_rad", "sideslip_rad", "rear_angle_rad"), strict=True):
                shown = style.RUN_NAMES.get(name, style.plain(name))
                axes.plot(lateral[run.after], run.degrees(angle)[run.after], label=shown, zorder=3, **looks[name])
                line = steering_response.fit(run, run[angle]) if angle != "rear_angle_rad" else None
                if line is not None:
                    ends = np.array([steering_response.FIT_FROM, steering_response.FIT_TO])
                    fitted = np.degrees(line.slope * ends + line.offset)
                    axes.plot(
                        ends, fitted, color=looks[name]["color"], label="_", marker="|", markersize=9, zorder=3.5, **FIT_LINE
                    )
        speed = float(next(iter(runs.values()))[-1, 1])
        neutral = np.degrees(config.vehicle.wheelbase / max(speed, 1.0) ** 2) * np.array([0.0, reached])
        panels[0].plot([0.0, reached], neutral, color=style.GREY, linewidth=0.9, zorder=2, label="neutral car, slope $L/v^2$")
        panels[0].set(ylabel=f"Front angle {style.FRONT_ANGLE} (deg)")
        panels[1].set(ylabel=r"Sideslip $\beta$ (deg)")
        panels[2].set(ylabel=f"Rear angle {style.REAR_ANGLE} (deg)", xlabel="Lateral acceleration (m/s²)")
        label = f"line fitted, {steering_response.FIT_FROM:.2g} to {steering_response.FIT_TO:.2g} m/s²"
        fit = style.line_handle(color=style.GREY, marker="|", markersize=9, label=label, **FIT_LINE)
        _finish(figure, panels, panels[0], title, fit)
    return figure


def _finish(figure: Figure, panels: Any, named: Axes, title: str, more: Artist) -> None:
    handles = [*named.get_legend_handles_labels()[0], more]
    for axes in panels:
        axes.grid(True)
        axes.margins(x=0.0)
    figure.align_ylabels()
    figure.suptitle(heading(title))
    style.legend_below(figure, handles)
