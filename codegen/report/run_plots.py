"""Runs over time: signals, references, status, and marks for moments, time spans and spins."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.report import style
from codegen.units import KM_H

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FAULT_COLOUR = "#F3D9CC"
SPIN_NAME = "spin: the run ends here"
SPIN_MARKER: dict[str, Any] = {"linestyle": "", "marker": "X", "markersize": 8, "markeredgecolor": style.WHITE}


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


def until_spin(run: FloatArray) -> FloatArray:
    """Return a run up to the sample in which the car spins, at least two samples; the whole run if it does not spin."""
    from hil_sim.metrics import spin_time

    time = spin_time(run)
    return run if time is None else run[: max(int(np.searchsorted(run[:, 0], time)) + 1, 2)]


def spin_handles(runs: Mapping[str, FloatArray], spun: Mapping[str, FloatArray]) -> list[Any]:
    """Return the legend entry for the mark of a spin, if a run was cut at one."""
    if all(len(spun[name]) == len(run) for name, run in runs.items()):
        return []
    return [style.line_handle(color=style.GREY, label=SPIN_NAME, **SPIN_MARKER)]


def draw_spans(panels: Sequence[Axes], spans: Sequence[Span]) -> list[Any]:
    """Shade time ranges and return their legend entry."""
    for axes in panels:
        for span in spans:
            axes.axvspan(span.start, span.end, color=FAULT_COLOUR, linewidth=0.0, zorder=0.5)
    names = list(dict.fromkeys(span.label for span in spans))
    return [style.patch_handle(color=FAULT_COLOUR, label=", ".join(names))] if names else []


def draw_marks(panels: Sequence[Axes], marks: Sequence[Mark]) -> None:
    """Draw lines through all panels, labelled above the first one."""
    for axes in panels:
        for mark in marks:
            axes.axvline(mark.time, color=style.GREY, linewidth=0.9, linestyle=(0, (1, 1.5)), zorder=1.5, label="_")
    for mark in marks:
        panels[0].annotate(
            mark.label,
            (mark.time, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            va="bottom",
            fontsize=8.5,
        )


@dataclass(frozen=True)
class _Signal:
    """A panel of a run: a column of RECORD_COLUMNS, and an optional dashed second column."""

    label: str
    column: str
    dashed: str | None = None


MOTION_SIGNALS = (
    _Signal("Yaw rate\n(deg/s)", "yaw_rate_rad_s", "yaw_rate_reference_rad_s"),
    _Signal("Lateral acc.\n(m/s²)", "lateral_acceleration_m_s2"),
    _Signal("Sideslip\n(deg)", "sideslip_rad"),
)
"""What the driver feels."""
SIGNALS = (
    *MOTION_SIGNALS,
    _Signal("Rear angle\n(deg)", "rear_angle_rad", "rear_angle_command_rad"),
    _Signal("Front angle\n(deg)", "front_angle_rad"),
)
SPEED_SIGNAL = _Signal("Speed\n(km/h)", "speed_m_s")
"""CellRuns if the speed is not constant."""
RUN_LINES: Mapping[str, Mapping[str, Any]] = {
    "recommended": {"color": style.CONTROLLER_COLOURS["tracking"], "linewidth": 2.2},
    "C1": {"color": style.CONTROLLER_COLOURS["pi"]},
    "C2": {"color": style.GREY},
    "passive": {"color": style.CONTROLLER_COLOURS["passive"], "linestyle": ":"},
    **{kind: {"color": colour} for kind, colour in style.CONTROLLER_COLOURS.items() if kind != "passive"},
}
RUN_COLOURS = (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.ORANGE, style.SKY)
"""Colours of runs that are not named after a kind of controller."""
LIMIT_LINE: Mapping[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": (0, (5, 2)), "zorder": 1.5}
LIMIT_IN_REACH = 0.6
"""A limit is drawn if it is at most this fraction of the panel's height beyond the curves."""
STATUS_COLOURS = {"LIMITED": "#F0E442", "STANDBY": "#BBBBBB", "DEGRADED": style.ORANGE, "FAIL_SAFE": style.VERMILION}
STATUS_SHOWN = ("STANDBY", "DEGRADED", "FAIL_SAFE")

MAP_LINE: Mapping[str, Any] = {"color": style.GREY, "linestyle": "-.", "linewidth": 1.3, "label": "map, steady", "zorder": 2.2}

BEFORE_START = 0.5
AFTER_START = 3.0
MOVED = math.radians(0.01)
AXIS_HEIGHT_MIN = 0.2
"""Minimum span of a panel, in deg, deg/s or m/s^2."""
SPEED_HELD = 0.5
"""Largest variation of a constant speed, in m/s."""


