"""Bytes of a map's tables for an error: the grid as it is, even axes, uneven ones, and int16. Counted, not timed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.paper_build import CONFIG
from benchmarks.tables import CountReport, Row
from codegen.refmap.lookup import Lookup
from codegen.refmap.place_ground import Ground, ground_of
from codegen.refmap.place_sweep import FlashTable, flash_table
from codegen.refmap.solve import solve_case
from codegen.refmap.total import TotalMap
from codegen.report.flash import AGAINST, HEADER, flash_rows

CASE = "4ws-2"
BOUND = math.radians(0.05)
REQUIRED = {"uneven": 0.35, "int16": 0.25}
"""Of the bytes of the even grid in single precision, at BOUND."""

TABLES = {"pi": 1, "tracking": 2}
"""Kind of controller -> tables that it looks up."""

RANDOM = 1_000
"""Speeds, and as many front angles, at which the error is measured again."""


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Place the breakpoints of the paper's map; `quick` for the bound alone of which something is asked."""
    reference_map = solve_case(CONFIG, CASE)
    ground = ground_of(reference_map, CONFIG)
    tables: list[tuple[str, tuple[str, ...], tuple[Row, ...]]] = []
    for kind, count in TABLES.items():
        say(f"placing breakpoints for kind {kind}")
        found = flash_table(reference_map, CONFIG, count, bounds=(BOUND,) if quick else None)
        title = f"At {math.degrees(BOUND):g} deg/s, map {CASE}, kind {kind}: tables and axes"
        header = ("stored", "breakpoints", "bytes", "of the grid", "largest error [deg/s]", "at random points", "required")
        tables.append((title, header, _rows(found, ground)))
        if not quick:
            rows = tuple(Row(cells) for cells in flash_rows(found))
            tables.append((f"Error against flash, map {CASE}, kind {kind}", HEADER, rows))
    return CountReport(
        tuple(tables),
        (
            f"{AGAINST[ground.origin]}, in the stored numbers, after the cap,",
            "wherever an ECU may be: from rest and straight ahead to the last speed and the mechanical stop.",
            f"At random points: the same at {RANDOM:,} speeds times {RANDOM:,} front angles, which the search has not seen.",
            "The grid as it is: 101 x 100, with the rows and columns at its edges.",
        ),
    )


def _rows(found: FlashTable, ground: Ground) -> tuple[Row, ...]:
    seen = _at_random(ground, ground.total)
    grid = f"{found.grid[0]} x {found.grid[1]}"
    error = f"{math.degrees(found.grid_error):.3g}"
    rows = [Row(("the grid as it is, float", grid, f"{found.grid_bytes:,}", "100 %", error, seen, "-"))]
    for point in found.points:
        placed, required = point.placed, REQUIRED.get(point.way)
        if point.bound != BOUND:
            continue
        if placed is None:
            rows.append(Row((point.way, "-", "-", "-", "-", "-", "-"), required is None))
            continue
        share = placed.flash_bytes / found.grid_bytes
        met = required is None or share <= required
        asked = "-" if required is None else f"<= {100.0 * required:.0f} %: {'met' if met else 'MISSED'}"
        shape = f"{placed.total.speed.size} x {placed.total.front_angle.size}"
        told = f"{math.degrees(placed.error.yaw_rate_whole):.3g}"
        name = f"{placed.spacing}, int16" if point.way == "int16" else f"{point.way}, float"
        cells = (
            name,
            shape,
            f"{placed.flash_bytes:,}",
            f"{100.0 * share:.1f} %",
            told,
            _at_random(ground, placed.total),
            asked,
        )
        rows.append(Row(cells, met))
    return tuple(rows)


def _at_random(ground: Ground, total: TotalMap) -> str:
    """deg/s, as text."""
    rng = np.random.default_rng(1)
    speed, front_angle = (
        rng.uniform(0.0, top, RANDOM).astype(np.float32).astype(np.float64)
        for top in (ground.own_speed[1], ground.front_angle_top)
    )
    truth, _ = ground.layers[-1].truth(speed, front_angle)
    error = np.abs(Lookup.from_map(total)(speed[:, np.newaxis], front_angle) - truth)
    return f"{math.degrees(float(error.max())):.3g}"
