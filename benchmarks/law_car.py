"""Cars of the benchmark `law`: built once in memory, and driven in batches on the plants and roads of the benchmark."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.judged_car import CONTROLLED
from benchmarks.judged_cars import PAPER, five_cars
from codegen import configuration
from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.errors import MapError
from codegen.judgement.bench import Bench
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.metrics import Runs
from codegen.metrics.runs import METRIC_COLUMNS, spin_times
from codegen.optimum.solve import solve_case
from codegen.sil.batch import NOISES, Lanes, sensor_errors
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.units import KM_H
from codegen.vehicle.plant_car import optional_parts, plant_parameters
from hil_sim.manoeuvres import dwell_shape
from hil_sim.suite.cells import (
    CELL_DURATION,
    CELL_STEER_TIME,
    Cell,
    Change,
    Condition,
    cells,
    front_angle,
    ideal,
    kept_stiffness,
    together,
)
from hil_sim.suite.subjects import RECOMMENDED_CASE, Subject, of_config, tuned
from hil_sim.third_plant import rolling

CARS = {"P": PAPER, "S": "heavy, 10 deg, 90 ms", "V": "van, loaded", "R": "light, rear-heavy"}
"""Letter of a car in the tables -> its name in `benchmarks.judged_cars`."""
HEAVY_UNDERSTEERING = ("S", "V")

IDEAL, REAL, ROLL = "ideal", "real", "roll"


def real(config: Config) -> Config:
    """Return the configured car; an ideal one with what the recommended preset has."""
    if config.plant != ideal(config).plant:
        return config
    return config.replace({"plant": configuration.preset("recommended").plant.model_dump(mode="json")}, "real plant")


PLANTS: Mapping[str, Change] = {IDEAL: ideal, REAL: real, ROLL: rolling}
"""Changes of the configured car to the plants of all rows."""

SEED = 6
"""Seed of the noise."""
BANK_TIME, BANK_RISE_TIME = 4.0, 1.0
"""s: the road begins to bank, and how long that takes."""
DRIVEN_COLUMNS = ("speed_m_s", *METRIC_COLUMNS)
"""Recorded columns."""


def road(friction: float, keeps_stiffness: bool) -> Condition:
    """Return a road without an estimate of its friction.

    Args:
        friction: below the one of the configuration.
        keeps_stiffness: whether tyres keep their cornering stiffness there, so that only their peak falls; otherwise they keep
            their factor B, and the stiffness falls with the friction.
    """
    title, share = ("stiffness kept", 1.0) if keeps_stiffness else ("B kept", 0.0)
    return Condition("road", f"friction {friction:g}, {title}", "friction", kept_stiffness(share), friction)


@dataclass(frozen=True)
class Drives:
    """Runs with one course of the steering wheel.

    Attributes:
        title: name of the manoeuvre.
        course: function of time (steps,) in s that returns the course, a factor of the front angle.
        duration, steer_time: s.
        speed, front_angle: (n,) m/s and rad.
        moment: function of time that returns a yaw moment from outside in N m.
        moment_arm: m ahead of the centre of gravity, where a side force causes that moment; infinite for none.
        speed_course: function of time that returns a factor of the speed.
    """

    title: str
    course: Callable[[FloatArray], FloatArray]
    duration: float
    steer_time: float
    speed: FloatArray
    front_angle: FloatArray
    moment: Callable[[FloatArray], FloatArray] | None = None
    moment_arm: float = math.inf
    speed_course: Callable[[FloatArray], FloatArray] | None = None

    @classmethod
    def straight(cls, duration: float, speeds_km_h: Sequence[float], **more: Any) -> Drives:
        """Return drives straight ahead."""
        speed = np.array(speeds_km_h) * KM_H
        return cls("straight", np.zeros_like, duration, 0.0, speed, np.zeros(speed.size), **more)

    def after(self, seconds: float) -> Drives:
        """Return the drives with so many more seconds straight ahead before them."""
        course, longer = self.course, self.duration + seconds
        return replace(self, course=lambda time: course(time - seconds), duration=longer, steer_time=self.steer_time + seconds)


@dataclass(frozen=True)
class Setting:
    """What differs between the runs of one batch besides the drives.

    Attributes:
        condition: car, road and estimate of its friction.
        acceleration_bias: m/s^2 of the measured lateral acceleration; NaN: it is not measured.
        yaw_rate_bias: rad/s of the measured yaw rate.
        bank: m/s^2 of gravity into a turn to the left, which the measured lateral acceleration lacks from BANK_TIME on.
        is_noisy: whether the sensors have the noise, the resolution and the bias of the car.
        controlled: False for the passive car.
    """

    condition: Condition = field(default_factory=lambda: Condition("dry", "dry", "nominal"))
    acceleration_bias: float = 0.0
    yaw_rate_bias: float = 0.0
    bank: float = 0.0
    is_noisy: bool = False
    controlled: bool = True

    def noise(self, config: Config, samples: int, count: int) -> FloatArray:
        """Return the errors (samples, k, count) of the sensors in NOISES of a car."""
        errors = np.zeros((samples, len(NOISES), count))
        if self.is_noisy:
            errors += sensor_errors(config.sensors, samples, count, SEED)
        errors[:, NOISES.index("yaw_rate")] += self.yaw_rate_bias
        time = np.arange(samples, dtype=np.float64) * config.controller.sampling_time_s
        banked = self.bank * np.clip((time - BANK_TIME) / BANK_RISE_TIME, 0.0, 1.0)
        errors[:, NOISES.index("lateral_acceleration")] += self.acceleration_bias - banked[:, None]
        return errors


@dataclass(frozen=True, eq=False)
class LawCar:
    """A car with its tested controller.

    Attributes:
        letter: see CARS.
        tested: controller around the configured car.
        reference_map: its map.
        straight_s: s of driving straight ahead before the drives with a bias of the lateral acceleration.
    """

    letter: str
    tested: Subject
    reference_map: ReferenceMap
    straight_s: float = 0.0

    @property
    def config(self) -> Config:
        """Configuration of the car and its controller."""
        return self.tested.config

    @functools.cached_property
    def cells(self) -> tuple[Cell, ...]:
        """Cells of the suite."""
        return cells(self.config, self.config.case(RECOMMENDED_CASE))

    @functools.cached_property
    def shares(self) -> FloatArray:
        """Shares (n,) of the largest front angle of the cells."""
        return np.array([cell.share for cell in self.cells])

    @functools.cached_property
    def speeds_km_h(self) -> FloatArray:
        """Speeds (n,) of the cells in km/h."""
        return np.array([cell.speed_km_h for cell in self.cells])

    @property
    def is_fast(self) -> BoolArray:
        """Whether each cell (n,) is at 80 to 120 km/h."""
        result: BoolArray = (self.speeds_km_h > 79.0) & (self.speeds_km_h < 121.0)
        return result

    @functools.cached_property
    def steps(self) -> Drives:
        """Steps of the suite, one for each cell."""
        speed, angle = self.speeds_km_h * KM_H, np.array([front_angle(cell) for cell in self.cells])

        def course(time: FloatArray) -> FloatArray:
            return np.where(time >= CELL_STEER_TIME - 1e-9, 1.0, 0.0)

        return Drives("step", course, CELL_DURATION, CELL_STEER_TIME, speed, angle)

    def drive(self, drives: Drives, plant: str, settings: Sequence[Setting]) -> Runs:
        """Return the runs of all settings, each with all drives: (samples, settings times drives).

        The map's yaw rate of the runs is that of the dry road.
        """
        config, count = self.config, drives.speed.size
        cars = [together(PLANTS[plant], each.condition.plant)(config) for each in settings]
        parts = [optional_parts(car) for car in cars]
        samples = round(drives.duration / config.controller.sampling_time_s)
        record = np.empty((len(DRIVEN_COLUMNS), samples, len(settings), count))
        for part in dict.fromkeys(parts):  # a batch has one structure of the plant
            places = [place for place, each in enumerate(parts) if each == part]
            chosen = [(settings[place], cars[place]) for place in places]
            record[:, :, places] = self._run(drives, chosen).reshape(len(DRIVEN_COLUMNS), samples, len(places), count)
        speed, angle = np.tile(drives.speed, len(settings)), np.tile(drives.front_angle, len(settings))
        return Runs(
            np.arange(samples, dtype=np.float64) * config.controller.sampling_time_s,
            dict(zip(DRIVEN_COLUMNS, record.reshape(len(DRIVEN_COLUMNS), samples, -1), strict=True)),
            drives.steer_time,
            steering_ratio=config.steering.ratio,
            map_yaw_rate=self.map_yaw_rate(speed, drives.course(np.array([drives.duration]))[0] * angle),
        )

    def _run(self, drives: Drives, chosen: Sequence[tuple[Setting, Config]]) -> FloatArray:
        """Return the recording (columns, samples, settings times drives) of settings with cars of one structure."""
        config, count = self.config, drives.speed.size
        software = self.tested.around.batch(chosen[0][1])
        bench = Bench(software, config)
        profile = bench.profile(config.steering.ratio * drives.course(bench.time(drives.duration)), drives.duration)
        if drives.moment is not None:
            profile[:, INPUT_COLUMNS.index("yaw_moment")] = drives.moment(bench.time(drives.duration))
        if drives.speed_course is not None:
            profile[:, INPUT_COLUMNS.index("speed")] = drives.speed_course(bench.time(drives.duration))
        samples = profile.shape[0] // software.steps_per_sample

        def each_run(value: Callable[[Setting], float | None]) -> FloatArray:
            return np.repeat(np.array([value(each) for each, _ in chosen], dtype=np.float64), count)

        friction = each_run(lambda each: each.condition.friction)
        lanes = Lanes(
            np.repeat(np.array([plant_parameters(car) for _, car in chosen]), count, axis=0),
            speed_factor=np.tile(drives.speed, len(chosen)),
            wheel_factor=np.tile(drives.front_angle, len(chosen)),
            friction=np.where(np.isnan(friction), config.road.friction, friction),
            moment_arm=drives.moment_arm,
            friction_estimate=each_run(lambda each: each.condition.estimate_or_nan),
            delay_samples=np.repeat([car.driven_delay_samples for _, car in chosen], count),
            controlled=np.repeat(np.array([each.controlled for each, _ in chosen]), count),
            noise=np.concatenate([each.noise(car, samples, count) for each, car in chosen], axis=2),
        )
        return software.run(profile, lanes, software.parameters(**self.tested.parameters), DRIVEN_COLUMNS)

    def map_yaw_rate(self, speed: FloatArray, angle: FloatArray, estimate: float = math.nan) -> FloatArray:
        """Return the map's yaw rates (n,) in rad/s at speeds in m/s and front angles in rad, by default on the dry road."""
        look_up = self.tested.around.batch(PLANTS[IDEAL](self.config)).software.function("map_yaw_rate_on_road")
        flat = zip(speed.ravel().tolist(), angle.ravel().tolist(), strict=True)
        return np.array([look_up(v, delta, estimate) for v, delta in flat]).reshape(angle.shape)


