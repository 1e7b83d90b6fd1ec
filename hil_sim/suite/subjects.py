"""Systems under test: a controller in compiled C around any plant, or the passive car; the candidate and its baselines."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from codegen import configuration
from codegen.configuration import Case, Config
from codegen.design.tune import tune
from codegen.emit.build import BuildInputs, BuildOptions, build_code
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.laws import LAWS, is_untuned
from codegen.emit.manifest import read_build
from codegen.emit.text import Precision
from codegen.errors import BuildError, ConfigError, within
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case, solve_stack
from codegen.sil.batch import BatchSoftware, compile_batch
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import Software, compile_build, require_can_side
from codegen.vehicle.plant_car import optional_parts

PASSIVE = "passive"

PAPERS = ("kind", "proportional_gain_s", "integral_gain", "rear_rate_max_deg_s", "rear_angle_error_max_deg")
"""Keys that define the paper's controller; sampling time, input ranges and fail-safe are the user's."""


@dataclass(frozen=True)
class Generated:
    """A build's C.

    Attributes:
        files: content by path. manifest: facts.
        edited: paths of files that are no longer as generated.
    """

    files: Mapping[str, bytes]
    manifest: Mapping[str, Any]
    edited: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Build:
    """Generated C, fetched when first needed, and compiled once for each plant."""

    fetch: Callable[[], Generated]
    _compiled: dict[str, Software] = field(default_factory=dict)
    _batches: dict[frozenset[str], BatchSoftware] = field(default_factory=dict)

    @functools.cached_property
    def generated(self) -> Generated:
        """Return the compiled controller. Raises the errors of `fetch`."""
        return self.fetch()

    def __call__(self, plant: Config) -> Software:
        """Return the controller compiled with a plant. Raises BuildError and the errors of `fetch`."""
        key = plant.to_json()
        if key not in self._compiled:
            found = self.generated
            self._compiled[key] = compile_build(found.files, found.manifest, plant, edited=found.edited)
        return self._compiled[key]

    def batch(self, plant: Config) -> BatchSoftware:
        """Compile for many cars at once, with the optional parts of a plant. Raises as the call does."""
        key = optional_parts(plant)
        if key not in self._batches:
            found = self.generated
            self._batches[key] = compile_batch(found.files, found.manifest, plant, edited=found.edited)
        return self._batches[key]


@dataclass(frozen=True, eq=False)
class Subject:
    """One controller under test, or the passive car.

    Attributes:
        name: for tables; unique in a suite.
        config: of the car for which the controller was built; plants are variations of it.
        around: the controller, to be compiled together with a plant.
        controlled: False for the passive car: the rear wheels stay straight.
        parameters: fields of the C parameter struct that differ from the build's, SI units.
    """

    name: str
    config: Config
    around: Build
    controlled: bool = True
    parameters: Mapping[str, float] = field(default_factory=dict)

    def loop(self, software: Software, delay_samples: int | None = None) -> ClosedLoop:
        """Return a closed loop at rest, by default with the delay of the software's car. Raises ValueError for an unknown
        parameter."""
        parameters = software.parameters(**self.parameters) if self.parameters else None
        delay = software.config.driven_delay_samples if delay_samples is None else delay_samples
        return ClosedLoop(software, LoopOptions(self.controlled, delay, parameters=parameters))


def around(reference_map: ReferenceMap, config: Config, precision: Precision = "single") -> Build:
    """Build a map with a configuration in memory.

    Raises (when first needed): BuildError, MapError, ConfigError as `codegen build` would.
    """

    def render() -> Generated:
        digest = hashlib.sha256(npz.to_bytes(reference_map)).hexdigest()
        inputs = BuildInputs("suite.npz", digest, "map")
        folder = build_code(reference_map, config, BuildOptions("suite", precision=precision), inputs)
        return Generated(folder.files, folder.manifest)

    return Build(render)


def around_folder(folder: Path) -> Build:
    """Return the build of a folder; its files are read when first needed. Raises BuildError then."""

    def read() -> Generated:
        manifest = read_build(folder)
        require_can_side(manifest, folder)
        return Generated(read_files(folder, manifest, ("include/", "src/")), manifest, tuple(verify_hashes(folder)))

    return Build(read)


def baseline_configs(config: Config) -> dict[str, Config]:
    """Return name -> configuration of the baselines: the paper's PI, feedforward, the older proportional law.

    The paper's PI always has its own gains, and neither rate limit nor limiter. The others are as configured except for their
    kind.
    """
    paper = configuration.preset()
    papers = {name: getattr(paper.controller, name) for name in PAPERS}
    return {
        "pi": _with_controller(config, **papers).unchecked({"limiter": paper.limiter}),
        "feedforward": _with_controller(config, kind="feedforward"),
        "proportional": _with_controller(config, kind="proportional"),
    }


def recommended_config(config: Config) -> Config:
    """Return the recommended controller, not yet tuned, for the car and the family of a configuration."""
    best = configuration.preset("recommended")
    changed = _with_controller(config, kind="tracking", rear_rate_max_deg_s=best.controller.rear_rate_max_deg_s)
    return changed.unchecked({"limiter": best.limiter})


def tuned(reference_map: ReferenceMap, config: Config, progress: Callable[[int, int], None] | None = None) -> Config:
    """Return the configuration tuned as by `codegen tune` on a map. Raises ConfigError if there are no suitable gains."""
    return tune(reference_map, config, progress).config


def _with_controller(config: Config, **changes: Any) -> Config:
    return config.unchecked({f"controller.{key}": value for key, value in changes.items()})


def of_config(name: str, reference_map: ReferenceMap, config: Config, precision: Precision = "single") -> Subject:
    """Return the controller of a configuration on a map."""
    return Subject(name, config, around(reference_map, config, precision))


def baselines(reference_map: ReferenceMap, config: Config, precision: Precision = "single") -> tuple[Subject, ...]:
    """Return the subjects of `baseline_configs` on a map.

    Pass those that are not under test to `run_suite`, which adds the passive car.
    """
    return tuple(of_config(name, reference_map, each, precision) for name, each in baseline_configs(config).items())


def passive_of(subject: Subject) -> Subject:
    """Return the passive car, in the library of another subject to save a compilation."""
    return Subject(PASSIVE, subject.config, subject.around, controlled=False)


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
            if (config.controller, config.limiter) != (self.config.controller, self.config.limiter):
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
