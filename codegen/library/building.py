"""Builds: generate the C of a map."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, cast

from codegen.configuration import Config
from codegen.ecu_map.placement import Request
from codegen.ecu_map.storage import Storage
from codegen.emit.build import BuildOptions
from codegen.emit.evidence import placement_line, placement_summary
from codegen.emit.from_files import Prepared, prepare_map
from codegen.emit.write import check_target
from codegen.errors import CheckFailed, CodegenError, within
from codegen.judgement.facts import all_warnings
from codegen.judgement.map_warnings import require_grip
from codegen.judgement.model import of_map
from codegen.library.builds import Build
from codegen.library.configurations import ConfigLike, given_config
from codegen.library.maps import Map, MapLike, map_of, place_of
from codegen.library.quantities import MEMORY_KIND, YAW_RATE_KIND
from codegen.library.result import PathLike, Progress, Work, path_of, public
from codegen.map_file.map import choose_config


class NewBuild(Build):
    """A build that was generated now.

    Attributes:
        changed: whether files were written.
        differences: what `build` would change, where `write` was False.
    """

    def __init__(self, prepared: Prepared, has_request: bool, write: bool) -> None:
        target, manifest = prepared.target, prepared.folder.manifest
        self.differences = [] if write else prepared.differences()
        self.changed = prepared.write() if write else False
        super().__init__(target, manifest, prepared.folder.files)
        config, reference_map = prepared.chosen.config, prepared.reference_map
        self.notes, self._written, self._has_request = prepared.chosen.notes, write, has_request
        self._other_tools = [] if write else prepared.other_tools
        if write:
            self.warnings = (*all_warnings(config, reference_map, manifest), *of_map(reference_map, config).warnings)
        elif self.differences:
            count = len(self.differences) - 1
            what = f"not up to date: {self.differences[0]}{f' and {count} more' if count else ''}"
            self.failure = CheckFailed(what, where=target, remedy="build again without `write=False`")
        else:
            self.notes += tuple(f"the build was made with {each}: the same files" for each in self._other_tools)

    def lines(self) -> list[str]:
        """Return the number of files, or whether the folder is up to date."""
        if not self._written:
            return [] if self.differences else [f"{self.folder}: up to date"]
        placed = [placement_line(self.manifest)] if self._has_request else []
        return [*self._headline("" if self.changed else " (unchanged)"), *self._facts(), *placed]

    def to_dict(self) -> dict[str, Any]:
        """Return the same facts, as `codegen build --json` prints them."""
        if not self._written:
            found = {"up_to_date": not self.differences, "differences": self.differences, "other_tools": self._other_tools}
            return {"build": str(self.folder), **found}
        placed = {"placement": placement_summary(self.manifest)} if self._has_request else {}
        told = {"notes": list(self.notes), "warnings": list(self.warnings)}
        return {"build": str(self.folder), "changed": self.changed, **super().to_dict(), **placed, **told}


@public
def build(
    map: MapLike,
    folder: PathLike | None = None,
    *,
    config: ConfigLike | None = None,
    prefix: str = "ars",
    precision: Literal["single", "double"] = "single",
    max_error: str | None = None,
    max_flash: str | None = None,
    storage: Literal["float", "int16"] | None = None,
    beyond_grip: bool = False,
    write: bool = True,
    progress: Progress | None = None,
) -> NewBuild:
    """Generate the C of a map: controller, lookup, dynamics, CMake, README, manifest.

    Args:
        map: the map, or its path.
        folder: where the C goes; by default generated/ and the name of the map.
        config: another configuration than that of the map. An object, unlike a path, replaces that of the map first.
        prefix: of all C names.
        precision: of the numbers in C.
        max_error: choose breakpoints for this largest error of the yaw rate, such as "0.05deg/s".
        max_flash: choose breakpoints for tables of at most this size, such as "4KiB".
        storage: number format with chosen breakpoints; by default "float".
        beyond_grip: accept a map that requires more lateral acceleration than road tyres reach.
        write: False compares the folder with what would be written, and writes nothing.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: the map or the configuration cannot be built, or the folder has files of others.
    """
    request = _request(max_error, max_flash, storage)
    target = None if folder is None else path_of(folder, "a folder")
    if request is not None and target is not None:
        check_target(target)  # before a search, which takes long
    given = given_config(config)
    path = None if isinstance(map, Map) else path_of(map, "a map")
    title = f"generating the C of {path or place_of(cast(Map, map))}"
    with Work(progress).status(title):
        name = _name(map, path, target)
        options = BuildOptions(name=name, prefix=prefix, precision=precision, request=request)
        found = map_of(map)
        reference_map, data = found.reference_map, found.data
        if isinstance(given, Config):
            changed = Map(reference_map.with_config(choose_config(reference_map, given).config))
            reference_map, data, given = changed.reference_map, changed.data, None
        place = found.path or Path(f"{name}.npz")
        if not beyond_grip:
            require_grip(reference_map, place)
        chosen = choose_config(reference_map, given)
        prepared = prepare_map(reference_map, data, place, chosen, options, target)
    return NewBuild(prepared, request is not None, write)


def _name(map: MapLike, path: Path | None, target: Path | None) -> str:
    """Return the name of the build: that of the map's file, else of the folder, else of the case."""
    if path is not None:
        return path.stem
    assert isinstance(map, Map)
    return map.name if map.path is not None or target is None else target.name


def _request(max_error: str | None, max_flash: str | None, storage: Storage | None) -> Request | None:
    """Return the target for choosing breakpoints; None without one."""
    if max_error is None and max_flash is None:
        if storage is not None:
            remedy = "add `max_error=` or `max_flash=`, such as `max_error='0.05deg/s'`"
            raise CodegenError("applies only to chosen breakpoints", where="`storage=`", remedy=remedy)
        return None
    with within("`max_error=`"):
        error = None if max_error is None else YAW_RATE_KIND.read(max_error)
    with within("`max_flash=`"):
        flash = None if max_flash is None else MEMORY_KIND.read(max_flash)
    words = [f"--max-error {error.words}"] if error else []
    words += [f"--max-flash {flash.words}"] if flash else []
    words += [f"--storage {storage}"] if storage == "int16" else []
    return Request(
        max_error=error.value if error else None,
        max_flash=int(min(flash.value, 2.0**31)) if flash else None,
        storage=storage or "float",
        words=" ".join(words),
    )
