"""Charts of runs: signals over time, handling diagram and frequency response; figures of each run."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.report.html.blocks import INK, MUTED, Block, Chart, Gallery, Table, Text, axis, layout, line
from codegen.report.run_plots import SPEED_HELD, column, looks_of, run_window, signal_limits, until_spin
from codegen.report.scenario_plots import title_of
from codegen.report.style import AFTER_STEP, BLACK, FREQUENCY_TICKS, GREY
from codegen.report.summary import metric_rows
from codegen.sil.software import Status
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres
from hil_sim.metrics import evaluate, steering_response
from hil_sim.metrics.run import LookUp, Run, spin_time
from hil_sim.scenarios import BUILT_IN, Scenario


@dataclass(frozen=True)
class Panel:
    """A row of the chart: its title with the unit, and the columns of a run with their line styles."""

    title: str
    columns: tuple[tuple[str, str], ...]

    @property
    def unit(self) -> str:
        """Unit from the title."""
        return self.title.partition("(")[2].rstrip(")")


SPEED_PANEL = Panel("Speed<br>(km/h)", (("speed_m_s", "solid"),))
"""Drawn if the speed is not constant."""

PANELS = (
    Panel("Yaw rate<br>(deg/s)", (("yaw_rate_rad_s", "solid"), ("yaw_rate_reference_rad_s", "dash"))),
    Panel("Sideslip β<br>(deg)", (("sideslip_rad", "solid"),)),
    Panel("Rear angle δr<br>(deg)", (("rear_angle_rad", "solid"), ("rear_angle_command_rad", "dash"))),
    Panel("Lateral acc.<br>(m/s²)", (("lateral_acceleration_m_s2", "solid"),)),
    Panel("Slip αf<br>(deg)", (("slip_front_rad", "solid"),)),
    Panel("Slip αr<br>(deg)", (("slip_rear_rad", "solid"),)),
    Panel("Front angle δf<br>(deg)", (("front_angle_rad", "solid"),)),
    SPEED_PANEL,
)
GAP = 0.022
MARKS = 14
"""Largest number of symbols along a line."""
SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "x", "star")
PASSIVE = ("passive", "passive car")
WORDS = {
    "yaw_rate_reference_rad_s": "reference",
    "rear_angle_command_rad": "command",
}


def colours_of(runs: Mapping[str, FloatArray]) -> dict[str, str]:
    """Return the colour of each run; black and grey follow the theme of the page. Raises PlotError: see `looks_of`."""
    colours = {name: look.get("color", GREY) for name, look in looks_of(runs).items()}
    return {name: INK if colour == BLACK else MUTED if colour == GREY else colour for name, colour in colours.items()}


def is_passive(name: str) -> bool:
    """Return whether a run of this name has no controller: no reference, no command, no status."""
    return name.lower() in PASSIVE


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
    yield run_chart(runs, config, scenario.title, step_time=scenario.step_time)
    evaluation = evaluate(scenario, config, runs, look_up)
    yield Table(f"Figures of each run: {scenario.title}", ("", *evaluation.runs), metric_rows(evaluation))


def run_chart(
    runs: Mapping[str, FloatArray],
    config: Config,
    title: str,
    panels: Sequence[Panel] = PANELS,
    step_time: float | None = None,
) -> Chart:
    """Return the chart of the signals, one row each. Reference and command are dashed, limits dotted.

    Args:
        runs, config, title, panels: what to draw.
        step_time: time of the steering step in s, which becomes zero; None keeps the time of the runs.

    Raises:
        PlotError: no run, or an array of another shape.
    """
    origin = step_time or 0.0
    colours = colours_of(runs)
    symbols = dict(zip(runs, itertools.cycle(SYMBOLS), strict=False))
    axes: dict[str, Any] = {}
    data: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    limits = _limits(config)
    is_held = all(np.ptp(column(record, "speed_m_s")) <= SPEED_HELD / KM_H for record in runs.values())
    panels = [panel for panel in panels if panel is not SPEED_PANEL or not is_held]
    height = (1.0 - GAP * (len(panels) - 1)) / len(panels)
    for row, panel in enumerate(panels):
        name = "y" if row == 0 else f"y{row + 1}"
        top = 1.0 - row * (height + GAP)
        axes[f"yaxis{name[1:]}"] = axis(panel.title, domain=[max(0.0, top - height), top], nticks=5)
        for run, record in runs.items():
            data += _lines(run, record, panel, (colours[run], symbols[run]), name, row == 0, origin)
        bound = limits.get(panel.columns[0][0])
        for value in () if bound is None else (bound, -bound):
            drawn = {"color": MUTED, "width": 1.5, "dash": "dot"}
            place = {"xref": "paper", "x0": 0, "x1": 1, "yref": name, "y0": value, "y1": value}
            if _is_near(value, runs, panel):
                shapes.append({"type": "line", "line": drawn, **place})
    is_dashed = any(trace["line"]["dash"] == "dash" for trace in data)
    data += [_entry("reference or command", INK, "dash")] if is_dashed else []
    data += [_entry("limit", MUTED, "dot")] if shapes else []
    first, last = (time - origin for time in run_window(runs))
    time_title = "Time (s)" if step_time is None else AFTER_STEP
    bottom = f"y{len(panels)}"
    look = layout(
        **axes,
        xaxis=axis(time_title, anchor=bottom, range=[first, last], unifiedhovertitle={"text": "%{x:.2f} s"}),
        shapes=shapes,
        hovermode="x unified",
        margin={"l": 80, "r": 20, "t": 30, "b": 50},
    )
    told = "; ".join(_status_text(run, record) for run, record in runs.items() if not is_passive(run))
    status = f" Status: {told}." if told else ""
    dashed = " Dashed: reference and command." if is_dashed else ""
    dotted = " Dotted: limits of the optimisation and of the actuator." if shapes else ""
    caption = f"{title}.{dashed}{dotted}{status}"
    spoken = f"Signals over time of the runs {', '.join(runs)}: {title}."
    return Chart("runs", {"data": data, "layout": look}, caption, spoken, 940)


def _lines(
    run: str, record: FloatArray, panel: Panel, look: tuple[str, str], y: str, first: bool, origin: float
) -> Iterator[dict[str, Any]]:
    colour, symbol = look
    time = column(record, "time_s") - origin
    for name, dash in panel.columns:
        if is_passive(run) and name in WORDS:
            continue
        what = f"{run}{', ' + WORDS[name] if name in WORDS else ''}"
        drawn = line(time, column(record, name), what, colour, dash=dash, width=1.5 if name in WORDS else 2)
        if name not in WORDS:  # distinguishable without colour, too
            drawn |= {"mode": "lines+markers", "marker": {"symbol": symbol, "size": 7, "maxdisplayed": MARKS, "color": colour}}
        yield {
            **drawn,
            **{"yaxis": y, "legendgroup": run, "showlegend": first and name not in WORDS},
            "hovertemplate": f"{what}: %{{y:.3f}} {panel.unit}<extra></extra>",
        }


def _entry(name: str, colour: str, dash: str) -> dict[str, Any]:
    """Return a legend entry for a kind of line."""
    return {**line([np.nan], [np.nan], name, colour, dash=dash, width=1.5), "hoverinfo": "skip"}


def _limits(config: Config) -> dict[str, float]:
    """Return the limit of each signal from the optimisation or the actuator, in its displayed unit."""
    tyres = AxleTyres.from_config(config)
    return {
        **signal_limits(config),
        "slip_front_rad": math.degrees(tyres.slip_limits[0]),
        "slip_rear_rad": math.degrees(tyres.slip_limits[1]),
    }


def _is_near(value: float, runs: Mapping[str, FloatArray], panel: Panel) -> bool:
    """Return whether a limit can be drawn without squeezing the signals: they reach a third of it, on its side."""
    seen = np.concatenate([column(record, panel.columns[0][0]) for record in runs.values()])
    reached = float(np.nanmax(np.sign(value) * seen)) if np.isfinite(seen).any() else 0.0
    return reached > abs(value) / 3.0


def _status_text(run: str, record: FloatArray) -> str:
    status = record[:, -1]
    counts = {each.name: int(np.count_nonzero(status == each)) for each in Status}
    seen = ", ".join(f"{name} {100.0 * count / len(status):.0f} %" for name, count in counts.items() if count)
    return f"{run} {seen}"


Runs = Mapping[str, FloatArray]

HANDLING, RESPONSE = BUILT_IN["ramp-steer"], BUILT_IN["sine-sweep"]
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
    ramp, sweep = driven[HANDLING.name], driven[RESPONSE.name]
    yield Gallery([_handling(ramp, config), *_response(sweep, config)])
    everything = (("", runs or {}), (HANDLING.name, ramp), (RESPONSE.name, sweep))
    rows = [row for name, each in everything for row in _actuator_rows(name, each)]
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
        ticks = {"type": "log", "tickvals": FREQUENCY_TICKS, "ticktext": [f"{tick:g}" for tick in FREQUENCY_TICKS]}
        look = layout(xaxis=axis("Frequency (Hz)", **ticks), yaxis=axis(title))
        caption = f"Frequency response, {key}. {title_of(RESPONSE)}."
        yield Chart(f"response-{key}", {"data": data, "layout": look}, caption, f"{title} over frequency of each car.", 400)


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
