"""Tyre curves with their linear range, and the optimum at one front angle over speed."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config, Limits
from codegen.figures.data import BLUE, INK, PURPLE, SKY, SPEED_TITLE, Chart, Picture, axis, layout, line, points, span, text
from codegen.figures.maps import CASE_LOOKS, OTHER_LOOKS, paper_mark, tyre_note
from codegen.figures.paper_tables import PAPER_TABLE, TABLE_SPEED_KM_H
from codegen.optimum.turns import turns_of
from codegen.units import KM_H
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

POINTS = 201
LOAD_SHARES = (0.5, 0.75, 1.0, 1.25, 1.5)
TYRE_SLIP_MAX = math.radians(8.0)


def tyre_picture(config: Config) -> Picture:
    """Return the picture of `tyre_charts`."""
    return Picture([tyre_charts(config)], (9.6, 4.6))


def tyre_charts(config: Config) -> list[Chart]:
    """Plot the lateral force of a front and a rear tyre over slip angle, for several wheel loads, with the slip limit of maps.

    Raises:
        ConfigError: the linear range of the tyre has no end.
    """
    tyres = AxleTyres.from_config(config)
    axles = tuple(zip(("front", "rear"), (tyres.front, tyres.rear), tyres.slip_limits, strict=True))
    slip_max = slip_shown(tyres)
    slip = np.linspace(0.0, slip_max, POINTS)
    top = max(float(np.max(tyre.force(slip, LOAD_SHARES[-1] * tyre.static_load))) for _, tyre, _ in axles)
    lowest = min(0.0, *(float(tyre.force(0.0)) for _, tyre, _ in axles))
    charts = []
    for name, tyre, bound in axles:
        edge = math.degrees(bound)
        look = layout(
            xaxis=axis("Slip angle α (deg)", range=[0.0, math.degrees(slip_max)]),
            yaxis=axis("Lateral force of one tyre (kN)", range=[lowest / 1e3, 1.1 * top / 1e3]),
            shapes=[span(0.0, edge, SKY, 0.25)],
            annotations=[
                text(f"{edge:.3f} deg", edge, lowest / 1e3, xanchor="left", yanchor="bottom", xshift=5, yshift=5),
                *_load_notes(tyre, slip_max),
            ],
        )
        limit = slip_limit_text(config.limits)
        caption = (
            f"A {name} tyre on a road with friction {config.road.friction:g}. Shaded: up to {edge:.3f} deg, the slip limit of "
            f"the optimisation: {limit}."
        )
        spoken = f"Force of a {name} tyre over slip angle; slip limit of {edge:.3f} deg."
        end = points([edge], [float(tyre.force(bound)) / 1e3], f"slip limit: {limit}", INK, size=7, hoverinfo="skip")
        figure = {"data": [*_tyre_lines(tyre, slip), end], "layout": look}
        title = f"{name.capitalize()} tyre, road friction {config.road.friction:g}"
        charts.append(Chart(f"tyre-{name}", figure, caption, spoken, 440, title))
    return charts


def slip_shown(tyres: AxleTyres) -> float:
    """Return the last slip angle of a tyre figure in rad: some times the limits, at most 45 degrees."""
    return max(TYRE_SLIP_MAX, min(3.0 * max(tyres.slip_limits), math.radians(45.0)))


def slip_limit_text(limits: Limits) -> str:
    """Return what bounds the slip angles of a map."""
    if limits.grip_use_max is not None:
        return f"{100.0 * limits.grip_use_max:g} % of the largest force (nonlinear tyre)"
    return f"linear range, within {limits.slip_departure_percent:g} % of the tangent"


def _load_notes(tyre: MagicFormulaTyre, slip: float) -> Iterator[dict[str, Any]]:
    """Yield the wheel load of each curve, above its end at the slip angle (rad)."""
    for share in LOAD_SHARES:
        load = share * tyre.static_load
        words = f"{load / 1e3:.2f} kN{' (static)' if share == 1.0 else ''}"
        place = {"xanchor": "right", "yanchor": "bottom", "xshift": -4, "yshift": 2}
        yield text(words, math.degrees(slip), float(tyre.force(slip, load)) / 1e3, **place)


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
            y = "y2" if row else "y"
            where = {"xaxis": "x", "yaxis": y, "legendgroup": name, "showlegend": row == 0}
            data.append(line(speed, values, title, colour, dash=dash, hovertemplate=told, **where))
            if paper and name in PAPER_TABLE:
                here = float(np.interp(TABLE_SPEED_KM_H, speed, values))
                data.append(paper_mark(name, row, here, colour, y))
                data += [paper_mark(name, 0, here, INK, "y", is_entry=True)] if row == 0 and name == "fws" else []
    look = layout(
        xaxis=axis(SPEED_TITLE, anchor="y2"),
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
