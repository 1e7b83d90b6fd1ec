"""Choice of breakpoints for a bound on the error against the continuous map, on the bytes, or on both.

`choose` returns the total map for the build. Its axes are even or uneven, whichever takes fewer bytes; its tables hold the
surface of `reference_surface`. The bound holds for the lookup's result after the cap, in the stored numbers, at any point.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.placement_axes import (
    POINTS_MAX,
    Axes,
    Cost,
    Search,
    Spacing,
    TableLayout,
    grip_layout,
    reference_layout,
    yaw_rate_layout,
)
from codegen.ecu_map.placement_error import ErrorEstimator, MeasuredError
from codegen.ecu_map.reference_surface import Origin, ReferenceSurface, SurfaceLayer, reference_surface_of, rule_at
from codegen.ecu_map.storage import Real, Scales, Storage, raw_of, scale_of, table_bytes, values_of
from codegen.ecu_map.total import GripTable, TotalMap
from codegen.errors import BuildError
from codegen.map_file.map import ReferenceMap

SPACINGS: tuple[Spacing, ...] = ("even", "uneven")
"""Spacings in order of preference at the same bytes: cells of an even axis are found without a search."""

BOUND_FRACTIONS = (0.98, 0.96)
"""Fractions of the requested bound at which the search is repeated, because a tighter bound can give fewer bytes."""

ATTEMPT_COUNT = 10
"""Number of attempts with ever tighter bounds, because rounding to the stored numbers adds to the error."""
FINAL_BOUND_FRACTION = 0.995
"""Fraction of the requested bound used in the last attempt."""

CLIP_LEVEL_FACTOR = 0.85
"""Ratio of successive candidates for the level above the cap at which the table is clipped."""

REACHABLE_ERROR_FRACTION = 2e-4
"""Error that is usually reachable, as a fraction of the largest yaw rate."""
GRID_ERROR_FACTOR = 4.0
"""Error that is usually reachable, as a multiple of the fine grid's own error."""

ERROR_GROWTH_FACTOR = 1.6
"""Ratio of the next error that is tried to the one that was not reached."""

SMALLEST_BOUND_FRACTION, BISECTION_COUNT = 1e-4, 9
"""Search for the bound that fills a number of bytes: its smallest value as a fraction of the largest yaw rate, and the number
of halvings, which find it within a fiftieth."""

GRIP_BOUND_FRACTION = 0.75
"""Fraction of the bound for the grip table. The errors of both tables do not add up, because the smaller of two numbers has at
most the larger error. The reserve covers errors on a finer lattice, which the other table cannot correct."""

TIGHTENING_FACTOR, MISSES_MAX = 0.97, 2
"""Factor to the next smaller error that is tried, and the number of misses in a row that end the search."""


@dataclass(frozen=True)
class Request:
    """Bounds that the user requested, with their command-line options.

    Attributes:
        max_error: rad/s, None for no bound. max_flash: bytes, likewise.
        storage: of the tables.
        words: options of `codegen build` with the same meaning.
    """

    max_error: float | None
    max_flash: int | None
    storage: Storage
    words: str


@dataclass(frozen=True)
class Target:
    """Storage target: number of tables of the kind of controller (1 or 2), and the number type."""

    tables: int
    real: Real
    storage: Storage

    def bytes_of(self, speeds: int, front_angles: int, layers: int) -> int:
        """Return the bytes of tables with these numbers of breakpoints."""
        return table_bytes(speeds, front_angles, self.tables, layers, self.storage, self.real)


