"""The figures: maps, cuts through them, tyres, runs, and the overview. Each function returns a Matplotlib Figure.

On paper degrees and km/h, SI inside. Layer: above `refmap` and `sil`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from codegen.config import KM_H, Config, preset
from codegen.refmap.map import Binding, ReferenceMap
from codegen.report.style import (
    BLACK,
    BLUE,
    FRONT_ANGLE,
    FRONT_ANGLE_LABEL,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    QUANTITIES,
    RUN_NAMES,
    SIDESLIP,
    SKY,
    SPEED_LABEL,
    VERMILION,
    WHITE,
    YAW_RATE,
    FloatArray,
    PlotError,
    draw_quantity,
    draw_table,
    map_legend,
    new_figure,
    phase_lines,
    plain,
    save,
    style,
)
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

__all__ = [
    "PlotError",
    "front_angle_cut_figure",
    "map_figure",
    "overview_figure",
    "run_figure",
    "save",
    "three_maps_figure",
    "tyre_figure",
]

# --- maps --------------------------------------------------------------------------------------------------------------

BINDING_COLOURS = {
    int(Binding.NONE): "#F4F1E6",
    int(Binding.SLIP_FRONT | Binding.SLIP_REAR): VERMILION,
    int(Binding.REAR_ANGLE): BLUE,
    int(Binding.SIDESLIP): ORANGE,
    int(Binding.LATERAL_ACCELERATION): GREEN,
    int(Binding.SLIP_FRONT): PURPLE,
    int(Binding.SLIP_REAR): SKY,
}
OTHER_COLOURS = ("#999933", "#882255", "#44AA99", "#332288", "#DDCC77")
"""For sets of constraints without a colour of their own (P. Tol's muted scheme); what is rarer still shares grey."""


def map_figure(reference_map: ReferenceMap, title: str) -> Figure:
    """What a map holds, over speed and front angle: yaw rate, sideslip, rear angle, and which constraints bind.

    A bare map shows only what it has.
    """
    shown = [quantity for quantity in QUANTITIES if quantity.table(reference_map) is not None]
    panels = len(shown) + (reference_map.active is not None)
    columns, rows = {1: (1, 1), 2: (2, 1), 3: (3, 1), 4: (2, 2)}[panels]
    with style():
        figure = new_figure(5.2 * columns if panels < 3 else 10.4, 3.9 * rows if panels < 3 else 3.55 * rows)
        figure.suptitle(plain(title))
        grid = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        phase_line = False
        for axes, quantity in zip(grid.flat, shown, strict=False):
            scale = quantity.scale([reference_map])
            phase_line |= draw_quantity(axes, reference_map, quantity, scale)
            quantity.colour_bar(figure, axes, scale, label=quantity.unit)
            axes.set_title(quantity.name)
        _label_outer(grid)
        entries = map_legend(phase_line, not reference_map.feasible.all())
        if reference_map.active is not None:
            patches = _draw_binding(grid.flat[panels - 1], reference_map, reference_map.active)
            longest = max(len(str(patch.get_label())) for patch in patches)
            ncols = 3 if longest < 24 else 2 if longest < 48 else 1  # what fits beside the other legend
            figure.legend(handles=patches, loc="outside lower right", ncols=ncols, handlelength=1.3)
        if entries:
            figure.legend(handles=entries, loc="outside lower left")
    return figure


def _label_outer(grid: npt.NDArray[Any]) -> None:
    for axes in grid[-1]:
        axes.set_xlabel(SPEED_LABEL)
    for axes in grid[:, 0]:
        axes.set_ylabel(FRONT_ANGLE_LABEL)


def _draw_binding(axes: Axes, reference_map: ReferenceMap, active: npt.NDArray[np.uint8]) -> list[Patch]:
    from matplotlib.colors import ListedColormap, Normalize
    from matplotlib.patches import Patch

    from codegen.report.summary import binding_text

    found, count = np.unique(active[reference_map.feasible], return_counts=True)
    others = iter(OTHER_COLOURS)
    entries: dict[int, tuple[str, str]] = {}
    for flags in found[np.argsort(-count, kind="stable")].tolist():
        if (colour := BINDING_COLOURS.get(flags) or next(others, None)) is not None:
            entries[flags] = (binding_text(flags), colour)
    rarer = found.size - len(entries)
    names = [*entries.values(), *([(f"{rarer} rarer sets", GREY)] if rarer else [])]
    index = np.full(int(active.max()) + 1, len(entries))
    index[list(entries)] = np.arange(len(entries))
    table = np.where(reference_map.feasible, index[active].astype(float), np.nan)
    scale = Normalize(-0.5, len(names) - 0.5)
    draw_table(axes, reference_map, table, scale, ListedColormap([colour for _, colour in names]))
    axes.set_title("Binding constraints")
    return [Patch(facecolor=colour, edgecolor=GREY, linewidth=0.5, label=name) for name, colour in names]


def three_maps_figure(maps: Mapping[str, ReferenceMap]) -> Figure:
    """Cases below each other (name -> map), yaw rate, sideslip and rear angle beside each other, on shared scales."""
    if not maps:
        raise PlotError("no maps to show", remedy="give at least one")
    with style():
        figure = new_figure(10.4, 1.6 + 2.5 * len(maps))
        grid = figure.subplots(len(maps), len(QUANTITIES), sharex=True, sharey=True, squeeze=False)
        phase_line = False
        for axes_below, quantity in zip(grid.T, QUANTITIES, strict=True):
            scale = quantity.scale(maps.values())
            for axes, one in zip(axes_below, maps.values(), strict=True):
                phase_line |= draw_quantity(axes, one, quantity, scale)
            look = {"location": "top", "aspect": 30, "shrink": 0.9, "pad": 0.015}
            quantity.colour_bar(figure, axes_below, scale, label=quantity.label, **look)
        for axes, name in zip(grid[:, 0], maps, strict=True):
            axes.annotate(
                _case_name(name), (-0.22, 0.5), xycoords="axes fraction", rotation=90, ha="center", va="center", weight="bold"
            )
        _label_outer(grid)
        infeasible = not all(one.feasible.all() for one in maps.values())
        if entries := map_legend(phase_line, infeasible):
            figure.legend(handles=entries, loc="outside lower center", ncols=2)
    return figure


def _case_name(name: str) -> str:
    return name.upper() if name.lower() in CASE_LINES else plain(name)


# --- a cut at one front angle ------------------------------------------------------------------------------------------

CASE_LINES: Mapping[str, Mapping[str, Any]] = {
    "fws": {"color": GREY, "linestyle": "-"},
    "4ws-1": {"color": BLUE, "linestyle": "-"},
    "4ws-2": {"color": VERMILION, "linestyle": "--"},
}
OTHER_LINES = tuple({"color": colour, "linestyle": "-."} for colour in (GREEN, PURPLE, ORANGE, SKY, BLACK))

PAPER_SPEED = 43.9 * KM_H
PAPER_FRONT_ANGLE = math.radians(4.0)
PAPER_TABLE = {"fws": (15.35, 1.101), "4ws-1": (26.82, 1.08), "4ws-2": (21.35, 0.03)}
"""The paper's table at this point: yaw rate in deg/s and |beta| in deg."""


def at_front_angle(reference_map: ReferenceMap, values: FloatArray, front_angle: float) -> FloatArray:
    """A table (n, m) along the speeds (n,) at one front angle (rad): linear between breakpoints, NaN beside infeasible cells.

    Raises:
        PlotError: the angle is outside the map.
    """
    angles = reference_map.front_angle
    place = float(np.interp(front_angle, angles, np.arange(angles.size), left=-1.0, right=-1.0))
    if not place >= 0.0:  # NaN is outside too
        low, high = np.degrees(angles[[0, -1]])
        raise PlotError(
            f"{math.degrees(front_angle):.4g} deg is outside the map's front angles",
            where="front_angle",
            remedy=f"choose {low:.4g} to {high:.4g} deg",
        )
    nearest = round(place)
    if abs(place - nearest) < 1e-9:  # on a breakpoint the next column, feasible or not, has no say
        return np.array(values[:, nearest])
    left = int(place)
    share = place - left
    result: FloatArray = (1.0 - share) * values[:, left] + share * values[:, left + 1]
    return result


def front_angle_cut_figure(maps: Mapping[str, ReferenceMap], front_angle: float) -> Figure:
    """Yaw rate and sideslip over speed at one front angle (rad), a line for each case, at feasible speeds.

    Where the cut is the paper's (its car, its cases, 4 deg), the values of its table are marked.

    Raises:
        PlotError: no map, or the angle is outside one.
    """
    if not maps:
        raise PlotError("no maps to show", remedy="give at least one")
    with style():
        figure = new_figure(6.4, 5.6)
        yaw_axes, sideslip_axes = figure.subplots(2, 1, sharex=True)
        lines = iter(OTHER_LINES * len(maps))
        marked = False
        for name, one in maps.items():
            look = CASE_LINES.get(name.lower()) or next(lines)
            for axes, quantity, entry in ((yaw_axes, YAW_RATE, 0), (sideslip_axes, SIDESLIP, 1)):
                table = quantity.degrees(one)
                if table is None:
                    continue
                values = at_front_angle(one, table, front_angle)
                axes.plot(one.speed / KM_H, values, label=_case_name(name), **look)
                if _is_paper(one, name.lower()) and math.isclose(front_angle, PAPER_FRONT_ANGLE, rel_tol=1e-6):
                    here = np.interp(PAPER_SPEED, one.speed, values)
                    # The table gives |beta|: it is marked on the side where the map has it.
                    value = math.copysign(PAPER_TABLE[name.lower()][entry], here)
                    axes.plot([43.9], [value], "o", color=look["color"], markerfacecolor=WHITE, markersize=6, zorder=5)
                    marked = True
        _finish_cut(figure, yaw_axes, sideslip_axes, front_angle, marked)
    return figure


def _is_paper(reference_map: ReferenceMap, name: str) -> bool:
    paper, own = preset(), reference_map.config
    if own is None or name not in PAPER_TABLE or reference_map.case != name or own.cases.get(name) != paper.cases[name]:
        return False
    return (own.vehicle, own.tyre, own.road, own.limits) == (paper.vehicle, paper.tyre, paper.road, paper.limits)


def _finish_cut(figure: Figure, yaw_axes: Axes, sideslip_axes: Axes, front_angle: float, marked: bool) -> None:
    from matplotlib.lines import Line2D

    handles: list[Any] = list(yaw_axes.get_lines())
    handles = [line for line in handles if not line.get_label().startswith("_")]
    if marked:
        for axes in (yaw_axes, sideslip_axes):
            axes.axvline(43.9, color=BLACK, linewidth=0.8, linestyle=":", zorder=0)
        ring: dict[str, Any] = {"marker": "o", "color": BLACK, "markerfacecolor": WHITE, "markersize": 6}
        handles.append(Line2D([], [], linestyle=":", linewidth=0.8, label="paper's table, 43.9 km/h", **ring))
    sideslip_axes.axhline(0.0, color=BLACK, linewidth=0.6, zorder=1)
    for axes, quantity in ((yaw_axes, YAW_RATE), (sideslip_axes, SIDESLIP)):
        axes.set_ylabel(quantity.label)
        axes.grid(True)
    yaw_axes.set_ylim(bottom=0.0)
    sideslip_axes.set_xlabel(SPEED_LABEL)
    figure.align_ylabels()
    figure.suptitle(f"Reference maps at {FRONT_ANGLE} = {math.degrees(front_angle):.4g} deg")
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))


