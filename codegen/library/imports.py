"""Maps and tyres from other tools."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from codegen.configuration import Config, parse, parse_toml
from codegen.emit.folder import check_output
from codegen.errors import CodegenError, ConfigError
from codegen.files import write_atomically
from codegen.importing.maps import Choices
from codegen.importing.maps import import_map as read_map
from codegen.importing.tyre import AxleImport, TyreImport
from codegen.importing.tyre import import_tyres as read_tyres
from codegen.library.configurations import ConfigLike, known_config, name_of
from codegen.library.logs import paths_of
from codegen.library.maps import Map
from codegen.library.result import PathLike, Result, path_of, public
from codegen.report.summary import map_summary
from codegen.text import text_table

MAP_VARIABLES = ("vx", "delta_f", "yaw_rate", "beta", "delta_r", "feasible")


class ImportedMap(Map):
    """A map from another tool; `notes` say how it was read, `source` is its file."""

    def __init__(self, source: Path, choices: Choices) -> None:
        found = read_map(source, choices)
        super().__init__(found.reference_map)
        self.source, self.notes, self.warnings = source, tuple(found.said), ()
        self._columns = found.columns

    def lines(self) -> list[str]:
        """Return axes and ranges."""
        summary = map_summary(self.reference_map)
        axes = text_table(("", "from", "to", "unit", "points"), summary.axis_rows)
        return [
            f"{self.path or 'map'}: {summary.headline}",
            axes,
            "",
            text_table(("", "from", "to", "unit"), summary.value_rows),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts."""
        found: dict[str, Any] = {"map": str(self.path), "source": str(self.source), "read": list(self.notes)}
        return {**found, "variables": self._columns, **map_summary(self.reference_map).to_dict()}


@public
def import_map(
    path: PathLike,
    *,
    units: str | None = None,
    rows: Literal["vx", "delta_f"] | None = None,
    variables: Mapping[str, str] | None = None,
) -> ImportedMap:
    """Read a map from a MATLAB file or a text table.

    Args:
        path: .mat, .csv, .tsv, .txt or .dat.
        units: such as "vx=km/h,delta_f=deg,yaw_rate=deg/s", if the names do not contain them.
        rows: axis along the rows of a table, if it is ambiguous.
        variables: vx, delta_f, yaw_rate, beta, delta_r, feasible -> name in the file, if it has no common name.

    Raises:
        CodegenError: the file cannot be read as a map.
    """
    chosen = dict(variables or {})
    for name in chosen:
        if name not in MAP_VARIABLES:
            remedy = f"known: {', '.join(MAP_VARIABLES)}"
            raise CodegenError(f"a map has no variable {name!r}", where="variables", remedy=remedy)
    return ImportedMap(path_of(path, "a map"), Choices(chosen, units, rows))


class ImportedTyres(Result):
    """Tyres from .tir files in a configuration: `config`, and its text as ars.toml."""

    def __init__(self, imported: TyreImport, where: str) -> None:
        self._imported, self.notes, self.text = imported, tuple(imported.notes), imported.text
        self.config: Config = parse(parse_toml(imported.text, where, ConfigError), where)
        self.path: Path | None = None

    def save(self, path: PathLike) -> None:
        """Write the ars.toml. Raises CodegenError."""
        place = path_of(path, "the path of an ars.toml")
        check_output(place, ".toml")
        write_atomically(place, self.text.encode("utf-8"))
        self.path = place

    def lines(self) -> list[str]:
        """Return the tyres, and how well their curves fit those of the files."""
        axles, name = self._imported.axles, self.path or "ars.toml"
        columns = [_column(axle) for axle in axles]
        rows = [(title, *(column[title] for column in columns)) for title in columns[0]]
        return [
            f"{name}: {', '.join(dict.fromkeys(f'{axle.file} ({axle.version})' for axle in axles))}",
            text_table(("one tyre of the axle", *(axle.axle for axle in axles)), rows),
            f"next: codegen solve --config {name} --case 4ws-2 -o 4ws2.npz",
        ]

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts."""
        return {"configuration": str(self.path), **self._imported.to_dict(), "notes": list(self.notes)}


@public
def import_tyres(
    files: PathLike | Sequence[PathLike], config: ConfigLike, *, peak: Literal["file", "road"] = "file"
) -> ImportedTyres:
    """Read the tyres of .tir files into the configuration of a car.

    Args:
        files: one file for both axles, or front and rear.
        config: the car, or the path of its ars.toml, which is not changed.
        peak: take the peak friction of the file, or `road.friction`.

    Raises:
        CodegenError: a file cannot be read, or has no lateral force.
    """
    given = known_config(config)
    return ImportedTyres(read_tyres(paths_of(files, "a .tir file"), given, peak), name_of(given))


def _column(axle: AxleImport) -> dict[str, str]:
    at_peak = "none below 45" if axle.slip_at_peak is None else f"{math.degrees(axle.slip_at_peak):.2f}"
    return {
        "static wheel load [N]": f"{axle.load:.0f}",
        "cornering stiffness [N/rad]": f"{axle.stiffness:.0f}",
        "peak force [N]": f"{axle.peak:.0f}",
        "peak friction": f"{axle.friction:.3f}",
        "slip at the peak [deg]": at_peak,
        "slip bound of the map [deg]": f"{math.degrees(axle.slip_bound):.2f}",
        "removed: horizontal shift [deg]": f"{math.degrees(axle.horizontal_shift):.3f}",
        "removed: vertical shift [N]": f"{axle.vertical_shift:.1f}",
        "removed: difference of E by side": f"{axle.asymmetry:.3f}",
        "curve against the file, up to the slip bound [% of peak]": f"{100.0 * axle.worst:.2f}",
        "the same up to the peak [% of peak]": f"{100.0 * axle.worst_to_peak:.2f}",
        "stiffness against the file at 0.7 of the load [%]": f"{100.0 * axle.stiffness_lighter:+.1f}",
        "stiffness against the file at 1.3 of the load [%]": f"{100.0 * axle.stiffness_heavier:+.1f}",
    }
