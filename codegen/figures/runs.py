"""Charts of runs over time: signals, references, limits, status, and marks for moments, time spans and spins."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.figures.data import (
    CONTROLLER_COLOURS,
    INK,
    MUTED,
    ORANGE,
    SERIES_COLOURS,
    SYMBOLS,
    VERMILION,
    WHITE,
    Chart,
    Picture,
    PlotError,
    axis,
    entry,
    layout,
    level,
    line,
    patches,
    plain,
    points,
    span,
    stacked,
    text,
    upright,
)
from codegen.sil.software import RECORD_COLUMNS, Status
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres
from hil_sim.metrics.run import spin_time

RUN_NAMES = {
    "recommended": "recommended controller",
    "C1": "C1 (paper's PI, 4WS-2 map)",
    "C2": "C2 (paper's PI, FWS map)",
    "passive": "passive car",
}
RUN_COLOURS = {
    "recommended": CONTROLLER_COLOURS["tracking"],
    "C1": CONTROLLER_COLOURS["pi"],
    "C2": MUTED,
    **CONTROLLER_COLOURS,
}
FAULT_COLOUR = "#F3D9CC"
SPIN_NAME = "spin: the run ends here"
STATUS_COLOURS = {"LIMITED": "#F0E442", "STANDBY": "#BBBBBB", "DEGRADED": ORANGE, "FAIL_SAFE": VERMILION}
STATUS_SHOWN = ("STANDBY", "DEGRADED", "FAIL_SAFE")


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


@dataclass(frozen=True)
class Panel:
    """A row of the chart: its title, unit, the column of RECORD_COLUMNS, and an optional dashed second column with its name."""

    title: str
    unit: str
    column: str
    dashed: tuple[str, str] | None = None

    @property
    def label(self) -> str:
        """Title and unit, on two lines."""
        return f"{self.title}<br>({self.unit})"


SPEED_PANEL = Panel("Speed", "km/h", "speed_m_s")
"""Drawn if the speed is not constant."""
MOTION_PANELS = (
    Panel("Yaw rate", "deg/s", "yaw_rate_rad_s", ("yaw_rate_reference_rad_s", "reference")),
    Panel("Lateral acc.", "m/s²", "lateral_acceleration_m_s2"),
    Panel("Sideslip β", "deg", "sideslip_rad"),
)
"""The motion that the driver feels."""
PANELS = (
    *MOTION_PANELS,
    Panel("Rear angle δ<sub>r</sub>", "deg", "rear_angle_rad", ("rear_angle_command_rad", "command")),
    Panel("Slip α<sub>f</sub>", "deg", "slip_front_rad"),
    Panel("Slip α<sub>r</sub>", "deg", "slip_rear_rad"),
    Panel("Front angle δ<sub>f</sub>", "deg", "front_angle_rad"),
    SPEED_PANEL,
)

BEFORE_START = 0.5
AFTER_START = 3.0
MOVED = math.radians(0.01)
AXIS_HEIGHT_MIN = 0.2
"""Minimum span of a panel, in deg, deg/s or m/s^2."""
SPEED_HELD_KM_H = 1.8
"""Largest variation of a constant speed."""
LIMIT_IN_REACH = 0.6
"""A limit is drawn if it is at most this fraction of the panel's height beyond the curves."""
SYMBOL_COUNT = 14
"""Largest number of symbols along a line."""


def column(run: FloatArray, name: str) -> FloatArray:
    """Return one column of a run in display units: angles in deg, speed in km/h, others in SI.

    The reference is NaN in STANDBY and FAIL_SAFE, in which the controller has none.
    """
    values = np.array(run[:, RECORD_COLUMNS.index(name)], dtype=np.float64)
    if name == "yaw_rate_reference_rad_s":
        idle = np.isin(run[:, RECORD_COLUMNS.index("status")], (Status.STANDBY, Status.FAIL_SAFE))
        values[idle] = np.nan
    if name == "speed_m_s":
        return values / KM_H
    return np.degrees(values) if name.endswith(("_rad", "_rad_s")) else values


def until_spin(run: FloatArray) -> FloatArray:
    """Return a run up to the sample in which the car spins, at least two samples; the whole run if it does not spin."""
    time = spin_time(run)
    return run if time is None else run[: max(int(np.searchsorted(run[:, 0], time)) + 1, 2)]