# --- tyres -------------------------------------------------------------------------------------------------------------

LOAD_SHARES = (0.5, 0.75, 1.0, 1.25, 1.5)
TYRE_SLIP_MAX = math.radians(8.0)


def tyre_figure(config: Config) -> Figure:
    """Lateral force of a front and of a rear tyre over slip, for several wheel loads, with the linear range.

    Raises:
        ConfigError: the tyre has no end to its linear range.
    """
    tyres = AxleTyres.from_config(config)
    axles = (("Front tyre", tyres.front, tyres.front_slip_bound), ("Rear tyre", tyres.rear, tyres.rear_slip_bound))
    slip_max = max(TYRE_SLIP_MAX, 3.0 * tyres.front_slip_bound, 3.0 * tyres.rear_slip_bound)
    with style():
        figure = new_figure(9.6, 4.6)
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        for axes, (name, tyre, slip_bound) in zip(panels, axles, strict=True):
            _draw_tyre(axes, tyre, slip_bound, slip_max)
            axes.set_title(f"{name}, road friction {config.road.friction:g}")
            axes.set_xlabel(r"Slip angle $\alpha$ (deg)")
        panels[0].set_ylabel("Lateral force of one tyre (kN)")
        handles = panels[0].get_legend_handles_labels()[0]
        handles[-1].set_label(f"linear range: within {config.limits.slip_departure_percent:g} % of the tangent")
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _draw_tyre(axes: Axes, tyre: MagicFormulaTyre, slip_bound: float, slip_max: float) -> None:
    import matplotlib

    shades = matplotlib.colormaps["Blues"](np.linspace(0.5, 1.0, len(LOAD_SHARES)))
    slip = np.linspace(0.0, slip_max, 401)
    for share, shade in zip(LOAD_SHARES, shades, strict=True):
        load, static = share * tyre.static_load, share == 1.0
        force = tyre.force(slip, load) / 1e3
        label = "Magic Formula at the wheel load named" if static else "_"
        axes.plot(np.degrees(slip), force, color=shade, linewidth=2.2 if static else 1.3, label=label)
        name = f"{load / 1e3:.2f} kN" + (" (static)" if static else "")
        at_end: dict[str, Any] = {"xytext": (4, 0), "textcoords": "offset points", "va": "center", "annotation_clip": False}
        axes.annotate(name, (math.degrees(slip_max), force[-1]), color=shade, **at_end)
    top = float(np.max(tyre.force(slip, LOAD_SHARES[-1] * tyre.static_load)))

    def tangent(angle: npt.ArrayLike) -> FloatArray:
        result: FloatArray = tyre.cornering_stiffness * (np.asarray(angle) - tyre.horizontal_shift) + tyre.vertical_shift
        return result

    ends = np.array([0.0, 0.97 * top / tyre.cornering_stiffness])
    look: dict[str, Any] = {"color": BLACK, "linestyle": "--", "linewidth": 1.1, "label": "tangent at zero, static load"}
    axes.plot(np.degrees(ends), tangent(ends) / 1e3, **look)
    bound = math.degrees(slip_bound)
    axes.axvspan(0.0, bound, color=SKY, alpha=0.25, linewidth=0.0, label="linear range")
    axes.plot([bound], [float(tyre.force(slip_bound)) / 1e3], "o", color=BLACK, markersize=4.5, zorder=5)
    axes.annotate(rf"$\overline{{\alpha}}$ = {bound:.3f} deg", (bound, 0.0), (5, 7), textcoords="offset points")
    axes.set(xlim=(0.0, math.degrees(slip_max)), ylim=(min(0.0, float(tyre.force(0.0)) / 1e3), 1.05 * top / 1e3))
    axes.grid(True)


