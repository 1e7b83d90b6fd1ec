"""One exploration: its start settings, and the data to display for any others."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
import numpy.typing as npt

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.family import members
from codegen.design.margins import Margins, concatenate, family_margins, family_range_km_h, margin_speeds, nominal_margins
from codegen.ecu_map.extend import TotalMap, extend
from codegen.ecu_map.lookup import Lookup
from codegen.emit.laws import law_of
from codegen.errors import MapError, within
from codegen.explore.controls import Control, Step, apply, checked, controls_of
from codegen.explore.recalibrated import Calibration, Recalibrated
from codegen.figures.data import packed
from codegen.figures.maps import binding_colours, phase_lines
from codegen.judgement.build_warnings import family_warnings
from codegen.judgement.car_warnings import car_warnings
from codegen.judgement.model import MISSING_RECORD, Stored, of_map
from codegen.map_file import map as npz
from codegen.map_file.bounds import binding_text
from codegen.map_file.map import ReferenceMap
from codegen.map_file.tables import ACCELERATION_STACK, ALL_BINDING, FRICTION_STACK
from codegen.optimum.solve import solve_case
from codegen.units import KM_H
from hil_sim import manoeuvres
from hil_sim.metrics.rows import step_metrics
from hil_sim.metrics.run import column, spin_time
from hil_sim.scenarios import SCENARIOS
from hil_sim.settings import Settings

Data = dict[str, Any]

STEER_TIME, DURATION = 0.5, 4.5
"""Time of the step and duration, in s. The paper's recording is longer on both sides of the step."""

FAMILY_SPEEDS = 22
CUT_ANGLES = 121
UNBOUNDED_DB, UNBOUNDED_DEG = 40.0, 180.0
"""Larger margins, and unlimited ones, are drawn at this value; a note on the page states it."""


def numbers(values: npt.ArrayLike, digits: int = 4) -> list[float | None]:
    """Return a rounded list for JSON; None for values that are not finite."""
    array = np.round(np.asarray(values, dtype=np.float64), digits)
    return [value if math.isfinite(value) else None for value in array.tolist()]


def map_data(reference_map: ReferenceMap, known: list[int]) -> Data:
    """Return the map as cells; packed tables have rows of front angles and columns of speeds.

    Args:
        known: sets of binding constraints in the order of their colours; new ones are appended.
    """
    active, feasible = reference_map.active, reference_map.feasible
    assert active is not None  # a solved map has all tables
    assert reference_map.sideslip is not None
    assert reference_map.rear_angle is not None
    present, counts = np.unique(active[feasible], return_counts=True)
    known += [int(flags) for flags in present[np.argsort(-counts, kind="stable")] if int(flags) not in known]
    places = np.full(ALL_BINDING + 1, 255, dtype=np.uint8)
    places[known] = np.arange(len(known))
    return {
        "speed_km_h": numbers(reference_map.speed / KM_H),
        "front_angle_deg": numbers(np.degrees(reference_map.front_angle)),
        "yaw_rate": packed(np.degrees(reference_map.yaw_rate).T),
        "sideslip": packed(np.degrees(reference_map.sideslip).T),
        "rear_angle": packed(np.degrees(reference_map.rear_angle).T),
        "binding": packed(np.where(feasible, places[active], np.uint8(255)).T),
        "binding_names": [binding_text(flags) for flags in known],
        "binding_colours": binding_colours(known),
        "phase_lines": [[numbers(piece[:, 0], 3), numbers(piece[:, 1], 3)] for piece in phase_lines(reference_map)],
        "feasible_percent": round(100.0 * float(feasible.mean()), 1),
    }


def cut_data(total: TotalMap, last_angle: float, speed: float) -> Data:
    """Return the yaw rates that the ECU looks up at one speed (m/s), from zero to the map's last front angle (rad)."""
    angles = np.linspace(0.0, last_angle, CUT_ANGLES)
    yaw_rate, rear_angle = Lookup.from_map(total).reference(speed, angles)
    return {
        "front_angle_deg": numbers(np.degrees(angles)),
        "yaw_rate_deg_s": numbers(np.degrees(yaw_rate)),
        "rear_angle_deg": numbers(np.degrees(rear_angle)),
    }


