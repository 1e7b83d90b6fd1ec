"""Maps in the report: cuts along both axes, and the loss of the rear steering."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.design.loss import MODES, LossOfFunction, loss_of_function
from codegen.figures.data import (
    EMPTY,
    FRONT_ANGLE_TITLE,
    INK,
    SKY,
    SPEED_TITLE,
    VERMILION,
    Chart,
    axis,
    layout,
    numbers,
    patches,
)
from codegen.figures.maps import MAP_QUANTITIES, NamedMap, category_trace, unformatted
from codegen.map_file.bounds import binding_text
from codegen.report.html.page import Block, Cuts, Text
from codegen.units import KM_H


def cuts(maps: Sequence[NamedMap]) -> Cuts:
    """Return the data from which the page cuts all maps at any speed and front angle."""
    quantities = [{"table": one.attribute, "name": unformatted(one.name), "unit": one.unit} for one in MAP_QUANTITIES]
    data = {"quantities": quantities, "axes": [SPEED_TITLE, FRONT_ANGLE_TITLE], "maps": [_cut_data(one) for one in maps]}
    return Cuts(data, "The maps cut along both axes. Where a line ends, no steady turn inside the limits exists.")


def _cut_data(one: NamedMap) -> dict[str, Any]:
    tables = {quantity.attribute: quantity.displayed(one.map) for quantity in MAP_QUANTITIES}
    binding: Mapping[str, Any] | None = None
    if one.map.active is not None:
        flags, places = np.unique(one.map.active, return_inverse=True)
        binding = {
            "codes": places.reshape(one.map.active.shape).astype(np.uint8),
            "names": [binding_text(flag) for flag in flags.tolist()],
        }
    return {
        "name": one.title,
        "speed_km_h": numbers(one.speed_km_h),
        "front_angle_deg": numbers(one.front_angle_deg),
        "tables": {name: numbers(table) for name, table in tables.items() if table is not None},
        "binding": binding,
    }


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
        trace = category_trace(one.speed_km_h, one.front_angle_deg, codes, ~one.map.feasible, CELLS, (SKY, VERMILION))
        data += [trace, *patches(CELLS, (SKY, VERMILION))]
    data += _points(loss)
    look = layout(
        xaxis=axis(SPEED_TITLE, zeroline=False, showgrid=False),
        yaxis=axis(FRONT_ANGLE_TITLE, zeroline=False, showgrid=False, rangemode="tozero"),
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
