"""Margins of the feedback over speed, and what they cost: rise time, and sines at the steering wheel."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from codegen.design.margins import WARN_GAIN_MARGIN_DB, WARN_PHASE_MARGIN_DEG
from codegen.report.style import (
    SPEED_LABEL,
    new_figure,
    plain,
    style,
)
from codegen.report.suite_looks import LIMIT, REFERENCE, WARNING, lines_of, markers_of, name_handles

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hil_sim.suite.tracking import SuiteResult


def margins_figure(result: SuiteResult) -> Figure:
    """Gain margin, phase margin and peak sensitivity over speed: of the configured car, and the worst of the family."""
    with style():
        figure = new_figure(11.0, 4.4)
        panels = figure.subplots(1, 3)
        for axes, panel in zip(panels, MARGIN_PANELS, strict=True):
            draw_margins(axes, result, *panel)
        figure.suptitle("Margins of the feedback: of the configured car, and the worst of the family of cars")
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
    axes.set(xlabel=SPEED_LABEL, ylabel=label)
    axes.margins(x=0.0)
    axes.grid(True)


FAMILY: Mapping[str, dict[str, Any]] = {
    "itself": {"linestyle": "-", "linewidth": 1.2},
    "worst": {"linestyle": "-", "linewidth": 2.4, "marker": "o", "markersize": 3.5},
}


def _margin_handles(result: SuiteResult) -> list[Any]:
    from matplotlib.lines import Line2D

    looks = lines_of(result)
    kinds = (("itself", "the car itself"), ("worst", "worst of the family"))
    handles: list[Any] = [
        Line2D([], [], label=f"{plain(name)}: {text}", **{**looks[name], **FAMILY[kind]})
        for name in _with_feedback(result)
        for kind, text in kinds
    ]
    return [
        *handles,
        Line2D([], [], **{**LIMIT, "label": "asked for"}),
        Line2D([], [], **{**WARNING, "label": "a build warns below"}),
    ]


def price_figure(result: SuiteResult) -> Figure:
    """Rise time over speed, and gain and phase of sines at the steering wheel at the highest speed where they were driven."""
    looks = lines_of(result)
    fastest = max((row.speed_km_h for row in result.sine[result.tested]), default=None)
    with style():
        figure = new_figure(11.0 if fastest is not None else 5.0, 4.2)
        panels = figure.subplots(1, 3 if fastest is not None else 1, squeeze=False)[0]
        for name in reversed(result.subjects):
            rows = [row for row in result.rise_times.get(name, ()) if row.mean_s is not None]
            panels[0].plot([row.speed_km_h for row in rows], [row.mean_s for row in rows], label="_", **looks[name])
        panels[0].set(xlabel=SPEED_LABEL, ylabel="Rise time to 90 %, mean over the cells (s)")
        speeds = list(dict.fromkeys(cell.speed_km_h for cell in result.cells))
        panels[0].set_xticks(speeds, [f"{speed:g}" for speed in speeds])
        panels[0].set_ylim(bottom=0.0)
        if fastest is not None:
            _draw_sine(panels[1:], result, fastest)
        for axes in panels:
            axes.grid(True)
        figure.suptitle("What it costs: how soon the yaw rate follows the steering wheel, as configured")
        figure.legend(handles=name_handles(result, looks), loc="outside lower center", ncols=len(result.subjects))
    return figure


def _draw_sine(panels: Sequence[Axes], result: SuiteResult, speed: float) -> None:
    looks, markers = lines_of(result), markers_of(result)
    for name in reversed(result.subjects):
        sine = [row for row in result.sine[name] if row.speed_km_h == speed and row.phase_deg is not None]
        frequencies = [row.frequency_hz for row in sine]
        for axes, field in zip(panels, ("gain_of_map", "phase_deg"), strict=True):
            values = [getattr(row, field) for row in sine]
            axes.plot(frequencies, values, label="_", **{**looks[name], **_marked(markers[name])})
    for axes, figure, level in zip(panels, ("gain over the map's", "phase (deg)"), (1.0, 0.0), strict=True):
        axes.axhline(level, label="_", **REFERENCE)
        axes.set(xlabel="Frequency (Hz)", ylabel=f"Sine at {speed:g} km/h: {figure}")
        axes.set_xticks(list(dict.fromkeys(row.frequency_hz for row in result.sine[result.tested])))


def _marked(marker: Mapping[str, Any]) -> dict[str, Any]:
    return {key: marker[key] for key in ("marker", "markersize", "markeredgecolor")}
