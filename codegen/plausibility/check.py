"""All facts and warnings about one file or folder: a configuration, a map or a build."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from codegen import configuration
from codegen.configuration import Config
from codegen.emit.build import build_facts, check_inputs
from codegen.emit.laws import is_untuned
from codegen.emit.limiter_view import LimiterCut
from codegen.emit.manifest import read_build
from codegen.errors import CodegenError, within
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap, choose_config, grip_notes
from codegen.optimum.solve import solve_case, solve_stack
from codegen.plausibility.build import build_warnings, folder_notes, folder_warnings, margins_line, schedule_warnings
from codegen.plausibility.car import Handling, car_warnings
from codegen.plausibility.map import MapFacts, beyond_grip, cut_warning, map_warnings

Kind = Literal["configuration", "map", "build"]
Manifest = Mapping[str, Any]

UNTUNED_NOTE = "the controller has no gains yet, so no margins; next: `codegen tune`"


@dataclass(frozen=True)
class Found:
    """Result of a check: lines for people, the same facts for JSON, notes, and the warnings."""

    kind: Kind
    lines: tuple[str, ...]
    facts: dict[str, Any]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]


def check_path(path: Path, config_path: Path | None = None) -> Found:
    """Check a configuration, a map or a build.

    Args:
        path: an ars.toml, an .npz or a build folder.
        config_path: the ars.toml to check a map with, as `codegen build` takes it; by default the map's own configuration.

    Raises:
        CodegenError: the path is none of the three, or cannot be read; or a configuration is given, and the path is not a map.
    """
    if config_path is not None and (path.is_dir() or path.suffix != ".npz"):
        raise CodegenError("only a map is checked with another configuration", where="--config", remedy="leave it out")
    if path.is_dir():
        return _check_build(path)
    return _check_map(path, config_path) if path.suffix == ".npz" else _check_configuration(path)


def all_warnings(config: Config, reference_map: ReferenceMap | None, manifest: Manifest | None) -> tuple[str, ...]:
    """Return the warnings about a car, its map and its build. Those about a map or a build that is None are left out."""
    found = [*car_warnings(config), *schedule_warnings(config)]
    if reference_map is not None:
        found += map_warnings(reference_map, config)
    elif manifest is not None and manifest["map"]["solved"]:
        found += filter(None, [cut_warning(manifest["limiter_cut"], config)])
    if manifest is not None:
        found += build_warnings(manifest)
    return tuple(found)


def _judge(config: Config, reference_map: ReferenceMap | None, manifest: Manifest | None) -> Found:
    """Return the facts and warnings that a map and its build share. Without the map, facts about it are left out."""
    handling = Handling.from_config(config)
    facts: dict[str, Any] = {"handling": handling.to_dict()}
    lines = [str(handling)]
    if manifest is not None:
        facts["margins"] = manifest["margins"]
        lines.append(margins_line(manifest["margins"]))
    if reference_map is not None and not beyond_grip(reference_map):
        of_map = MapFacts.of_map(reference_map, config)
        facts.update(of_map.to_dict())
        lines += of_map.lines()
    notes = (UNTUNED_NOTE,) if is_untuned(config) else ()
    return Found("map", tuple(lines), facts, notes, all_warnings(config, reference_map, manifest))


def _judge_map(config: Config, reference_map: ReferenceMap) -> Found:
    """Check a map and the build that it would give. An error that would stop `codegen build` becomes a warning."""
    manifest: Manifest | None = None
    refused: list[str] = []
    try:
        if is_untuned(config):
            check_inputs(reference_map, config)
        elif not beyond_grip(reference_map):
            manifest = build_facts(reference_map, config)
    except CodegenError as error:
        refused.append(str(error))
    found = _judge(config, reference_map, manifest)
    return replace(found, warnings=(*found.warnings, *refused))


def _check_map(path: Path, config_path: Path | None) -> Found:
    reference_map = npz.load(path)
    chosen = choose_config(reference_map, config_path)
    found = _judge_map(chosen.config, reference_map)
    return replace(found, notes=(*chosen.notes, *found.notes))


def _check_configuration(path: Path) -> Found:
    """Check a configuration, and the maps of all its cases that steer the rear wheels."""
    chosen = choose_config(None, path)
    config, steering = chosen.config, [name for name, case in chosen.config.cases.items() if case.rear_steering]
    common = _judge(config, None, None)
    facts: dict[str, Any] = {**common.facts, "cases": {}}
    lines: dict[str, list[str]] = {}
    warnings: dict[str, list[str]] = {}
    for name in steering:
        try:
            with within(path):
                found = _judge_map(config, solve_case(config, name))
        except CodegenError as error:
            warnings.setdefault(f"no map: {error}", []).append(name)
            continue
        facts["cases"][name] = {key: value for key, value in found.facts.items() if key not in common.facts}
        for text in found.lines:
            lines.setdefault(text, []).append(name)
        for text in found.warnings:
            warnings.setdefault(text, []).append(name)

    def of_cases(found: dict[str, list[str]]) -> tuple[str, ...]:
        return tuple(text if names == steering else f"case {', '.join(names)}: {text}" for text, names in found.items())

    everywhere = dict.fromkeys(common.warnings, steering)
    notes = (*chosen.notes, *common.notes)
    return Found(
        "configuration", of_cases(dict.fromkeys(common.lines, steering) | lines), facts, notes, of_cases(everywhere | warnings)
    )


def _check_build(path: Path) -> Found:
    manifest = read_build(path)
    with within(path):
        config = configuration.parse(manifest["configuration"], path / "manifest.json")
    reference_map = _map_behind(manifest, config)
    found = _judge(config, reference_map, manifest)
    notes = [*grip_notes(config, [manifest["inputs"]["map"].get("case")]), *found.notes, *folder_notes(path)]
    if reference_map is None and manifest["map"]["solved"]:
        inputs = manifest["inputs"]
        notes.append(
            "the facts about its map are not in the build; see "
            f"`codegen check {inputs['map']['file']} --config {inputs['configuration']['source']}`"
        )
    return replace(found, kind="build", notes=tuple(notes), warnings=(*found.warnings, *folder_warnings(path)))


def _map_behind(manifest: Manifest, config: Config) -> ReferenceMap | None:
    """Solve the map of a build again; None if the result differs or the build has a configuration other than the map's."""
    inputs, case = manifest["inputs"], manifest["inputs"]["map"].get("case")
    if not manifest["map"]["solved"] or inputs["configuration"]["source"] != "map" or case is None:
        return None
    frictions = manifest["map"]["frictions"]
    try:
        found = solve_case(config, case) if len(frictions) == 1 else solve_stack(config, case, frictions)
    except CodegenError:
        return None
    return found if LimiterCut.of_map(found, config).to_dict() == manifest["limiter_cut"] else None
