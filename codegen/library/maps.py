"""Reference maps: load, save, show."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.emit.folder import check_output
from codegen.errors import CodegenError
from codegen.judgement.map_warnings import beyond_grip
from codegen.judgement.model import MISSING_RECORD, Judgement, of_map
from codegen.library.configurations import ConfigLike, given_config
from codegen.library.result import PathLike, Result, drawn, path_of, public
from codegen.map_file import archive
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap, choose_config
from codegen.report.summary import map_summary
from codegen.text import text_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLES = (
    (("what binds", "cells", "share"), "binding_rows"),
    (("friction", "feasible cells", "share", "lateral acceleration, largest [m/s^2]"), "stack_rows"),
    (
        ("longitudinal acceleration [m/s^2]", "feasible cells", "share", "lateral, largest [m/s^2]", "like friction"),
        "acceleration_rows",
    ),
)
"""Header and attribute of the summary, for tables that not every map has."""


class Map(Result):
    """A reference map: yaw rates for n speeds and m front angles, in left turns. Arrays are in SI units, signs as in ISO 8855.

    Attributes:
        speed_m_s: (n,), increasing.
        front_angle_rad: (m,) at the road wheel, increasing.
        yaw_rate_rad_s: (n, m); NaN where no steady turn keeps all limits.
        feasible: (n, m) whether there is one.
        rear_angle_rad, sideslip_rad: (n, m); None for a table that has none.
        config: the configuration of the map; None for a table without one.
        case: name of the case in it, or None.
        path: file of the map; None before it is saved.
    """

    def __init__(self, reference_map: ReferenceMap, path: Path | None = None, data: bytes | None = None) -> None:
        self.reference_map, self.path = reference_map, path
        self._data = data
        self.notes: tuple[str, ...] = reference_map.notes
        self.warnings: tuple[str, ...] = tuple(filter(None, [beyond_grip(reference_map)]))

    @classmethod
    def from_arrays(
        cls,
        speed_m_s: npt.ArrayLike,
        front_angle_rad: npt.ArrayLike,
        yaw_rate_rad_s: npt.ArrayLike,
        *,
        config: ConfigLike | None = None,
    ) -> Map:
        """Return the map of a table of your own, (n,), (m,) and (n, m). Raises CodegenError: see `load_map`."""
        named = {"vx": speed_m_s, "delta_f": front_angle_rad, "yaw_rate": yaw_rate_rad_s}
        try:
            arrays = {key: np.asarray(values) for key, values in named.items()}
        except ValueError as error:
            raise CodegenError("the rows have different lengths", where="yaw_rate", remedy="give an (n, m) array") from error
        made = npz.from_arrays(arrays, "the table")
        return cls(made if config is None else made.with_config(choose_config(made, given_config(config)).config))

    @property
    def speed_m_s(self) -> FloatArray:
        return self.reference_map.speed

    @property
    def front_angle_rad(self) -> FloatArray:
        return self.reference_map.front_angle

    @property
    def yaw_rate_rad_s(self) -> FloatArray:
        return self.reference_map.yaw_rate

    @property
    def rear_angle_rad(self) -> FloatArray | None:
        return self.reference_map.rear_angle

    @property
    def sideslip_rad(self) -> FloatArray | None:
        return self.reference_map.sideslip

    @property
    def feasible(self) -> BoolArray:
        return self.reference_map.feasible

    @property
    def config(self) -> Config | None:
        return self.reference_map.config

    @property
    def case(self) -> str | None:
        return self.reference_map.case

    @property
    def name(self) -> str:
        """Name of the file without its ending, else of the case."""
        return self.path.stem if self.path is not None else self.case or "map"

    @property
    def judgement(self) -> Judgement | None:
        """The judgement of the car that `tune` stored, if it belongs to this map; else None."""
        return None if self.config is None else of_map(self.reference_map, self.config).judgement

    @property
    def data(self) -> bytes:
        """Content of the `.npz`: of the file that was read, else as `save` writes it."""
        return npz.to_bytes(self.reference_map) if self._data is None else self._data

    def save(self, path: PathLike) -> Path:
        """Write the map as `.npz` and return its path. Raises CodegenError if that would destroy something."""
        place = path_of(path, "the path of a map")
        check_output(place, ".npz")
        self._write(place)
        self.path, self._data = place, None
        return place

    def _write(self, path: Path) -> None:
        npz.save(self.reference_map, path)

    def plot(self, path: PathLike | None = None) -> Figure:
        """Draw yaw rate, sideslip, rear angle and what binds, over speed and front angle; write a PNG if there is a path."""
        return drawn(self._figure(), path)

    def _figure(self) -> Figure:
        from codegen.figures.draw import draw
        from codegen.figures.maps import map_picture

        return draw(map_picture(self.reference_map, self.name))

    def lines(self) -> list[str]:
        """Return axes, ranges, what binds, and the judgement of the car."""
        summary, judgement = map_summary(self.reference_map), self.judgement
        lines = [f"{self.path or 'map'}: {summary.headline}", summary.tyre_line, summary.tightening_line]
        lines = [line for line in lines if line]
        lines += [text_table(("", "from", "to", "unit", "points"), summary.axis_rows), ""]
        lines.append(text_table(("", "from", "to", "unit"), summary.value_rows))
        for header, rows in TABLES:
            if found := getattr(summary, rows):
                lines += ["", text_table(header, found)]
        return lines if judgement is None else [*lines, "", *judgement.lines()]

    def to_dict(self) -> dict[str, Any]:
        """Return the summary and the judgement, as `codegen show --json` prints them."""
        config, path = self.config, self.path
        stored = MISSING_RECORD if config is None else of_map(self.reference_map, config)
        where = {} if path is None else {"map": str(path)}
        return {**where, **map_summary(self.reference_map).to_dict(), "judgement": stored.to_dict()}


MapLike = Map | PathLike
"""A map, or the path of its `.npz`."""


@public
def load_map(path: PathLike) -> Map:
    """Read and check a map. Raises CodegenError with the file, the key and the index of the first fault."""
    place = path_of(path, "a map")
    data = archive.read_map_file(place)
    found = Map(npz.from_bytes(data, place), place, data)
    if found.config is not None:
        found.notes += tuple(filter(None, [of_map(found.reference_map, found.config).note]))
    return found


def map_of(given: Any) -> Map:
    """Return an argument that is a map or its path as a map. Raises CodegenError."""
    return given if isinstance(given, Map) else load_map(path_of(given, "a map"))


def place_of(found: Map) -> str:
    """Return the location of a map in messages."""
    return str(found.path or "the map")
