"""Figures printed in the paper, and tables that compare them with ours, as rows of text.

Ryu, Hwang, Yoon, Choi: Constrained Optimization-Based Yaw-Rate Reference Map Generation for Active Rear Steering Control of
Four-Wheel Steering Vehicles.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.optimum.turns import turns_of
from codegen.units import KM_H

TABLE_SPEED_KM_H = 43.9
TABLE_FRONT_ANGLE_DEG = 4.0

PAPER_TABLE = {"fws": (15.35, 1.101), "4ws-1": (26.82, 1.08), "4ws-2": (21.35, 0.03)}
"""Optimisation results at that speed and front angle: yaw rate (deg/s) and |sideslip| (deg) of each case."""

PAPER_GAINS = {"4ws-1": 74.7, "4ws-2": 38.1}
"""Printed gains in yaw rate over FWS, %; the printed yaw rates themselves give 39.1 for 4WS-2."""

PAPER_RUNS = {"C1": (27.39, 0.44), "C2": (24.86, 0.22)}
"""Simulation results: largest yaw rate (deg/s) and smallest |sideslip| (deg)."""


CASES = {"fws": "FWS", "4ws-1": "4WS-1", "4ws-2": "4WS-2"}
TABLE_SPEEDS_KM_H = (TABLE_SPEED_KM_H, 43.35)
"""The speed that the paper's table names, and the one at which its three rows come out together."""

CASE_OF_RUN = {"C1": "4ws-2", "C2": "fws"}
"""Name of a run in the paper -> case of its map."""

Table = tuple[tuple[str, ...], list[tuple[str, ...]]]
"""A header and its rows."""


@dataclass(frozen=True)
class TableRow:
    """One case at one speed in deg/s and deg: our values and the paper's."""

    case: str
    speed_km_h: float
    yaw_rate_deg_s: float
    sideslip_abs_deg: float
    paper_yaw_rate_deg_s: float
    paper_sideslip_abs_deg: float

    @property
    def yaw_rate_difference_percent(self) -> float:
        """Difference to the paper's yaw rate, in percent."""
        return 100.0 * (self.yaw_rate_deg_s / self.paper_yaw_rate_deg_s - 1.0)


def optimum_rows(config: Config) -> list[TableRow]:
    """Return the optimum of the paper's cases at its front angle and both speeds, with the printed values."""
    front_angle = np.array([math.radians(TABLE_FRONT_ANGLE_DEG)])
    rows = []
    for speed in TABLE_SPEEDS_KM_H:
        for case in CASES:
            solution = turns_of(config, config.case(case)).solve(np.array([speed * KM_H]), front_angle)
            yaw_rate, sideslip = (math.degrees(float(values[0, 0])) for values in (solution.yaw_rate, solution.sideslip))
            rows.append(TableRow(case, speed, yaw_rate, abs(sideslip), *PAPER_TABLE[case]))
    return rows


def optimum_table(rows: Sequence[TableRow]) -> Table:
    """Return the rows as text."""
    header = ("", "speed", "yaw rate", "paper", "differs", "over FWS", "paper", "|sideslip|", "paper")
    passive = {row.speed_km_h: row.yaw_rate_deg_s for row in rows if row.case == "fws"}
    cells: list[tuple[str, ...]] = []
    for row in rows:
        gain = 100.0 * (row.yaw_rate_deg_s / passive[row.speed_km_h] - 1.0)
        cells.append(
            (
                CASES[row.case],
                f"{row.speed_km_h:g} km/h",
                f"{row.yaw_rate_deg_s:.2f} deg/s",
                f"{row.paper_yaw_rate_deg_s:.2f}",
                f"{round(row.yaw_rate_difference_percent, 1) + 0.0:+.1f} %",
                "" if row.case == "fws" else f"{gain:+.1f} %",
                "" if row.case == "fws" else f"{PAPER_GAINS[row.case]:+.1f} %",
                f"{row.sideslip_abs_deg:.3f} deg",
                f"{row.paper_sideslip_abs_deg:g}",
            )
        )
    return header, cells


def run_table(runs: Mapping[str, Mapping[str, Any]]) -> Table:
    """Return the figures of the paper's runs, by their names in RUNS, with the printed values."""
    header = ("", "steady, here", "peak, here", "paper's maximum", "least |sideslip|, here", "paper's")
    rows: list[tuple[str, ...]] = [
        (
            f"{name} ({CASES[CASE_OF_RUN[name]]} map)",
            f"{metrics['yaw_rate_steady_deg_s']:.2f} deg/s",
            f"{metrics['yaw_rate_peak_deg_s']:.2f}",
            f"{PAPER_RUNS[name][0]:.2f}",
            f"{metrics['sideslip_abs_min_deg']:.2f} deg",
            f"{PAPER_RUNS[name][1]:.2f}",
        )
        for name, metrics in runs.items()
    ]
    return header, rows
