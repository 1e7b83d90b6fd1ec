"""Campaigns with a measured car: its cars come from `[identified]`, and its controller from its own map.

The map of the controller takes about half a minute to solve and tune, so it is kept in the cache under the SHA-256 of all that
determines it.
"""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from codegen import cache, configuration
from codegen.configuration import Config, Identified
from codegen.design.family import measured_keys
from codegen.design.tune import tune
from codegen.emit.build import BuildInputs, BuildOptions, build_code
from codegen.errors import BuildError, ConfigError, within
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.sweep.lanes import DELAY_KEY
from codegen.sweep.spec import FACTORS, Spec
from codegen.sweep.versions import sources_digest
from codegen.vehicle.plant_car import plant_parameters
from codegen.vehicle.population import Population, changed_car, require_accepted, require_identified

SPEC: dict[str, Any] = {"samples": 1000, "seed": 1, "scenarios": ["step-steer", "sine-with-dwell"]}
"""Campaign without a `sweep.toml`."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class MeasuredCar:
    """The file that `codegen identify` wrote.

    Attributes:
        name: file name, for messages.
        config: its content.
        population: the cars that differ in the identified keys that can vary in a campaign.
        held: identified keys that cannot; they keep their values.
    """

    name: str
    config: Config
    population: Population
    held: tuple[str, ...]

    @property
    def digest(self) -> str:
        """SHA-256 of the content, in hexadecimal digits; independent of comments and key order."""
        return hashlib.sha256(self.config.to_json().encode()).hexdigest()

    def check_spec(self, spec: Spec, where: object) -> None:
        """Raise ConfigError if a spec varies what already varies as measured, or is a factorial design."""
        if spec.design == "factorial":
            raise ConfigError(
                "in a factorial design each combination would have another car",
                where=f"{where}: design",
                remedy='use "monte-carlo", or leave out `measured=`',
            )
        for factor in spec.factors:
            for key in FACTORS[factor].keys:
                if key in self.population.keys:
                    raise ConfigError(
                        f"{key} already varies as in {self.name}",
                        where=f"{where}: factors.{factor}",
                        remedy="remove the factor",
                    )


def load(path: Path) -> MeasuredCar:
    """Read the car of a file that `codegen identify` wrote. Raises ConfigError."""
    config = configuration.load(path)
    with within(path):
        require_identified(config)
        require_accepted(config)
        varied = [key for key in config.identified.keys if _can_vary(config, key)]
        if not varied:
            raise ConfigError(
                "no identified key can vary in a campaign", where="identified.keys", remedy="take the file of codegen identify"
            )
        population = Population.of(config, varied)
        population.possible_car(np.random.default_rng(0))  # report hardly possible cars before anything is written
    held = tuple(key for key in config.identified.keys if key not in varied)
    return MeasuredCar(path.name, config, population, held)


def _can_vary(config: Config, key: str) -> bool:
    """Return whether the runs of a batch can differ in a key: whether it changes the plant's car.

    The friction and gravity of `[road]` do not vary: the tyres of all cars are described for them, and the scenario sets the
    friction that is driven.
    """
    if key == DELAY_KEY:  # rounded, so that a small change is none
        return True
    if key.startswith("road."):
        return False
    changed = changed_car(config, key)
    return changed is not None and not np.array_equal(plant_parameters(changed), plant_parameters(config))


def solve_map(car: MeasuredCar, progress: Progress | None = None) -> ReferenceMap:
    """Return the car's own map with its controller; kind "tracking" is tuned for it, any other kind is as configured.

    Args:
        progress: called with (done, in all) if the map is not in the cache.

    Raises:
        ConfigError, MapError: the car has no case with rear steering, no map, or no gains for its family.
    """
    config, case = car.config, car.config.rear_steer_case
    if case is None:
        raise ConfigError("no case has rear steering", where=f"{car.name}: [cases]", remedy="add one with rear_steering = true")
    key = hashlib.sha256("\n".join((car.digest, case, sources_digest())).encode()).hexdigest()
    folder, name = cache.cache_folder(), f"map-{key}"
    kept = cache.find(folder, name, ".npz")
    if kept is not None:
        return npz.from_bytes(kept.content, kept.path)
    with within(car.name):
        reference_map = solve_case(config, case)
        if config.controller.kind == "tracking":
            assert reference_map.config is not None  # a solved map has one
            reference_map = reference_map.with_config(_tuned(reference_map, reference_map.config, progress, car.name))
    with contextlib.suppress(BuildError):  # for instance a full disk: then it is solved again next time
        cache.keep(folder, name, npz.to_bytes(reference_map), ".npz")
    return reference_map


def _tuned(reference_map: ReferenceMap, config: Config, progress: Progress | None, where: str) -> Config:
    """Return the configuration with the controller tuned for the measured family, or that of `[tuning]` if it is too wide.

    The second one has no uncertainty in `[identified]`; the grip that the drives reached stays.
    """
    try:
        return tune(reference_map, config, progress, where).config
    except ConfigError:
        if not measured_keys(config):
            raise
    known = config.identified
    exact = Identified(front_grip_reached=known.front_grip_reached, rear_grip_reached=known.rear_grip_reached)
    return tune(reference_map, config.model_copy(update={"identified": exact}), progress, where).config


def code_of(reference_map: ReferenceMap) -> tuple[dict[str, bytes], dict[str, Any]]:
    """Return files and manifest of the build of a map. Raises BuildError, MapError."""
    assert reference_map.config is not None  # it was solved, see `solve_map`
    digest = hashlib.sha256(npz.to_bytes(reference_map)).hexdigest()
    name = str(reference_map.case)
    folder = build_code(reference_map, reference_map.config, BuildOptions(name), BuildInputs(f"{name}.npz", digest, "map"))
    files = {path: content for path, content in folder.files.items() if path.startswith(("include/", "src/"))}
    return files, dict(folder.manifest)
