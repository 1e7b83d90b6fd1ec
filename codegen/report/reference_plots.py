"""The comparison of references (`codegen suite references`) in one picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.figures.draw import new_figure, style, words
from codegen.figures.maps import QUANTITIES, at_front_angle
from codegen.report.style import FRONT_ANGLE, SPEED_LABEL
from codegen.report.suite_step_plots import lines_of, name_handles
from codegen.units import KM_H
from hil_sim.suite.cells import NOMINAL

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hil_sim.suite.references import ReferencesResult
    from hil_sim.suite.runs import CellResult

CUT_FRONT_ANGLE = math.radians(2.0)


def _lateral_acceleration(each: CellResult) -> float | None:
    """Return the steady lateral acceleration in m/s^2."""
    steady = each.yaw_rate_steady_deg_s
    return None if steady is None else math.radians(steady) * each.cell.speed_km_h * KM_H


STEP_PANELS: tuple[tuple[str, Callable[[CellResult], float | None]], ...] = (
    ("Largest overshoot (%)", lambda each: each.overshoot_percent),
    ("Largest rise time (s)", lambda each: each.rise_time_s),
    ("Largest lateral acc., steady (m/s²)", _lateral_acceleration),
    (r"Largest $|\beta|$ (deg)", lambda each: each.sideslip_max_deg),
)


def references_figure(result: ReferencesResult) -> Figure:
    """Draw the maps at one front angle above, and figures of the step steers over speed below."""
    looks = lines_of(result.suite)
    grid = next(iter(result.maps.values())).front_angle
    cut = float(np.clip(CUT_FRONT_ANGLE, grid[0], grid[-1]))
    with style():
        figure = new_figure(14.0, 7.2)
        above, below = figure.subplots(2, len(QUANTITIES))
        for axes, quantity in zip(above, QUANTITIES, strict=True):
            for name, one in reversed(list(result.maps.items())):
                table = quantity.displayed(one)
                if table is not None:
                    axes.plot(one.speed / KM_H, at_front_angle(one, table, cut), label="_", **looks[name])
            axes.set(xlabel=SPEED_LABEL, ylabel=words(quantity.label))
            axes.grid(True)
        above[0].set_title(f"The maps at {FRONT_ANGLE} = {math.degrees(cut):.3g} deg")
        for axes, (label, figure_of) in zip(below, STEP_PANELS, strict=True):
            _draw_steps(axes, result, figure_of, looks)
            axes.set(xlabel=SPEED_LABEL, ylabel=label)
        below[0].set_title("Step steers without a spin")
        figure.suptitle("References under the same controller")
        handles = name_handles(result.suite, looks)
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def _draw_steps(
    axes: Axes,
    result: ReferencesResult,
    figure_of: Callable[[CellResult], float | None],
    looks: Mapping[str, Mapping[str, Any]],
) -> None:
    speeds = list(dict.fromkeys(cell.speed_km_h for cell in result.suite.cells))
    for name in reversed(result.suite.subjects):
        cells = result.suite.results[name][NOMINAL.name]
        values = [
            max(
                (value for each in cells if each.cell.speed_km_h == speed and (value := figure_of(each)) is not None),
                default=math.nan,
            )
            for speed in speeds
        ]
        axes.plot(speeds, values, label="_", marker="o", markersize=3.5, **looks[name])
    axes.set_ylim(bottom=0.0)
    axes.grid(True)
