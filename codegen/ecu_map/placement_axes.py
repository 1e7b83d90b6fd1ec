"""Breakpoints for a bilinear table whose error, after the cap, stays within a bound: the search, in double precision.

The search alternates between the axes. With the breakpoints of one axis fixed, the error of a cell of the other depends on its
two ends alone, so the longest cells within the bound, taken from zero on, are the fewest. The search repeats until nothing is
gained, from several starts. A start divides the bound between the axes: linear interpolation has norm 1, so their errors at
most add up. Errors are computed on a lattice several times finer than any cell. An even axis, perhaps with one wider cell at
either end (`Axis`), is searched in the same way: the longest end cells, then the fewest even ones between them.

A layout has the numbers that tables hold, and the yaw rates that the lookup computes from them. Bounds on errors are in rad/s.
The error of a rear angle is converted to a yaw rate: the angle times the passive yaw gain G of the linear car. A law that
looks up the rear angle commands it, or applies it to its reference model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Self

import numpy as np

from codegen.arrays import FloatArray
from codegen.ecu_map.reference_surface import ReferenceSurface, SurfaceLayer, above_zero, along, cell_of, interpolated
from codegen.ecu_map.total import CapSteering, GripTable

Stacked = Callable[[FloatArray, FloatArray], FloatArray]
"""Speeds (n,) in m/s and front angles (m,) in rad -> (k, n, m)."""
Outcome = Callable[[FloatArray, FloatArray], FloatArray]
"""Numbers of tables (k, ...) and accompanying numbers (f, ...) -> rad/s (d, ...)."""


@dataclass(frozen=True)
class TableLayout:
    """Layout of the tables of one friction.

    Attributes:
        values: numbers of k tables. beside: f accompanying numbers that the outcome also depends on.
        outcome: d yaw rates from both, rad/s. truth: their exact values, rad/s.
    """

    values: Stacked
    beside: Stacked
    outcome: Outcome
    truth: Stacked


def yaw_rate_layout(layer: SurfaceLayer, grip: GripTable | None) -> TableLayout:
    """Return the layout of the yaw rate table, with a grip table (None: no such table)."""
    stored = _beside(layer, grip)
    return TableLayout(
        values=lambda v, angle: layer.surface(v, angle)[0][np.newaxis],
        beside=lambda v, angle: stored.limit(v, angle)[np.newaxis],
        outcome=np.minimum,
        truth=lambda v, angle: layer.truth(v, angle)[0][np.newaxis],
    )


def reference_layout(layer: SurfaceLayer, grip: GripTable | None) -> TableLayout:
    """Return the layout of the tables of yaw rate and rear angle, with a grip table or None."""
    stored, car = _beside(layer, grip), layer.total.steering
    largest = car.rear_angle_max

    def beside(v: FloatArray, angle: FloatArray) -> FloatArray:
        limit = stored.limit(v, angle)
        speed = above_zero(v)[:, np.newaxis]
        in_phase = car.sideslip_max - limit * (car.rear_arm / speed - car.rear_slip_per_lateral_acceleration * speed)
        needed = np.broadcast_to(1.0 / gain_of(car, speed), limit.shape)
        return np.stack([limit, needed, np.minimum(in_phase, largest)])

    def outcome(values: FloatArray, numbers: FloatArray) -> FloatArray:
        (yaw_rate, rear_angle), (limit, needed, most) = values, numbers
        allowed = np.minimum(yaw_rate, limit)
        # `lookup.capped_rear_angle`, vectorised, within the range to which the laws clip it.
        turned = np.minimum((yaw_rate - allowed) * needed, np.maximum(most - rear_angle, 0.0))
        return np.stack([allowed, np.clip(rear_angle + turned, -largest, largest) / needed])

    def truth(v: FloatArray, angle: FloatArray) -> FloatArray:
        yaw_rate, rear_angle = layer.truth(v, angle)
        return np.stack([yaw_rate, rear_angle * gain_of(car, above_zero(v)[:, np.newaxis])])

    return TableLayout(lambda v, angle: np.stack(layer.surface(v, angle)), beside, outcome, truth)


def grip_layout(layer: SurfaceLayer) -> TableLayout:
    """Return the layout of the grip table, with the exact surface of the yaw rate."""

    def scale(v: FloatArray) -> FloatArray:
        return (layer.cap / above_zero(v))[:, np.newaxis]

    return TableLayout(
        values=lambda v, angle: (layer.limit(v, angle) / scale(v))[np.newaxis],
        beside=lambda v, angle: np.stack(np.broadcast_arrays(scale(v), layer.surface(v, angle)[0])),
        outcome=lambda share, numbers: np.minimum(share * numbers[:1], numbers[1:]),
        truth=lambda v, angle: layer.truth(v, angle)[0][np.newaxis],
    )


def gain_of(car: CapSteering, speed: FloatArray) -> FloatArray:
    """Return the passive yaw gain G in 1/s at speeds (m/s, any shape) above zero."""
    result: FloatArray = 1.0 / (car.wheelbase / speed + car.understeer_coefficient * speed)
    return result


def _beside(layer: SurfaceLayer, grip: GripTable | None) -> SurfaceLayer:
    """Return the layer with the share of the cap that a table holds."""
    return layer if grip is None else layer.with_share(interpolated(grip.speed, grip.front_angle, grip.share))


Spacing = Literal["even", "uneven"]
Axes = tuple[FloatArray, FloatArray]
Cost = Callable[[int, int], int]
"""Numbers of breakpoints of both axes -> bytes."""

POINTS_MAX = 256
"""Largest number of breakpoints of an axis that `codegen build` may choose; larger tables do not suit an ECU."""

OWN_POINTS, OTHER_POINTS, POINTS_IN_CELL = 256, 32, 12
"""Points of the lattice: over the map's own part of an axis, over each part outside it, and in each cell found so far."""

