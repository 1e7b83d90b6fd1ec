"""Drives of simulated cars, measured by sensors with noise, bias, delay and jitter, and the cars that drive them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.identify.drive import Drive
from codegen.identify.parameters import configured
from codegen.sil.plant import Plant, PlantInput
from codegen.units import DEGREE, KM_H
from codegen.vehicle.single_track import SingleTrack
from hil_sim.plant_node import SensorModel
from hil_sim.suite.cars import random_car

STEP, PERIOD = 0.001, 0.01
"""Step of the plant and period of the log, s."""


@dataclass(frozen=True)
class Part:
    """A part of a drive: speed (m/s), front and rear angle (rad) as functions of the time (n,) since its start (s)."""

    duration: float
    speed: float
    front: FloatArray | float = 0.0
    rear: FloatArray | float = 0.0
    speed_end: float | None = None


def _time(duration: float) -> FloatArray:
    return np.asarray(np.arange(round(duration / STEP)) * STEP, dtype=np.float64)


def _fade(time: FloatArray, duration: float, length: float = 1.0) -> FloatArray:
    result: FloatArray = np.clip(np.minimum(time, duration - time) / length, 0.0, 1.0)
    return result


def sweep(duration: float, first: float = 0.2, last: float = 3.0) -> FloatArray:
    """Return a sine sweep of amplitude one, frequencies in Hz rising evenly in their logarithm."""
    time = _time(duration)
    octaves = math.log(last / first)
    phase = 2.0 * math.pi * first * duration / octaves * np.expm1(octaves * time / duration)
    return np.sin(phase) * _fade(time, duration)


@dataclass(frozen=True)
class Course:
    """Front angles of a car for its own manoeuvres."""

    config: Config

    def angle(self, speed: float, acceleration: float) -> float:
        """Return the front angle in rad at which the linear car has a lateral acceleration (m/s^2)."""
        car = SingleTrack.from_config(self.config)
        return (car.wheelbase / speed**2 + max(car.understeer_coefficient, 0.0)) * acceleration

    def straight(self, duration: float = 8.0, km_h: float = 60.0, end_km_h: float = 90.0) -> Part:
        """Accelerate straight ahead."""
        return Part(duration, km_h * KM_H, speed_end=end_km_h * KM_H)

    def turns(self, km_h: float, acceleration: float = 4.0, duration: float = 20.0) -> Part:
        """Drive a slow left and right turn."""
        time = _time(duration)
        wave = np.sin(2.0 * math.pi * time / duration) * _fade(time, duration)
        return Part(duration, km_h * KM_H, self.angle(km_h * KM_H, acceleration) * wave)

    def front_sweep(self, km_h: float, acceleration: float = 3.0, duration: float = 20.0) -> Part:
        """Sweep the front wheels."""
        return Part(duration, km_h * KM_H, self.angle(km_h * KM_H, acceleration) * sweep(duration))

    def rear_sweep(self, km_h: float, degrees: float = 0.7, duration: float = 20.0) -> Part:
        """Sweep the rear wheels."""
        return Part(duration, km_h * KM_H, 0.0, degrees * DEGREE * sweep(duration))

    def rear_steps(self, km_h: float = 40.0, share: float = 0.5, duration: float = 12.0) -> Part:
        """Step the rear wheels from side to side."""
        side = np.array([0.0, 1.0, -1.0, 0.5, -0.5, 1.0, 0.0, -1.0])[(_time(duration) / 1.5).astype(int) % 8]
        return Part(duration, km_h * KM_H, 0.0, share * self.config.rear_actuator.angle_max * side)

    def limit(self, km_h: float = 70.0, acceleration: float = 14.0, duration: float = 8.0) -> Part:
        """Steer slowly to beyond the grip of the front axle, to the left and to the right."""
        time = _time(2.0 * duration)
        wave = np.where(time < duration, 1.0, -1.0) * np.sin(math.pi * (time % duration) / duration)
        return Part(2.0 * duration, km_h * KM_H, self.angle(km_h * KM_H, acceleration) * wave)

    def everything(self) -> tuple[tuple[Part, ...], ...]:
        """Return the whole programme as three drives."""
        return (
            (self.straight(), self.turns(40.0), self.turns(80.0), self.straight(4.0, 90.0, 60.0), self.rear_steps()),
            (self.front_sweep(50.0), self.front_sweep(90.0), self.rear_sweep(50.0), self.rear_sweep(90.0)),
            (self.limit(), self.limit(50.0)),
        )

    def hold_out(self) -> tuple[Part, ...]:
        """Return a drive that the others do not contain."""
        time = _time(15.0)
        front = self.angle(75.0 * KM_H, 3.5) * np.sin(2.0 * math.pi * 0.5 * time) * _fade(time, 15.0)
        rear = 0.8 * DEGREE * np.sin(2.0 * math.pi * 0.3 * time) * _fade(time, 15.0)
        return (Part(15.0, 75.0 * KM_H, front, rear),)


@dataclass(frozen=True)
class Errors:
    """Sensor errors beside those of the configuration; see `hil_sim.third_plant`.

    Attributes:
        bias: quantity -> rad, rad/s, m/s^2. speed_factor: measured over true.
        jitter_steps: largest age of a sample in plant steps. command_delay: s.
    """

    bias: Mapping[str, float] = field(
        default_factory=lambda: {
            "delta_f": 0.05 * DEGREE,
            "delta_r": -0.05 * DEGREE,
            "yaw_rate": 0.25 * DEGREE,
            "lateral_acceleration": 0.1,
        }
    )
    speed_factor: float = 1.005
    jitter_steps: int = 2
    command_delay: float = 0.008


SENSOR = {
    "vx": "speed",
    "delta_f": "front_angle",
    "yaw_rate": "yaw_rate",
    "delta_r": "rear_angle",
    "lateral_acceleration": "lateral_acceleration",
}
"""Quantity of a drive -> sensor of the bench."""


def profile(parts: Iterable[Part]) -> FloatArray:
    """Return speed, front angle and rear command (n, 3) on the plant's grid, the command held over a period."""
    rows = []
    for part in parts:
        count = round(part.duration / STEP)
        speed = np.linspace(part.speed, part.speed if part.speed_end is None else part.speed_end, count)
        front, rear = (np.broadcast_to(np.asarray(value, dtype=np.float64), (count,)) for value in (part.front, part.rear))
        per = round(PERIOD / STEP)
        rows.append(np.stack([speed, front, np.repeat(rear[::per], per)[:count]], axis=1))
    result = np.concatenate(rows)
    # No car changes its speed at once: at most 3 m/s^2 between parts.
    for index in range(1, len(result)):
        limit = 3.0 * STEP
        result[index, 0] = min(max(result[index, 0], result[index - 1, 0] - limit), result[index - 1, 0] + limit)
    return result


