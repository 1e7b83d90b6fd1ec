"""Which configuration counts: the file that the user names, else the map's own, else the paper's preset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from codegen import config as configuration
from codegen.config import Config
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
