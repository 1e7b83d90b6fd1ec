"""All facts and warnings about one file or folder: a configuration, a map or a build."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from codegen import configuration
from codegen.emit.manifest import read_build
from codegen.errors import CodegenError, within
from codegen.map_file import map as npz
from codegen.map_file.choose import choose_config
from codegen.optimum.solve import solve_case
from codegen.plausibility.build import build_warnings, folder_warnings, schedule_warnings
from codegen.plausibility.car import Handling, car_warnings
from codegen.plausibility.map import MapFacts, map_warnings

Kind = Literal["configuration", "map", "build"]


@dataclass(frozen=True)
class Found:
    """Result of a check: lines for people, the same facts for JSON, and the warnings."""

    kind: Kind
    lines: tuple[str, ...]
    facts: dict[str, Any]
    warnings: tuple[str, ...]


def check_path(path: Path) -> Found:
    """Check what lies at a path. Raises CodegenError: it is none of the three, or cannot be read."""
    if path.is_dir():
        return _check_build(path)
    return _check_map(path) if path.suffix == ".npz" else _check_configuration(path)


def _check_configuration(path: Path) -> Found:
    """Check a configuration, and the maps of all its cases that steer the rear wheels."""
    config = configuration.load(path)
    handling = Handling.from_config(config)
    lines, warnings = [str(handling)], [*car_warnings(config), *schedule_warnings(config)]
    facts: dict[str, Any] = {"handling": handling.to_dict(), "cases": {}}
    for name in (name for name, case in config.cases.items() if case.rear_steering):
        try:
            with within(path):
                reference_map = solve_case(config, name)
        except CodegenError as error:
            warnings.append(f"case {name} has no map: {error}")
            continue
        of_map = MapFacts.of_map(reference_map, config)
        facts["cases"][name] = of_map.to_dict()
        lines += [f"case {name}: {line}" for line in of_map.lines()]
        warnings += [f"case {name}: {text}" for text in map_warnings(reference_map, config)]
    return Found("configuration", tuple(lines), facts, tuple(warnings))


def _check_map(path: Path) -> Found:
    reference_map = npz.load(path)
    chosen = choose_config(reference_map, None)
    config = chosen.config
    if reference_map.config is None:
        return Found("map", chosen.notes, {}, tuple(map_warnings(reference_map, config)))
    facts = MapFacts.of_map(reference_map, config)
    handling = Handling.from_config(config)
    warnings = (*car_warnings(config), *schedule_warnings(config), *map_warnings(reference_map, config))
    return Found("map", (str(handling), *facts.lines()), {"handling": handling.to_dict(), **facts.to_dict()}, warnings)


def _check_build(path: Path) -> Found:
    manifest = read_build(path)
    with within(path):
        config = configuration.parse(manifest["configuration"], path / "manifest.json")
    handling, margins = Handling.from_config(config), manifest["margins"]
    lines = [str(handling)]
    if margins is not None:
        lines.append(
            f"margins of the configured car: at least {margins['gain_margin_db']:g} dB and {margins['phase_margin_deg']:g} deg"
        )
    warnings = (*car_warnings(config), *schedule_warnings(config), *build_warnings(manifest), *folder_warnings(path))
    return Found("build", tuple(lines), {"handling": handling.to_dict(), "margins": margins}, warnings)
