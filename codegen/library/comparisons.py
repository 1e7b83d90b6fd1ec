"""Comparisons of maps, the size of their tables, and the reproduction of the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from codegen.emit.laws import law_of
from codegen.errors import CodegenError, MapError, within
from codegen.figures.draw import draw
from codegen.library.configurations import ConfigLike, given_config
from codegen.library.maps import Map, MapLike, map_of, place_of
from codegen.library.result import PathLike, Progress, Result, Work, drawn, public
from codegen.map_file.map import choose_config
from codegen.optimum.nonlinear import slip_use
from codegen.report.flash import FLASH_HEADER, FlashTable, flash_dict, flash_headline, flash_picture, flash_rows, flash_table
from codegen.report.map_difference import (
    CAR_HEADER,
    DIFFERENCE_HEADER,
    POINT_HEADER,
    caveats,
    map_difference,
    map_difference_picture,
    same_car,
)
from codegen.text import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


from codegen.library.result import path_of


class Difference(Result):
    """The changes from one map to another; `largest_deg_s` is that of the yaw rate, first less second."""

    def __init__(self, first: Map, second: Map) -> None:
        maps = first.reference_map, second.reference_map
        self._maps, self._first, self._second = maps, first, second
        self._used = slip_use(maps[0]), slip_use(maps[1])
        try:
            self._found = map_difference(*maps, self._used)
        except MapError as error:
            raise MapError(error.what, where=f"{place_of(first)}, {place_of(second)}", remedy=error.remedy) from error
        others = ["the maps are of different cars or roads"] if same_car(*maps) is False else []
        self.notes = (*others, *caveats(*maps))
        self.largest_deg_s = self._found.largest_deg_s

    def plot(self, path: PathLike | None = None) -> Figure:
        """Draw both maps and their difference; write a PNG if there is a path."""
        return drawn(self._figure(), path)

    def _figure(self) -> Figure:
        return draw(map_difference_picture(self._maps, self._used, (self._first.name, self._second.name)))

    def lines(self) -> list[str]:
        """Return the figures of both maps, the difference of the yaw rates, and some operating points."""
        found = self._found
        lines = [f"first:  {place_of(self._first)}\nsecond: {place_of(self._second)}\n"]
        lines += [text_table(CAR_HEADER, list(found.rows())), "", text_table(DIFFERENCE_HEADER, [found.difference_row])]
        if found.points:
            lines += ["\nyaw rate r [deg/s] and rear angle [deg]:", text_table(POINT_HEADER, found.point_rows)]
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Return the same figures."""
        return {"map": place_of(self._first), "against": place_of(self._second), **self._found.to_dict()}


@public
def compare(first: MapLike, second: MapLike, *, progress: Progress | None = None) -> Difference:
    """Compare two maps, or their paths, where both are defined. Raises CodegenError if they have no point in common."""
    one, other = map_of(first), map_of(second)
    if one is other or (one.path is not None and other.path is not None and one.path.samefile(other.path)):
        raise CodegenError("is the map itself", where=f"`second=` {place_of(other)}", remedy="name another map")
    with Work(progress).status("comparing"):
        return Difference(one, other)


class FlashSizes(Result):
    """Bytes of a map's tables over the error of the yaw rate, for even and uneven breakpoints and for int16."""

    def __init__(self, of: Map, found: FlashTable, notes: tuple[str, ...]) -> None:
        self._map, self._found, self.notes = of, found, notes

    def plot(self, path: PathLike | None = None) -> Figure:
        """Draw error over bytes; write a PNG if there is a path."""
        return drawn(self._figure(), path)

    def _figure(self) -> Figure:
        return draw(flash_picture(self._found, self._map.name))

    def lines(self) -> list[str]:
        """Return a row for each error."""
        return [f"{place_of(self._map)}: {flash_headline(self._found)}\n", text_table(FLASH_HEADER, flash_rows(self._found))]

    def to_dict(self) -> dict[str, Any]:
        """Return the same, in SI units."""
        return {"map": place_of(self._map), **flash_dict(self._found)}


@public
def flash_sizes(map: MapLike, config: ConfigLike | None = None, *, progress: Progress | None = None) -> FlashSizes:
    """Choose breakpoints for errors from 1 to 0.02 deg/s, and return the bytes of the tables; takes minutes.

    Args:
        map: the map, or its path.
        config: with the kind of controller; by default that of the map.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: the map cannot be built.
    """
    found = map_of(map)
    chosen = choose_config(found.reference_map, given_config(config))
    tables = 2 if law_of(chosen.config).uses_rear_angle else 1
    with within(place_of(found)), Work(progress).stage("placing breakpoints") as tell:
        return FlashSizes(found, flash_table(found.reference_map, chosen.config, tables, progress=tell), chosen.notes)


class Paper(Result):
    """The paper's tables beside ours, and the files that were written."""

    def __init__(self, folder: PathLike, progress: Progress | None) -> None:
        with Work(progress).stage("reproducing the paper") as tell:
            tell(0, 1, "loading")
            from codegen.report.paper import reproduce

            self._found = reproduce(path_of(folder, "a folder"), done=tell)

    def lines(self) -> list[str]:
        """Return the tables."""
        return list(self._found.lines())

    def to_dict(self) -> dict[str, Any]:
        """Return the same figures."""
        return self._found.to_dict()


@public
def paper(folder: PathLike, *, progress: Progress | None = None) -> Paper:
    """Reproduce the paper: solve its three maps, build the C, run C1 and C2, and compare its tables with ours.

    Args:
        folder: for maps, C, plots, runs and the report.
        progress: called with the share of the work that is done.
    """
    return Paper(folder, progress)