def is_passive(name: str) -> bool:
    """Return whether a run of this name has no controller: no reference, no command, no status."""
    return name.lower().startswith("passive")


def limits_of(config: Config) -> dict[str, float]:
    """Return the limit of each column to either side, of optimisation or actuator, in its displayed unit."""
    limits, tyres = config.limits, AxleTyres.from_config(config)
    return {
        "sideslip_rad": limits.sideslip_max_deg,
        "rear_angle_rad": min(limits.rear_angle_max_deg, config.rear_actuator.angle_max_deg),
        "lateral_acceleration_m_s2": limits.lateral_acceleration_max_g * config.road.gravity_m_s2,
        "slip_front_rad": math.degrees(tyres.slip_limits[0]),
        "slip_rear_rad": math.degrees(tyres.slip_limits[1]),
    }


def run_window(runs: Mapping[str, FloatArray]) -> tuple[float, float]:
    """Return the time range to show: from 0.5 s before the front angle first moves to 3 s after, or until all has settled."""
    starts, ends = [], []
    for run in runs.values():
        time, front_angle = column(run, "time_s"), np.radians(column(run, "front_angle_rad"))
        moved = np.flatnonzero(np.abs(front_angle - front_angle[0]) > MOVED)
        starts.append(time[moved[0]] - BEFORE_START if moved.size else time[0])
        unsettled = [time[moved[0]] + AFTER_START if moved.size else time[-1]]
        for name in ("yaw_rate_rad_s", "front_angle_rad", "rear_angle_rad", "speed_m_s", "status"):
            values = column(run, name)
            late = np.flatnonzero(~(np.abs(values - values[-1]) <= 0.02 * np.ptp(values)))
            unsettled += [time[late[-1]] + BEFORE_START] if late.size else []
        ends.append(max(unsettled))
    first, last = (min(run[0, 0] for run in runs.values()), max(run[-1, 0] for run in runs.values()))
    return float(max(min(starts), first)), float(min(max(ends), last))


def whole_window(runs: Mapping[str, FloatArray]) -> tuple[float, float]:
    """Return the time range of all runs."""
    check_runs(runs)
    return float(min(run[0, 0] for run in runs.values())), float(max(run[-1, 0] for run in runs.values()))


def check_runs(runs: Mapping[str, FloatArray]) -> None:
    """Raise PlotError if there is no run, or an array of another shape."""
    if not runs:
        raise PlotError("no runs to show", remedy="give at least one")
    for name, run in runs.items():
        if run.ndim != 2 or run.shape[1] != len(RECORD_COLUMNS) or run.shape[0] < 2:
            raise PlotError(
                f"shape {run.shape}, where (samples, {len(RECORD_COLUMNS)}) with two samples or more is needed",
                where=f"run {name}",
                remedy=f"give the columns {', '.join(RECORD_COLUMNS)}",
            )


def looks_of(runs: Mapping[str, FloatArray]) -> dict[str, dict[str, Any]]:
    """Return colour, width and dash of the line of each run. Raises PlotError: see `check_runs`."""
    check_runs(runs)
    named = {name: RUN_COLOURS.get("passive" if is_passive(name) else name) for name in runs}
    spare = itertools.cycle([each for each in SERIES_COLOURS if each not in named.values()] or SERIES_COLOURS)
    return {
        name: {
            "colour": colour or next(spare),
            "width": 2.7 if name == "recommended" else 2.0,
            "dash": "dot" if is_passive(name) else "solid",
        }
        for name, colour in named.items()
    }


