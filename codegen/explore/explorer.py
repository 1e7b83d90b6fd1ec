"""One exploration: the settings that it began with, and the picture of any other."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypeVar

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.extend import TotalMap, extend
from codegen.emit.laws import law_of
from codegen.errors import MapError, within
from codegen.explore import picture
from codegen.explore.controls import Control, Step, apply, checked, controls_of
from codegen.explore.picture import Data
from codegen.explore.recalibrated import Calibration, Recalibrated
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.plausibility.car import car_warnings
from codegen.units import KM_H

__all__ = ["Explorer", "opened"]

Kept = TypeVar("Kept")


@dataclass(eq=False)
class Explorer:
    """Answers to the requests of the page. Calls may come from any thread; one computes at a time.

    Attributes:
        start: the configuration that the page begins with.
        case: the case of it that is solved.
        name: of the map, for titles.
        notes: what the user should know.
    """

    start: Config
    case: str
    name: str
    notes: tuple[str, ...] = ()
    controls: tuple[Control, ...] = field(init=False)
    _software: Recalibrated = field(init=False)
    _begun: Calibration = field(init=False)
    _begun_margins: Data | None = field(init=False)
    _bindings: list[int] = field(init=False, default_factory=list)
    _latest: dict[str, tuple[Any, Any]] = field(init=False, default_factory=dict)
    _computing: threading.RLock = field(init=False, default_factory=threading.RLock)

    def __post_init__(self) -> None:
        self.controls = controls_of(self.start, self.case)
        law_of(self.start)  # before anything is compiled: it may have no gains yet
        self._begun = self.calibration(self.start)
        self._software = Recalibrated(self._map(self.start).reference_map, self.start)
        self._begun_margins = picture.margin_data(self.start)

    def configured(self, given: object) -> Config:
        """The configuration of what the page sends. Raises CodegenError."""
        return apply(self.start, self.case, self.controls, checked(self.controls, given))

    def solvable(self, config: Config) -> None:
        """Refuse a configuration that leaves no map, or that the C cannot be built for. Raises CodegenError."""
        self.calibration(config)

    def calibration(self, config: Config) -> Calibration:
        """All numbers of a configuration for the C. Raises CodegenError."""
        with self._computing:
            return Calibration.of(self._map(config).total, config)

    def run(self, calibration: Calibration, inputs: FloatArray) -> FloatArray:
        """The closed loop in C with those numbers; see `Recalibrated.run`."""
        return self._software.run(calibration, inputs)

    def picture(self, given: object) -> Data:
        """Return all data that the page shows of some settings, see `picture`; `took_ms` has the time of each part in ms.

        Raises:
            CodegenError: settings that are none, or that leave no map.
        """
        values = checked(self.controls, given)
        with self._computing:
            clock = _Clock()
            config, step = apply(self.start, self.case, self.controls, values), Step.of(values)
            shown = self._map(config).shown
            calibration = self.calibration(config)
            clock.lap("map")
            runs, cut = self._runs(calibration, step), self._cut(calibration, step)
            clock.lap("step")
            margins = self._kept("margins", _of_the_loop(config), lambda: picture.margin_data(config))
            clock.lap("margins")
        return {
            "map": shown,
            "cut": cut,
            "step": runs,
            "margins": None if margins is None else {"now": margins, "start": self._begun_margins},
            "warnings": list(car_warnings(config)),
            "took_ms": clock.laps,
        }

    def family(self, given: object, is_stale: Callable[[], bool]) -> Data | None:
        """The margins of the whole family of cars, see `picture.family_data`. Nobody waits for it. Raises CodegenError."""
        return picture.family_data(self.configured(given), is_stale)

    def _kept(self, name: str, key: object, make: Callable[[], Kept]) -> Kept:
        """Return the last result under a name if its key is unchanged; else compute it."""
        found = self._latest.get(name)
        if found is None or found[0] != key:
            found = self._latest[name] = (key, make())
        value: Kept = found[1]
        return value

    def _map(self, config: Config) -> _Map:
        key = (config.vehicle, config.tyre, config.road, config.limits, config.grid, config.case(self.case))
        return self._kept("map", key, lambda: _Map.of(config, self.case, self._bindings))

    def _runs(self, calibration: Calibration, step: Step) -> Data:
        config = calibration.config

        def driven(which: Calibration, *, controlled: bool = True) -> tuple[Data, Data, Sequence[float | None]]:
            record = picture.drive(self._software, which, step, controlled=controlled)
            return picture.run_data(record), picture.figures(record, config), picture.time_axis(record)

        runs = {
            "now": driven(calibration),
            "start": self._kept("start", step, lambda: driven(self._begun)),
            "passive": self._kept("passive", (step, config.road), lambda: driven(calibration, controlled=False)),
        }
        return {
            "time_s": runs["now"][2],
            "rear_angle_max_deg": config.rear_actuator.angle_max_deg,
            "runs": {name: curves for name, (curves, _, _) in runs.items()},
            "figures": {name: found for name, (_, found, _) in runs.items()},
        }

    def _cut(self, calibration: Calibration, step: Step) -> Data:
        last = float(self._map(calibration.config).reference_map.front_angle[-1])
        steering = self.start.steering
        return {
            "now": picture.cut_data(calibration.total, last, step.speed),
            "start": self._kept("cut", step, lambda: picture.cut_data(self._begun.total, last, step.speed)),
            "speed_km_h": round(step.speed / KM_H, 3),
            "front_angle_deg": round(min(step.angle_deg / steering.ratio, steering.front_angle_stop_deg), 4),
        }


def _of_the_loop(config: Config) -> tuple[object, ...]:
    """Return the part of the configuration that determines the margins of the feedback."""
    return config.vehicle, config.tyre, config.road, config.controller


@dataclass(frozen=True, eq=False)
class _Map:
    """A solved map, the same over an ECU's whole domain, and as the page is shown it."""

    reference_map: ReferenceMap
    total: TotalMap
    shown: Data

    @classmethod
    def of(cls, config: Config, case: str, bindings: list[int]) -> Self:
        """Solve it. Raises CodegenError."""
        reference_map = solve_case(config, case)
        total = extend(reference_map, config, config.steering.front_angle_stop)
        return cls(reference_map, total, picture.map_data(reference_map, bindings))


