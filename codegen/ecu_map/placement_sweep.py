"""Bytes of tables over their error bound, for even and uneven axes and for int16."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from codegen.configuration import Config
from codegen.ecu_map.placement import SPACINGS, Maker, Placed, Target
from codegen.ecu_map.placement_axes import Spacing
from codegen.ecu_map.placement_error import ErrorEstimator, MeasuredError
from codegen.ecu_map.reference_surface import Origin, reference_surface_of
from codegen.ecu_map.storage import Real, Storage
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