def run_chart(
    runs: Mapping[str, FloatArray],
    config: Config | None,
    title: str,
    panels: Sequence[Panel] = PANELS,
    *,
    origin: float = 0.0,
    time_label: str = "Time (s)",
    marks: Sequence[Mark] = (),
    spans: Sequence[Span] = (),
    window: tuple[float, float] | None = None,
    of_map: FloatArray | None = None,
) -> Chart:
    """Return the chart of the signals of runs over time, one row each. Reference and command are dashed, limits dotted.

    A name that starts with "passive" denotes a car without a controller: no command, no status. The status has a row if it
    ever leaves normal operation. A run ends where the car spins.

    Args:
        runs: name -> array with columns RECORD_COLUMNS, in the order of the legend.
        config: configuration of the car, for its limits; None draws none.
        title: title of the chart.
        origin: time in s that becomes zero.
        time_label: label of the time axis.
        marks, spans: times and time ranges to mark, after the origin.
        window: start and end of the shown range in s, after the origin; None selects it with `run_window`.
        of_map: (samples,) rad/s, the map's steady yaw rate in the samples of the first run; None omits it.

    Raises:
        PlotError: no run, or an array of another shape.
    """
    looks = looks_of(runs)
    shifted = {name: np.column_stack([run[:, 0] - origin, run[:, 1:]]) for name, run in runs.items()}
    spun = {name: until_spin(run) for name, run in shifted.items()}
    window = run_window(spun) if window is None else window
    shown = {name: run[(run[:, 0] >= window[0]) & (run[:, 0] <= window[1])] for name, run in spun.items()}
    is_held = all(np.ptp(column(run, "speed_m_s")) <= SPEED_HELD_KM_H for run in spun.values())
    panels = [each for each in panels if each is not SPEED_PANEL or not is_held]
    status = {name: run for name, run in shown.items() if not is_passive(name) and _has_incident(run)}
    labels = [*(each.label for each in panels), *(["Status"] if status else [])]
    ratios = [1.5, *[1.0] * (len(panels) - 1), *([0.15 + 0.15 * len(status)] if status else [])]
    axes = stacked(labels, ratios)
    names = [f"y{row + 1}" if row else "y" for row in range(len(labels))]
    limits = {} if config is None else limits_of(config)
    data: list[dict[str, Any]] = []
    shapes: list[dict[str, Any]] = []
    for y, each in zip(names, panels, strict=False):
        data += _lines(shown, looks, each, y)
        if each is panels[0] and of_map is not None:
            time = next(iter(shifted.values()))[:, 0]
            inside = (time >= window[0]) & (time <= window[1])
            data.append(line(time[inside], np.degrees(of_map[inside]), "map, steady", MUTED, dash="dashdot", width=1.6))
        ends = [run[-1:] for name, run in spun.items() if len(run) < len(runs[name])]
        colours = [looks[name]["colour"] for name, run in spun.items() if len(run) < len(runs[name])]
        for end, colour in zip(ends, colours, strict=True):
            look: dict[str, Any] = {
                "symbol": "x",
                "size": 12,
                "marker": {"line": {"color": WHITE, "width": 1}},
                "showlegend": False,
            }
            data.append(points(end[:, 0], column(end, each.column), "", colour, yaxis=y, hoverinfo="skip", **look))
        near, low, high = _limits_near(limits.get(each.column), shown, each)
        shapes += [level(value, y, INK, "dash") for value in near]
        if high - low < AXIS_HEIGHT_MIN and not near:  # rounding errors must not look like motion
            middle = 0.5 * (low + high)
            axes[f"yaxis{y[1:]}"]["range"] = [middle - 0.5 * AXIS_HEIGHT_MIN, middle + 0.5 * AXIS_HEIGHT_MIN]
    is_dashed = any(trace["line"]["dash"] == "dash" for trace in data if "line" in trace and trace["mode"] != "markers")
    has_command = any(each.dashed is not None and each.dashed[1] == "command" for each in panels)
    data += [entry("reference, command" if has_command else "reference", MUTED, "dash")] if is_dashed else []
    has_limit = bool(shapes)
    data += [entry("limit", INK, "dash", 1.2)] if has_limit else []
    if any(len(spun[name]) < len(run) for name, run in runs.items()):
        data.append(points([np.nan], [np.nan], SPIN_NAME, MUTED, "x", 12, hoverinfo="skip"))
    shapes += [span(each.start, each.end, FAULT_COLOUR) for each in spans]
    if spans:
        data += patches([", ".join(dict.fromkeys(each.label for each in spans))], [FAULT_COLOUR])
    shapes += [upright(each.time) for each in marks]
    if status:
        bars, seen = _status_bars(status, names[-1])
        shapes += bars
        titles = [name.lower().replace("_", "-") for name in seen]
        data += patches(titles, [STATUS_COLOURS[name] for name in seen], yaxis=names[-1])
        places = {"tickvals": list(range(len(status))), "ticktext": list(map(plain, status)), "showgrid": False}
        axes[f"yaxis{names[-1][1:]}"] |= {"range": [len(status) - 0.5, -0.5], **places}
    look = layout(
        **axes,
        xaxis=axis(time_label, anchor=names[-1], range=list(window), unifiedhovertitle={"text": "%{x:.2f} s"}),
        shapes=shapes,
        annotations=[text(each.label, each.time, 1, yref="paper", yanchor="bottom") for each in marks],
        hovermode="x unified",
        margin={"l": 80, "r": 20, "t": 30, "b": 50},
    )
    told = "; ".join(_status_text(run, record) for run, record in runs.items() if not is_passive(run))
    parts = [
        title,
        "Dashed, coloured: reference and command" if is_dashed else "",
        "Dashed, black: limits of the optimisation and of the actuator" if has_limit else "",
        f"Status: {told}" if told else "",
    ]
    caption = "".join(f"{each}. " for each in parts if each).rstrip()
    spoken = f"Signals over time of the runs {', '.join(runs)}: {title}."
    return Chart("runs", {"data": data, "layout": look}, caption, spoken, 940)


