"""Charts of a scenario: over time, or in the form that its standard uses."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import one_line
from codegen.figures.data import (
    AFTER_STEP,
    FREQUENCY_TICKS,
    MUTED,
    Chart,
    Picture,
    axis,
    entry,
    layout,
    level,
    line,
    plain,
    points,
    stacked,
)
from codegen.figures.runs import (
    PANELS,
    RUN_NAMES,
    Mark,
    Panel,
    Span,
    looks_of,
    run_chart,
    run_picture,
    until_spin,
    whole_window,
)
from codegen.metrics.sine import DISPLACEMENT_TIME, RATIOS, SineWithDwell
from hil_sim.metrics import steering_response
from hil_sim.metrics.run import LookUp, Run, spin_time
from hil_sim.scenarios import Scenario

CONTROLLED = "controlled"
"""Name of the build's run in `runs`."""
TITLE_LENGTH = 64
"""Largest number of characters of name and title on one line."""
LINE_LENGTH = 78
"""Largest number of characters on one line."""

Runs = Mapping[str, FloatArray]


def scenario_picture(
    scenario: Scenario,
    config: Config,
    runs: Runs,
    name: str = "",
    details: str = "",
    look_up: LookUp | None = None,
) -> Picture:
    """Return the picture of the runs of a scenario.

    Args:
        scenario: scenario of the runs.
        config: configuration of the car.
        runs: name -> array with columns RECORD_COLUMNS; see `run_chart`.
        name: name of the build, for the title.
        details: details of the car and the run, below the title; long lines are wrapped.
        look_up: map lookup, to draw the map's steady yaw rate over time; None omits it.

    Raises:
        PlotError: no run, or an array of another shape.
    """
    title, runs = _title(scenario, name, details), _named(runs, config)
    if scenario.kind == "frequency":
        return Picture([[response_chart(scenario, config, runs)]], (7.2, 6.2), title)
    if scenario.kind == "ramp":
        return Picture([[handling_chart(scenario, config, runs)]], (7.2, 8.0), title)
    of_map = Run(next(iter(runs.values())), scenario, config, look_up).map_yaw_rate if runs else None
    spans = [Span(fault.start, fault.start + fault.duration, f"fault: {fault.kind}") for fault in scenario.faults]
    more: dict[str, Any] = {"of_map": of_map, "spans": spans}
    if scenario.kind in ("sine-with-dwell", "recording") or scenario.faults:
        marks = _dwell_marks(scenario, config, runs) if scenario.kind == "sine-with-dwell" else []
        chart = run_chart(runs, None, title, window=whole_window(runs), marks=marks, **more)
    else:
        chart = time_chart(scenario, config, runs, **more)
    return run_picture(chart, title)


def time_chart(scenario: Scenario, config: Config, runs: Runs, panels: Sequence[Panel] = PANELS, **more: Any) -> Chart:
    """Return the signals over time, those of a step from the step on; further arguments are those of `run_chart`."""
    if scenario.step_time is not None:
        more |= {"origin": scenario.step_time, "time_label": AFTER_STEP}
    return run_chart(runs, config, title_of(scenario), panels, **more)


def _named(runs: Runs, config: Config) -> dict[str, FloatArray]:
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
    wrapped = (part for each in rest for part in textwrap.wrap(each, LINE_LENGTH, break_on_hyphens=False))
    return "<br>".join([*first, *wrapped])


def _dwell_marks(scenario: Scenario, config: Config, runs: Runs) -> list[Mark]:
    """Return the evaluation times of FMVSS 126: beginning and completion of steer of the first car, and times after them."""
    looks_of(runs)  # rejects runs without times
    first = Run(next(iter(runs.values())), scenario, config)
    beginning, _, completion = (float(times[0]) for times in SineWithDwell(first.runs).times)
    if math.isnan(completion):
        return []
    marks = [
        Mark(beginning, "begin"),
        Mark(beginning + DISPLACEMENT_TIME, f"+{DISPLACEMENT_TIME:g} s"),
        Mark(completion, "end"),
    ]
    return marks + [Mark(completion + after, f"+{after:g} s") for after, _ in RATIOS.values()]