def per_setting(values: FloatArray, settings: Sequence[Setting]) -> FloatArray:
    """Return figures of runs as (settings, drives)."""
    return values.reshape(len(settings), -1)


def spun(runs: Runs, settings: Sequence[Setting]) -> BoolArray:
    """Return whether the car spins, (settings, drives)."""
    result: BoolArray = ~np.isnan(per_setting(spin_times(runs), settings))
    return result


def step_to(signs: Sequence[float], length: float, start: float) -> Callable[[FloatArray], FloatArray]:
    """Return a course of steps: each factor for so many s, the last one to the end."""

    def course(time: FloatArray) -> FloatArray:
        place = np.floor((time - start) / length + 1e-9).astype(int)
        factors = np.array([0.0, *signs])
        result: FloatArray = factors[np.clip(place + 1, 0, len(signs))]
        return result

    return course


LIMIT_SPEEDS_KM_H, LIMIT_ANGLES_DEG = (60.0, 80.0, 100.0), (2.0, 4.0, 6.0)
"""Speeds and front angles of the flicks and sines with dwell on slippery roads."""
LIMIT_DURATION_S, LIMIT_STEER_S, FLICK_S = 6.0, 0.5, 0.8


def _at_limit(title: str, course: Callable[[FloatArray], FloatArray]) -> Drives:
    speeds, angles = np.meshgrid(LIMIT_SPEEDS_KM_H, LIMIT_ANGLES_DEG, indexing="ij")
    return Drives(title, course, LIMIT_DURATION_S, LIMIT_STEER_S, speeds.ravel() * KM_H, np.radians(angles.ravel()))