def run_picture(chart: Chart, title: str) -> Picture:
    """Return a chart of runs as a picture, as high as its rows require."""
    rows = [each["domain"] for key, each in chart.figure["layout"].items() if key.startswith("yaxis")]
    height = 1.5 * 1.25 / (rows[0][1] - rows[0][0])  # the first row has the height of one and a half
    return Picture([[chart]], (7.2, height + 0.9), title)


def _lines(
    runs: Mapping[str, FloatArray], looks: Mapping[str, dict[str, Any]], each: Panel, y: str
) -> Iterator[dict[str, Any]]:
    symbols = dict(zip(runs, itertools.cycle(SYMBOLS), strict=False))
    columns = (each.column, *([each.dashed[0]] if each.dashed is not None else []))
    for run, record in runs.items():
        shown, look = RUN_NAMES.get(run, plain(run)), looks[run]
        for name in columns[: 1 if is_passive(run) else 2]:
            what = shown if name == each.column else f"{shown}, {each.dashed[1]}"  # type: ignore[index]
            own = look if name == each.column else {"colour": look["colour"], "width": 1.4, "dash": "dash"}
            drawn = line(column(record, "time_s"), column(record, name), what, **own)
            if name == each.column:  # distinguishable without colour, too
                marker = {"symbol": symbols[run], "size": 6, "maxdisplayed": SYMBOL_COUNT, "color": look["colour"]}
                drawn |= {"mode": "lines+markers", "marker": marker}
            yield {
                **drawn,
                **{"yaxis": y, "legendgroup": run, "showlegend": y == "y" and name == each.column},
                "hovertemplate": f"{what}: %{{y:.3f}} {each.unit}<extra></extra>",
            }


def _limits_near(limit: float | None, runs: Mapping[str, FloatArray], each: Panel) -> tuple[list[float], float, float]:
    """Return the limits to either side that are close to the curves, and the range of the curves."""
    seen = np.concatenate([column(run, each.column) for run in runs.values()])
    known = seen[np.isfinite(seen)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    reach = LIMIT_IN_REACH * max(high - low, AXIS_HEIGHT_MIN)
    levels = () if limit is None else (limit, -limit)
    return [value for value in levels if low - reach <= value <= high + reach], low, high


def _has_incident(run: FloatArray) -> bool:
    return bool(np.isin(column(run, "status"), [Status[one] for one in STATUS_SHOWN]).any())


def _status_bars(runs: Mapping[str, FloatArray], y: str) -> tuple[list[dict[str, Any]], list[str]]:
    """Return a rectangle for each stay of each run in a status, a row each, and the names of the statuses."""
    bars, seen = [], set()
    for row, run in enumerate(runs.values()):
        time, status = column(run, "time_s"), column(run, "status")
        starts = np.flatnonzero(np.diff(status, prepend=np.nan) != 0.0)
        for first, last in zip(starts, [*starts[1:], len(time) - 1], strict=True):
            name = Status(int(status[first])).name
            if name in STATUS_COLOURS:
                place = {"x0": float(time[first]), "x1": float(time[last]), "yref": y, "y0": row - 0.4, "y1": row + 0.4}
                bars.append({"type": "rect", "fillcolor": STATUS_COLOURS[name], "line": {"width": 0}, **place})
                seen.add(name)
    return bars, [name for name in STATUS_COLOURS if name in seen]


def _status_text(run: str, record: FloatArray) -> str:
    status = record[:, -1]
    counts = {each.name: int(np.count_nonzero(status == each)) for each in Status}
    seen = ", ".join(f"{name} {100.0 * count / len(status):.0f} %" for name, count in counts.items() if count)
    return f"{run} {seen}"
