"""The table of the ECU over its whole domain: which cells were solved, and which were extended by which rule."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.ecu_map.extend import extend
from codegen.ecu_map.total import RULE_TEXT, Rule
from codegen.emit.manifest import read_build
from codegen.report.html.blocks import Chart, Table
from codegen.report.html.charts import axis, cell_edges, layout, patches
from codegen.report.html.maps import FRONT_ANGLE, SPEED, NamedMap, category_trace
from codegen.report.style import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from codegen.units import KM_H

YELLOW = "#F0E442"
"""Yellow of the palette in `codegen.report.style`."""
LINEAR = ", from there linear to the first breakpoint"

RULE_COLOURS = {
    Rule.SOLVED: BLUE,
    Rule.ZERO: YELLOW,
    Rule.HOLD: ORANGE,
    Rule.PASSIVE_SLOPE: GREEN,
    Rule.BETWEEN: PURPLE,
    Rule.NEIGHBOUR: SKY,
    Rule.CONTINUED: VERMILION,
}
RULE_NAMES = {
    Rule.SOLVED: "as in the map",
    Rule.ZERO: "linear, from zero",
    Rule.HOLD: "held: ay_cap / vx",
    Rule.PASSIVE_SLOPE: "on with the passive gain",
    Rule.BETWEEN: "between feasible cells",
    Rule.NEIGHBOUR: "between speeds",
    Rule.CONTINUED: "beyond the cap, continued",
}
"""Short names for a legend; RULE_TEXT has the full ones."""


@dataclass(frozen=True)
class _Cells:
    """Breakpoints (n,) in m/s and (m,) in rad, and the rule of each cell, (n, m)."""

    speed: npt.NDArray[np.float64]
    front_angle: npt.NDArray[np.float64]
    rule: npt.NDArray[np.str_]


def _cells(one: NamedMap, config: Config, build: Path | None) -> _Cells:
    """Return the cells of a build as its manifest lists them; without a build, extend the map."""
    if build is None:
        total = extend(one.map, config)
        return _Cells(total.speed, total.front_angle, total.rule)
    table = read_build(build)["map"]
    speed, front_angle = (np.array(table[key], dtype=np.float64) for key in ("speed_m_s", "front_angle_rad"))
    return _Cells(speed, front_angle, np.array([list(row) for row in table["rule_by_speed_and_front_angle"]]))


def extended(one: NamedMap, config: Config, build: Path | None = None) -> tuple[Chart, Table]:
    """The table of the ECU: which cells were solved, and by which rule the others were made (`codegen.ecu_map.total`)."""
    total = _cells(one, config, build)
    rules = [rule for rule in Rule if (total.rule == rule.value).any()]
    codes = np.zeros(total.rule.shape, dtype=np.uint8)
    for code, rule in enumerate(rules):
        codes[total.rule == rule.value] = code
    names, colours = [RULE_NAMES[rule] for rule in rules], [RULE_COLOURS[rule] for rule in rules]
    speed, angle = total.speed / KM_H, np.degrees(total.front_angle)
    trace = category_trace(cell_edges(speed), cell_edges(angle), codes, np.zeros(codes.shape, dtype=bool), names, colours)
    look = layout(
        xaxis=axis(SPEED, zeroline=False, showgrid=False),
        yaxis=axis(FRONT_ANGLE, zeroline=False, showgrid=False),
    )
    counts = [int((codes == code).sum()) for code in range(len(rules))]
    spoken = ", ".join(f"{count} {name}" for count, name in zip(counts, names, strict=True))
    figure = {"data": [trace, *patches(names, colours)], "layout": look}
    caption = "The whole domain that the ECU meets: cells that were solved, and those that were extended, by rule."
    chart = Chart("map-extended", figure, caption, f"Cells of the ECU's table by their origin: {spoken}.", 480)
    rows = [
        (name, RULE_TEXT[rule] + LINEAR * (rule is Rule.ZERO), f"{count:,}", f"{100.0 * count / codes.size:.1f} %")
        for rule, name, count in zip(rules, names, counts, strict=True)
    ]
    return chart, Table("Cells of the ECU's table by their origin", ("", "rule", "cells", "share"), rows, words=(0, 1))