APART = 1e-6
"""Fraction of an axis within which two points count as one."""

SHARES = (0.3, 0.6, 0.85)
"""Fractions of the bound for the axis that is placed first, one for each start."""

TURNS = 6

COARSE = 0.004
"""Bound, as a fraction of the largest yaw rate, for which the first lattice is fine enough; the search halves it from there."""


@dataclass(frozen=True)
class _Layer:
    """A layout on a lattice: its arrays, (k, n, m) each."""

    values: FloatArray
    beside: FloatArray
    truth: FloatArray
    outcome: Outcome

    @classmethod
    def of(cls, layout: TableLayout, speed: FloatArray, front_angle: FloatArray) -> Self:
        """Sample a layout on coordinates."""
        values, beside, truth = (of(speed, front_angle) for of in (layout.values, layout.beside, layout.truth))
        return cls(values, beside, truth, layout.outcome)

    @property
    def transposed(self) -> _Layer:
        """Return the layer with the axes exchanged."""
        values, beside, truth = (np.swapaxes(each, 1, 2) for each in (self.values, self.beside, self.truth))
        return _Layer(values, beside, truth, self.outcome)

    def error(self, values: FloatArray, points: slice) -> float:
        """Return the largest error in rad/s of values (k, p, m) of the tables at p points of the first axis."""
        found = self.outcome(values, self.beside[:, points])
        return float(np.abs(found - self.truth[:, points]).max(initial=0.0))


class Lattice:
    """Layouts on a grid: `coordinates` are speeds (n,) and front angles (m,), from zero to the top."""

    def __init__(self, layouts: Sequence[TableLayout], speed: FloatArray, front_angle: FloatArray) -> None:
        self.layouts, self.coordinates = layouts, (speed, front_angle)
        self.layers = [_Layer.of(layout, speed, front_angle) for layout in layouts]

    @classmethod
    def over(cls, surface: ReferenceSurface, layouts: Sequence[TableLayout], axes: Axes | None = None) -> Lattice:
        """Return a lattice over the domain of an ECU, fine enough for the cells of `axes`."""
        return cls(layouts, *cls.points(surface, axes))

    @staticmethod
    def points(surface: ReferenceSurface, axes: Axes | None = None) -> Axes:
        """Return the coordinates of such a lattice."""
        speed, front_angle = (None, None) if axes is None else axes
        return (
            _points(surface.own_speed, surface.own_speed[1], surface.speed_kinks, speed),
            _points(surface.own_front_angle, surface.front_angle_top, surface.front_angle_kinks, front_angle),
        )


def _points(own: tuple[float, float], top: float, kinks: FloatArray, axis: FloatArray | None) -> FloatArray:
    """Return points from zero to `top`, kinks included, as fine as the part of the axis and the cells require."""
    fixed = np.unique(np.clip(np.concatenate([[0.0, own[0], own[1], top], kinks]), 0.0, top))
    fixed = fixed[np.append(True, np.diff(fixed) > APART * top)]
    points = [fixed[:1]]
    for low, high in itertools.pairwise(fixed):
        inside = low >= own[0] * (1.0 - APART) and high <= own[1] * (1.0 + APART)
        widest = (own[1] - own[0]) / OWN_POINTS if inside else max(top - own[1], own[0]) / OTHER_POINTS
        points.append(_graded(low, high, min(widest, (high - low) / 3.0), axis))
    return np.concatenate(points)


