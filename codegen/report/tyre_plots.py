"""Tyre curves with their linear range."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config, Limits
from codegen.report.style import BLACK, SKY, new_figure, style
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


LOAD_SHARES = (0.5, 0.75, 1.0, 1.25, 1.5)
TYRE_SLIP_MAX = math.radians(8.0)


def tyre_figure(config: Config) -> Figure:
    """Draw the lateral force of a front and a rear tyre over slip, for several wheel loads, with the slip limit of maps.

    Raises:
        ConfigError: the linear range of the tyre has no end.
    """
    tyres = AxleTyres.from_config(config)
    axles = tuple(zip(("Front tyre", "Rear tyre"), (tyres.front, tyres.rear), tyres.slip_limits, strict=True))
    slip_max = slip_shown(tyres)
    with style():
        figure = new_figure(9.6, 4.6)
        panels = figure.subplots(1, 2, sharex=True, sharey=True)
        for axes, (name, tyre, slip_bound) in zip(panels, axles, strict=True):
            _draw_tyre(axes, tyre, slip_bound, slip_max)
            axes.set_title(f"{name}, road friction {config.road.friction:g}")
            axes.set_xlabel(r"Slip angle $\alpha$ (deg)")
        panels[0].set_ylabel("Lateral force of one tyre (kN)")
        handles = panels[0].get_legend_handles_labels()[0]
        handles[-1].set_label(slip_limit_text(config.limits))
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def slip_shown(tyres: AxleTyres) -> float:
    """Return the last slip angle of a tyre figure in rad: some times the limits, at most 45 degrees."""
    return max(TYRE_SLIP_MAX, min(3.0 * max(tyres.slip_limits), math.radians(45.0)))


def slip_limit_text(limits: Limits) -> str:
    """Return what bounds the slip angles of a map."""
    if limits.grip_use_max is not None:
        return f"{100.0 * limits.grip_use_max:g} % of the largest force (nonlinear tyre)"
    return f"linear range: within {limits.slip_departure_percent:g} % of the tangent"


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
    axes.axvspan(0.0, bound, color=SKY, alpha=0.25, linewidth=0.0, label="slip limit")
    axes.plot([bound], [float(tyre.force(slip_bound)) / 1e3], "o", color=BLACK, markersize=4.5, zorder=5)
    axes.annotate(rf"$\overline{{\alpha}}$ = {bound:.3f} deg", (bound, 0.0), (5, 7), textcoords="offset points")
    axes.set(xlim=(0.0, math.degrees(slip_max)), ylim=(min(0.0, float(tyre.force(0.0)) / 1e3), 1.05 * top / 1e3))
    axes.grid(True)
