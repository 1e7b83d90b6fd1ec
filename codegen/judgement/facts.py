"""All facts and warnings about one file or folder: a configuration, a map or a build."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from codegen import configuration
from codegen.configuration import Config
from codegen.emit.build import build_facts, check_inputs
from codegen.emit.folder import verify_hashes
from codegen.emit.laws import is_untuned
from codegen.emit.limiter_view import LimiterCut
from codegen.emit.manifest import read_build
from codegen.errors import CodegenError, within
from codegen.judgement.build_warnings import build_warnings, folder_notes, folder_warnings, margins_line, schedule_warnings
from codegen.judgement.car_warnings import Handling, car_warnings
from codegen.judgement.judge import judge, judge_build
from codegen.judgement.map_warnings import MapFacts, beyond_grip, cut_warning, map_warnings
from codegen.judgement.model import MISSING_RECORD, Judgement, Stored, of_manifest, of_map
from codegen.map_file import map as npz
from codegen.map_file.map import Chosen, ReferenceMap, choose_config, grip_notes, older_keys
from codegen.optimum.solve import solve_case, solve_stack
from codegen.sil.batch import load_batch

Kind = Literal["configuration", "map", "build"]
Manifest = Mapping[str, Any]

NO_CAR = "without a configuration there is no car to judge; name one with `config=`"
UNTUNED_NOTE = "the controller has no gains yet, so no margins; next: `codegen tune`"


@dataclass(frozen=True)
class Found:
    """Result of a check: lines for people, the same facts for JSON, notes, and the warnings."""

    kind: Kind
    lines: tuple[str, ...]
    facts: dict[str, Any]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    judgement: Judgement | None = None

    def with_judgement(self, stored: Stored) -> Found:
        """Return the result with a judgement of the car, or with the note that there is none."""
        facts = {**self.facts, "judgement": stored.to_dict()}
        if stored.judgement is None:
            return replace(self, facts=facts, notes=(*self.notes, stored.note))
        lines, warnings = stored.judgement.lines(), stored.judgement.warnings
        return replace(
            self, facts=facts, lines=(*self.lines, *lines), warnings=(*self.warnings, *warnings), judgement=stored.judgement
        )


Progress = Callable[[int, int], None]


def check_path(
    path: Path, config: Path | Config | None = None, *, drive: bool = False, progress: Progress | None = None
) -> Found:
    """Check a configuration, a map or a build. No file is changed.

    Args:
        path: an ars.toml, an .npz or a build folder.
        config: the ars.toml to check a map with, as `codegen build` takes it; by default the map's own configuration.
        drive: make the judgement of the car; by default the one in the map or build is used.
        progress: called with (done, in all) by each judgement.

    Raises:
        CodegenError: the path is none of the three, or cannot be read; or a configuration is given, and the path is not a map.
    """
    if config is not None and (path.is_dir() or path.suffix != ".npz"):
        raise CodegenError("only a map is checked with another configuration", where="`config=`", remedy="leave it out")
    if path.is_dir():
        return _check_build(path, drive, progress)
    if path.suffix == ".npz":
        reference_map = npz.load(path)
        return check_map(reference_map, choose_config(reference_map, config), path, drive, progress)
    return check_configuration(choose_config(None, path), path, drive, progress)


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


def _facts(config: Config, reference_map: ReferenceMap | None, manifest: Manifest | None) -> Found:
    """Return the facts and warnings that a map and its build share. Without the map, facts about it are left out."""
    handling = Handling.from_config(config)
    facts: dict[str, Any] = {"handling": handling.to_dict()}
    lines = [str(handling)]
    if manifest is not None:
        facts["margins"] = manifest["margins"]
        lines.append(margins_line(manifest["margins"]))
    if reference_map is not None and not beyond_grip(reference_map):
        found = MapFacts.of_map(reference_map, config)
        facts.update(found.to_dict())
        lines += found.lines()
    notes = (UNTUNED_NOTE,) if is_untuned(config) else ()
    return Found("map", tuple(lines), facts, notes, all_warnings(config, reference_map, manifest))


def _facts_of_map(config: Config, reference_map: ReferenceMap) -> Found:
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
    found = _facts(config, reference_map, manifest)
    return replace(found, warnings=(*found.warnings, *refused))


def _judged(found: Found, reference_map: ReferenceMap, config: Config, drive: bool, progress: Progress | None) -> Found:
    """Add the judgement of a map that can be built."""
    if beyond_grip(reference_map):
        return found
    if not drive:
        return found.with_judgement(of_map(reference_map, config))
    return found.with_judgement(Stored("current", judge(reference_map, config, progress=progress)))


def check_map(
    reference_map: ReferenceMap, chosen: Chosen, where: object, drive: bool = False, progress: Progress | None = None
) -> Found:
    """Check a map as `check_path`. `where`: the map in messages."""
    found = _facts_of_map(chosen.config, reference_map)
    found = replace(found, notes=tuple(dict.fromkeys((*chosen.notes, *_older(chosen.config, chosen.source), *found.notes))))
    if chosen.source == "preset" and not beyond_grip(reference_map):
        return replace(found, notes=(*found.notes, NO_CAR))
    with within(where):
        return _judged(found, reference_map, chosen.config, drive, progress)


def check_configuration(chosen: Chosen, where: object, drive: bool = False, progress: Progress | None = None) -> Found:
    """Check a configuration, and the maps of all its cases that steer the rear wheels. `where`: its place in messages."""
    config, steering = chosen.config, [name for name, case in chosen.config.cases.items() if case.rear_steering]
    common = _facts(config, None, None)
    facts: dict[str, Any] = {**common.facts, "cases": {}}
    lines: dict[str, list[str]] = {}
    warnings: dict[str, list[str]] = {}
    for name in steering:
        try:
            with within(where):
                reference_map = solve_case(config, name)
                found = _judged(_facts_of_map(config, reference_map), reference_map, config, drive, progress)
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
    older = (*chosen.notes, *_older(config, chosen.source), *common.notes)
    notes = tuple(dict.fromkeys((*older, *(() if drive else (MISSING_RECORD.note,)))))
    return Found(
        "configuration", of_cases(dict.fromkeys(common.lines, steering) | lines), facts, notes, of_cases(everywhere | warnings)
    )


def _check_build(path: Path, drive: bool, progress: Progress | None) -> Found:
    manifest = read_build(path)
    with within(path):
        config = configuration.parse(manifest["configuration"], path / "manifest.json")
    reference_map = _map_behind(manifest, config)
    found = _facts(config, reference_map, manifest)
    if drive:
        speed = np.array(manifest["map"]["speed_m_s"], dtype=np.float64)
        found = found.with_judgement(Stored("current", judge_build(load_batch(path), speed, reference_map, progress)))
    else:
        found = found.with_judgement(of_manifest(manifest, is_edited=bool(verify_hashes(path))))
    notes = [
        *_older(config, manifest["inputs"]["configuration"]["source"]),
        *grip_notes(config, [manifest["inputs"]["map"].get("case")]),
        *found.notes,
        *folder_notes(path),
    ]
    if reference_map is None and manifest["map"]["solved"]:
        inputs = manifest["inputs"]
        notes.append(
            "the facts about its map are not in the build; see "
            f"`codegen check {shlex.quote(inputs['map']['file'])} --config {shlex.quote(inputs['configuration']['source'])}`"
        )
    return replace(found, kind="build", notes=tuple(notes), warnings=(*found.warnings, *folder_warnings(path)))


def _older(config: Config, source: str) -> tuple[str, ...]:
    """Return the notes about older keys, unless the configuration is the paper's preset for a map without its own."""
    return () if source == "preset" else older_keys(config)


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
