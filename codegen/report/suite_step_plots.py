"""Step responses, margins and rise times of the test set, with the colours and markers of its subjects."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from codegen.arrays import FloatArray
from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG
from codegen.figures.runs import SPIN_NAME, column, until_spin
from codegen.report import style
from codegen.report.style import SPIN_MARKER
from hil_sim.suite.cells import STEER_TIME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hil_sim.suite.tracking import CellRuns, SuiteResult


MORE_COLOURS = (style.ORANGE, style.BLUE, style.GREEN, style.PURPLE, style.VERMILION, style.GREY)
MARKERS = ("o", "s", "^", "D", "v", "P", "*")
LIMIT: dict[str, Any] = {"color": style.BLACK, "linewidth": 1.0, "linestyle": (0, (5, 2)), "zorder": 1.5, "label": "_"}
WARNING: dict[str, Any] = {"color": style.GREY, "linewidth": 1.0, "linestyle": (0, (1, 1.5)), "zorder": 1.5, "label": "_"}
REFERENCE: dict[str, Any] = {"color": style.GREY, "linewidth": 1.2, "linestyle": (0, (4, 2)), "zorder": 2}


def lines_of(result: SuiteResult) -> dict[str, dict[str, Any]]:
    """Return colour and line style of each subject; the one under test has the widest line."""
    taken = {style.CONTROLLER_COLOURS.get(name) for name in result.subjects}
    spare = iter([colour for colour in MORE_COLOURS if colour not in taken] * len(result.subjects))
    looks: dict[str, dict[str, Any]] = {}
    for name in result.subjects:
        looks[name] = {
            "color": style.CONTROLLER_COLOURS.get(name) or next(spare),
            "linewidth": 2.2 if name == result.tested else 1.3,
        }
        if name == "passive":
            looks[name]["linestyle"] = ":"
        looks[name]["zorder"] = 4 if name == result.tested else 3
    return looks


def markers_of(result: SuiteResult) -> dict[str, dict[str, Any]]:
    """Return colour and marker of each subject, for pictures without lines."""
    return {
        name: {"color": look["color"], "marker": marker, "linestyle": "", "markersize": 5.5, "markeredgecolor": style.WHITE}
        for (name, look), marker in zip(lines_of(result).items(), MARKERS, strict=False)
    }


def name_handles(result: SuiteResult, looks: Mapping[str, Mapping[str, Any]]) -> list[Any]:
    """Return legend entries: names of the subjects, with lines or markers."""
    return [style.line_handle(label=style.plain(name), **{**looks[name], "zorder": 2}) for name in result.subjects]


def margins_figure(result: SuiteResult) -> Figure:
    """Draw gain margin, phase margin and peak sensitivity over speed, of the configured car and the worst of the family
    without its slow cars (`family_margins`)."""
    with style.style():
        figure = style.new_figure(11.0, 4.4)
        panels = figure.subplots(1, 3)
        for axes, panel in zip(panels, MARGIN_PANELS, strict=True):
            draw_margins(axes, result, *panel)
        figure.suptitle("Margins of the feedback: of the configured car, and the worst of the family without slow cars")
        handles = _margin_handles(result)
        figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 6))
    return figure


MARGIN_PANELS = (
    ("Gain margin (dB)", "gain_margin_db", WARN_GAIN_MARGIN_DB),
    ("Phase margin (deg)", "phase_margin_deg", WARN_PHASE_MARGIN_DEG),
    ("Peak sensitivity", "sensitivity", None),
)
SENSITIVITY_TOP = 5.0


def _with_feedback(result: SuiteResult) -> list[str]:
    return [name for name in result.subjects if name in result.margins]


def draw_margins(axes: Axes, result: SuiteResult, label: str, field: str, warning: float | None) -> None:
    looks = lines_of(result)
    for name in _with_feedback(result):
        found = result.margins[name]
        for points, line in ((found.configured, FAMILY["itself"]), (found.points, FAMILY["worst"])):
            speeds = [point.speed_km_h for point in points]
            values = [math.nan if (value := getattr(point, field)) is None else value for point in points]
            axes.plot(speeds, values, label="_", **{**looks[name], **line})
    axes.axhline(getattr(result.limits, field), **LIMIT)
    if warning is not None:
        axes.axhline(warning, **WARNING)
        axes.set_ylim(bottom=0.0)
    else:
        axes.set_ylim(1.0, SENSITIVITY_TOP)
    axes.set(xlabel=style.SPEED_LABEL, ylabel=label)
    axes.margins(x=0.0)
    axes.grid(True)


FAMILY: Mapping[str, dict[str, Any]] = {
    "itself": {"linestyle": "-", "linewidth": 1.2},
    "worst": {"linestyle": "-", "linewidth": 2.4, "marker": "o", "markersize": 3.5},
}


def _margin_handles(result: SuiteResult) -> list[Any]:
    looks = lines_of(result)
    kinds = (("itself", "the car itself"), ("worst", "worst of the family"))
    handles: list[Any] = [
        style.line_handle(label=f"{style.plain(name)}: {text}", **{**looks[name], **FAMILY[kind]})
        for name in _with_feedback(result)
        for kind, text in kinds
    ]
    return [
        *handles,
        style.line_handle(**{**LIMIT, "label": "required"}),
        style.line_handle(**{**WARNING, "label": "a build warns below"}),
    ]


def price_figure(result: SuiteResult) -> Figure:
    """Draw the rise time over speed, and gain and phase of sines at the steering wheel at the highest simulated speed."""
    looks = lines_of(result)
    fastest = max((row.speed_km_h for row in result.sine[result.tested]), default=None)
    with style.style():
        figure = style.new_figure(11.0 if fastest is not None else 5.0, 4.2)
        panels = figure.subplots(1, 3 if fastest is not None else 1, squeeze=False)[0]
        for name in reversed(result.subjects):
            rows = [row for row in result.rise_times.get(name, ()) if row.mean_s is not None]
            panels[0].plot([row.speed_km_h for row in rows], [row.mean_s for row in rows], label="_", **looks[name])
        panels[0].set(xlabel=style.SPEED_LABEL, ylabel="Rise time to 90 %, mean over the cells (s)")
        speeds = list(dict.fromkeys(cell.speed_km_h for cell in result.cells))
        panels[0].set_xticks(speeds, [f"{speed:g}" for speed in speeds])
        panels[0].set_ylim(bottom=0.0)
        if fastest is not None:
            _draw_sine(panels[1:], result, fastest)
        for axes in panels:
            axes.grid(True)
        figure.suptitle("Response of the yaw rate to the steering wheel, as configured")
        figure.legend(handles=name_handles(result, looks), loc="outside lower center", ncols=len(result.subjects))
    return figure


def _draw_sine(panels: Sequence[Axes], result: SuiteResult, speed: float) -> None:
    looks, markers = lines_of(result), markers_of(result)
    for name in reversed(result.subjects):
        sine = [row for row in result.sine[name] if row.speed_km_h == speed and row.phase_deg is not None]
        frequencies = [row.frequency_hz for row in sine]
        marker = {key: markers[name][key] for key in ("marker", "markersize", "markeredgecolor")}
        for axes, field in zip(panels, ("gain_of_map", "phase_deg"), strict=True):
            values = [getattr(row, field) for row in sine]
            axes.plot(frequencies, values, label="_", **{**looks[name], **marker})
    for axes, figure, level in zip(panels, ("gain over the map's", "phase (deg)"), (1.0, 0.0), strict=True):
        axes.axhline(level, label="_", **REFERENCE)
        axes.set(xlabel="Frequency (Hz)", ylabel=f"Sine at {speed:g} km/h: {figure}")
        axes.set_xticks(list(dict.fromkeys(row.frequency_hz for row in result.sine[result.tested])))


BEFORE, AFTER = 0.2, 2.0
"""CellRuns time before and after the step, in s."""
FOLLOWED: dict[str, Any] = {**REFERENCE, "color": style.SKY, "zorder": 4.5}


MOTION_SIGNALS = (
    ("Yaw rate (deg/s)", "yaw_rate_rad_s"),
    ("Lateral acc. (m/s²)", "lateral_acceleration_m_s2"),
    (r"Sideslip $\beta$ (deg)", "sideslip_rad"),
)
SIGNALS = (*MOTION_SIGNALS, (f"Rear angle {style.REAR_ANGLE} (deg)", "rear_angle_rad"))


def steps_figure(result: SuiteResult) -> Figure:
    """Draw the paper's step and some cells in columns: motion of the car, with the values of map and model, and rear angle."""
    looks = lines_of(result)
    with style.style():
        figure = style.new_figure(3.1 * len(result.shown) + 0.6, 9.6)
        panels = figure.subplots(len(SIGNALS), len(result.shown), sharex=True, squeeze=False)
        spun = False
        for place, shown in enumerate(result.shown):
            for axes, (label, name) in zip(panels[:, place], SIGNALS, strict=True):
                spun |= draw_step(axes, result, shown, name, looks)
                if place == 0:
                    axes.set_ylabel(label)
            title = "C1: " if place == 0 else ""
            panels[0, place].set_title(f"{title}{cell_title(shown)}")
            panels[-1, place].set_xlabel(style.AFTER_STEP)
        handles = [*name_handles(result, looks), *reference_handles(result)]
        handles += [spin_handle()] if spun else []
        figure.align_ylabels(panels[:, 0])
        figure.suptitle(f"Step steer, as configured: {result.delay_text} in the computation")
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def cell_title(shown: CellRuns) -> str:
    return f"{shown.cell.speed_km_h:g} km/h, {shown.cell.front_angle_deg:.3g} deg"


