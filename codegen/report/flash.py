"""Bytes of tables over their error bound, for even and uneven axes and for int16: as a table, as JSON and as a figure."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.configuration import Config
from codegen.ecu_map.placement import SPACINGS, Maker, Placed, Target
from codegen.ecu_map.placement_axes import Spacing
from codegen.ecu_map.placement_error import ErrorEstimator, MeasuredError
from codegen.ecu_map.reference_surface import Origin, reference_surface_of
from codegen.ecu_map.storage import Real, Storage
from codegen.figures.data import BLUE, GREEN, MUTED, VERMILION, Picture, axis, line, panel, plain, points
from codegen.map_file.map import ReferenceMap

BOUNDS = tuple(math.radians(degrees) for degrees in (1.0, 0.5, 0.2, 0.1, 0.05, 0.02))
"""Error bounds, rad/s."""


@dataclass(frozen=True)
class StorageOption:
    """Storage of a map, with the `spacings` to choose from."""

    name: str
    spacings: tuple[Spacing, ...]
    storage: Storage


STORAGE_OPTIONS = (
    StorageOption("even", ("even",), "float"),
    StorageOption("uneven", ("uneven",), "float"),
    StorageOption("int16", SPACINGS, "int16"),
)


@dataclass(frozen=True)
class FlashPoint:
    """One storage option at one bound, rad/s. None: not met with 256 breakpoints an axis."""

    way: str
    bound: float
    placed: Placed | None


@dataclass(frozen=True)
class FlashTable:
    """All points, and the map's own grid for comparison.

    Attributes:
        tables: number of tables of the kind of controller. origin: reference of the errors, see `ReferenceSurface`.
        grid: numbers of breakpoints of both axes, with those that the total map adds.
        grid_bytes, grid_error: bytes and error of the map's own grid, in real numbers.
    """

    points: tuple[FlashPoint, ...]
    tables: int
    origin: Origin
    grid: tuple[int, int]
    grid_bytes: int
    grid_error: MeasuredError

    def of(self, way: str) -> list[FlashPoint]:
        """Return the points of an option that have a table, the largest bound first."""
        return [point for point in self.points if point.way == way and point.placed is not None]


def flash_table(
    reference_map: ReferenceMap,
    config: Config,
    tables: int,
    real: Real = np.float32,
    bounds: Sequence[float] | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> FlashTable:
    """Place breakpoints for each bound and option. An option that fails a bound is not tried with smaller ones.

    Args:
        bounds: rad/s, falling; by default BOUNDS.
        config: the car, for a map that does not bring its own configuration.
        tables: 2 where the kind of controller looks the rear angle up, else 1.
        progress: called with (points done, points in all, name of the next).

    Raises:
        MapError: see `extend`.
    """
    surface = reference_surface_of(reference_map, config)
    total = surface.total
    plain = Target(tables, real, "float")
    points: list[FlashPoint] = []
    chosen = BOUNDS if bounds is None else bounds
    hopeless: set[str] = set()
    for bound in chosen:
        for way in STORAGE_OPTIONS:
            placed = None
            if way.name not in hopeless:
                if progress is not None:
                    progress(len(points), len(chosen) * len(STORAGE_OPTIONS), f"{math.degrees(bound):g} deg/s, {way.name}")
                placed = Maker(surface, Target(tables, real, way.storage)).for_error(bound, way.spacings)
            if placed is None:
                hopeless.add(way.name)
            points.append(FlashPoint(way.name, bound, placed))
    if progress is not None:
        progress(len(points), len(points), "")
    grid = (total.speed.size, total.front_angle.size)
    return FlashTable(
        points=tuple(points),
        tables=tables,
        origin=surface.origin,
        grid=grid,
        grid_bytes=plain.bytes_of(*grid, len(surface.layers)),
        grid_error=ErrorEstimator(surface, (total.speed, total.front_angle), real).error(total),
    )


SERIES_STYLES = {
    "even": (BLUE, "square", "even axes, float"),
    "uneven": (VERMILION, "circle", "uneven axes, float"),
    "int16": (GREEN, "triangle-up", "int16"),
}
"""StorageOption -> colour, marker, and name in the legend."""

FLASH_HEADER = (
    "error [deg/s]",
    *(f"{way.name} [B]" for way in STORAGE_OPTIONS),
    *(f"{way.name} [%]" for way in STORAGE_OPTIONS),
    "breakpoints, uneven",
)
AGAINST = {
    "optimum": "errors are against the optimum, solved anew at every point",
    "surfaces": "errors are against the optimum, solved on a fine grid, plus the error bound of that grid",
    "table": "errors are against the bilinear interpolation of the map's own table",
}


def flash_rows(table: FlashTable) -> list[tuple[str, ...]]:
    """Return a row of text for each bound; "-" if no table with up to 256 breakpoints on each axis meets it."""
    rows = []
    for bound in dict.fromkeys(point.bound for point in table.points):
        found = {point.way: point.placed for point in table.points if point.bound == bound}
        sizes = [None if placed is None else placed.flash_bytes for placed in found.values()]
        uneven = found.get("uneven")
        shape = "-" if uneven is None else f"{uneven.total.speed.size} x {uneven.total.front_angle.size}"
        shares = ["-" if size is None else f"{100.0 * size / table.grid_bytes:.1f}" for size in sizes]
        rows.append((f"{math.degrees(bound):g}", *("-" if size is None else f"{size:,}" for size in sizes), *shares, shape))
    return rows


def flash_headline(table: FlashTable) -> str:
    """Return a line with the map's own grid, its error, and the reference of the errors."""
    tables, rear = "yaw rate", ""
    if table.tables > 1:
        tables = "yaw rate and rear angle"
        rear = f", the rear angle worth {math.degrees(table.grid_error.rear_yaw_rate_whole):.2g} deg/s"
    return (
        f"as it is {table.grid[0]} x {table.grid[1]} breakpoints with those of its edges, {table.grid_bytes:,} B for {tables}, "
        f"up to {math.degrees(table.grid_error.yaw_rate_whole):.2g} deg/s off{rear}; {AGAINST[table.origin]}"
    )


