"""Differences between two maps, on the breakpoints of the first where both are defined: figures and a picture.

Values are in degrees and km/h. The console, the JSON output and the HTML report use them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.errors import MapError, one_line
from codegen.figures.data import BLUE, EMPTY, INK, ORANGE, Chart, Picture, entry, patches, plain, scale_of, text
from codegen.figures.maps import INFEASIBLE_NAME, NamedMap, category_trace, colour_limits, heat_map, map_layout
from codegen.map_file.bounds import MARKS
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ACCELERATION_STACK, FRICTION_STACK
from codegen.optimum.nonlinear import ABOVE, SlipUse, slip_use
from codegen.report.summary import TYRE, map_summary
from codegen.units import KM_H

POINT_SPEEDS_KM_H = (30.0, 60.0, 100.0, 150.0)
POINT_FRONT_ANGLES_DEG = (2.0, 5.0, 10.0)
"""Operating points that are listed individually, where at least one map has a yaw rate."""

ON_BREAKPOINT = 1e-9
"""Fraction of the cell width within which a point counts as on the breakpoint."""

SAME = 1e-7
"""Relative difference below which the slips of two cells count as equal."""

CAR_HEADER = ("", "first", "second")
DIFFERENCE_HEADER = ("[deg/s]", "mean", "RMS", "largest", "there")
POINT_HEADER = ("operating point", "r, first", "r, second", "difference", "rear, first", "rear, second")


@dataclass(frozen=True)
class OperatingPoint:
    """An operating point."""

    speed_km_h: float
    front_angle_deg: float

    def __str__(self) -> str:
        return f"{self.speed_km_h:.3g} km/h, {self.front_angle_deg:.2f} deg"


@dataclass(frozen=True)
class AxleSlip:
    """Slip of an axle on the plant, in percent of its bound: the largest, its place, and the number of cells above it."""

    largest_percent: float
    at: OperatingPoint
    cells_above: int


@dataclass(frozen=True)
class Side:
    """Figures of one map over all its cells.

    Attributes:
        tyre_model: tyre model of its case; None for a bare map.
        binding_cells: constraint -> cells in which it binds, alone or with others; None if the map lacks it.
        front_slip, rear_slip: slip if the map is tracked exactly; None without a car, or if no cell has such a turn.
        unreached_cells: cells in which the plant has no steady turn with that yaw rate; None without a car.
    """

    tyre_model: str | None
    feasible_cells: int
    cells: int
    lateral_acceleration_max_m_s2: float
    binding_cells: dict[str, int] | None
    front_slip: AxleSlip | None
    rear_slip: AxleSlip | None
    unreached_cells: int | None


@dataclass(frozen=True)
class Point:
    """Both maps at one operating point; None where a map has no value."""

    at: OperatingPoint
    first_yaw_rate_deg_s: float | None
    second_yaw_rate_deg_s: float | None
    first_rear_angle_deg: float | None
    second_rear_angle_deg: float | None


@dataclass(frozen=True)
class MapDifference:
    """Comparison of two maps. Differences are first minus second, in deg/s, over the cells with a value in both.

    Attributes:
        largest_deg_s: difference of the largest magnitude, with its sign, at `largest_at`.
        both, only_first, only_second: breakpoints of the first inside the axes of the second, by the feasible maps.
        outside: remaining breakpoints of the first.
    """

    first: Side
    second: Side
    both: int
    only_first: int
    only_second: int
    outside: int
    largest_deg_s: float
    largest_at: OperatingPoint
    rms_deg_s: float
    mean_deg_s: float
    points: tuple[Point, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return name -> value, for JSON."""
        return asdict(self)

    @property
    def difference_row(self) -> tuple[str, ...]:
        """Difference of the yaw rates, under DIFFERENCE_HEADER."""
        told = (self.mean_deg_s, self.rms_deg_s, self.largest_deg_s)
        return "yaw rate, first less second", *(f"{value:.3g}" for value in told), str(self.largest_at)

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows of each figure that both maps have: name, first, second."""
        sides = (self.first, self.second)
        yield TYRE, *(side.tyre_model or "-" for side in sides)
        yield "feasible cells", *(f"{side.feasible_cells} of {side.cells}" for side in sides)
        yield "feasible in both", str(self.both), str(self.both)
        yield "feasible in this map alone", str(self.only_first), str(self.only_second)
        if self.outside:
            yield "outside of the other's axes", str(self.outside), "-"
        yield "lateral acceleration up to [m/s^2]", *(f"{side.lateral_acceleration_max_m_s2:.4g}" for side in sides)
        for name in ("none", *(mark.label for mark in MARKS)):
            counts = [None if side.binding_cells is None else side.binding_cells[name] for side in sides]
            if any(counts):
                label = "nothing binds [cells]" if name == "none" else f"{name} binds [cells]"
                yield label, *("-" if count is None else str(count) for count in counts)
        for axle in ("front", "rear"):
            slips: list[AxleSlip | None] = [getattr(side, f"{axle}_slip") for side in sides]
            if any(slips):
                told = ["-" if slip is None else f"{slip.largest_percent:.1f}" for slip in slips]
                yield f"{axle} slip on the plant [% of bound]", *told
                yield f"{axle} slip largest at", *("-" if slip is None else str(slip.at) for slip in slips)
                yield (
                    f"{axle} slip above the bound [cells]",
                    *("-" if slip is None else str(slip.cells_above) for slip in slips),
                )
        if any(side.unreached_cells for side in sides):
            told = ["-" if side.unreached_cells is None else str(side.unreached_cells) for side in sides]
            yield "no such turn on the plant [cells]", *told

    @property
    def point_rows(self) -> list[tuple[str, ...]]:
        """Rows for each operating point, under POINT_HEADER; deg/s and deg."""
        rows = []
        for point in self.points:
            one, two = point.first_yaw_rate_deg_s, point.second_yaw_rate_deg_s
            difference = None if one is None or two is None else one - two
            told = (one, two, difference, point.first_rear_angle_deg, point.second_rear_angle_deg)
            rows.append((str(point.at), *("-" if value is None else f"{round(value, 3) + 0.0:.3f}" for value in told)))
        return rows


def map_difference(one: ReferenceMap, other: ReferenceMap, used: Sequence[SlipUse | None] | None = None) -> MapDifference:
    """Compare two maps; of a stack, the map itself.

    Args:
        used: `slip_use` of both maps, if already known.

    Raises:
        MapError: no breakpoint of the first lies inside the axes of the second, or none has a value in both.
    """
    inside = inside_of(one, other)
    if not inside.any():
        raise MapError(
            f"no operating point in common: {_span(one)} beside {_span(other)}",
            remedy="compare maps whose speeds and front angles overlap",
        )
    gain = np.degrees(one.yaw_rate - on_axes_of(one, other))
    both = np.isfinite(gain)
    if not both.any():
        raise MapError("no operating point is feasible in both", remedy="compare maps whose feasible cells overlap")
    theirs = np.isfinite(on_axes_of(one, other))
    largest = np.unravel_index(int(np.nanargmax(np.abs(gain))), gain.shape)
    slips = (slip_use(one), slip_use(other)) if used is None else used
    return MapDifference(
        first=_side(one, slips[0]),
        second=_side(other, slips[1]),
        both=int(both.sum()),
        only_first=int((one.feasible & ~theirs & inside).sum()),
        only_second=int((theirs & ~one.feasible).sum()),
        outside=int((~inside).sum()),
        largest_deg_s=float(gain[largest]),
        largest_at=_place(one, largest),
        rms_deg_s=float(np.sqrt(np.mean(gain[both] ** 2))),
        mean_deg_s=float(np.mean(gain[both])),
        points=tuple(_points(one, other)),
    )


def same_car(one: ReferenceMap, other: ReferenceMap) -> bool | None:
    """Return whether two maps are of the same car on the same road; None if a map has no configuration."""
    if one.config is None or other.config is None:
        return None
    mine, theirs = ((config.vehicle, config.tyre, config.road) for config in (one.config, other.config))
    return mine == theirs


def caveats(one: ReferenceMap, other: ReferenceMap) -> list[str]:
    """Return the limitations of a comparison."""
    told = []
    quantities = one.quantity, other.quantity
    if FRICTION_STACK in quantities:
        told.append("of a stack, the map for its highest friction is compared")
    if ACCELERATION_STACK in quantities:
        told.append("of a stack, the map at constant speed is compared")
    if not (np.array_equal(one.speed, other.speed) and np.array_equal(one.front_angle, other.front_angle)):
        told.append("the maps have different breakpoints: compared on those of the first")
    return told


def _span(one: ReferenceMap) -> str:
    low, high = ((axis[0], axis[-1]) for axis in (one.speed / KM_H, np.degrees(one.front_angle)))
    return f"{low[0]:.4g} to {low[1]:.4g} km/h and {high[0]:.4g} to {high[1]:.4g} deg"


def _place(one: ReferenceMap, cell: Sequence[Any]) -> OperatingPoint:
    return OperatingPoint(float(one.speed[cell[0]] / KM_H), float(np.degrees(one.front_angle[cell[1]])))


def _side(one: ReferenceMap, used: SlipUse | None) -> Side:
    summary, binding = map_summary(one), None
    if one.active is not None:
        flags = one.active[one.feasible]
        binding = {"none": int((flags == 0).sum())}
        binding |= {mark.label: int((flags & int(mark.flag) != 0).sum()) for mark in MARKS}
    return Side(
        tyre_model=one.tyre_model,
        feasible_cells=summary.feasible_cells,
        cells=summary.cells,
        lateral_acceleration_max_m_s2=summary.lateral_acceleration_max_m_s2,
        binding_cells=binding,
        front_slip=None if used is None else _axle(one, used.front),
        rear_slip=None if used is None else _axle(one, used.rear),
        unreached_cells=None if used is None else int(used.unreached.sum()),
    )


def _axle(one: ReferenceMap, percent: FloatArray) -> AxleSlip | None:
    if not np.isfinite(percent).any():
        return None
    largest = float(np.nanmax(percent))
    # Where a bound binds, many cells are equal except for rounding; the first of them is named.
    first = np.argwhere(percent >= largest * (1.0 - SAME))[0]
    return AxleSlip(largest, _place(one, first), int((percent > ABOVE).sum()))


def _points(one: ReferenceMap, other: ReferenceMap) -> Iterator[Point]:
    speed, front_angle = np.array(POINT_SPEEDS_KM_H) * KM_H, np.radians(POINT_FRONT_ANGLES_DEG)
    tables = [
        None if table is None else np.degrees(interpolated(of, table, speed, front_angle))
        for of, table in ((one, one.yaw_rate), (other, other.yaw_rate), (one, one.rear_angle), (other, other.rear_angle))
    ]
    for i, speed_km_h in enumerate(POINT_SPEEDS_KM_H):
        for j, front_angle_deg in enumerate(POINT_FRONT_ANGLES_DEG):
            values = [None if table is None or np.isnan(table[i, j]) else float(table[i, j]) for table in tables]
            if values[0] is not None or values[1] is not None:
                yield Point(OperatingPoint(speed_km_h, front_angle_deg), *values)


# --- on other axes -----------------------------------------------------------------------------------------------------


def on_axes_of(one: ReferenceMap, other: ReferenceMap) -> FloatArray:
    """Return the other map's yaw rate in rad/s, (n, m), at the breakpoints of the first; see `interpolated`."""
    return interpolated(other, other.yaw_rate, one.speed, one.front_angle)