@dataclass(frozen=True)
class Placed:
    """A total map on chosen breakpoints.

    Attributes:
        spacing: "even" (perhaps with a wider cell at either end) or "uneven".
        flash_bytes: of tables, axes and scales.
        error: measured.
        rounding: largest rounding of the storage, rad/s and rad; zero for real numbers.
        origin: reference of the error, see `ReferenceSurface`.
        own_speed, own_front_angle: first and last breakpoint of the map that it is made from, m/s and rad.
        tables: 2 with one of the rear angle, else 1.
        gap: part of the error that is the surface's own deviation from the optimum, rad/s.
    """

    total: TotalMap
    spacing: Spacing
    flash_bytes: int
    error: MeasuredError
    rounding: tuple[float, float]
    origin: Origin
    own_speed: tuple[float, float]
    own_front_angle: tuple[float, float]
    tables: int
    gap: float = 0.0

    @property
    def bounded_error(self) -> float:
        """See `MeasuredError.bounded`."""
        return self.error.bounded(self.tables)


def choose(reference_map: ReferenceMap, config: Config, request: Request, tables: int, real: Real) -> Placed:
    """Return the total map that meets a request in the fewest bytes, or with the least error where only bytes are bounded.

    Args:
        config: the car, for a map that does not bring its own configuration.
        tables: 2 where the kind of controller looks the rear angle up, else 1.

    Raises:
        BuildError: the request cannot be met; the message names what can be reached.
        MapError: see `extend`.
    """
    maker = Maker(reference_surface_of(reference_map, config), Target(tables, real, request.storage))
    return _within_flash(maker, request) if request.max_error is None else _within_error(maker, request, request.max_error)


def _within_error(maker: Maker, request: Request, max_error: float) -> Placed:
    placed = maker.for_error(max_error)
    if placed is None:
        cause = f"takes more than {POINTS_MAX} breakpoints on an axis, or numbers finer than stored"
        if max_error <= maker.gap:
            cause = f"is less than the error of the fine grid of the optimum itself, {_degrees(maker.gap, up=True)}"
        if request.max_flash is not None:
            raise BuildError(f"{_degrees(max_error)} {cause}", where="`max_error=`", remedy=_in_flash(maker, request.max_flash))
        raise BuildError(
            f"{_degrees(max_error)} {cause}",
            where="`max_error=`",
            remedy=f"give a larger error; {_reachable(maker, max_error)} is known to be possible, smaller ones were not tried",
        )
    if request.max_flash is not None and placed.flash_bytes > request.max_flash:
        raise BuildError(
            f"{_degrees(max_error)} takes {placed.flash_bytes} bytes, more than {request.max_flash}",
            where="`max_error=`, `max_flash=`",
            remedy=_in_flash(maker, request.max_flash),
        )
    return placed


def _in_flash(maker: Maker, max_flash: int) -> str:
    best = maker.for_flash(max_flash)
    return f"in {max_flash} bytes {'nothing' if best is None else _degrees(best.bounded_error, up=True)} can be reached"


def _within_flash(maker: Maker, request: Request) -> Placed:
    assert request.max_flash is not None  # one of both is given
    placed = maker.for_flash(request.max_flash)
    if placed is None:
        raise BuildError(
            f"{request.max_flash} bytes hold no table",
            where="`max_flash=`",
            remedy=f"the smallest one takes {maker.least_bytes} bytes",
        )
    return placed


def _reachable(maker: Maker, target: float) -> str:
    tried = max(2.0 * target, GRID_ERROR_FACTOR * maker.gap, REACHABLE_ERROR_FRACTION * maker.largest)
    while (found := maker.for_error(tried, ("uneven",))) is None:
        tried *= ERROR_GROWTH_FACTOR
        if tried > maker.largest:
            return "more than the map holds"
    return _degrees(found.bounded_error, up=True)


def _degrees(yaw_rate: float, *, up: bool = False) -> str:
    degrees = math.degrees(yaw_rate)
    if up and degrees > 0.0:
        step = 10.0 ** (math.floor(math.log10(degrees)) - 1)
        degrees = math.ceil(degrees / step) * step
    return f"{degrees:.4g}deg/s"