def judgement_data(stored: Stored) -> Data:
    """Return the judgement of the car as texts: a sentence, or why there is none, and the rows of its table."""
    if stored.judgement is None:
        return {"state": stored.state, "sentence": f"{stored.note[0].upper()}{stored.note[1:]}.", "header": [], "rows": []}
    header, rows = stored.judgement.table()
    texts = {"header": list(header), "rows": [list(row) for row in rows]}
    return {"state": stored.state, "sentence": stored.judgement.sentence, **texts}


def drive(software: Recalibrated, calibration: Calibration, step: Step, *, controlled: bool = True) -> FloatArray:
    """Return a recording (samples, 12) of the step in closed loop, simulated in C; columns RECORD_COLUMNS."""
    config = calibration.config
    scenario = replace(
        SCENARIOS["step-steer"],
        duration=DURATION,
        steer_time=STEER_TIME,
        drive=manoeuvres.step(STEER_TIME),
        settings=Settings(step.speed / KM_H, step.angle_deg, config.road.friction * step.road_share),
    )
    return software.run(calibration, scenario.inputs(config), controlled=controlled)


_CURVES = (
    ("yaw_rate_deg_s", "yaw_rate_rad_s"),
    ("reference_deg_s", "yaw_rate_reference_rad_s"),
    ("sideslip_deg", "sideslip_rad"),
    ("rear_angle_deg", "rear_angle_rad"),
)


def figures(record: FloatArray, config: Config) -> Data:
    """Return the figures of a step; None for those without a steady value. Angles and accelerations are magnitudes."""
    if spin_time(record) is not None:
        return {"spins": True}
    found = step_metrics(record, STEER_TIME, config.steering.ratio)
    turns = found["settled"] and abs(found["yaw_rate_steady_deg_s"]) > 1e-3
    return {
        "settled": found["settled"],
        "overshoot_percent": round(found["overshoot_percent"], 2) if turns else None,
        "rise_time_s": round(found["rise_time_s"], 3) if turns else None,
        "yaw_rate_steady_deg_s": round(found["yaw_rate_steady_deg_s"], 3) if found["settled"] else None,
        "sideslip_peak_deg": round(found["sideslip_abs_max_deg"], 3),
        "rear_angle_peak_deg": round(max(abs(found["rear_angle_min_deg"]), abs(found["rear_angle_max_deg"])), 3),
        "lateral_acceleration_m_s2": round(found["lateral_acceleration_max_m_s2"], 3),
    }


def margin_data(config: Config) -> Data | None:
    """Return the margins over speed and their design targets."""
    gains = law_of(config).gains(config)
    if gains is None:
        return None
    speeds = margin_speeds(config)
    margins = nominal_margins(config, speeds, *gains(speeds))
    gain, phase = int(margins.gain_margin_db.argmin()), int(margins.phase_margin_deg.argmin())
    return {
        **_over_speed(speeds, margins),
        "drawn_to_gain_db": UNBOUNDED_DB,
        "drawn_to_phase_deg": UNBOUNDED_DEG,
        "asked_gain_db": config.tuning.gain_margin_db,
        "asked_phase_deg": config.tuning.phase_margin_deg,
        "worst": {
            "gain_db": _least(margins.gain_margin_db, gain),
            "gain_at_km_h": round(float(speeds[gain]) / KM_H, 1),
            "phase_deg": _least(margins.phase_margin_deg, phase),
            "phase_at_km_h": round(float(speeds[phase]) / KM_H, 1),
            "stable": bool(margins.stable.all()),
        },
    }


