"""Systems under test: a controller in compiled C around any plant, or the passive car."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from codegen import configuration
from codegen.configuration import Config
from codegen.emit.build import BuildInputs, BuildOptions, build_code
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.emit.text import Precision
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.sil.batch import BatchSoftware, compile_batch
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import Software, compile_build, require_can_side
from codegen.tuning.tune import tune

DELAY_SAMPLES = 1
"""Computing delay in all runs: an ECU sends its command one period after sampling."""

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
    _batches: dict[bool, BatchSoftware] = field(default_factory=dict)

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
        """Compile for many cars at once, with a relaxation length or without, like a plant. Raises as the call does."""
        key = plant.plant.relaxation_length_m > 0.0
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

    def loop(self, software: Software, delay_samples: int = DELAY_SAMPLES) -> ClosedLoop:
        """Return a closed loop at rest. Raises ValueError for an unknown parameter."""
        parameters = software.parameters(**self.parameters) if self.parameters else None
        return ClosedLoop(software, LoopOptions(self.controlled, delay_samples, parameters=parameters))


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
        "pi": _with_controller(config, **papers).model_copy(update={"limiter": paper.limiter}),
        "feedforward": _with_controller(config, kind="feedforward"),
        "proportional": _with_controller(config, kind="proportional"),
    }


def recommended_config(config: Config) -> Config:
    """Return the recommended controller, not yet tuned, for the car and the family of a configuration."""
    best = configuration.preset("recommended")
    changed = _with_controller(config, kind="tracking", rear_rate_max_deg_s=best.controller.rear_rate_max_deg_s)
    return changed.model_copy(update={"limiter": best.limiter})


def tuned(reference_map: ReferenceMap, config: Config, progress: Callable[[int, int], None] | None = None) -> Config:
    """Return the configuration tuned as by `codegen tune` on a map. Raises ConfigError if there are no suitable gains."""
    return tune(reference_map, config, progress).config


def _with_controller(config: Config, **changes: Any) -> Config:
    return config.model_copy(update={"controller": config.controller.model_copy(update=changes)})


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