def interpolated(one: ReferenceMap, table: FloatArray, speed: FloatArray, front_angle: FloatArray) -> FloatArray:
    """Return a table of a map (NaN where infeasible) at speeds (k,) and front angles (l,), as (k, l). It is linear between
    breakpoints, and NaN outside and next to an infeasible cell.

    On a breakpoint, neighbours have no influence, feasible or not.
    """
    row, along = _places(one.speed, speed)
    column, across = _places(one.front_angle, front_angle)
    lower, upper = (_between(table[at][:, column], table[at][:, column + 1], across) for at in (row, row + 1))
    return _between(lower, upper, along[:, np.newaxis])


def inside_of(one: ReferenceMap, other: ReferenceMap) -> BoolArray:
    """Return which breakpoints of the first lie inside the axes of the other, (n, m)."""
    along, across = (
        np.isfinite(_places(theirs, mine)[1])
        for theirs, mine in ((other.speed, one.speed), (other.front_angle, one.front_angle))
    )
    result: BoolArray = along[:, np.newaxis] & across
    return result


def _places(axis: FloatArray, at: FloatArray) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """Return the cell of each value and its fractional position there; NaN for the fraction outside the axis."""
    cell = np.clip(np.searchsorted(axis, at, side="right") - 1, 0, axis.size - 2)
    share = (at - axis[cell]) / (axis[cell + 1] - axis[cell])
    nearest = np.round(share)
    share = np.where(np.abs(share - nearest) < ON_BREAKPOINT, nearest, share)
    return cell, np.where((share >= 0.0) & (share <= 1.0), share, np.nan)


