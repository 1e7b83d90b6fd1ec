"""Tyre curves with their linear range, and the optimum at one front angle over speed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.optimum.turns import turns_of
from codegen.report.html.blocks import INK, MUTED, Chart, Gallery, axis, layout, line
from codegen.report.html.maps import SPEED
from codegen.report.paper_tables import PAPER_TABLE, TABLE_SPEED_KM_H
from codegen.report.style import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, WHITE
from codegen.report.summary import tyre_note
from codegen.report.tyre_plots import LOAD_SHARES, slip_limit_text, slip_shown
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

CASE_LOOKS = {"fws": (MUTED, "solid"), "4ws-1": (BLUE, "solid"), "4ws-2": (VERMILION, "dash")}
POINTS = 201
OTHER_LOOKS = tuple((colour, "dashdot") for colour in (GREEN, PURPLE, ORANGE, SKY, INK))


def tyre_charts(config: Config) -> Gallery:
    """Plot the lateral force of a front and a rear tyre over slip angle, for several wheel loads, with the slip limit of maps.

    Raises:
        ConfigError: the linear range of the tyre has no end.
    """
    tyres = AxleTyres.from_config(config)
    axles = tuple(zip(("front", "rear"), (tyres.front, tyres.rear), tyres.slip_limits, strict=True))
    slip_max = slip_shown(tyres)
    slip = np.linspace(0.0, slip_max, POINTS)
    top = max(float(np.max(tyre.force(slip, LOAD_SHARES[-1] * tyre.static_load))) for _, tyre, _ in axles)
    charts = []
    for name, tyre, bound in axles:
        edge = math.degrees(bound)
        shade = {"fillcolor": SKY, "opacity": 0.25, "line": {"width": 0}, "layer": "below", "yref": "paper"}
        look = layout(
            xaxis=axis("Slip angle α (deg)"),
            yaxis=axis("Lateral force of one tyre (kN)", range=[0.0, 1.08 * top / 1e3]),
            shapes=[{"type": "rect", "x0": 0, "x1": edge, "y0": 0, "y1": 1, **shade}],
        )
        caption = (
            f"A {name} tyre on a road with friction {config.road.friction:g}. Shaded: up to {edge:.3f} deg, the slip limit of "
            f"the optimisation: {slip_limit_text(config.limits)}."
        )
        spoken = f"Force of a {name} tyre over slip angle; slip limit of {edge:.3f} deg."
        figure = {"data": list(_tyre_lines(tyre, slip)), "layout": look}
        charts.append(Chart(f"tyre-{name}", figure, caption, spoken, 440))
    return Gallery(charts)


def _tyre_lines(tyre: MagicFormulaTyre, slip: FloatArray) -> Iterator[dict[str, Any]]:
    looks = ((SKY, "dot"), (SKY, "solid"), (BLUE, "solid"), (PURPLE, "solid"), (PURPLE, "dot"))
    for share, (shade, dash) in zip(LOAD_SHARES, looks, strict=True):
        load = share * tyre.static_load
        told = f"{100 * share:.0f} % load ({load / 1e3:.2f} kN): %{{y:.2f}} kN at %{{x:.2f}} deg<extra></extra>"
        thick = 3 if share == 1.0 else 2
        force = tyre.force(slip, load) / 1e3
        yield line(np.degrees(slip), force, f"{100 * share:.0f} % load", shade, dash=dash, width=thick, hovertemplate=told)
    top = float(np.max(tyre.force(slip, LOAD_SHARES[-1] * tyre.static_load)))
    ends = np.array([0.0, min(float(slip[-1]), 0.97 * top / tyre.cornering_stiffness)])
    tangent = tyre.cornering_stiffness * (ends - tyre.horizontal_shift) + tyre.vertical_shift
    yield line(np.degrees(ends), tangent / 1e3, "tangent at zero slip", INK, dash="dash", width=1.5, hoverinfo="skip")


def front_angle_chart(config: Config, front_angle_deg: float, paper: bool, own: str | None = None) -> Chart:
    """Plot yaw rate and sideslip of the optimum over speed at one front angle, one line for each case of the configuration.

    Args:
        config: configuration with the car, its limits and its cases.
        front_angle_deg: angle at the road wheels.
        paper: whether to mark the paper's table, which is for this car and angle.
        own: case of the map. Of equal cases only the first is drawn, but this one always.
    """
    speed = np.linspace(config.grid.first_speed_km_h, config.grid.last_speed_km_h, 401)
    angle = np.array([math.radians(front_angle_deg)])
    others = iter(OTHER_LOOKS * len(config.cases))
    data: list[dict[str, Any]] = []
    names = _unlike(config, own)
    for name in names:
        solution = turns_of(config, config.case(name)).solve(speed * KM_H, angle)
        title = f"{name.upper()}{tyre_note(config.case(name).tyre_model)}"
        colour, dash = CASE_LOOKS.get(name) or next(others)
        for row, (table, unit) in enumerate(((solution.yaw_rate, "deg/s"), (solution.sideslip, "deg"))):
            values = np.degrees(table[:, 0])
            told = f"{title}: %{{y:.3f}} {unit} at %{{x:.1f}} km/h<extra></extra>"
            where = {"xaxis": "x", "yaxis": "y" if row == 0 else "y2", "legendgroup": name, "showlegend": row == 0}
            data.append(line(speed, values, title, colour, dash=dash, hovertemplate=told, **where))
            if paper and name in PAPER_TABLE:
                here = float(np.interp(TABLE_SPEED_KM_H, speed, values))
                ring = {"symbol": "circle", "size": 9, "color": WHITE, "line": {"color": colour, "width": 2}}
                data.append(
                    {
                        **{"type": "scatter", "mode": "markers", "x": [TABLE_SPEED_KM_H], "marker": ring},
                        **{**where, "showlegend": row == 0 and name == "fws", "legendgroup": "paper"},
                        # The table gives |beta|; the mark is on the side of the map's value.
                        "y": [math.copysign(PAPER_TABLE[name][row], here)],
                        "legendrank": 2000,
                        "name": f"paper's table, {TABLE_SPEED_KM_H:g} km/h",
                        "hovertemplate": f"paper, {name.upper()}: %{{y}} {unit}<extra></extra>",
                    }
                )
    look = layout(
        xaxis=axis(SPEED, anchor="y2"),
        yaxis=axis("Yaw rate (deg/s)", domain=[0.54, 1.0], rangemode="tozero"),
        yaxis2=axis("Sideslip β (deg)", domain=[0.0, 0.46]),
        hovermode="closest",
    )
    caption = (
        f"The optimum of each case at a front angle of {front_angle_deg:g} deg; lines end where no steady turn is feasible."
    )
    spoken = f"Yaw rate and sideslip over speed at a front angle of {front_angle_deg:g} deg, cases {', '.join(names)}."
    return Chart("front-angle-cut", {"data": data, "layout": look}, caption, spoken, 560)


def _unlike(config: Config, own: str | None) -> list[str]:
    """Return the names of the cases without duplicates under another name."""
    chosen: list[str] = []
    for name, case in config.cases.items():
        twin = next((other for other in chosen if config.case(other) == case), None)
        if twin is None:
            chosen.append(name)
        elif name == own:
            chosen[chosen.index(twin)] = name
    return chosen
