"""Bytes of a map's tables for an error: the grid as it is, even axes, uneven ones, and int16. Counted, not timed."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.nonlinear_map import nonlinear
from benchmarks.paper_build import CONFIG
from benchmarks.tables import CountReport, Row
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup
from codegen.ecu_map.placement_error import MeasuredError
from codegen.ecu_map.reference_surface import ReferenceSurface, reference_surface_of
from codegen.ecu_map.total import TotalMap
from codegen.optimum.nonlinear import NonlinearTurns
from codegen.optimum.solve import solve_case
from codegen.report.flash import FLASH_HEADER, FlashTable, flash_rows, flash_table
from codegen.vehicle.single_track import SingleTrack

CASE = "4ws-2"
BOUND = math.radians(0.05)
REQUIRED = {"uneven": 0.35, "int16": 0.25}
"""Limit as a fraction of the bytes of the even grid in single precision, at BOUND."""

COLUMNS = (
    *("stored", "breakpoints", "bytes", "of the grid"),
    *("largest error [deg/s]", "rear angle, worth [deg/s]", "at random points [deg/s]"),
    "required",
)

GAIN = SingleTrack.from_config(CONFIG).yaw_gain

TABLES = {"pi": 1, "tracking": 2}
"""Kind of controller -> tables that it looks up."""

RANDOM, SOLVED_ANEW = 1_000, 300
"""Speeds, and as many front angles, at which the error is measured again; with the nonlinear tyre, solved at each."""

Seen = Callable[[TotalMap, int], str]
"""A total map and how many tables it has -> the largest error at random points, deg/s."""


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Place the breakpoints of the paper's map and of the nonlinear one for the required bound; `quick` for that bound
    alone."""
    tables: list[tuple[str, tuple[str, ...], tuple[Row, ...]]] = []
    for config, tyre in ((CONFIG, ""), (nonlinear(CONFIG, CASE), " with the nonlinear tyre")):
        reference_map = solve_case(config, CASE)
        surface = reference_surface_of(reference_map, config)
        seen = _solved_anew(surface, config) if tyre else _at_random(surface)
        for kind, count in TABLES.items():
            say(f"placing breakpoints for kind {kind}{tyre}")
            found = flash_table(reference_map, config, count, bounds=(BOUND,) if quick or tyre else None)
            title = f"At {math.degrees(BOUND):g} deg/s, map {CASE}{tyre}, kind {kind}: tables and axes"
            tables.append((title, COLUMNS, _rows(found, surface, seen)))
            if not quick and not tyre:
                rows = tuple(Row(cells) for cells in flash_rows(found))
                tables.append((f"Error against flash, map {CASE}, kind {kind}", FLASH_HEADER, rows))
    return CountReport(
        tuple(tables),
        (
            "errors are against the optimum, in the stored numbers, after the cap, from rest to the last speed and the stop.",
            "With linear tyres it is solved anew at every point, with the nonlinear one on a fine grid; its own error counts.",
            "Rear angle, worth: its error times the yaw gain of the car with its rear wheels straight; bounded as well.",
            f"At random points: the larger of both at {RANDOM:,} x {RANDOM:,} points that the search has not seen.",
            f"With the nonlinear tyre it is solved anew at {SOLVED_ANEW} x {SOLVED_ANEW} points, of which the feasible count.",
            "The grid as it is: 101 x 100, with the rows and columns at its edges.",
        ),
    )


def _rows(found: FlashTable, surface: ReferenceSurface, seen: Seen) -> tuple[Row, ...]:
    grid = f"{found.grid[0]} x {found.grid[1]}"
    errors = (*_format_errors(found.grid_error, found.tables), seen(surface.total, found.tables))
    rows = [Row(("the grid as it is, float", grid, f"{found.grid_bytes:,}", "100 %", *errors, "-"))]
    for point in found.points:
        placed, required = point.placed, REQUIRED.get(point.way)
        if point.bound != BOUND:
            continue
        if placed is None:
            rows.append(Row((point.way, *["-"] * (len(COLUMNS) - 1)), required is None))
            continue
        share = placed.flash_bytes / found.grid_bytes
        met = required is None or share <= required
        asked = "-" if required is None else f"<= {100.0 * required:.0f} %: {'met' if met else 'MISSED'}"
        shape = f"{placed.total.speed.size} x {placed.total.front_angle.size}"
        name = f"{placed.spacing}, int16" if point.way == "int16" else f"{point.way}, float"
        errors = (*_format_errors(placed.error, placed.tables), seen(placed.total, placed.tables))
        rows.append(Row((name, shape, f"{placed.flash_bytes:,}", f"{100.0 * share:.1f} %", *errors, asked), met))
    return tuple(rows)


def _format_errors(error: MeasuredError, tables: int) -> tuple[str, str]:
    """Format the errors of the yaw rate and of the rear angle, both in deg/s."""
    rear = "-" if tables == 1 else f"{math.degrees(error.rear_yaw_rate_whole):.3g}"
    return f"{math.degrees(error.yaw_rate_whole):.3g}", rear


def _at_random(surface: ReferenceSurface) -> Seen:
    rng = np.random.default_rng(1)
    speed, front_angle = (_stored(rng.uniform(0.0, top, RANDOM)) for top in (surface.own_speed[1], surface.front_angle_top))
    truth = surface.layers[-1].truth(speed, front_angle)
    return lambda total, tables: _largest(total, tables, speed, front_angle, truth, np.True_)


def _solved_anew(surface: ReferenceSurface, config: Config) -> Seen:
    rng = np.random.default_rng(1)
    speed, front_angle = (
        _stored(np.sort(rng.uniform(*ends, SOLVED_ANEW))) for ends in (surface.own_speed, surface.own_front_angle)
    )
    optimum = NonlinearTurns.from_config(config, config.case(CASE)).solve(speed, front_angle)
    truth = (optimum.yaw_rate, optimum.rear_angle)
    return lambda total, tables: _largest(total, tables, speed, front_angle, truth, optimum.feasible)


def _stored(axis: FloatArray) -> FloatArray:
    """Round an axis to the numbers that an ECU reads."""
    return axis.astype(np.float32).astype(np.float64)


def _largest(
    total: TotalMap, tables: int, speed: FloatArray, front_angle: FloatArray, truth: tuple[FloatArray, FloatArray], where: Any
) -> str:
    yaw_rate, rear_angle = Lookup.from_map(total).reference(speed[:, np.newaxis], front_angle)
    errors = [np.abs(yaw_rate - truth[0])]
    if tables > 1:
        largest = total.steering.rear_angle_max  # in which the laws hold it
        errors.append(np.abs(np.clip(rear_angle, -largest, largest) - truth[1]) * GAIN(np.maximum(speed, 1e-9))[:, np.newaxis])
    return f"{math.degrees(max(float(error.max(where=where, initial=0.0)) for error in errors)):.3g}"
