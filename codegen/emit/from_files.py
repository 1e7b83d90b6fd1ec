"""From files to a rendered build: which configuration counts, what the build is called, what its inputs hash to."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.emit.text import Precision
from codegen.refmap import map as npz
from codegen.refmap.map import ReferenceMap

PRESET_NOTE = "the map brings no configuration: the paper's car and controller are taken"


@dataclass(frozen=True)
class Chosen:
    """The configuration that counts, where it came from ("map", "preset" or a file's name), and what the user should know."""

    config: Config
    source: str
    notes: tuple[str, ...] = ()


def choose_config(reference_map: ReferenceMap | None, config_path: Path | None) -> Chosen:
    """The file that the user names, else the map's own, else the paper's preset. Raises ConfigError."""
    own = reference_map.config if reference_map is not None else None
    if config_path is not None:
        config = configuration.load(config_path)
        notes: tuple[str, ...] = ()
        if own is not None and (own.vehicle, own.tyre, own.road) != (config.vehicle, config.tyre, config.road):
            notes = (f"{config_path.name} describes another car than the map was solved for; the map is taken as it is",)
        return Chosen(config, config_path.name, notes)
    if own is not None:
        return Chosen(own, "map")
    return Chosen(configuration.preset(), "preset", (PRESET_NOTE,) if reference_map is not None else ())


@dataclass(frozen=True)
class Prepared:
    """A rendered build and what it was made from."""

    folder: Folder
    target: Path
    reference_map: ReferenceMap
    chosen: Chosen


def prepare(
    map_path: Path,
    config_path: Path | None = None,
    target: Path | None = None,
    prefix: str = "ars",
    precision: Precision = "single",
) -> Prepared:
    """Read the map, choose the configuration and render the build; nothing is written.

    Args:
        target: output folder; by default generated/<stem of the map> in the current folder.

    Raises:
        MapError, ConfigError, BuildError: what cannot be read or built.
    """
    # The name is checked before the map is read: a bad one is the quicker thing to mend.
    options = BuildOptions(name=map_path.stem, prefix=prefix, precision=precision)
    reference_map = npz.load(map_path)
    chosen = choose_config(reference_map, config_path)
    inputs = BuildInputs(
        map_file=map_path.name,
        map_sha256=hashlib.sha256(map_path.read_bytes()).hexdigest(),
        config_source=chosen.source,
    )
    folder = build(reference_map, chosen.config, options, inputs)
    return Prepared(folder, target or Path("generated") / map_path.stem, reference_map, chosen)