def flash_dict(table: FlashTable) -> dict[str, Any]:
    """Return JSON values in SI units."""
    return {
        "tables": table.tables,
        "error_against": table.origin,
        "grid": {
            "breakpoints": list(table.grid),
            "flash_bytes": table.grid_bytes,
            "error_rad_s": table.grid_error.yaw_rate_whole,
            **_rear(table.tables, table.grid_error),
        },
        "placed": [_point(point) for point in table.points],
    }


def _point(point: FlashPoint) -> dict[str, Any]:
    facts: dict[str, Any] = {"way": point.way, "max_error_rad_s": point.bound, "flash_bytes": None}
    if point.placed is not None:
        total, error = point.placed.total, point.placed.error
        facts |= {
            "flash_bytes": point.placed.flash_bytes,
            "breakpoints": [total.speed.size, total.front_angle.size],
            "axes": point.placed.spacing,
            "error_rad_s": error.yaw_rate,
            "error_whole_domain_rad_s": error.yaw_rate_whole,
            **_rear(point.placed.tables, error),
        }
    return facts


def _rear(tables: int, error: MeasuredError) -> dict[str, float]:
    return {} if tables == 1 else {"rear_angle_error_as_yaw_rate_rad_s": error.rear_yaw_rate_whole}


def flash_picture(table: FlashTable, name: str) -> Picture:
    """Return error over bytes, both logarithmic, for each storage option and for the map's own grid."""
    data = []
    for way, (colour, symbol, label) in SERIES_STYLES.items():
        found = [point.placed for point in table.of(way) if point.placed is not None]
        errors = [math.degrees(placed.bounded_error) for placed in found]
        marker = {"mode": "lines+markers", "marker": {"symbol": symbol, "size": 7.5, "color": colour}}
        data.append({**line([placed.flash_bytes for placed in found], errors, label, colour), **marker})
    grid_error = math.degrees(table.grid_error.bounded(table.tables))
    data.append(points([table.grid_bytes], [grid_error], "the map's own grid, float", MUTED, "diamond", 9))
    more = "" if table.tables == 1 else ",<br>or of the rear angle times the yaw gain"
    y = axis(f"Largest error of the yaw rate{more} (deg/s)", type="log")
    tables = "yaw rate" if table.tables == 1 else "yaw rate and rear angle"
    chart = panel(data, axis("Tables, axes and scales (bytes)", type="log"), y, title=f"{plain(name)}: {tables}")
    return Picture([[chart]], (6.2, 4.4))