def draw_step(axes: Axes, result: SuiteResult, shown: CellRuns, name: str, looks: Mapping[str, Mapping[str, Any]]) -> bool:
    """Draw one signal of all subjects until the car spins. Return whether one spins in the shown time."""
    spun = False
    for subject in result.subjects:
        whole = shown.records[subject]
        run = _around_step(until_spin(whole))
        time = column(run, "time_s") - STEER_TIME
        axes.plot(time, column(run, name), label="_", **looks[subject])
        if len(until_spin(whole)) < len(whole) and time[-1] < AFTER - 0.02:
            spun = True
            axes.plot(time[-1:], column(run, name)[-1:], color=looks[subject]["color"], label="_", zorder=5, **SPIN_MARKER)
    if name == "yaw_rate_rad_s":
        _draw_references(axes, result, shown)
    axes.set_xlim(-BEFORE, AFTER)
    axes.grid(True)
    return spun


def _around_step(run: FloatArray) -> FloatArray:
    time = run[:, 0] - STEER_TIME
    inside = run[(time >= -BEFORE - 1e-9) & (time <= AFTER + 1e-9)]
    return inside if len(inside) >= 2 else run[:2]


def _draw_references(axes: Axes, result: SuiteResult, shown: CellRuns) -> None:
    """Draw the steady yaw rate of the map, and the reference of the controller under test."""
    inside = _around_step(shown.records[result.tested])
    axes.plot(column(inside, "time_s") - STEER_TIME, column(inside, "yaw_rate_reference_rad_s"), label="_", **FOLLOWED)
    axes.axhline(math.degrees(shown.map_yaw_rate), label="_", **REFERENCE)


def reference_handles(result: SuiteResult) -> list[Any]:
    return [
        style.line_handle(label=f"reference of {style.plain(result.tested)}", **FOLLOWED),
        style.line_handle(label="the map's value", **REFERENCE),
    ]


def spin_handle() -> Any:
    return style.line_handle(color=style.GREY, label=SPIN_NAME, **SPIN_MARKER)