def _between(first: FloatArray, second: FloatArray, share: FloatArray) -> FloatArray:
    mixed = first + share * (second - first)
    return np.where(share == 0.0, first, np.where(share == 1.0, second, mixed))


COLOUR_RANGE_MIN, ABOVE_BOUND_MIN = 0.01, 10.0
"""Minimum span of a diverging scale: deg/s to both sides, and percent above the bound."""

NAME_MAX = 20
"""Largest number of characters of a map's name in a title."""

BOUND = 100.0
"""Percent."""

MAPS_SIZE = (9.6, 7.2)
"""Width and height of a picture without slips, in inches."""

BOTH_COLOUR = "#D9D4C5"

Maps = tuple[ReferenceMap, ReferenceMap]
Uses = tuple[SlipUse | None, SlipUse | None]


def difference_charts(one: NamedMap, other: NamedMap, number: int = 1) -> list[Chart]:
    """Return the yaw rates of two maps and their difference on the axes of the first; NaN where one is infeasible.

    `number` distinguishes several comparisons in one report.
    """
    here = on_axes_of(one.map, other.map)
    mine, theirs, gain = (np.degrees(rates) for rates in (one.map.yaw_rate, here, one.map.yaw_rate - here))
    both = colour_limits([mine, theirs])
    reach = max(float(np.nanmax(np.abs(gain))) if np.isfinite(gain).any() else 0.0, COLOUR_RANGE_MIN)
    shown = (
        ("first", one.title, mine, "viridis", both),
        ("second", other.title, theirs, "viridis", both),
        ("difference", f"{one.title} minus {other.title}", gain, "BrBG", (-reach, reach)),
    )
    charts = []
    for name, title, table, colours, limits in shown:
        figure = {"data": [heat_map(one, table, title, "deg/s", colours, limits)], "layout": map_layout(one, legend=False)}
        spoken = f"Heat map of the yaw rate: {title}."
        own = {"first": one.name, "second": other.name}.get(name)
        above = "First less second" if own is None else f"Yaw rate r, {name}: {plain(one_line(own, NAME_MAX))}"
        charts.append(Chart(f"compare-{name}-{number}", figure, f"Yaw rate: {title}.", spoken, 360, above))
    return charts


