"""The loop of the third car and a generated controller."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.sil.plant import PlantSample
from codegen.sil.software import Software
from hil_sim.runs import refuse_bus
from hil_sim.scenarios import Scenario
from hil_sim.second_plant.run import drive
from hil_sim.third_plant.car import DEFAULT, Differences, RollPlant
from hil_sim.third_plant.measuring import Errors, Sensors

FloatArray = npt.NDArray[np.float64]


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
