"""Third plant for cross-checks: the configured car with tyres, a body and sensors that the controller's design does not know.

The car is the two-track plant of a changed configuration, see `rolling`. `run` adds errors of the sensors that no key has, and
closes the loop with a generated controller. See docs/second-plant.md.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.sil.plant import Plant, PlantInput, PlantSample
from codegen.sil.software import Software
from hil_sim.bench import refuse_bus
from hil_sim.plant_node import SensorModel
from hil_sim.scenarios import Scenario
from hil_sim.second_plant.run import drive, measured_of
from hil_sim.suite.cells import VARIED, load_sensitivity, stiffness, together

PARTS: Mapping[str, object] = {
    "plant": {
        "relaxation_length_m": 0.35,
        "rear_relaxation_factor": 0.5 / 0.35,
        "roll_deg_per_g": 4.0,
        "actuator_motor_share": 0.5,
        "backlash_deg": 0.1,
    },
    "sensors": {"front_angle": {"bias_deg": 0.05}, "yaw_rate": {"bias_deg_s": 0.25}, "rear_angle": {"bias_deg": 0.05}},
}
"""Keys of the third plant that do not depend on the car."""

SPEED_FACTOR = 1.005
"""Ratio of measured to true speed, for a tyre worn by 2 mm."""
JITTER_STEPS = 2
"""Largest age of a sample in plant steps; all ages are equally frequent."""
AGED = ("front_angle", "yaw_rate", "rear_angle")
"""Sensors whose samples differ in age."""


def rolling(config: Config) -> Config:
    """Return the configuration of the third plant: its body, tyres and actuator, and the biases of its sensors.

    Raises:
        ConfigError: the changed tyres are rejected.
    """
    tyres = together(stiffness(-10.0, 5.0), load_sensitivity(-0.15))
    return tyres(config).replace(PARTS, VARIED)


class RememberingPlant(Plant):
    """The car of a configuration with the recent values of its sensors.

    Attributes:
        seen: values of AGED, rad and rad/s, after each of the last plant steps, newest last.
    """

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self.seen: deque[dict[str, float]] = deque([dict.fromkeys(AGED, 0.0)], maxlen=JITTER_STEPS + 1)

    def advance(self, acting: Iterable[PlantInput]) -> None:
        """Advance by one plant step for each input."""
        for values in acting:
            super().advance((values,))
            measured = measured_of(super().sample(values))
            self.seen.append({name: measured[name] for name in AGED})


class Sensors:
    """The sensors of one run; the same seed gives the same run."""

    def __init__(self, config: Config, seed: int) -> None:
        self._model = SensorModel(config.sensors, seed)
        self._random = np.random.default_rng((seed, 1))

    def measure(self, plant: RememberingPlant, car: PlantSample) -> dict[str, float]:
        """Return the fields of a measurement without the friction; once a sample."""
        age = min(int(self._random.integers(JITTER_STEPS + 1)), len(plant.seen) - 1)
        true = {**measured_of(car), **plant.seen[-1 - age], "speed": SPEED_FACTOR * plant.speed}
        return {name: self._model.measure(name, value) for name, value in true.items()}


def run(software: Software | None, config: Config, scenario: Scenario, *, seed: int = 0) -> FloatArray:
    """Return a recording (samples, 12) of a scenario on the third car, columns RECORD_COLUMNS, with the car's true motion.

    Args:
        software: a compiled build; None is the passive car, its rear wheels straight.
        config: of the car; may differ from the build's.
        seed: of noise and jitter.

    Raises:
        BuildError: the C of the car does not compile here.
        CodegenError: the scenario needs a bus.
        ConfigError: see `rolling`.
    """
    if software is not None:
        refuse_bus(scenario)
    car = rolling(config)
    plant, sensors = RememberingPlant(car), Sensors(car, seed)
    return drive(plant, software, config, scenario, lambda now: sensors.measure(plant, now))
