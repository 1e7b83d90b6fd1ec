"""Overview picture: a map, and its effect on a car."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.map_file.map import ReferenceMap
from codegen.report.run_plots import YAW_RATE_SIGNAL, column, draw_signal, looks_of, run_handles, run_window
from codegen.report.style import (
    FRONT_ANGLE_LABEL,
    SPEED_LABEL,
    VERMILION,
    WHITE,
    YAW_RATE,
    PlotError,
    draw_quantity,
    map_legend,
    new_figure,
    phase_lines,
    style,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def overview_figure(config: Config, maps: Mapping[str, ReferenceMap], runs: Mapping[str, FloatArray]) -> Figure:
    """The 4WS-2 map and what the controller makes of it, in one wide picture, 1600 by 620 pixels.

    Raises:
        PlotError: no map "4ws-2", or runs that cannot be shown.
    """
    by_name = {name.lower(): one for name, one in maps.items()}
    if "4ws-2" not in by_name:
        raise PlotError("no map 4ws-2", where=f"maps {', '.join(maps)}", remedy="solve the case 4ws-2 first")
    looks, window, reference_map = looks_of(runs), run_window(runs), by_name["4ws-2"]
    with style(1.3):
        figure = new_figure(1600 / 130, 620 / 130, dpi=130)
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.05))
        _draw_overview_map(figure, left, reference_map, runs)
        left.set_title(f"Optimal yaw-rate map 4WS-2, road friction {config.road.friction:g}")
        draw_signal(right, runs, looks, YAW_RATE_SIGNAL, window)
        right.set(xlabel="Time (s)", ylabel=YAW_RATE.label, title="Generated C in the loop: step steer")
        right.legend(handles=run_handles(right, "reference"), loc="lower right")
    return figure


def _draw_overview_map(figure: Figure, axes: Axes, reference_map: ReferenceMap, runs: Mapping[str, FloatArray]) -> None:
    scale = YAW_RATE.scale([reference_map])
    entries = map_legend(draw_quantity(axes, reference_map, YAW_RATE, scale), not reference_map.feasible.all())
    YAW_RATE.colour_bar(figure, axes, scale, label=YAW_RATE.label)
    last = next(iter(runs.values()))[-1:]
    speed, front_angle = column(last, "speed_m_s")[0], column(last, "front_angle_rad")[0]
    point: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 9, "color": VERMILION, "markeredgecolor": WHITE}
    label = f"the step: {speed:.4g} km/h, {front_angle:.3g} deg"
    entries += axes.plot([speed], [front_angle], label=label, zorder=4, **point)
    for piece in phase_lines(reference_map)[:1]:
        foot = float(piece[np.argmin(piece[:, 1]), 0])
        for side, name, align in ((-2.0, "rear wheels opposite", "right"), (2.0, "same direction", "left")):
            axes.text(foot + side, 0.35, name, color=WHITE, ha=align, va="center")
    axes.set(xlabel=SPEED_LABEL, ylabel=FRONT_ANGLE_LABEL)
    axes.legend(handles=entries, loc="upper right", frameon=True, framealpha=1.0)