def response_chart(scenario: Scenario, config: Config, runs: Runs) -> Chart:
    """Return gain and phase of the yaw rate over the steering wheel angle (ISO 7401); a car that spins has neither.

    Raises:
        PlotError: no run, or an array of another shape.
    """
    looks, lowest = looks_of(runs), -90.0
    data: list[dict[str, Any]] = []
    for name, record in runs.items():
        shown, look = RUN_NAMES.get(name, plain(name)), looks[name]
        found = None if spin_time(record) is not None else steering_response.frequency_response(Run(record, scenario, config))
        if found is None:
            data.append(entry(f"{shown}: none", look["colour"], look["dash"], look["width"]))
            continue
        gain, phase = 20.0 * np.log10(found.gain / found.gain[0]), np.degrees(found.phase)
        lowest = min(lowest, float(phase.min()))
        bandwidths = (
            found.where_gain_falls(steering_response.BANDWIDTH_SHARE),
            found.where_phase_falls(steering_response.BANDWIDTH_PHASE),
        )
        rows = zip(("y", "y2"), (gain, phase), bandwidths, BANDWIDTH_LEVELS, ("dB", "deg"), strict=True)
        for y, values, frequency, value, unit in rows:
            told = f"{shown}: %{{y:.2f}} {unit} at %{{x:.2f}} Hz<extra></extra>"
            more: dict[str, Any] = {"yaxis": y, "showlegend": y == "y", "legendgroup": name, "hovertemplate": told}
            data.append(line(found.frequency, values, shown, **look, **more))
            if frequency is not None:
                hidden: dict[str, Any] = {"showlegend": False, "hoverinfo": "skip"}
                data.append(points([frequency], [value], "", look["colour"], size=9, yaxis=y, **hidden))
    data.append(points([np.nan], [np.nan], "bandwidth: -3 dB, -45 deg", MUTED, size=9))
    ends = [math.log10(steering_response.LOW), math.log10(steering_response.HIGH)]
    axes = stacked((f"Gain over that<br>at {steering_response.LOW:g} Hz (dB)", "Phase (deg)"), gap=0.06)
    axes["yaxis2"]["tickvals"] = np.arange(45.0 * math.floor(lowest / 45.0), 46.0, 45.0).tolist()
    look = layout(
        **axes,
        xaxis=axis("Frequency (Hz)", anchor="y2", range=ends, **FREQUENCY_TICKS),
        shapes=[level(value, y) for y, value in zip(("y", "y2"), BANDWIDTH_LEVELS, strict=True)],
    )
    caption = f"Frequency response of the yaw rate to the steering wheel. {title_of(scenario)}."
    return Chart("response", {"data": data, "layout": look}, caption, f"{caption} Gain and phase of each car.", 560)


BANDWIDTH_LEVELS = (-3.0, -45.0)
"""Gain in dB and phase in deg that define the bandwidths."""
FITTED = (("front_angle_rad", "Front angle δ<sub>f</sub> (deg)"), ("sideslip_rad", "Sideslip β (deg)"))
OVER_ACCELERATION = (*FITTED, ("rear_angle_rad", "Rear angle δ<sub>r</sub> (deg)"))


def handling_chart(scenario: Scenario, config: Config, runs: Runs) -> Chart:
    """Return front angle, sideslip and rear angle over lateral acceleration (ISO 4138), with the lines of the gradients.

    Raises:
        PlotError: no run, or an array of another shape.
    """
    looks, reached = looks_of(runs), 0.0
    data: list[dict[str, Any]] = []
    for name, whole in runs.items():
        run, look = Run(until_spin(whole), scenario, config), looks[name]
        lateral = run["lateral_acceleration_m_s2"]
        reached = max(reached, float(lateral[run.after].max(initial=0.0)))
        for y, (angle, _) in zip(("y", "y2", "y3"), OVER_ACCELERATION, strict=True):
            more: dict[str, Any] = {"yaxis": y, "showlegend": y == "y", "legendgroup": name}
            shown = RUN_NAMES.get(name, plain(name))
            data.append(line(lateral[run.after], run.degrees(angle)[run.after], shown, **look, **more))
            data += _fitted_line(run, angle, look["colour"], y) if angle in dict(FITTED) else []
    speed = float(next(iter(runs.values()))[-1, 1])
    neutral = np.degrees(config.vehicle.wheelbase / max(speed, 1.0) ** 2) * np.array([0.0, reached])
    data.append(line([0.0, reached], neutral, "neutral car, slope L/v²", MUTED, width=1.2))
    fit = f"line fitted, {steering_response.FIT_FROM:.2g} to {steering_response.FIT_TO:.2g} m/s²"
    data.append({**entry(fit, MUTED, "dash", 1.4), "mode": "lines+markers", "marker": FIT_ENDS})
    look = layout(
        **stacked([title for _, title in OVER_ACCELERATION], (1.5, 1.0, 1.0), gap=0.04),
        xaxis=axis("Lateral acceleration (m/s²)", anchor="y3"),
    )
    caption = f"Handling diagram. {title_of(scenario)}: the steeper the front angle, the more the car understeers."
    return Chart("handling", {"data": data, "layout": look}, caption, caption, 640)


FIT_ENDS: Mapping[str, Any] = {"symbol": "line-ns", "size": 12, "color": MUTED, "line": {"width": 1.5, "color": MUTED}}


def _fitted_line(run: Run, angle: str, colour: str, y: str) -> Iterator[dict[str, Any]]:
    fitted = steering_response.fit(run, run[angle])
    if fitted is not None:
        ends = np.array([steering_response.FIT_FROM, steering_response.FIT_TO])
        drawn = line(ends, np.degrees(fitted.slope * ends + fitted.offset), "", colour, dash="dash", width=1.4, yaxis=y)
        marker = {**FIT_ENDS, "color": colour, "line": {"width": 1.5, "color": colour}}
        yield {**drawn, "mode": "lines+markers", "marker": marker, "showlegend": False, "hoverinfo": "skip"}