def drive(
    config: Config,
    parts: Iterable[Part],
    seed: int = 0,
    errors: Errors | None = None,
    *,
    name: str = "drive",
    signals: Iterable[str] = (*SENSOR, "steering_wheel_angle", "delta_r_command"),
    plant: Any = None,
) -> Drive:
    """Drive a car and return what its sensors measured.

    Args:
        config: of the true car and of its sensors.
        parts: what is driven.
        errors: of the sensors; None takes the defaults.
        signals: quantities of the log; "sideslip" may be added.
        plant: another car than the two-track one.
    """
    errors = Errors() if errors is None else errors
    rows = profile(parts)
    true = np.array(list(_true(config, rows, Plant(config) if plant is None else plant, errors.command_delay)))
    return measure(config, rows, true, seed, errors, name=name, signals=signals)


def measure(
    config: Config, rows: FloatArray, true: FloatArray, seed: int, errors: Errors, *, name: str, signals: Iterable[str]
) -> Drive:
    """Return what the sensors of a car measure; see `drive`.

    Args:
        rows: what is driven, see `profile`.
        true: (n, 6) speed, front angle, yaw rate, rear angle, lateral acceleration and sideslip on the same grid.
    """
    columns = dict(zip(("vx", "delta_f", "yaw_rate", "delta_r", "lateral_acceleration", "sideslip"), true.T, strict=True))
    rng = np.random.default_rng((seed, 1))
    per = round(PERIOD / STEP)
    at = np.arange(0, len(rows), per)
    aged = np.maximum(at - rng.integers(errors.jitter_steps + 1, size=at.size), 0)
    model = SensorModel(config.sensors, seed)
    # The wheel leads the road wheels by the lag of the steering; the plant limits the rate of both.
    wheel = config.steering.ratio * (columns["delta_f"] + config.steering.lag_s * np.gradient(columns["delta_f"], STEP))
    found: dict[str, FloatArray] = {
        "steering_wheel_angle": np.round(wheel[aged] / (0.1 * DEGREE)) * 0.1 * DEGREE
        + errors.bias.get("steering_wheel_angle", 0.0),
        "delta_r_command": rows[at, 2],
        "sideslip": columns["sideslip"][at] + 0.1 * DEGREE * rng.standard_normal(at.size),
    }
    for quantity, sensor in SENSOR.items():
        values = columns[quantity][aged if quantity in ("delta_f", "yaw_rate", "delta_r") else at]
        values = values * errors.speed_factor if quantity == "vx" else values + errors.bias.get(quantity, 0.0)
        found[quantity] = np.array([model.measure(sensor, value) for value in values.tolist()])
    return Drive(name, np.asarray(at * STEP, dtype=np.float64), {quantity: found[quantity] for quantity in signals})