# --- runs --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Signal:
    """A panel of a run: a column of RECORD_COLUMNS, and what is drawn dashed beside it."""

    label: str
    column: str
    dashed: str | None = None


YAW_RATE_SIGNAL = _Signal("Yaw rate\n(deg/s)", "yaw_rate_rad_s", "yaw_rate_reference_rad_s")
SIGNALS = (
    YAW_RATE_SIGNAL,
    _Signal("Sideslip\n(deg)", "sideslip_rad"),
    _Signal("Rear angle\n(deg)", "rear_angle_rad", "rear_angle_command_rad"),
    _Signal("Front angle\n(deg)", "front_angle_rad"),
    _Signal("Lateral acc.\n(m/s²)", "lateral_acceleration_m_s2"),
)
RUN_LINES: Mapping[str, Mapping[str, Any]] = {
    "C1": {"color": BLUE},
    "C2": {"color": GREY},
    "passive": {"color": BLACK, "linestyle": ":"},
}
RUN_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY)
STATUS_COLOURS = {"LIMITED": "#F0E442", "STANDBY": "#BBBBBB", "DEGRADED": ORANGE, "FAIL_SAFE": VERMILION}
STATUS_SHOWN = ("STANDBY", "DEGRADED", "FAIL_SAFE")

BEFORE_START = 0.5
AFTER_START = 3.0
MOVED = math.radians(0.01)


