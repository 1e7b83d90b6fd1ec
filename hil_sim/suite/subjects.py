"""What is under test: a controller in compiled C around any plant, or the passive car."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from codegen import config as configuration
from codegen.config import Config, Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.text import Precision
from codegen.refmap import map as npz
from codegen.refmap.map import ReferenceMap
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import Software, compile_build, load

AroundPlant = Callable[[Config], Software]
"""From the configuration of a plant to the controller under test, compiled together with that plant."""

DELAY_SAMPLES = 1
"""Of computation in all runs: an ECU sends its command one period after it has sampled."""

PASSIVE = "passive"


@dataclass(frozen=True, eq=False)
class Subject:
    """One controller under test, or the passive car.

    Attributes:
        name: for tables; unique in a suite.
        config: of the car for which the controller was built; plants are variations of it.
        around: the compiled controller for the configuration of a plant.
        controlled: False for the passive car: the rear wheels stay straight.
        parameters: fields of the C parameter struct that differ from the build's, SI units.
    """

    name: str
    config: Config
    around: AroundPlant
    controlled: bool = True
    parameters: Mapping[str, float] = field(default_factory=dict)

    def loop(self, software: Software, delay_samples: int = DELAY_SAMPLES) -> ClosedLoop:
        """A closed loop of its own, at rest. Raises ValueError for a parameter that does not exist."""
        parameters = software.parameters(**self.parameters) if self.parameters else None
        return ClosedLoop(software, LoopOptions(self.controlled, delay_samples, parameters=parameters))


def around(reference_map: ReferenceMap, config: Config, precision: Precision = "single") -> AroundPlant:
    """The build of a map and a configuration, in memory; rendered once, compiled once for each plant.

    Raises (when called): BuildError, MapError, ConfigError as `codegen build` would.
    """
    rendered: list[tuple[Mapping[str, bytes], Mapping[str, object]]] = []
    compiled: dict[str, Software] = {}

    def software(plant: Config) -> Software:
        if not rendered:
            digest = hashlib.sha256(npz.to_bytes(reference_map)).hexdigest()
            folder = build(
                reference_map, config, BuildOptions("suite", precision=precision), BuildInputs("suite.npz", digest, "map")
            )
            rendered.append((folder.files, folder.manifest))
        key = plant.to_json()
        if key not in compiled:
            compiled[key] = compile_build(*rendered[0], plant)
        return compiled[key]

    return software


def around_folder(folder: Path) -> AroundPlant:
    """The build of a folder, compiled once for each plant. Raises (when called) BuildError."""
    compiled: dict[str, Software] = {}

    def software(plant: Config) -> Software:
        key = plant.to_json()
        if key not in compiled:
            compiled[key] = load(folder, plant)
        return compiled[key]

    return software


def of_kind(reference_map: ReferenceMap, config: Config, kind: Kind, name: str | None = None) -> Subject:
    """A kind of controller on a map; everything else of it as configured."""
    chosen = config.model_copy(update={"controller": config.controller.model_copy(update={"kind": kind})})
    return Subject(name or kind, chosen, around(reference_map, chosen))


def paper_pi(reference_map: ReferenceMap, config: Config, name: str = "pi") -> Subject:
    """The paper's controller on a map: its gains, neither rate limit nor limiter, whatever the configuration says of them."""
    paper = configuration.preset()
    chosen = config.model_copy(update={"controller": paper.controller, "limiter": paper.limiter})
    return Subject(name, chosen, around(reference_map, chosen))


def baselines(reference_map: ReferenceMap, config: Config) -> tuple[Subject, ...]:
    """What a controller is shown beside, on the same map: the paper's PI, feedforward alone, and the older proportional law.

    Give `run_suite` those that are not the one under test; it adds the passive car.
    """
    return (
        paper_pi(reference_map, config),
        of_kind(reference_map, config, "feedforward"),
        of_kind(reference_map, config, "proportional"),
    )


def passive_of(subject: Subject) -> Subject:
    """The passive car, in the library of another subject, so that nothing more is compiled."""
    return Subject(PASSIVE, subject.config, subject.around, controlled=False)
