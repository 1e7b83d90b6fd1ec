"""Run the closed loop of the third plant with sensor errors and a generated controller."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.sil.plant import PlantSample
from codegen.sil.software import Software
from hil_sim.runs import refuse_bus
from hil_sim.scenarios import Scenario
from hil_sim.second_plant.run import drive
from hil_sim.sensors import SensorModel
from hil_sim.third_plant.car import DEFAULT, Differences, RollPlant

BIASES: Mapping[str, float] = {
    "front_angle": math.radians(0.05),
    "yaw_rate": math.radians(0.25),
    "rear_angle": math.radians(0.05),
}
"""Bias of each sensor in rad and rad/s."""
SPEED_FACTOR = 1.005
"""Ratio of measured to true speed, for a tyre worn by 2 mm."""
JITTER_STEPS = 2
"""Largest age of a sample in plant steps; all ages are equally frequent."""


@dataclass(frozen=True)
class Errors:
    """Sensor errors in addition to the configured noise, resolution and delay."""

    biases: Mapping[str, float] = field(default_factory=lambda: dict(BIASES))
    speed_factor: float = SPEED_FACTOR
    jitter_steps: int = JITTER_STEPS


class Sensors:
    """The sensors of one run; the same seed gives the same run."""

    def __init__(self, config: Config, errors: Errors, seed: int) -> None:
        self._errors, self._model = errors, SensorModel(config.sensors, seed)
        self._random = np.random.default_rng((seed, 1))
        self._gravity = config.road.gravity_m_s2

    def measure(self, plant: RollPlant, lateral_acceleration: float) -> dict[str, float]:
        """Return the fields of a measurement without the friction, as measured; once a sample.

        The rear angle is that of the actuator's motor: no sensor sees the play behind it. The accelerometer rolls
        with the body.
        """
        age = min(int(self._random.integers(self._errors.jitter_steps + 1)), len(plant.seen) - 1)
        true = dict(zip(("front_angle", "yaw_rate", "rear_angle"), plant.seen[-1 - age], strict=True))
        biased = {name: value + self._errors.biases.get(name, 0.0) for name, value in true.items()}
        biased["speed"] = self._errors.speed_factor * plant.speed
        biased["lateral_acceleration"] = lateral_acceleration + self._gravity * math.sin(plant.roll)
        return {name: self._model.measure(name, value) for name, value in biased.items()}


def run(
    software: Software | None,
    config: Config,
    scenario: Scenario,
    *,
    seed: int = 0,
    differences: Differences = DEFAULT,
    errors: Errors | None = None,
    delay_samples: int = 1,
) -> FloatArray:
    """Return a recording (samples, 12) of a scenario on the third car, columns RECORD_COLUMNS, with the car's true motion.

    Args:
        software: a compiled build; None is the passive car, its rear wheels straight.
        config: of the car; may differ from the build's.
        seed: of noise and jitter.
        differences: from the configured car.
        errors: of the sensors; None takes the defaults.
        delay_samples: control samples between computing a command and its acting.

    Raises:
        BuildError: the C of the car does not compile here.
        CodegenError: the scenario needs a bus.
    """
    if software is not None:
        refuse_bus(scenario)
    errors = Errors() if errors is None else errors
    plant = RollPlant(config, differences, remembered=errors.jitter_steps + 1)
    sensors = Sensors(config, errors, seed)

    def measured(car: PlantSample) -> dict[str, float]:
        return sensors.measure(plant, car.lateral_acceleration)

    return drive(plant, software, config, scenario, measured, delay_samples=delay_samples)
