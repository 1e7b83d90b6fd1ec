"""Drives of a car with its controller and of the same car with straight rear wheels, as lanes of one batch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.metrics import Runs
from codegen.sil.batch import BatchSoftware, Drivers, Lanes
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.vehicle.plant_car import varied_cars


@dataclass(frozen=True)
class Bench:
    """A compiled controller around the simulated car of a configuration.

    Attributes:
        software: the build, compiled for batches.
        config: configuration of car and controller.
        parameters: parameters of the controller; None uses the build's.
    """

    software: BatchSoftware
    config: Config
    parameters: Any = None

    def profile(self, wheel: FloatArray | float, duration: float) -> FloatArray:
        """Return inputs (steps, 7), INPUT_COLUMNS, at 1 m/s on the configured road without an estimate of its friction.

        Args:
            wheel: (steps,) rad of the steering wheel, or a number; each run multiplies it by its own factor.
            duration: s.
        """
        values = {
            "speed": 1.0,
            "friction": self.config.road.friction,
            "friction_estimate": math.nan,
            "steering_wheel_command": wheel,
        }
        profile = np.zeros((self.time(duration).size, len(INPUT_COLUMNS)))
        for name, value in values.items():
            profile[:, INPUT_COLUMNS.index(name)] = value
        return profile

    def time(self, duration: float) -> FloatArray:
        """Return the times (steps,) in s of the plant's steps; a whole number of control samples."""
        samples = round(duration / self.config.controller.sampling_time_s)
        step = self.software.config.plant.sampling_time_s
        return np.arange(samples * self.software.steps_per_sample, dtype=np.float64) * step

    def run(
        self,
        profile: FloatArray,
        steer_time: float,
        columns: Sequence[str],
        *,
        speed: FloatArray,
        wheel: FloatArray | float = 1.0,
        mass: FloatArray | float = 1.0,
        friction: FloatArray | None = None,
        drivers: Drivers | None = None,
    ) -> Runs:
        """Return 2 n runs: first those of the controlled car, then the same of the passive car.

        Args:
            profile: inputs, see `profile`.
            steer_time: s, beginning of steering.
            columns: columns of RECORD_COLUMNS.
            speed, wheel: (n,) factors.
            mass: factor of the configured mass; the yaw inertia goes with it.
            friction: (n,) of the road, which the controller does not know.
            drivers: drivers of the n runs.
        """
        factors = np.tile(np.broadcast_to(mass, speed.shape), 2)
        twice = None if drivers is None else _twice(drivers)
        lanes = Lanes(
            varied_cars(self.config, mass=factors),
            speed_factor=np.tile(speed, 2),
            wheel_factor=np.tile(np.broadcast_to(wheel, speed.shape), 2),
            friction=None if friction is None else np.tile(friction, 2),
            delay_samples=self.config.driven_delay_samples,
            controlled=np.arange(2 * speed.size) < speed.size,
            drivers=twice,
        )
        record = self.software.run(profile, lanes, self.parameters, columns)
        return Runs(
            np.arange(record.shape[1], dtype=np.float64) * self.config.controller.sampling_time_s,
            dict(zip(columns, record, strict=True)),
            steer_time,
            steering_ratio=self.config.steering.ratio,
            mass=factors * self.config.vehicle.mass_kg,
        )


def _twice(drivers: Drivers) -> Drivers:
    names = ("path_start", "ahead", "path_weight", "motion_weight", "delay_samples")
    doubled: dict[str, Any] = {name: np.concatenate([getattr(drivers, name)] * 2, axis=-1) for name in names}
    return replace(drivers, **doubled)
