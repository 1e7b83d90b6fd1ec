"""The plan of a campaign: numbering of its runs, and all data that a worker needs to simulate them.

Run numbers start at 0. The controller changes fastest, then the scenario, then the sample. The number of samples in a chunk
does not depend on the engine, so neither do the results.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from codegen import configuration
from codegen.configuration import Config
from codegen.emit.folder import read_files, verify_hashes
from codegen.emit.manifest import read_build
from codegen.errors import CodegenError, ConfigError, suggestion, within
from codegen.map_file.map import ReferenceMap
from codegen.metrics import METRIC_TABLES
from codegen.sil.batch import Isa, best_isa
from codegen.sweep import measured
from codegen.sweep import spec as specification
from codegen.sweep.lanes import Profile, cars, profile_of
from codegen.sweep.measured import MeasuredCar
from codegen.sweep.spec import PASSIVE, Spec
from codegen.units import KM_H
from hil_sim.scenario_files import find
from hil_sim.scenarios import SCENARIOS, Scenario

RUNS_PER_CHUNK_MAX = 512
"""Approximate runs in a chunk: enough to hide the interpreter's overhead, few enough to repeat after an interruption."""
CHUNK_BYTES_MAX = 128 * 2**20
"""Memory limit for recording, noise and intermediate arrays of a chunk. Long scenarios get fewer samples in a chunk."""
NUMBERS_PER_SAMPLE = 26
"""Numbers held for each control sample of a run: nine columns, the noise as drawn and as added, intermediate results."""

LENGTH_MIN = {"step": 2.0, "sine-with-dwell": 3.8}
"""Minimum length after the start of steering, in s, by kind: 1 s rise and 1 s steady; sine with dwell plus 1.75 s."""


@dataclass(frozen=True, eq=False)
class Controller:
    """One controller of a campaign.

    Attributes:
        name: name in the spec.
        files: path -> content of `include/` and `src/` of its build; the passive car uses another controller's build.
        manifest: manifest of that build.
        digest: SHA-256 of its configuration and files.
        controlled: False for the passive car.
        folder: build folder, for messages.
        edited: files of the build that were changed after generation.
        own_map: the map of a controller that was made for a measured car.
    """

    name: str
    files: Mapping[str, bytes]
    manifest: Mapping[str, Any]
    digest: str
    controlled: bool = True
    folder: str = ""
    edited: tuple[str, ...] = ()
    own_map: ReferenceMap | None = None


@dataclass(frozen=True)
class RunKey:
    """Sample number, scenario index and controller index of a run."""

    sample: int
    scenario: int
    controller: int