@dataclass(frozen=True)
class _Tables:
    """Tables to search for, and the grip tables that accompany them.

    Attributes:
        grips: grip table of each friction; None where the cap is the same everywhere.
        layouts: layout of the tables at each friction.
        bytes_of: bytes of all tables, from the numbers of breakpoints.
    """

    surface: ReferenceSurface
    grips: tuple[GripTable | None, ...]
    layouts: tuple[TableLayout, ...]
    bytes_of: Cost
    _searches: dict[tuple[Spacing, float], Search] = field(default_factory=dict, init=False, repr=False, compare=False)

    def search(self, spacing: Spacing, bytes_max: float) -> Search:
        """Return the search among axes of one spacing within `bytes_max` bytes; it serves every bound on the error."""
        key = (spacing, bytes_max)
        if key not in self._searches:
            self._searches[key] = Search(self.surface, self.layouts, spacing, self.bytes_of, bytes_max)
        return self._searches[key]


@dataclass(frozen=True)
class Maker:
    """Maker of total maps from one surface for one target."""

    surface: ReferenceSurface
    target: Target

    @property
    def largest(self) -> float:
        """Largest yaw rate, rad/s."""
        return max(float(layer.total.yaw_rate.max()) for layer in self.surface.layers)

    @property
    def gap(self) -> float:
        """Error of the surface itself against the optimum, in rad/s of the bounded quantity."""
        return max(gap for layer in self.surface.layers for gap in self._gaps(layer))

    def _gaps(self, layer: SurfaceLayer) -> tuple[float, ...]:
        return (layer.gap.yaw_rate, layer.gap.rear_yaw_rate)[: self.target.tables]

    @property
    def least_bytes(self) -> int:
        """Bytes of the smallest tables."""
        beside = self._grip_bytes(2, 2) if self._follows_grip else 0
        return beside + self._bytes_of(2, 2)

    @property
    def _follows_grip(self) -> bool:
        return any(layer.share is not None for layer in self.surface.layers)

    def _bytes_of(self, speeds: int, front_angles: int) -> int:
        return self.target.bytes_of(speeds, front_angles, len(self.surface.layers))

    def _grip_bytes(self, speeds: int, front_angles: int) -> int:
        """Return the bytes of the grip tables of all frictions."""
        number, is_raw = np.dtype(self.target.real).itemsize, self.target.storage == "int16"
        cells = len(self.surface.layers) * speeds * front_angles
        return cells * (2 if is_raw else number) + number * (speeds + front_angles + is_raw)

    def _tables_for(self, bound: float) -> _Tables | None:
        """Return the tables for a bound in rad/s; None where no grip table meets it."""
        layers = self.surface.layers
        if not self._follows_grip:
            return self._tables_without_grip
        search = Search(self.surface, [grip_layout(layer) for layer in layers], "uneven", self._grip_bytes)
        axes = search.place(GRIP_BOUND_FRACTION * bound)
        if axes is None:
            return None
        grips = tuple(self._grip(axes, layer.share(*axes)) for layer in layers if layer.share is not None)
        beside = self._grip_bytes(axes[0].size, axes[1].size)
        return _Tables(
            self.surface,
            grips,
            tuple(self._layout(layer, grip) for layer, grip in zip(layers, grips, strict=True)),
            lambda speeds, front_angles: beside + self._bytes_of(speeds, front_angles),
        )

    @cached_property
    def _tables_without_grip(self) -> _Tables:
        """Tables where the cap is the same everywhere, for any bound."""
        layers = self.surface.layers
        layouts = tuple(self._layout(layer, None) for layer in layers)
        return _Tables(self.surface, (None,) * len(layers), layouts, self._bytes_of)

    def _layout(self, layer: SurfaceLayer, grip: GripTable | None) -> TableLayout:
        return yaw_rate_layout(layer, grip) if self.target.tables == 1 else reference_layout(layer, grip)

    def _grip(self, axes: Axes, share: FloatArray) -> GripTable:
        """Return a grip table in its stored numbers."""
        if self.target.storage == "float":
            return GripTable(*axes, share)
        scale = scale_of(1.0, self.target.real)
        return GripTable(*axes, values_of(raw_of(share, scale), scale), scale)

    def for_error(self, max_error: float, spacings: tuple[Spacing, ...] = SPACINGS) -> Placed | None:
        """Return the map with the fewest bytes for an error of at most `max_error`, rad/s; None where no table meets it."""
        bound = max_error - self.gap
        tables = self._tables_for(bound) if bound > 0.0 else None
        if tables is None:
            return None
        best: Placed | None = None
        for spacing in sorted(spacings, reverse=True):  # the size of the uneven table limits the search for the even one
            best = self._for_error(spacing, max_error, tables, math.inf if best is None else best.flash_bytes) or best
        if best is None:
            return None
        for share in BOUND_FRACTIONS:
            found = self._for_error(best.spacing, share * max_error, tables, math.inf)
            best = found if found is not None and found.flash_bytes < best.flash_bytes else best
        return best

    def for_flash(self, max_flash: int, spacings: tuple[Spacing, ...] = SPACINGS) -> Placed | None:
        """Return the map with the least error in at most `max_flash` bytes; None where not even the smallest table fits."""
        best: Placed | None = None
        for spacing in sorted(spacings, reverse=True):
            found = self._filling(spacing, max_flash) if best is None else self._better(spacing, best)
            best = found or best
        return best

    def _for_error(self, spacing: Spacing, max_error: float, tables: _Tables, bytes_max: float) -> Placed | None:
        search = tables.search(spacing, bytes_max)
        bound = max_error - self.gap
        axes = search.place(bound)
        for _ in range(ATTEMPT_COUNT):
            if axes is None:
                return None
            placed = self._on(axes, spacing, tables)
            if placed.bounded_error <= max_error:
                return placed
            # The lattice of the search and the rounding of the numbers both miss a little of the error.
            bound *= FINAL_BOUND_FRACTION * max_error / placed.bounded_error
            axes = search.again(axes, bound)
        return None

    def _filling(self, spacing: Spacing, max_flash: int) -> Placed | None:
        """Return the map with the least error found in a number of bytes, by bisection of the bound on a logarithmic scale."""
        if self.least_bytes > max_flash:
            return None
        low, high = math.log(SMALLEST_BOUND_FRACTION * self.largest), math.log(self.largest)
        best = self._smallest(spacing)
        for _ in range(BISECTION_COUNT):
            middle = 0.5 * (low + high)
            placed = self._within(spacing, math.exp(middle), max_flash)
            if placed is None:
                low = middle
                continue
            high = middle
            best = placed if placed.bounded_error < best.bounded_error else best
        bound, misses = best.bounded_error, 0
        while misses < MISSES_MAX:  # a smaller error does not always take more bytes
            bound *= TIGHTENING_FACTOR
            fitting = self._fitting(spacing, bound, max_flash)
            if fitting is None or fitting.bounded_error >= best.bounded_error:  # none is below zero
                misses += 1
            else:
                best, bound, misses = fitting, fitting.bounded_error, 0
        return best

    def _fitting(self, spacing: Spacing, max_error: float, max_flash: int) -> Placed | None:
        """Return a map within both bounds, from a search without the limit of bytes or from one with it."""
        tables = self._tables_for(max_error - self.gap) if max_error > self.gap else None
        if tables is None:
            return None
        for most in (math.inf, max_flash):
            placed = self._for_error(spacing, max_error, tables, most)
            if placed is not None and placed.flash_bytes <= max_flash:
                return placed
        return None

    def _better(self, spacing: Spacing, than: Placed) -> Placed | None:
        """Return a map of the other spacing with no larger error in as many bytes."""
        placed = self._within(spacing, than.bounded_error - self.gap, than.flash_bytes)
        return placed if placed is not None and placed.bounded_error <= than.bounded_error else None

    def _within(self, spacing: Spacing, bound: float, bytes_max: float) -> Placed | None:
        """Return the result of one search for a bound on the error of the tables; the stored numbers can add a little."""
        tables = self._tables_for(bound)
        if tables is None:
            return None
        axes = tables.search(spacing, bytes_max).place(bound)
        return None if axes is None else self._on(axes, spacing, tables)

    def _smallest(self, spacing: Spacing) -> Placed:
        axes = (np.array([0.0, self.surface.own_speed[1]]), np.array([0.0, self.surface.front_angle_top]))
        tables = self._tables_for(self.largest)
        assert tables is not None  # a cap's share is far from the largest yaw rate everywhere
        return self._on(axes, spacing, tables)

    def _on(self, axes: Axes, spacing: Spacing, tables: _Tables) -> Placed:
        """Return the total map on given axes from zero, in its stored numbers, and its error."""
        estimator = ErrorEstimator(self.surface, axes, self.target.real)
        stored, rounding = self._stored(self._clipped(_total(self.surface, axes, tables.grips), estimator))
        return Placed(
            total=stored,
            spacing=spacing,
            flash_bytes=tables.bytes_of(axes[0].size, axes[1].size),
            error=estimator.error(stored),
            rounding=rounding,
            origin=self.surface.origin,
            own_speed=self.surface.own_speed,
            own_front_angle=self.surface.own_front_angle,
            tables=self.target.tables,
            gap=self.gap,
        )

    def _clipped(self, total: TotalMap, estimator: ErrorEstimator) -> TotalMap:
        """Clip the total map far above the cap, where no error results, for a finer scale."""
        before = estimator.on_lattice(total)
        level = max(float(layer.yaw_rate.max()) for layer in total.stack)
        while True:
            level *= CLIP_LEVEL_FACTOR
            clipped = _clipped_at(total, level)
            after = estimator.on_lattice(clipped)
            if after.yaw_rate_whole > before.yaw_rate_whole or after.yaw_rate > before.yaw_rate:
                return total
            if self.target.tables > 1 and (
                after.rear_angle_whole > before.rear_angle_whole or after.rear_yaw_rate_whole > before.rear_yaw_rate_whole
            ):
                return total
            total = clipped

    def _stored(self, total: TotalMap) -> tuple[TotalMap, tuple[float, float]]:
        if self.target.storage == "float":
            return total, (0.0, 0.0)
        stack = total.stack
        largest = [max(float(np.abs(getattr(layer, key)).max()) for layer in stack) for key in ("yaw_rate", "rear_angle")]
        scales = Scales.of(largest[0], largest[1], self.target.real)
        stored = [_rounded(layer, scales) for layer in stack]
        rounding = [
            max(float(np.abs(getattr(new, key) - getattr(old, key)).max()) for old, new in zip(stack, stored, strict=True))
            for key in ("yaw_rate", "rear_angle")
        ]
        return TotalMap.of_stack(stored), (rounding[0], rounding[1])