def column(run: FloatArray, name: str) -> FloatArray:
    """One column of a run as it is drawn: angles in deg, others in SI; no reference where the controller gives none."""
    from codegen.sil.software import RECORD_COLUMNS, Status

    values = np.array(run[:, RECORD_COLUMNS.index(name)], dtype=np.float64)
    if name == "yaw_rate_reference_rad_s":
        idle = np.isin(run[:, RECORD_COLUMNS.index("status")], (Status.STANDBY, Status.FAIL_SAFE))
        values[idle] = np.nan
    return np.degrees(values) if name.endswith(("_rad", "_rad_s")) else values


def run_window(runs: Mapping[str, FloatArray]) -> tuple[float, float]:
    """The time worth showing: from 0.5 s before the front angle first moves to 3 s after, or until all has settled."""
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


def run_figure(runs: Mapping[str, FloatArray], title: str) -> Figure:
    """Runs (name -> array with columns RECORD_COLUMNS) over time, in panels below each other.

    A name that starts with "passive" is a car without control: no command, no status. Status is shown where it ever leaves
    normal operation.

    Raises:
        PlotError: no run, or an array of another shape.
    """
    looks, window = _looks(runs), run_window(runs)
    status = {name: run for name, run in runs.items() if _has_incident(name, run, window)}
    heights = [1.5, *[1.0] * (len(SIGNALS) - 1), *([0.12 + 0.16 * len(status)] if status else [])]
    with style():
        figure = new_figure(7.2, 1.6 * sum(heights) + 0.9)
        panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        for axes, signal in zip(panels, SIGNALS, strict=False):
            _draw_signal(axes, runs, looks, signal, window)
        handles = _run_handles(panels[0], "reference, command")
        if status:
            handles += _draw_status(panels[-1], status, window)
        panels[-1].set(xlabel="Time (s)", xlim=window)
        figure.align_ylabels()
        figure.suptitle(plain(title))
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4))
    return figure


