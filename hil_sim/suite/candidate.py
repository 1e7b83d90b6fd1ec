"""Candidate of the test set, its origin, and its baselines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from codegen import configuration
from codegen.configuration import Case, Config
from codegen.emit.laws import LAWS, is_untuned
from codegen.emit.manifest import read_build
from codegen.emit.text import Precision
from codegen.errors import BuildError, ConfigError, within
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.optimum.stack import solve_stack
from hil_sim.suite.subjects import (
    Build,
    Subject,
    around_folder,
    baseline_configs,
    of_config,
    recommended_config,
    tuned,
)

RECOMMENDED_CASE = "4ws-2"

Steps = Callable[[int, int], None]
"""Progress callback, called with (done, total)."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """Controller to test, before anything is solved or compiled.

    Attributes:
        title: description of its origin.
        config: configuration of the car and the controller.
        case: name of the map's case.
        frictions: frictions of the maps, rising; one without a stack.
        folder: folder of the build; None for a build in memory.
        precision: precision of the build.
    """

    title: str
    config: Config
    case: str
    frictions: tuple[float, ...]
    folder: Path | None = None
    precision: Precision = "single"

    @property
    def name(self) -> str:
        """Name in tables."""
        return self.config.controller.kind

    def contenders(self) -> dict[str, Config]:
        """Return name -> configuration of all controllers, this one first. Those with a reference model are not tuned yet."""
        own = self.config.controller.kind
        found = {self.name: self.config}
        best = recommended_config(self.config)
        if best.controller.kind != own:
            found[best.controller.kind] = best
        for name, config in baseline_configs(self.config).items():
            if not _same_controller(config, self.config):
                found[f"{name} (paper)" if name == own else name] = config
        return found

    def reference_map(self) -> ReferenceMap:
        """Solve the map as for its build. Raises ConfigError, MapError."""
        if len(self.frictions) > 1:
            return solve_stack(self.config, self.case, self.frictions)
        return solve_case(self.config, self.case)

    def comparison(self, steps: Steps | None = None, reference_map: ReferenceMap | None = None) -> Comparison:
        """Tune and prepare all controllers. Baselines that cannot be tuned for the car are omitted.

        Args:
            reference_map: map of the candidate, if available; None solves it.

        Raises:
            ConfigError, MapError: see `solve_case` and `tuned`.
        """
        reference_map = self.reference_map() if reference_map is None else reference_map
        configs, notes = self.contenders(), []
        for name, config in configs.items():
            if not LAWS[config.controller.kind].scheduled or (name == self.name and self.folder is not None):
                continue
            try:
                configs[name] = tuned(reference_map, config, steps)
            except ConfigError as error:
                if name == self.name:
                    raise
                notes.append(f"{name} is omitted from the comparison: {error}")
        left_out = {name for name, config in configs.items() if is_untuned(config)}
        subjects = [of_config(name, reference_map, configs[name], self.precision) for name in configs if name not in left_out]
        tested = subjects[0] if self.folder is None else replace(subjects[0], around=around_folder(self.folder))
        return Comparison(tested, tuple(subjects[1:]), self.config.case(self.case), tuple(notes))


@dataclass(frozen=True, eq=False)
class Comparison:
    """Controllers in the comparison: the tested one and its baselines, with the case of the map and notes for the user."""

    tested: Subject
    baselines: tuple[Subject, ...]
    case: Case
    notes: tuple[str, ...] = ()

    @property
    def build(self) -> Build:
        """Build under test."""
        return self.tested.around


def _same_controller(one: Config, other: Config) -> bool:
    return (one.controller, one.limiter) == (other.controller, other.limiter)


def recommended() -> Candidate:
    """Return the recommended preset."""
    config = configuration.preset("recommended")
    title = f"the recommended preset, case {RECOMMENDED_CASE}, solved, tuned and built in memory"
    return Candidate(title, config, RECOMMENDED_CASE, (config.road.friction,))


def of_folder(folder: Path) -> Candidate:
    """Return the candidate of a folder made by `codegen build`, for its own car.

    Raises:
        BuildError: not a build folder, or its map cannot be solved again from a configuration.
        ConfigError: its configuration is not one of this version.
    """
    manifest = read_build(folder)
    with within(folder):
        config = configuration.parse(manifest["configuration"], "manifest.json: configuration")
    case, solved_map = manifest["inputs"]["map"]["case"], manifest["map"]
    if case is None or not solved_map["solved"]:
        raise BuildError(
            "its map is a table of your own, which cannot be solved again for its test set and baselines",
            where=folder,
            remedy="build a map made by `codegen solve`",
        )
    config.case(case, f"{folder}: [cases]")
    frictions = tuple(sorted({config.road.friction, *solved_map["frictions"]}))
    return Candidate(str(folder), config, case, frictions, folder, manifest["options"]["precision"])