def _total(surface: ReferenceSurface, axes: Axes, grips: Sequence[GripTable | None]) -> TotalMap:
    return TotalMap.of_stack(_layer(surface, layer, axes, grip) for layer, grip in zip(surface.layers, grips, strict=True))


def _layer(surface: ReferenceSurface, layer: SurfaceLayer, axes: Axes, grip: GripTable | None) -> TotalMap:
    yaw_rate, rear_angle = layer.surface(*axes)
    return replace(
        layer.total,
        speed=axes[0],
        front_angle=axes[1],
        yaw_rate=yaw_rate,
        rear_angle=rear_angle,
        rule=rule_at(surface, layer, *axes),
        layers=(),
        grip=grip,
    )


def _clipped_at(total: TotalMap, level: float) -> TotalMap:
    layers = tuple(_clipped_at(layer, level) for layer in total.layers)
    return replace(total, yaw_rate=np.minimum(total.yaw_rate, level), layers=layers)


def _rounded(total: TotalMap, scales: Scales) -> TotalMap:
    yaw_rate, rear_angle = (
        values_of(raw_of(table, scale), scale)
        for table, scale in ((total.yaw_rate, scales.yaw_rate), (total.rear_angle, scales.rear_angle))
    )
    return replace(total, yaw_rate=yaw_rate, rear_angle=rear_angle, scales=scales)