def _looks(runs: Mapping[str, FloatArray]) -> dict[str, Mapping[str, Any]]:
    from codegen.sil.software import RECORD_COLUMNS

    if not runs:
        raise PlotError("no runs to show", remedy="give at least one")
    for name, run in runs.items():
        if run.ndim != 2 or run.shape[1] != len(RECORD_COLUMNS) or run.shape[0] < 2:
            raise PlotError(
                f"shape {run.shape}, where (samples, {len(RECORD_COLUMNS)}) with two samples or more is needed",
                where=f"run {name}",
                remedy=f"give the columns {', '.join(RECORD_COLUMNS)}",
            )
    free = [colour for colour in RUN_COLOURS if not ("C1" in runs and colour == BLUE)]
    others = iter(free * len(runs))
    return {name: RUN_LINES.get("passive" if _is_passive(name) else name) or {"color": next(others)} for name in runs}


def _is_passive(name: str) -> bool:
    return name.lower().startswith("passive")


def _draw_signal(
    axes: Axes,
    runs: Mapping[str, FloatArray],
    looks: Mapping[str, Mapping[str, Any]],
    signal: _Signal,
    window: tuple[float, float],
) -> None:
    for name, run in runs.items():
        inside = run[(run[:, 0] >= window[0]) & (run[:, 0] <= window[1])]
        time = column(inside, "time_s")
        axes.plot(time, column(inside, signal.column), label=RUN_NAMES.get(name, plain(name)), zorder=3, **looks[name])
        if signal.dashed is not None and not _is_passive(name):
            dashed = {**looks[name], "linestyle": (0, (4, 2)), "linewidth": 1.1}
            axes.plot(time, column(inside, signal.dashed), label="_", zorder=2.5, **dashed)
    axes.set_ylabel(signal.label)
    axes.margins(x=0.0)
    axes.grid(True)