def family_data(config: Config, is_stale: Callable[[], bool]) -> Data | None:
    """Return the worst margins of the whole family of cars over `family_range_km_h`; None if the request is outdated.

    Raises:
        ConfigError: the family is too large.
    """
    gains = law_of(config).gains(config)
    if gains is None:
        return None
    speeds = np.linspace(*family_range_km_h(config), FAMILY_SPEEDS) * KM_H
    found = []
    for k in range(speeds.size):
        if is_stale():
            return None
        here = speeds[k : k + 1]
        found.append(family_margins(config, here, *gains(here))[0])
    margins = concatenate(found)
    return {
        "cars": len(members(config)),
        **_over_speed(speeds, margins),
        "stable": bool(margins.stable.all()),
        "warnings": list(family_warnings(config, margins)),
    }


def _over_speed(speeds: FloatArray, margins: Margins) -> Data:
    return {
        "speed_km_h": numbers(speeds / KM_H, 2),
        "gain_db": numbers(np.minimum(margins.gain_margin_db, UNBOUNDED_DB), 3),
        "phase_deg": numbers(np.minimum(margins.phase_margin_deg, UNBOUNDED_DEG), 3),
    }


def _least(values: FloatArray, place: int) -> float | None:
    value = float(values[place])
    return round(value, 2) if math.isfinite(value) else None


Kept = TypeVar("Kept")


@dataclass(eq=False)
class Explorer:
    """Answers to the requests of the page. Calls may come from any thread; one computes at a time.

    Attributes:
        start: configuration at the start.
        case: its case that is solved.
        name: name of the map, for titles.
        notes: notes for the user.
        judgement: judgement of the car at the start.
    """

    start: Config
    case: str
    name: str
    notes: tuple[str, ...] = ()
    judgement: Stored = MISSING_RECORD
    controls: tuple[Control, ...] = field(init=False)
    _software: Recalibrated = field(init=False)
    _begun: Calibration = field(init=False)
    _begun_margins: Data | None = field(init=False)
    _bindings: list[int] = field(init=False, default_factory=list)
    _latest: dict[str, tuple[Any, Any]] = field(init=False, default_factory=dict)
    _computing: threading.RLock = field(init=False, default_factory=threading.RLock)

    def __post_init__(self) -> None:
        self.controls = controls_of(self.start, self.case)
        law_of(self.start)  # rejects missing gains before anything is compiled
        self._begun = self.calibration(self.start)
        self._software = Recalibrated(self._map(self.start).reference_map, self.start)
        self._begun_margins = margin_data(self.start)

    def configured(self, given: object) -> Config:
        """Return the configuration for the settings of the page. Raises CodegenError."""
        return apply(self.start, self.case, self.controls, checked(self.controls, given))

    def calibration(self, config: Config) -> Calibration:
        """Return all numbers of a configuration for the C.

        Raises:
            CodegenError: it has no feasible map, or the C cannot be built for it.
        """
        with self._computing:
            return Calibration.of(self._map(config).total, config)

    def run(self, calibration: Calibration, inputs: FloatArray) -> FloatArray:
        """Run the closed loop in C with these numbers; see `Recalibrated.run`."""
        return self._software.run(calibration, inputs)

    def picture(self, given: object) -> Data:
        """Return all data that the page displays for some settings, see `picture`; `took_ms` is the time of each part in ms.

        Raises:
            CodegenError: the settings are invalid or leave no map.
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
            of_the_loop = (config.vehicle, config.tyre, config.road, config.controller)
            margins = self._kept("margins", of_the_loop, lambda: margin_data(config))
            clock.lap("margins")
        return {
            "map": shown,
            "cut": cut,
            "step": runs,
            "margins": None if margins is None else {"now": margins, "start": self._begun_margins},
            "judgement": judgement_data(self._judgement(config)),
            "warnings": list(car_warnings(config)),
            "took_ms": clock.laps,
        }

    def _judgement(self, config: Config) -> Stored:
        """Return the judgement for settings: that of the start is out of date with others."""
        return self.judgement if config == self.start or self.judgement.state == "missing" else Stored("out of date")

    def family(self, given: object, is_stale: Callable[[], bool]) -> Data | None:
        """Return the margins of the family of cars; see `family_data`. Runs beside other requests. Raises CodegenError."""
        return family_data(self.configured(given), is_stale)

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

        def driven(which: Calibration, *, controlled: bool = True) -> FloatArray:
            return drive(self._software, which, step, controlled=controlled)

        records = {
            "now": driven(calibration),
            "start": self._kept("start", step, lambda: driven(self._begun)),
            "passive": self._kept("passive", (step, config.road), lambda: driven(calibration, controlled=False)),
        }
        return {
            "time_s": numbers(column(records["now"], "time_s") - STEER_TIME),
            "rear_angle_max_deg": config.rear_actuator.angle_max_deg,
            "runs": {
                name: {curve: numbers(np.degrees(column(record, source))) for curve, source in _CURVES}
                for name, record in records.items()
            },
            "figures": {name: figures(record, config) for name, record in records.items()},
        }

    def _cut(self, calibration: Calibration, step: Step) -> Data:
        last = float(self._map(calibration.config).reference_map.front_angle[-1])
        steering = self.start.steering
        return {
            "now": cut_data(calibration.total, last, step.speed),
            "start": self._kept("cut", step, lambda: cut_data(self._begun.total, last, step.speed)),
            "speed_km_h": round(step.speed / KM_H, 3),
            "front_angle_deg": round(min(step.angle_deg / steering.ratio, steering.front_angle_stop_deg), 4),
        }


@dataclass(frozen=True, eq=False)
class _Map:
    """A solved map: as solved, extended to the ECU's whole domain, and as sent to the page."""

    reference_map: ReferenceMap
    total: TotalMap
    shown: Data

    @classmethod
    def of(cls, config: Config, case: str, bindings: list[int]) -> Self:
        """Solve a map. Raises CodegenError."""
        reference_map = solve_case(config, case)
        total = extend(reference_map, config, config.steering.front_angle_stop)
        return cls(reference_map, total, map_data(reference_map, bindings))