def _graded(low: float, high: float, widest: float, axis: FloatArray | None) -> FloatArray:
    """Return points after `low` up to `high`, at most `widest` apart; finer in and near the cells of `axis`."""
    if axis is None:
        return np.linspace(low, high, math.ceil((high - low) / widest) + 1)[1:]
    width = np.diff(axis)
    begin, end, step = axis[:-1] - width, axis[1:] + width, width / POINTS_IN_CELL
    points, x = [], low
    while x < high:
        near = step[(begin <= x) & (x < end)]
        x += max(min(widest, float(near.min(initial=widest))), APART * high)
        points.append(x)
    stretched = np.array(points)
    result: FloatArray = low + (stretched - low) * ((high - low) / (stretched[-1] - low))
    return result


class Strips:
    """The cells of one axis (0 speed, 1 front angle), each over the whole other axis, which has the breakpoints `other`.

    Without `other`, the other axis is exact.
    """

    def __init__(self, lattice: Lattice, dimension: int, other: FloatArray | None) -> None:
        self.lattice, self.dimension, self.other = lattice, dimension, other
        self.x = lattice.coordinates[dimension]
        self._across = None if other is None else cell_of(other, lattice.coordinates[1 - dimension])
        self._layers = [one.transposed if dimension else one for one in lattice.layers]
        self._lines = [layer.values for layer in self._layers] if other is None else self._rows(self.x)

    def _rows(self, at: FloatArray) -> list[FloatArray]:
        """Return for each layer the values (k, p, m) at points (p,) of this axis, over the lattice of the other one."""
        beside = self.lattice.coordinates[1 - self.dimension] if self.other is None else self.other
        rows = []
        for layout in self.lattice.layouts:
            values = np.swapaxes(layout.values(beside, at), 1, 2) if self.dimension else layout.values(at, beside)
            rows.append(values if self._across is None else np.swapaxes(along(np.swapaxes(values, 1, 2), *self._across), 1, 2))
        return rows

    def error(self, low: int, high: int) -> float:
        """Return the largest error, rad/s, of one cell between two points of the lattice, by their indices."""
        part = slice(low + 1, high)
        if self.other is not None:
            part = slice(low, high + 1)
        share = ((self.x[part] - self.x[low]) / (self.x[high] - self.x[low]))[:, np.newaxis]
        worst = 0.0
        for line, layer in zip(self._lines, self._layers, strict=True):
            begin, end = line[:, low : low + 1], line[:, high : high + 1]
            worst = max(worst, layer.error(begin + share * (end - begin), part))
        return worst

    def error_on(self, axis: FloatArray, bound: float = math.inf) -> float:
        """Return the largest error, rad/s, with any breakpoints of this axis; above `bound`, any number above it."""
        all_rows = self._rows(axis)
        worst = 0.0
        for points in (slice(None, None, 7), slice(None)):  # most failures show at a few points
            cell, share = cell_of(axis, self.x[points])
            for rows, layer in zip(all_rows, self._layers, strict=True):
                worst = max(worst, layer.error(along(rows, cell, share), points))
            if worst > bound:
                break
        return worst

    def longest(self, low: int, bound: float, stride: int = 1) -> int:
        """Return the end of the longest cell from `low` that keeps the bound: an index of the lattice, at least low + 1."""
        last = self.x.size - 1
        good, reach = low + 1, max(stride, 2)
        while low + reach < last and self.error(low, low + reach) <= bound:
            good, reach = low + reach, 2 * reach
        bad = min(low + reach, last)
        if bad == last and self.error(low, last) <= bound:
            return last
        while good + 1 < bad:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if self.error(low, middle) <= bound else (good, middle)
        return good

    def last_cell(self, bound: float) -> int:
        """Return the start of the longest cell that ends at the top and keeps the bound."""
        last = self.x.size - 1
        good, bad = last - 1, 0
        if self.error(0, last) <= bound:
            return 0
        while bad + 1 < good:
            middle = (good + bad) // 2
            good, bad = (middle, bad) if self.error(middle, last) <= bound else (good, middle)
        return good