def _run_handles(axes: Axes, dashed_name: str) -> list[Any]:
    from matplotlib.lines import Line2D

    handles: list[Any] = list(axes.get_legend_handles_labels()[0])
    if len(axes.get_lines()) > len(handles):
        handles.append(Line2D([], [], color=GREY, linestyle=(0, (4, 2)), linewidth=1.1, label=dashed_name))
    return handles


def _has_incident(name: str, run: FloatArray, window: tuple[float, float]) -> bool:
    from codegen.sil.software import Status

    inside = (run[:, 0] >= window[0]) & (run[:, 0] <= window[1])
    return not _is_passive(name) and bool(np.isin(column(run, "status")[inside], [Status[one] for one in STATUS_SHOWN]).any())


def _draw_status(axes: Axes, runs: Mapping[str, FloatArray], window: tuple[float, float]) -> list[Patch]:
    from matplotlib.patches import Patch

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
    axes.set_yticks(range(len(runs)), [plain(name) for name in runs])
    axes.set(ylabel="Status", ylim=(len(runs) - 0.5, -0.5))
    shown = [(name, colour) for name, colour in STATUS_COLOURS.items() if name in seen]
    return [Patch(color=colour, label=name.lower().replace("_", "-")) for name, colour in shown]


# --- the overview ------------------------------------------------------------------------------------------------------


def overview_figure(config: Config, maps: Mapping[str, ReferenceMap], runs: Mapping[str, FloatArray]) -> Figure:
    """The 4WS-2 map and what the controller makes of it, in one wide picture, 1600 by 620 pixels.

    Raises:
        PlotError: no map "4ws-2", or runs that cannot be shown.
    """
    by_name = {name.lower(): one for name, one in maps.items()}
    if "4ws-2" not in by_name:
        raise PlotError("no map 4ws-2", where=f"maps {', '.join(maps)}", remedy="solve the case 4ws-2 first")
    looks, window, reference_map = _looks(runs), run_window(runs), by_name["4ws-2"]
    with style(1.3):
        figure = new_figure(1600 / 130, 620 / 130, dpi=130)
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.05))
        _draw_overview_map(figure, left, reference_map, runs)
        left.set_title(f"Optimal yaw-rate map 4WS-2, road friction {config.road.friction:g}")
        _draw_signal(right, runs, looks, YAW_RATE_SIGNAL, window)
        right.set(xlabel="Time (s)", ylabel=YAW_RATE.label, title="Generated C in the loop: step steer")
        right.legend(handles=_run_handles(right, "reference"), loc="lower right")
    return figure


def _draw_overview_map(figure: Figure, axes: Axes, reference_map: ReferenceMap, runs: Mapping[str, FloatArray]) -> None:
    scale = YAW_RATE.scale([reference_map])
    entries = map_legend(draw_quantity(axes, reference_map, YAW_RATE, scale), not reference_map.feasible.all())
    YAW_RATE.colour_bar(figure, axes, scale, label=YAW_RATE.label)
    last = next(iter(runs.values()))[-1:]
    speed, front_angle = column(last, "speed_m_s")[0] / KM_H, column(last, "front_angle_rad")[0]
    point: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 9, "color": VERMILION, "markeredgecolor": WHITE}
    label = f"the step: {speed:.4g} km/h, {front_angle:.3g} deg"
    entries += axes.plot([speed], [front_angle], label=label, zorder=4, **point)
    for piece in phase_lines(reference_map)[:1]:
        foot = float(piece[np.argmin(piece[:, 1]), 0])
        for side, name, align in ((-2.0, "rear wheels opposite", "right"), (2.0, "same direction", "left")):
            axes.text(foot + side, 0.35, name, color=WHITE, ha=align, va="center")
    axes.set(xlabel=SPEED_LABEL, ylabel=FRONT_ANGLE_LABEL)
    axes.legend(handles=entries, loc="upper right", frameon=True, framealpha=1.0)