@dataclass
class _Clock:
    """Computing time of each part of one update."""

    laps: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def lap(self, name: str) -> None:
        """Record the time since the last lap, in ms, under `name`."""
        now = time.perf_counter()
        self.laps[name], self.last = round(1e3 * (now - self.last), 2), now


def opened(map_path: Path, config_path: Path | None = None) -> Explorer:
    """Return an exploration of a map file, with the map's own configuration or that of a given file.

    Raises:
        CodegenError: a file cannot be read, solved or compiled, or the map was not solved by this project.
    """
    reference_map = npz.load(map_path)
    if reference_map.case is None or reference_map.active is None:
        raise MapError(
            "it was not solved by codegen, so there is no optimisation to explore",
            where=map_path,
            remedy="solve one with `codegen solve --config ars.toml --case 4ws-2 -o 4ws2.npz`",
        )
    config, case = reference_map.config, reference_map.case
    if config_path is not None:
        config = configuration.load(config_path)
        config.case(case, f"{config_path}: [cases]")
    if config is None:
        raise MapError("it contains no configuration", where=map_path, remedy="name one with --config ars.toml")
    notes = []
    if reference_map.quantity is FRICTION_STACK:
        notes.append("the maps for lower frictions are not used: settings are solved for their own friction")
    if reference_map.quantity is ACCELERATION_STACK:
        notes.append("the maps for longitudinal accelerations are not used")
    if config.case(case).reference != "optimum":
        notes.append("the case follows a law for the rear angle, on which the sideslip weight has no effect")
    if config_path is not None and reference_map.config is not None:
        notes.append(f"the map is solved again with {config_path.name}; the one in the file is not used")
    with within(config_path or map_path):
        return Explorer(config, case, map_path.stem, tuple(notes), of_map(reference_map, config))
