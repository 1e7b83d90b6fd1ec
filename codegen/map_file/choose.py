"""Selection of the configuration: the given file, else the map's own, else the paper's preset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from codegen import configuration
from codegen.configuration import Config, Controller
from codegen.map_file.map import ReferenceMap

PRESET_NOTE = "the map brings no configuration: the paper's car and the paper's PI, with a rate limit, are taken"


@dataclass(frozen=True)
class Chosen:
    """The chosen configuration, its source ("map", "preset" or a file name), and notes for the user."""

    config: Config
    source: str
    notes: tuple[str, ...] = ()


def choose_config(reference_map: ReferenceMap | None, config_path: Path | None) -> Chosen:
    """Return the configuration of the given file, else the map's own, else the paper's preset. Raises ConfigError."""
    own = reference_map.config if reference_map is not None else None
    if config_path is not None:
        config = configuration.load(config_path)
        notes = _borrowed(config)
        if own is not None and (own.vehicle, own.tyre, own.road) != (config.vehicle, config.tyre, config.road):
            notes += (f"{config_path.name} describes another car than the map was solved for; the map is taken as it is",)
        return Chosen(config, config_path.name, notes)
    if own is not None:
        return Chosen(own, "map")
    paper = configuration.preset()
    if reference_map is None:
        return Chosen(paper, "preset")
    # The paper's controller belongs to the paper's maps; another table gets the one with its rate limit on.
    return Chosen(paper.model_copy(update={"controller": Controller(kind="pi")}), "preset", (PRESET_NOTE,))


def _borrowed(config: Config) -> tuple[str, ...]:
    """Return a note if data of the car are missing and replaced by those of the paper's car."""
    missing = [f"vehicle.{key}" for key in type(config.vehicle).model_fields if key not in config.vehicle.model_fields_set]
    missing += [f"tyre.{axle}" for axle in type(config.tyre).model_fields if axle not in config.tyre.model_fields_set]
    return (f"not given, so the paper's car stands in: {', '.join(missing)}",) if missing else ()