@dataclass(frozen=True, eq=False)
class Plan:
    """A campaign without its results. It can be sent to another machine.

    Attributes:
        spec: the specification of the campaign.
        config: configuration that defines car and bench: that of the first controller's build, or of the measured car.
        controllers, profiles: in the order of the spec.
        isa: vector instructions of the batch.
        measured: the car whose uncertainty gives the car of each sample; None if all samples are the configured car with
            factors. It then replaces the car of `config`.
        notes: remarks for the user.
    """

    spec: Spec
    config: Config
    controllers: tuple[Controller, ...]
    profiles: tuple[Profile, ...]
    isa: Isa
    measured: MeasuredCar | None = None
    notes: tuple[str, ...] = ()

    @property
    def samples_per_chunk(self) -> int:
        """Samples in every chunk but the last. Spec, profiles and sampling times determine it, not the engine."""
        steps = round(self.config.controller.sampling_time_s / self.config.plant.sampling_time_s)
        longest: int = max(profile.inputs.shape[0] // steps for profile in self.profiles)
        held: int = CHUNK_BYTES_MAX // (8 * NUMBERS_PER_SAMPLE * longest)
        return max(1, min(RUNS_PER_CHUNK_MAX // (len(self.profiles) * len(self.controllers)), held))

    @property
    def chunk_count(self) -> int:
        """Total number of chunks."""
        return -(-self.spec.sample_count // self.samples_per_chunk)

    def samples_of(self, chunk: int) -> range:
        """Return the sample numbers of a chunk."""
        first = chunk * self.samples_per_chunk
        return range(first, min(first + self.samples_per_chunk, self.spec.sample_count))

    def runs_of(self, chunk: int) -> range:
        """Return the run numbers of a chunk."""
        samples, each = self.samples_of(chunk), len(self.profiles) * len(self.controllers)
        return range(samples.start * each, samples.stop * each)

    def key(self, run: int) -> RunKey:
        """Return the key of a run number. Raises CodegenError if there is no such run."""
        if not 0 <= run < self.spec.run_count:
            raise CodegenError(f"there is no run {run}", where="`run=`", remedy=f"0 to {self.spec.run_count - 1}")
        rest, controller = divmod(run, len(self.controllers))
        sample, scenario = divmod(rest, len(self.profiles))
        return RunKey(sample, scenario, controller)

    def facts(self) -> dict[str, Any]:
        """Return all inputs of the results, for JSON. Builds and scenarios are identified by digest, not by path."""
        return {
            "spec": self.spec.model_dump(mode="json", exclude_none=True, exclude={"controllers", "scenarios"}),
            **({} if self.measured is None else {"measured_car": self.measured.digest}),
            "controllers": {controller.name: controller.digest for controller in self.controllers},
            "scenarios": {profile.name: profile.digest for profile in self.profiles},
            "isa": self.isa,
            "runs": self.spec.run_count,
            "chunks": self.chunk_count,
        }


def read(
    path: Path | None,
    isa: Isa | None = None,
    measured_path: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Plan:
    """Read the plan of a `sweep.toml`; build paths are relative to its folder.

    Args:
        path: `sweep.toml`; None: the default campaign of a measured car.
        isa: vector instructions; None: the best of this machine.
        measured_path: file that `codegen identify` wrote, whose uncertainty gives the cars. Without controllers in the spec,
            its own one is made, beside the passive car.
        progress: called with (done, in all) while that controller is made.

    Raises:
        CodegenError: the spec, a build, a scenario or the measured car cannot be used.
    """
    car = None if measured_path is None else measured.load(measured_path)
    tables = dict(measured.SPEC) if path is None else specification.read_tables(path)
    place = path or measured_path
    assert place is not None  # the command requires one of them
    own: dict[str, Controller] = {}
    if car is not None and "controllers" not in tables:
        own = {car.config.controller.kind: _own(car, progress)}
        tables["controllers"] = {name: controller.folder for name, controller in own.items()} | {PASSIVE: ""}
    spec = specification.parse(tables, place)
    builds = own or _builds(spec, place)
    first = next(iter(builds.values()))
    config, notes = configuration.parse(first.manifest["configuration"], f"{first.name}: manifest.json: configuration"), []
    if car is not None:
        car.check_spec(spec, place)
        config = car.config
        notes = [f"{key} cannot vary within a campaign; it keeps its value" for key in car.held]
        notes += [_TOO_WIDE for controller in own.values() if not controller.manifest["configuration"].get("identified")]
    for controller in builds.values():
        notes += _check_car(config, controller, place, car)
    controllers = tuple(
        builds.get(name) or Controller(name, first.files, first.manifest, first.digest, controlled=False)
        for name in spec.controllers
    )
    profiles = tuple(_profile(spec, name, config, place) for name in spec.scenarios)
    names = [profile.name for profile in profiles]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ConfigError(
            f"two of them are called {twice!r}", where=f"{place}: scenarios", remedy="give one another name in its file"
        )
    if "cg_shift_m" in spec.factors:
        with within(place):
            cars(config, {"cg_shift_m": np.array(spec.factors["cg_shift_m"].extremes)}, 2)  # rejects shifts beyond an axle
    return Plan(spec, config, controllers, profiles, best_isa() if isa is None else isa, car, tuple(notes))


_TOO_WIDE = (
    "no gains keep their margins for the family of [identified]; the controller is tuned for that of [tuning]. Drive with more "
    "excitation"
)


def _own(car: MeasuredCar, progress: Callable[[int, int], None] | None) -> Controller:
    """Return the controller of the measured car's own map."""
    reference_map = measured.solve_map(car, progress)
    files, manifest = measured.code_of(reference_map)
    name = f"the map of {car.name}, case {reference_map.case}"
    return Controller(car.config.controller.kind, files, manifest, _digest(manifest, files), folder=name, own_map=reference_map)


def _builds(spec: Spec, path: Path) -> dict[str, Controller]:
    builds = {}
    for name, folder in spec.controllers.items():
        if folder:
            with within(f"{path}: controllers.{name}"):
                builds[name] = _build(name, path, folder)
    return builds


def _build(name: str, path: Path, folder: str) -> Controller:
    place = path.parent / folder
    manifest = read_build(place)
    files = read_files(place, manifest, ("include/", "src/"))
    return Controller(name, files, manifest, _digest(manifest, files), folder=str(place), edited=tuple(verify_hashes(place)))


def _digest(manifest: Mapping[str, Any], files: Mapping[str, bytes]) -> str:
    digest = hashlib.sha256(json.dumps(manifest["configuration"], sort_keys=True).encode())
    for file in sorted(files):
        digest.update(file.encode() + b"\0" + files[file] + b"\0")
    return digest.hexdigest()


def _check_car(config: Config, controller: Controller, path: Path, car: MeasuredCar | None) -> list[str]:
    """Check that a build suits the campaign's car. Return notes: with a measured car, the build may be another car's."""
    own = configuration.parse(controller.manifest["configuration"], f"{controller.name}: manifest.json: configuration")
    reference = "the first controller" if car is None else car.name
    if own.controller.sampling_time_s != config.controller.sampling_time_s:
        raise ConfigError(
            f"its build has another controller.sampling_time_s than that of {reference}",
            where=f"{path}: controllers.{controller.name}",
            remedy="build both with one sampling time",
        )
    for table in ("vehicle", "tyre", "road", "steering"):
        if getattr(own, table) == getattr(config, table):
            continue
        if car is not None:
            return [f"controllers.{controller.name} is built for another [{table}] than that of {car.name}"]
        raise ConfigError(
            f"its build has another [{table}] than that of the first controller",
            where=f"{path}: controllers.{controller.name}",
            remedy="build both for one car, or use two campaigns",
        )
    return []


def _profile(spec: Spec, name: str, config: Config, path: Path) -> Profile:
    place = f"{path}: scenarios"
    is_file = name not in SCENARIOS and Path(name).suffix.lower() in (".csv", ".toml")
    if not is_file and name not in SCENARIOS:
        here = [each.name for each in SCENARIOS.values() if each.kind in METRIC_TABLES and not each.faults]
        remedy = f"known here: {', '.join(here)}, or a .csv or .toml file{suggestion(name, here)}"
        raise ConfigError(f"there is no scenario {name!r}", where=place, remedy=remedy)
    try:
        scenario = find(str(path.parent / name) if is_file else name, config)
    except CodegenError as error:
        raise ConfigError(error.what, where=f"{place}: {error.where}", remedy=error.remedy) from None
    if scenario.kind not in METRIC_TABLES:
        known = " and ".join(METRIC_TABLES)
        raise ConfigError(
            f"{scenario.name} has no figures for a campaign", where=place, remedy=f"take scenarios of the kinds {known}"
        )
    if scenario.faults:
        raise ConfigError(
            f"{scenario.name} has faults on the bus, but a campaign has no bus",
            where=place,
            remedy="use codegen hil or codegen faults",
        )
    _check_length(spec, scenario, path)
    profile = profile_of(scenario, config, spec.lead_s, spec.length_s)
    speeds = spec.factors.get("speed_km_h")
    if speeds is not None and "steering_wheel_angle_deg" not in spec.factors:
        # If the car can do the manoeuvre at both ends, it can at all speeds between.
        profile.amplitudes(config, np.array(speeds.extremes) * KM_H)
    told = not np.isnan(profile.estimate)
    if told and "friction" in spec.factors and "friction_estimate_error" not in spec.factors:
        raise ConfigError(
            f"{scenario.name} gives the controller a friction of {profile.estimate:g} on any road",
            where=f"{path}: factors.friction",
            remedy="set friction_estimate_error, to 0 for an exact estimate",
        )
    return profile


def _check_length(spec: Spec, scenario: Scenario, path: Path) -> None:
    """Check that the scenario lasts long enough after the start of steering for `length_s` and for the figures."""
    longest, shortest = scenario.duration - scenario.steer_time, LENGTH_MIN[scenario.kind]
    length = longest if spec.length_s is None else spec.length_s
    # Compared to a nanosecond: in floating point, 12.1 - 10 is not 2.1.
    if length > longest + 1e-9:
        raise ConfigError(
            f"{scenario.name} ends {longest:g} s after the driver begins, before {length:g} s",
            where=f"{path}: length_s",
            remedy=f"give {longest:g} s or less, or raise duration_s in a scenario file whose base supports it",
        )
    if length < shortest - 1e-9:
        place, remedy = "length_s", f"give {shortest:g} s or more"
        if spec.length_s is None:
            place, remedy = "scenarios", f"raise its duration_s by {shortest - length:g} s or more"
        raise ConfigError(
            f"{length:g} s are too short for the figures of {scenario.name}", where=f"{path}: {place}", remedy=remedy
        )