@dataclass
class _Clock:
    """Computing time of the parts of one picture."""

    laps: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def lap(self, name: str) -> None:
        """The time since the last lap is that of `name`, in ms."""
        now = time.perf_counter()
        self.laps[name], self.last = round(1e3 * (now - self.last), 2), now


def opened(map_path: Path, config_path: Path | None = None) -> Explorer:
    """An exploration of a map in a file, with its own configuration or that of the file that the user names.

    Raises:
        CodegenError: what cannot be read, solved or compiled; a map that this project did not solve.
    """
    reference_map = npz.load(map_path)
    if reference_map.case is None or reference_map.active is None:
        raise MapError(
            "it was not solved here: there is no optimisation to explore",
            where=map_path,
            remedy="solve one with `codegen solve --config ars.toml --case 4ws-2 -o 4ws2.npz`",
        )
    config, case = reference_map.config, reference_map.case
    if config_path is not None:
        config = configuration.load(config_path)
        config.case(case, f"{config_path}: [cases]")
    if config is None:
        raise MapError("it brings no configuration", where=map_path, remedy="name one with --config ars.toml")
    with within(config_path or map_path):
        return Explorer(config, case, map_path.stem, _notes(reference_map, config_path))


def _notes(reference_map: ReferenceMap, config_path: Path | None) -> tuple[str, ...]:
    notes = []
    if reference_map.layers:
        notes.append("the maps for lower frictions are left out here: each setting is solved for its own friction")
    if config_path is not None and reference_map.config is not None:
        notes.append(f"the map is solved again with {config_path.name}; the one in the file is not used")
    return tuple(notes)