def map_difference_picture(maps: Maps, used: Uses, names: tuple[str, str]) -> Picture:
    """Return two maps and their difference over speed and front angle, on the breakpoints of the first.

    Args:
        used: `slip_use` of each map; without it, its two panels are omitted.
    """
    rows = difference_rows(maps, used, names)
    return Picture(rows, (13.2, 7.2) if any(used) else MAPS_SIZE)


def difference_rows(maps: Maps, used: Uses, names: tuple[str, str]) -> list[list[Chart | None]]:
    """Return the charts of `map_difference_picture` in rows."""
    named = NamedMap(names[0], maps[0]), NamedMap(names[1], maps[1])
    first, second, gain = difference_charts(*named)
    where = _where_chart(named[0], maps)
    if not any(used):
        return [[first, second], [gain, where]]
    return [[first, second, gain], [*_use_charts(named, used), where]]


def _where_chart(one: NamedMap, maps: Maps) -> Chart:
    """Return which map is feasible at the breakpoints of the first."""
    first, second = maps
    theirs = np.isfinite(on_axes_of(first, second))
    kinds = (
        (first.feasible & theirs, BOTH_COLOUR, "both"),
        (first.feasible & ~theirs, BLUE, "the first alone"),
        (theirs & ~first.feasible, ORANGE, "the second alone"),
    )
    codes = np.zeros(first.feasible.shape, dtype=np.uint8)
    for index, (cells, _, _) in enumerate(kinds):
        codes[cells] = index
    hidden = ~(first.feasible | theirs)
    colours, labels = [colour for _, colour, _ in kinds], [label for _, _, label in kinds]
    trace = category_trace(one.speed_km_h, one.front_angle_deg, codes, hidden, labels, colours)
    told = [(label, colour) for cells, colour, label in kinds if cells.any()]
    told += [(INFEASIBLE_NAME, EMPTY)] if hidden.any() else []
    entries = patches([label for label, _ in told], [colour for _, colour in told])
    return Chart("", {"data": [trace, *entries], "layout": map_layout(one)}, title="Where feasible")


