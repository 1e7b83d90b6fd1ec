"""Differences between two maps, on the breakpoints of the first where both are defined: figures and a picture.

Values are in degrees and km/h. The console, the JSON output and the HTML report use them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.errors import MapError, one_line
from codegen.map_file.bounds import MARKS
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ACCELERATION, FRICTION
from codegen.optimum.nonlinear import ABOVE, SlipUse, slip_use
from codegen.report import style
from codegen.report.summary import TYRE, map_summary
from codegen.units import KM_H

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure


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
class Place:
    """An operating point."""

    speed_km_h: float
    front_angle_deg: float

    def __str__(self) -> str:
        return f"{self.speed_km_h:.3g} km/h, {self.front_angle_deg:.2f} deg"


@dataclass(frozen=True)
class AxleSlip:
    """Slip of an axle on the plant, in percent of its bound: the largest, its place, and the number of cells above it."""

    largest_percent: float
    at: Place
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

    at: Place
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
    largest_at: Place
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
    if FRICTION in quantities:
        told.append("of a stack, the map for its highest friction is compared")
    if ACCELERATION in quantities:
        told.append("of a stack, the map at constant speed is compared")
    if not (np.array_equal(one.speed, other.speed) and np.array_equal(one.front_angle, other.front_angle)):
        told.append("the maps have different breakpoints: compared on those of the first")
    return told


def _span(one: ReferenceMap) -> str:
    low, high = ((axis[0], axis[-1]) for axis in (one.speed / KM_H, np.degrees(one.front_angle)))
    return f"{low[0]:.4g} to {low[1]:.4g} km/h and {high[0]:.4g} to {high[1]:.4g} deg"


def _place(one: ReferenceMap, cell: Sequence[Any]) -> Place:
    return Place(float(one.speed[cell[0]] / KM_H), float(np.degrees(one.front_angle[cell[1]])))


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
                yield Point(Place(speed_km_h, front_angle_deg), *values)


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
"""Width and height of a figure without slips, in inches."""

BOTH, DIVERGING, USE = "#D9D4C5", "BrBG", "RdYlBu_r"


def map_difference_figure(
    maps: tuple[ReferenceMap, ReferenceMap], used: tuple[SlipUse | None, SlipUse | None], names: tuple[str, str]
) -> Figure:
    """Draw two maps over speed and front angle: each on its own breakpoints, comparisons on those of the first.

    Args:
        used: `slip_use` of each map; without it, its two panels are omitted.
    """
    with style.style():
        figure = style.new_figure(13.2, 7.2) if any(used) else style.new_figure(*MAPS_SIZE)
        draw_map_difference(figure, maps, used, names)
    return figure


def draw_map_difference(
    figure: Figure | SubFigure,
    maps: tuple[ReferenceMap, ReferenceMap],
    used: tuple[SlipUse | None, SlipUse | None],
    names: tuple[str, str],
) -> None:
    """Draw the panels of `map_difference_figure` in a figure or a part of one, in the style that is set."""
    from matplotlib.ticker import MaxNLocator

    known = any(used)
    titles = [
        f"{which}: {style.plain(one_line(name, NAME_MAX))}" for which, name in zip(("first", "second"), names, strict=True)
    ]
    grid = figure.subplots(2, 3 if known else 2, sharex=True, sharey=True)
    _draw_yaw_rates(figure, grid[0][:2], maps, titles)
    gain, where = grid[:, 2] if known else grid[1]
    limits = {"xlim": grid[0][0].get_xlim(), "ylim": grid[0][0].get_ylim()}
    _draw_gain(figure, gain, maps)
    entries = _draw_where(where, maps)
    if known and _draw_use(figure, grid[1][:2], maps, used, titles):
        entries.append(style.line_handle(color=style.BLACK, linewidth=1.0, label="slip meets its bound"))
    grid[0][0].set(**limits)
    for axes in grid[-1]:
        axes.set_xlabel(style.SPEED_LABEL)
    grid[0][0].xaxis.set_major_locator(MaxNLocator(5, prune="upper"))  # the last label would touch the first of the next panel
    for axes in grid[:, 0]:
        axes.set_ylabel(style.FRONT_ANGLE_LABEL)
    figure.legend(handles=entries, loc="outside lower center", ncols=len(entries))


def _draw_yaw_rates(
    figure: Figure | SubFigure, panels: Sequence[Axes], maps: tuple[ReferenceMap, ReferenceMap], titles: Sequence[str]
) -> None:
    """Draw both on one scale. The first is drawn last, because its limits are those of the picture."""
    scale = style.YAW_RATE.scale(maps)
    for axes, one, title in reversed(list(zip(panels, maps, titles, strict=True))):
        table = style.YAW_RATE.degrees(one)
        assert table is not None
        style.draw_table(axes, one, table, scale, style.YAW_RATE.colours)
        axes.set_title(f"{style.YAW_RATE.name}, {title}")
    style.YAW_RATE.colour_bar(figure, list(panels), scale, label=f"yaw rate ({style.YAW_RATE.unit})")


def _draw_gain(figure: Figure | SubFigure, axes: Axes, maps: tuple[ReferenceMap, ReferenceMap]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    first, second = maps
    gain = np.degrees(first.yaw_rate - on_axes_of(first, second))
    reach = max(float(np.nanmax(np.abs(gain), initial=0.0)), COLOUR_RANGE_MIN)
    scale = Normalize(-reach, reach)
    style.draw_table(axes, first, gain, scale, DIVERGING)
    figure.colorbar(ScalarMappable(scale, DIVERGING), ax=axes, label=f"yaw rate ({style.YAW_RATE.unit})")
    axes.set_title("First less second")


def _draw_where(axes: Axes, maps: tuple[ReferenceMap, ReferenceMap]) -> list[Artist]:
    """Draw which map is feasible at the breakpoints of the first; return the legend entries."""
    from matplotlib.colors import ListedColormap, Normalize

    first, second = maps
    theirs = np.isfinite(on_axes_of(first, second))
    kinds = (
        (first.feasible & theirs, BOTH, "both"),
        (first.feasible & ~theirs, style.BLUE, "the first alone"),
        (theirs & ~first.feasible, style.ORANGE, "the second alone"),
    )
    table = np.full(first.feasible.shape, np.nan)
    for index, (cells, _, _) in enumerate(kinds):
        table[cells] = index
    style.draw_table(axes, first, table, Normalize(-0.5, len(kinds) - 0.5), ListedColormap([colour for _, colour, _ in kinds]))
    axes.set_title("Where feasible")
    patches = [
        style.patch_handle(facecolor=colour, edgecolor=style.GREY, linewidth=0.5, label=name)
        for cells, colour, name in kinds
        if cells.any()
    ]
    return [*patches, *style.map_legend(phase_line=False, infeasible=bool(np.isnan(table).any()))]


def _draw_use(
    figure: Figure | SubFigure,
    panels: Sequence[Axes],
    maps: tuple[ReferenceMap, ReferenceMap],
    used: tuple[SlipUse | None, SlipUse | None],
    titles: Sequence[str],
) -> bool:
    """Draw the slip of the axle that is nearer to its bound, in percent of the bound, with a line where it meets the bound.
    Return whether there is such a line."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import TwoSlopeNorm

    tables = [None if use is None else np.fmax(use.front, use.rear) for use in used]
    highest = max((float(np.nanmax(table, initial=0.0)) for table in tables if table is not None), default=0.0)
    top = max(highest, BOUND + ABOVE_BOUND_MIN)
    scale = TwoSlopeNorm(BOUND, 0.0, top)
    lines = 0
    for axes, one, table, title in zip(panels, maps, tables, titles, strict=True):
        if table is None:
            axes.text(0.5, 0.5, "contains no car", transform=axes.transAxes, ha="center")
        else:
            style.draw_table(axes, one, table, scale, USE)
            if (table > ABOVE).any():
                lines += 1
                held = np.ma.masked_invalid(table.T)
                axes.contour(one.speed / KM_H, np.degrees(one.front_angle), held, [ABOVE], colors=style.BLACK, linewidths=1.0)
        axes.set_title(f"Slip used, {title}")
    ticks = [*np.arange(0.0, BOUND, 25.0), *np.linspace(BOUND, top, 3)]
    label = "slip, of its bound on the plant (%)"
    figure.colorbar(ScalarMappable(scale, USE), ax=list(panels), label=label, ticks=ticks, format="%.0f")
    return lines > 0
