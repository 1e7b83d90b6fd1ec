"""Step responses of the test set."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from codegen.arrays import FloatArray
from codegen.report.run_marks import SPIN_MARKER, SPIN_NAME, until_spin
from codegen.report.run_plots import column
from codegen.report.style import GREY, REAR_ANGLE, SKY, new_figure, plain, style
from codegen.report.suite_looks import REFERENCE, lines_of, name_handles
from hil_sim.suite.cells import STEER_TIME

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hil_sim.suite.tracking import Shown, SuiteResult

BEFORE, AFTER = 0.2, 2.0
"""s around the step that are shown."""
FOLLOWED: dict[str, Any] = {**REFERENCE, "color": SKY, "zorder": 4.5}


SIGNALS = (
    ("Yaw rate (deg/s)", "yaw_rate_rad_s"),
    (f"Rear angle {REAR_ANGLE} (deg)", "rear_angle_rad"),
    (r"Sideslip $\beta$ (deg)", "sideslip_rad"),
)


def steps_figure(result: SuiteResult) -> Figure:
    """The paper's step and some cells, a column each: yaw rate with the map's value and the model's, rear angle, sideslip."""
    looks = lines_of(result)
    with style():
        figure = new_figure(3.1 * len(result.shown) + 0.6, 7.6)
        panels = figure.subplots(len(SIGNALS), len(result.shown), sharex=True, squeeze=False)
        spun = False
        for place, shown in enumerate(result.shown):
            for axes, (label, name) in zip(panels[:, place], SIGNALS, strict=True):
                spun |= draw_step(axes, result, shown, name, looks)
                if place == 0:
                    axes.set_ylabel(label)
            title = "C1: " if place == 0 else ""
            panels[0, place].set_title(f"{title}{cell_title(shown)}")
            panels[-1, place].set_xlabel("Time after the step (s)")
        handles = [*name_handles(result, looks), *reference_handles(result)]
        handles += [spin_handle()] if spun else []
        figure.align_ylabels(panels[:, 0])
        figure.suptitle("Step steer, as configured: one sample of delay in the computation")
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def cell_title(shown: Shown) -> str:
    return f"{shown.cell.speed_km_h:g} km/h, {shown.cell.front_angle_deg:.3g} deg"


def draw_step(axes: Axes, result: SuiteResult, shown: Shown, name: str, looks: Mapping[str, Mapping[str, Any]]) -> bool:
    """Draw one signal of all subjects, as far as the car stays on the road; whether one spins in the time shown."""
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


def _draw_references(axes: Axes, result: SuiteResult, shown: Shown) -> None:
    """Draw the steady yaw rate of the map, and the reference of the controller under test."""
    inside = _around_step(shown.records[result.tested])
    axes.plot(column(inside, "time_s") - STEER_TIME, column(inside, "yaw_rate_reference_rad_s"), label="_", **FOLLOWED)
    axes.axhline(math.degrees(shown.map_yaw_rate), label="_", **REFERENCE)


def reference_handles(result: SuiteResult) -> list[Any]:
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], label=f"reference of {plain(result.tested)}", **FOLLOWED),
        Line2D([], [], label="the map's value", **REFERENCE),
    ]


def spin_handle() -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=GREY, label=SPIN_NAME, **SPIN_MARKER)