def uneven_axis(strips: Strips, bound: float, most: int) -> FloatArray | None:
    """Return the fewest breakpoints, on the lattice; None where they are more than `most`."""
    ends, stride = [0], 4
    while ends[-1] < strips.x.size - 1:
        ends.append(strips.longest(ends[-1], bound, stride))
        stride = max((ends[-1] - ends[-2]) // 2, 1)
        if len(ends) > most:
            return None
    axis: FloatArray = strips.x[np.array(ends)]
    return axis


def even_axis(strips: Strips, bound: float, most: int) -> FloatArray | None:
    """Return the fewest breakpoints of an even axis, perhaps with a wider cell at either end; None where more than `most`."""
    x, top = strips.x, strips.x.size - 1
    first, last = strips.longest(0, bound), strips.last_cell(bound)
    if first == top:
        return x[[0, top]]
    best: FloatArray | None = None
    for start, end in ((first, last), (0, last), (first, top), (0, top)):
        if start < end:
            found = _fewest(strips, start, end, bound, most if best is None else best.size - 1)
            best = best if found is None else found
    return best


def _fewest(strips: Strips, start: int, end: int, bound: float, most: int) -> FloatArray | None:
    """Return the axis of at most `most` breakpoints with the fewest even cells between two lattice points within the bound.

    The search assumes that more cells are never worse."""
    before, after = strips.x[:1] if start else strips.x[:0], strips.x[-1:] if end < strips.x.size - 1 else strips.x[:0]

    def axis(cells: int) -> FloatArray:
        return np.concatenate([before, np.linspace(strips.x[start], strips.x[end], cells + 1), after])

    def keeps(cells: int) -> bool:
        return strips.error_on(axis(cells), bound) <= bound

    cells_max = most - 1 - before.size - after.size
    bad, good = 0, 1
    while good <= cells_max and not keeps(good):
        bad, good = good, 2 * good
    if good > cells_max:
        if bad >= cells_max or not keeps(cells_max):
            return None
        good = cells_max
    while bad + 1 < good:
        middle = (bad + good) // 2
        bad, good = (bad, middle) if keeps(middle) else (middle, good)
    return axis(good)


AXIS_OF = {"even": even_axis, "uneven": uneven_axis}


@dataclass(frozen=True)
class Search:
    """Search for axes of one spacing and least `cost`, at most `cost_max`, for the layouts of all frictions.

    Results for the coarse bounds are kept, because a second search passes the same ones.
    """

    surface: ReferenceSurface
    layouts: Sequence[TableLayout]
    spacing: Spacing
    cost: Cost
    cost_max: float = math.inf
    _coarse: dict[tuple[int, float], Axes | None] = field(default_factory=dict, init=False, repr=False, compare=False)

    def place(self, bound: float) -> Axes | None:
        """Return breakpoints of both axes that keep the bound, rad/s, at few bytes; None where they cost too much."""
        coarse = max(bound, COARSE * self._largest)
        best = self._at_level(0, coarse, None)
        for level in itertools.count(1):
            if best is None or coarse <= bound:
                break
            coarse = max(bound, 0.5 * coarse)
            best = self._at_level(level, coarse, best)
        return None if best is None else self.again(best, bound)

    @cached_property
    def _first(self) -> Lattice:
        return Lattice.over(self.surface, self.layouts)

    @property
    def _largest(self) -> float:
        """Return the largest yaw rate of all layouts, rad/s."""
        return max(float(layer.truth.max()) for layer in self._first.layers)

    def _at_level(self, level: int, bound: float, before: Axes | None) -> Axes | None:
        """Return the axes for a halved bound, on a lattice for the axes of the level before."""
        if (level, bound) not in self._coarse:
            lattice = self._first if before is None else Lattice.over(self.surface, self.layouts, before)
            self._coarse[level, bound] = self._from_starts(lattice, bound)
        return self._coarse[level, bound]

    def again(self, axes: Axes, bound: float) -> Axes | None:
        """Search again for about the same bound, on a lattice fine enough for the cells of these axes."""
        lattice = Lattice.over(self.surface, self.layouts, axes)
        kept = self._cheaper(*(self._turned(lattice, dimension, axes[dimension], bound) for dimension in (0, 1)))
        return self._cheaper(kept, self._from_starts(lattice, bound))

    def _from_starts(self, lattice: Lattice, bound: float) -> Axes | None:
        best: Axes | None = None
        for dimension in (0, 1):
            for share in SHARES:
                first = AXIS_OF[self.spacing](Strips(lattice, dimension, None), share * bound, POINTS_MAX)
                best = self._cheaper(best, self._turned(lattice, dimension, first, bound))
        return best

    def _turned(self, lattice: Lattice, dimension: int, first: FloatArray | None, bound: float) -> Axes | None:
        """Alternate between the axes, beginning with one, while it saves bytes."""
        best: Axes | None = None
        axis, placed = first, dimension
        for _ in range(TURNS):
            if axis is None:
                break
            other, placed = axis, 1 - placed
            most = self._most(other.size)
            if self.cost(most, other.size) > self.cost_max:
                break
            axis = AXIS_OF[self.spacing](Strips(lattice, placed, other), bound, most)
            if axis is not None:
                before, best = best, self._cheaper(best, (axis, other) if placed == 0 else (other, axis))
                if best is before:
                    break
        return best

    def _most(self, other: int) -> int:
        """Return the most breakpoints of an axis when the other one has `other`."""
        most = POINTS_MAX
        while most > 2 and self.cost(most, other) > self.cost_max:
            most -= 1
        return most

    def _cheaper(self, one: Axes | None, other: Axes | None) -> Axes | None:
        if one is None or other is None:
            return other if one is None else one
        return other if self.cost(other[0].size, other[1].size) < self.cost(one[0].size, one[1].size) else one
