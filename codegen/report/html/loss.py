"""Loss of the rear steering: cells that require it, and the motion of the car after the loss."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.design.loss import MODES, LossOfFunction, loss_of_function
from codegen.report.html.blocks import EMPTY, INK, Block, Chart, Text
from codegen.report.html.charts import axis, categories, layout, numbers, patches, small
from codegen.report.html.maps import FRONT_ANGLE, SPEED, NamedMap
from codegen.report.style import SKY, VERMILION
from codegen.units import KM_H

AFTER = {"hold": "held", "ramp": "led back by the fail-safe's ramp", "zero": "set straight at once"}
"""Description of the rear angle after the loss, by mode."""

CELLS = ("feasible with straight rear wheels too", "feasible only with rear steering")


def loss_blocks(one: NamedMap, config: Config) -> Iterator[Block]:
    """Yield a chart of the cells and of the operating points whose loss was simulated."""
    loss = loss_of_function(one.map, config)
    if loss.only_with_rear_steer is None:
        yield Text("It is not known which cells of a bare map need rear steering; the points below were simulated.")
    yield _chart(one, loss)
    yield Text(
        "Each mark is a steady turn in which the function is lost: the nonlinear car is simulated with the rear angle held, "
        "led back by the fail-safe's ramp, and set straight at once. A car spins where its sideslip angle passes 10 deg while "
        "its rear axle slides. A rear angle of zero is not by itself a safe state."
    )


def _chart(one: NamedMap, loss: LossOfFunction) -> Chart:
    data: list[dict[str, Any]] = []
    if loss.only_with_rear_steer is not None:
        codes = loss.only_with_rear_steer.astype(np.uint8)
        trace = {
            "type": "heatmap",
            "x": numbers(one.speed_km_h),
            "y": numbers(one.front_angle_deg),
            **categories(codes.T, CELLS, (SKY, VERMILION), ~one.map.feasible.T),
            "codes": {**small(codes.T), "names": list(CELLS)},
            "hoverongaps": False,
            "hovertemplate": "%{text}<br>vx %{x:.1f} km/h, δf %{y:.2f} deg<extra></extra>",
        }
        data += [trace, *patches(CELLS, (SKY, VERMILION))]
    data += _points(loss)
    look = layout(
        xaxis=axis(SPEED, zeroline=False, showgrid=False),
        yaxis=axis(FRONT_ANGLE, zeroline=False, showgrid=False, rangemode="tozero"),
        plot_bgcolor=EMPTY,
    )
    share = "" if loss.share_of_feasible is None else f" {100.0 * loss.share_of_feasible:.0f} % of the feasible cells need it."
    spins = ", ".join(f"{int(loss.spins[k].sum())} with the rear angle {AFTER[mode]}" for k, mode in enumerate(MODES))
    of = f"Of {loss.speed.size} simulated losses the car spins in {spins}."
    caption = f"Where the loss of the rear steering is dangerous.{share} {of}"
    return Chart("map-loss", {"data": data, "layout": look}, caption, caption, 480)


def _points(loss: LossOfFunction) -> Iterator[dict[str, Any]]:
    at_once = loss.spins[MODES.index("zero")]
    groups = (
        ("spins with the rear wheels straight at once", "x", loss.settles & at_once),
        ("does not spin", "circle-open", loss.settles & ~at_once),
        ("no steady turn before the loss", "diamond-open", ~loss.settles),
    )
    for name, symbol, chosen in groups:
        if chosen.any():
            yield {
                "type": "scatter",
                "mode": "markers",
                "x": (loss.speed[chosen] / KM_H).round(2).tolist(),
                "y": np.degrees(loss.front_angle[chosen]).round(3).tolist(),
                "name": name,
                "marker": {"symbol": symbol, "size": 11, "color": INK, "line": {"width": 2, "color": INK}},
                "text": [_told(loss, int(k)) for k in np.flatnonzero(chosen)],
                "hovertemplate": "%{text}<extra></extra>",
            }


def _told(loss: LossOfFunction, k: int) -> str:
    lines = [f"vx {loss.speed[k] / KM_H:.0f} km/h, δf {np.degrees(loss.front_angle[k]):.2f} deg"]
    if not loss.settles[k]:
        return "<br>".join([*lines, "no steady turn before the loss"])
    lines.append(f"before: δr {np.degrees(loss.rear_angle[k]):.2f} deg, β {np.degrees(loss.sideslip[k]):.1f} deg")
    for row, mode in enumerate(MODES):
        end = "spins" if loss.spins[row, k] else f"|β| up to {np.degrees(loss.sideslip_max[row, k]):.1f} deg"
        lines.append(f"{AFTER[mode]}: {end}")
    return "<br>".join(lines)