FLICKS = _at_limit("flick", step_to((-1.0, 1.0), FLICK_S, LIMIT_STEER_S))
DWELLS = _at_limit("sine with dwell", lambda time: dwell_shape(time - LIMIT_STEER_S))


def configured(letter: str, changes: Mapping[str, Any]) -> Config:
    """Return a car of CARS with other values at keys of `ars.toml`. Raises ConfigError."""
    return five_cars()[CARS[letter]].replace(changes, f"car {letter}")


def prepare(letter: str, changes: Mapping[str, Any], folder: Path | None = None, straight_s: float = 0.0) -> LawCar:
    """Solve, tune and build a car of CARS in memory.

    Args:
        letter: of the car.
        changes: other values at keys of `ars.toml`.
        folder: with the tuned maps of an earlier run, which gives maps and gains; a missing map is written there. The changes
            are made to its configuration, too.
        straight_s: see `LawCar`.

    Raises:
        CodegenError: it cannot be solved, tuned or read.
    """
    path = None if folder is None else folder / f"{letter}.npz"
    if path is not None and path.exists():
        reference_map = npz.load(path)
        if reference_map.config is None:
            raise MapError("it has no configuration", where=path, remedy="remove it")
        config = reference_map.config.replace(changes, f"car {letter}")
    else:
        config = configured(letter, changes)
        reference_map = solve_case(config, RECOMMENDED_CASE)
        config = tuned(reference_map, config)
        reference_map = reference_map.with_config(config)
        if path is not None:
            npz.save(reference_map, path)
    return LawCar(letter, of_config(CONTROLLED, reference_map, config), reference_map, straight_s)