def column(run: FloatArray, name: str) -> FloatArray:
    """Return one column of a run in display units: angles in deg, speed in km/h, others in SI.

    The reference is NaN in STANDBY and FAIL_SAFE, in which the controller has none.
    """
    from codegen.sil.software import RECORD_COLUMNS, Status

    values = np.array(run[:, RECORD_COLUMNS.index(name)], dtype=np.float64)
    if name == "yaw_rate_reference_rad_s":
        idle = np.isin(run[:, RECORD_COLUMNS.index("status")], (Status.STANDBY, Status.FAIL_SAFE))
        values[idle] = np.nan
    if name == "speed_m_s":
        return values / KM_H
    return np.degrees(values) if name.endswith(("_rad", "_rad_s")) else values


def signal_limits(config: Config) -> dict[str, float]:
    """Return the limit of each column to either side in display units, deg and m/s^2: those of optimisation and actuator."""
    limits = config.limits
    return {
        "sideslip_rad": limits.sideslip_max_deg,
        "rear_angle_rad": min(limits.rear_angle_max_deg, config.rear_actuator.angle_max_deg),
        "lateral_acceleration_m_s2": limits.lateral_acceleration_max_g * config.road.gravity_m_s2,
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


def run_figure(
    runs: Mapping[str, FloatArray],
    title: str,
    *,
    marks: Sequence[Mark] = (),
    spans: Sequence[Span] = (),
    window: tuple[float, float] | None = None,
    of_map: FloatArray | None = None,
    limits: Mapping[str, float] | None = None,
    time_label: str = "Time (s)",
) -> Figure:
    """Draw runs (name -> array with columns RECORD_COLUMNS) over time, in panels below each other.

    A name that starts with "passive" denotes a car without a controller: no command, no status. Status is shown if it ever
    leaves normal operation, speed if it is not constant. A run ends where the car spins.

    Args:
        runs: runs in the order of the legend.
        title: title above all panels.
        marks, spans: times and time ranges to mark.
        window: start and end of the shown range in s; None selects it with `run_window`.
        of_map: (samples,) rad/s, the map's steady yaw rate in the samples of the first run; None omits it.
        limits: column -> limit to either side, in deg or m/s^2.
        time_label: label of the time axis.

    Raises:
        PlotError: no run, or an array of another shape.
    """
    looks = looks_of(runs)
    spun = {name: until_spin(run) for name, run in runs.items()}
    window = run_window(spun) if window is None else window
    status = {name: run for name, run in spun.items() if _has_incident(name, run, window)}
    varies = any(np.ptp(column(run, "speed_m_s")) > SPEED_HELD / KM_H for run in spun.values())
    signals = [*SIGNALS, *([SPEED_SIGNAL] if varies else [])]
    heights = [1.5, *[1.0] * (len(signals) - 1), *([0.12 + 0.16 * len(status)] if status else [])]
    with style.style():
        figure = style.new_figure(7.2, 1.6 * sum(heights) + 0.9)
        panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        for axes, signal in zip(panels, signals, strict=False):
            draw_signal(axes, spun, looks, signal, window)
        handles = run_handles(panels[0], "reference, command")
        if of_map is not None:
            handles += _draw_map(panels[0], next(iter(runs.values())), of_map, window)
        for axes, signal in zip(panels, signals, strict=False):
            _draw_spins(axes, runs, spun, looks, signal)
        handles += _draw_limits(panels, signals, limits or {})
        handles += spin_handles(runs, spun) + draw_spans(panels, spans)
        draw_marks(panels, marks)
        if status:
            handles += _draw_status(panels[-1], status, window)
        panels[-1].set(xlabel=time_label, xlim=window)
        figure.align_ylabels(panels[: len(signals)])
        figure.suptitle(heading(title))
        style.legend_below(figure, handles)
    return figure


def heading(title: str) -> str:
    """Return a title of one or more lines, each unchanged."""
    return "\n".join(style.plain(line) for line in title.split("\n"))


def _draw_spins(
    axes: Axes,
    runs: Mapping[str, FloatArray],
    spun: Mapping[str, FloatArray],
    looks: Mapping[str, Mapping[str, Any]],
    signal: _Signal,
) -> None:
    for name, run in spun.items():
        if len(run) < len(runs[name]):
            last = run[-1:]
            look = {**SPIN_MARKER, "color": looks[name]["color"], "label": "_", "zorder": 4}
            axes.plot(column(last, "time_s"), column(last, signal.column), **look)


def looks_of(runs: Mapping[str, FloatArray]) -> dict[str, Mapping[str, Any]]:
    from codegen.sil.software import RECORD_COLUMNS

    if not runs:
        raise style.PlotError("no runs to show", remedy="give at least one")
    for name, run in runs.items():
        if run.ndim != 2 or run.shape[1] != len(RECORD_COLUMNS) or run.shape[0] < 2:
            raise style.PlotError(
                f"shape {run.shape}, where (samples, {len(RECORD_COLUMNS)}) with two samples or more is needed",
                where=f"run {name}",
                remedy=f"give the columns {', '.join(RECORD_COLUMNS)}",
            )
    named = {name: RUN_LINES.get("passive" if _is_passive(name) else name) for name in runs}
    taken = {look["color"] for look in named.values() if look is not None}
    others = iter([colour for colour in RUN_COLOURS if colour not in taken] * len(runs) or RUN_COLOURS)
    return {name: look or {"color": next(others)} for name, look in named.items()}


def _is_passive(name: str) -> bool:
    return name.lower().startswith("passive")


def draw_signal(
    axes: Axes,
    runs: Mapping[str, FloatArray],
    looks: Mapping[str, Mapping[str, Any]],
    signal: _Signal,
    window: tuple[float, float],
) -> None:
    for name, run in runs.items():
        inside = run[(run[:, 0] >= window[0]) & (run[:, 0] <= window[1])]
        time = column(inside, "time_s")
        axes.plot(
            time, column(inside, signal.column), label=style.RUN_NAMES.get(name, style.plain(name)), zorder=3, **looks[name]
        )
        if signal.dashed is not None and not _is_passive(name):
            dashed = {**looks[name], "linestyle": (0, (4, 2)), "linewidth": 1.1}
            axes.plot(time, column(inside, signal.dashed), label="_", zorder=2.5, **dashed)
    axes.set_ylabel(signal.label)
    axes.margins(x=0.0)
    low, high = axes.get_ylim()
    if high - low < AXIS_HEIGHT_MIN:  # rounding errors must not look like motion
        axes.set_ylim(0.5 * (low + high - AXIS_HEIGHT_MIN), 0.5 * (low + high + AXIS_HEIGHT_MIN))
    axes.grid(True)


def run_handles(axes: Axes, dashed_name: str) -> list[Any]:
    handles: list[Any] = list(axes.get_legend_handles_labels()[0])
    if len(axes.get_lines()) > len(handles):
        handles.append(style.line_handle(color=style.GREY, linestyle=(0, (4, 2)), linewidth=1.1, label=dashed_name))
    return handles


def _draw_map(axes: Axes, run: FloatArray, of_map: FloatArray, window: tuple[float, float]) -> list[Any]:
    time = column(run, "time_s")
    inside = (time >= window[0]) & (time <= window[1])
    axes.plot(time[inside], np.degrees(of_map[inside]), **{**MAP_LINE, "label": "_"})
    return [style.line_handle(**MAP_LINE)]


def _draw_limits(panels: Sequence[Axes], signals: Sequence[_Signal], limits: Mapping[str, float]) -> list[Any]:
    """Draw the limits that are close to the curves and return their legend entry."""
    drawn = False
    for axes, signal in zip(panels, signals, strict=False):
        low, high = axes.get_ylim()
        reach = LIMIT_IN_REACH * (high - low)
        for level in (limits[signal.column], -limits[signal.column]) if signal.column in limits else ():
            if low - reach <= level <= high + reach:
                axes.axhline(level, label="_", **LIMIT_LINE)
                drawn = True
    return [style.line_handle(label="limit", **LIMIT_LINE)] if drawn else []


def _has_incident(name: str, run: FloatArray, window: tuple[float, float]) -> bool:
    from codegen.sil.software import Status

    inside = (run[:, 0] >= window[0]) & (run[:, 0] <= window[1])
    return not _is_passive(name) and bool(np.isin(column(run, "status")[inside], [Status[one] for one in STATUS_SHOWN]).any())


def _draw_status(axes: Axes, runs: Mapping[str, FloatArray], window: tuple[float, float]) -> list[Artist]:
    from codegen.sil.software import Status

    seen = set()
    for row, run in enumerate(runs.values()):
        time, status = column(run, "time_s"), column(run, "status")
        starts = np.flatnonzero(np.diff(status, prepend=np.nan) != 0.0)
        for first, last in zip(starts, [*starts[1:], len(time) - 1], strict=True):
            name = Status(int(status[first])).name
            if name in STATUS_COLOURS and time[last] > window[0] and time[first] < window[1]:
                axes.broken_barh([(time[first], time[last] - time[first])], (row - 0.4, 0.8), color=STATUS_COLOURS[name])
                seen.add(name)
    axes.set_yticks(range(len(runs)), [style.plain(name) for name in runs])
    axes.set(ylabel="Status", ylim=(len(runs) - 0.5, -0.5))
    shown = [(name, colour) for name, colour in STATUS_COLOURS.items() if name in seen]
    return [style.patch_handle(color=colour, label=name.lower().replace("_", "-")) for name, colour in shown]
