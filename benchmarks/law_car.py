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
from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.judgement.bench import Bench
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.metrics import Runs
from codegen.metrics.runs import COLUMNS, spin_times
from codegen.optimum.solve import solve_case
from codegen.sil.batch import NOISES, Lanes
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.units import KM_H
from codegen.vehicle.plant_car import plant_parameters
from hil_sim.manoeuvres import dwell_shape
from hil_sim.suite.cells import (
    DURATION,
    STEER_TIME,
    Cell,
    Change,
    Condition,
    cells,
    front_angle,
    peak,
    relaxation,
    together,
    unchanged,
)
from hil_sim.suite.subjects import DELAY_SAMPLES, RECOMMENDED_CASE, Subject, of_config, tuned

CARS = {"P": PAPER, "S": "heavy, 10 deg, 90 ms", "V": "van, loaded", "R": "light, rear-heavy"}
"""Letter of a car in the tables -> its name in `benchmarks.judged_cars`."""
HEAVY_UNDERSTEERING = ("S", "V")

IDEAL, REAL = "ideal", "real"
PLANTS: Mapping[str, Change] = {IDEAL: unchanged, REAL: relaxation(0.4)}
"""Changes of the configured car to the plants of all rows: without what the two-track model omits, and with it."""
REAL_PLANT = "a relaxation length of 0.4 m"

SEED = 6
"""Seed of the noise."""


def road(friction: float, keeps_stiffness: bool) -> Condition:
    """Return a road without an estimate of its friction.

    Args:
        friction: below the one of the configuration.
        keeps_stiffness: whether tyres keep their cornering stiffness there, so that only their peak falls; otherwise they keep
            their factor B, and the stiffness falls with the friction.
    """
    if not keeps_stiffness:
        return Condition("road", f"friction {friction:g}, B kept", "friction", friction=friction)

    def slippery(config: Config) -> Config:
        return peak(100.0 * (friction / config.road.friction - 1.0))(config)

    return Condition("road", f"friction {friction:g}, stiffness kept", "friction", plant=slippery)


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
    """

    title: str
    course: Callable[[FloatArray], FloatArray]
    duration: float
    steer_time: float
    speed: FloatArray
    front_angle: FloatArray
    moment: Callable[[FloatArray], FloatArray] | None = None
    moment_arm: float = math.inf

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
        is_noisy: whether the sensors have the noise of the configuration.
        controlled: False for the passive car.
    """

    condition: Condition = field(default_factory=lambda: Condition("dry", "dry", "nominal"))
    acceleration_bias: float = 0.0
    yaw_rate_bias: float = 0.0
    is_noisy: bool = False
    controlled: bool = True

    def noise(self, config: Config, samples: int, count: int) -> FloatArray:
        """Return the errors (samples, k, count) of the sensors in NOISES."""
        errors = np.zeros((samples, len(NOISES), count))
        if self.is_noisy:
            deviations = np.array([getattr(config.sensors, name).noise for name in NOISES])
            errors += deviations[:, np.newaxis] * np.random.default_rng(SEED).standard_normal(errors.shape)
        errors[:, NOISES.index("yaw_rate")] += self.yaw_rate_bias
        errors[:, NOISES.index("lateral_acceleration")] += self.acceleration_bias
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
            return np.where(time >= STEER_TIME - 1e-9, 1.0, 0.0)

        return Drives("step", course, DURATION, STEER_TIME, speed, angle)

    def drive(self, drives: Drives, plant: str, settings: Sequence[Setting]) -> Runs:
        """Return the runs of all settings, each with all drives: (samples, settings times drives).

        The map's yaw rate of the runs is that of the dry road.
        """
        config, count = self.config, drives.speed.size
        cars = [together(PLANTS[plant], each.condition.plant)(config) for each in settings]
        software = self.tested.around.batch(cars[0])
        bench, step = Bench(software, config), config.controller.sampling_time_s
        time, samples = bench.time(drives.duration), round(drives.duration / step)
        profile = bench.profile(config.steering.ratio * drives.course(time), drives.duration)
        if drives.moment is not None:
            profile[:, INPUT_COLUMNS.index("yaw_moment")] = drives.moment(time)

        def each_run(value: Callable[[Setting], float | None]) -> FloatArray:
            return np.repeat(np.array([value(each) for each in settings], dtype=np.float64), count)

        friction = each_run(lambda each: each.condition.friction)
        speed, angle = (np.tile(values, len(settings)) for values in (drives.speed, drives.front_angle))
        lanes = Lanes(
            np.repeat(np.array([plant_parameters(car) for car in cars]), count, axis=0),
            speed_factor=speed,
            wheel_factor=angle,
            friction=np.where(np.isnan(friction), config.road.friction, friction),
            moment_arm=drives.moment_arm,
            friction_estimate=each_run(lambda each: each.condition.estimate_or_nan),
            delay_samples=DELAY_SAMPLES,
            controlled=np.repeat(np.array([each.controlled for each in settings]), count),
            noise=np.concatenate([each.noise(config, samples, count) for each in settings], axis=2),
        )
        columns = ("speed_m_s", *COLUMNS)
        record = software.run(profile, lanes, software.parameters(**self.tested.parameters), columns)
        last = np.full(angle.shape, drives.course(time[-1:])[0]) * angle
        return Runs(
            np.arange(samples, dtype=np.float64) * step,
            dict(zip(columns, record, strict=True)),
            drives.steer_time,
            steering_ratio=config.steering.ratio,
            map_yaw_rate=np.asarray(self.map_yaw_rate(speed, last), dtype=np.float64),
        )

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
        assert reference_map.config is not None  # it was solved here
        config = reference_map.config.replace(changes, f"car {letter}")
    else:
        config = configured(letter, changes)
        reference_map = solve_case(config, RECOMMENDED_CASE)
        config = tuned(reference_map, config)
        reference_map = reference_map.with_config(config)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            npz.save(reference_map, path)
    return LawCar(letter, of_config(CONTROLLED, reference_map, config), reference_map, straight_s)