def _true(config: Config, rows: FloatArray, plant: Any, delay: float) -> Iterator[tuple[float, ...]]:
    ratio, friction = config.steering.ratio, config.road.friction
    late = round(delay / STEP)
    for index, (speed, front, _) in enumerate(rows.tolist()):
        acting = PlantInput(speed, front * ratio, float(rows[max(index - late, 0), 2]), friction)
        now = plant.sample(acting)
        acceleration = now.measured_lateral_acceleration
        yield (speed, now.front_angle, now.yaw_rate, now.measured_rear_angle, acceleration, now.sideslip_angle)
        plant.advance((acting,))


def true_car(seed: int) -> tuple[Config, Errors]:
    """Draw a car with a relaxation length, otherwise the ideal one, and its sensors."""
    rng = np.random.default_rng(seed)
    data = random_car(rng).with_ideal_plant().model_dump(mode="json")
    data["plant"]["relaxation_length_m"] = float(rng.uniform(0.1, 0.6))
    for axle in ("front", "rear"):
        tyre = data["tyre"][axle]
        tyre["shape_factor_c"] += float(rng.uniform(-0.05, 0.05))
        tyre["curvature_factor_e"] += float(rng.uniform(-0.2, 0.2))

    def around(size: float) -> float:
        return float(rng.uniform(-size, size))

    bias = {
        "delta_f": around(0.1 * DEGREE),
        "delta_r": around(0.1 * DEGREE),
        "yaw_rate": around(0.5 * DEGREE),
        "lateral_acceleration": around(0.2),
    }
    errors = Errors(bias, 1.0 + around(0.01), 2, float(rng.integers(0, 21)) * STEP)
    return configuration.parse(data, "random car"), errors


def truth(config: Config, errors: Errors) -> dict[str, float]:
    """Return the true value of every quantity, SI. What is not aged by jitter is early against what is."""
    age = 0.5 * errors.jitter_steps * STEP
    values = configured(config) | {
        "front_offset": errors.bias["delta_f"],
        "rear_offset": errors.bias["delta_r"],
        "yaw_rate_offset": errors.bias["yaw_rate"],
        "lateral_acceleration_offset": errors.bias["lateral_acceleration"],
        "speed_factor": errors.speed_factor,
        "actuator_delay": errors.command_delay + age,
    }
    return {**values, **{f"{name}_delay": values[f"{name}_delay"] - age for name in ("lateral_acceleration", "sideslip")}}


KNOWN = ("mass_kg", "cg_height_m", "track_m", "cg_to_front_axle_m", "cg_to_rear_axle_m", "front_roll_share")


def configured_car(true: Config) -> Config:
    """Return the preset with what is known of a car: masses and geometry, the angle of its actuator."""
    data = configuration.preset("recommended").with_ideal_plant().model_dump(mode="json")
    data["vehicle"] |= {key: getattr(true.vehicle, key) for key in KNOWN}
    data["rear_actuator"]["angle_max_deg"] = true.rear_actuator.angle_max_deg
    return configuration.parse(data, "known car")