def _use_charts(named: tuple[NamedMap, NamedMap], used: Uses) -> Iterator[Chart]:
    """Yield the slip of the axle that is nearer to its bound, in percent of the bound, with a line where it meets the bound."""
    tables = [None if use is None else np.fmax(use.front, use.rear) for use in used]
    highest = max((float(np.nanmax(table, initial=0.0)) for table in tables if table is not None), default=0.0)
    top = max(highest, BOUND + ABOVE_BOUND_MIN)
    between = [round(0.5 * (BOUND + top))] if top > 1.3 * BOUND else []
    ticks = [*np.arange(0.0, BOUND + 1.0, 25.0).tolist(), *between, round(top)]
    bar = {"title": {"text": "slip / its bound on the plant (%)"}, "tickvals": ticks}
    for one, table, which in zip(named, tables, ("first", "second"), strict=True):
        look, title = map_layout(one), f"Slip used, {which}: {plain(one_line(one.name, NAME_MAX))}"
        if table is None:
            words = [text("contains no car", 0.5, 0.5, xref="paper", yref="paper")]
            yield Chart("", {"data": [], "layout": {**look, "annotations": words}}, title=title)
            continue
        trace = heat_map(one, table, "slip", "%", "RdYlBu_r", (0.0, top))
        data: list[dict[str, Any]] = [{**trace, "colorscale": scale_of("RdYlBu_r", BOUND / top), "colorbar": bar}]
        if (table > ABOVE).any():
            asked = {"start": ABOVE, "end": ABOVE, "size": 1.0, "coloring": "none"}
            drawn = {"color": INK, "width": 1.3}
            data.append({**trace, "type": "contour", "contours": asked, "line": drawn, "showscale": False, "showlegend": False})
            data.append(entry("slip meets its bound", INK, "solid", 1.3))
        yield Chart("", {"data": data, "layout": look}, title=title)
