"""Run a scenario in software, without a bus."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from codegen.errors import CodegenError
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import Software
from hil_sim.bench import BenchResult, run_in_process
from hil_sim.plant_node import PlantNode
from hil_sim.scenarios import Scenario


def run(software: Software, scenario: Scenario, *, controlled: bool = True) -> npt.NDArray[np.float64]:
    """Return a recording (samples, 12) of a scenario, columns RECORD_COLUMNS; `controlled=False` is the passive car.

    Raises:
        CodegenError: the scenario needs a bus (faults or two clocks) and the car is not passive.
    """
    if controlled:
        refuse_bus(scenario)
    loop = ClosedLoop(software, LoopOptions(controlled=controlled))
    driver, inputs = scenario.driver(software.config), scenario.inputs(software.config)
    return loop.run(inputs) if driver is None else loop.run_stepped(inputs, driver.steer)


def refuse_bus(scenario: Scenario) -> None:
    """Raise CodegenError where a scenario has faults on the bus or two clocks, for a run without a bus."""
    if scenario.faults or scenario.clocks.are_free_running:
        kinds = ", ".join(fault.kind for fault in scenario.faults) or "two clocks"
        raise CodegenError(
            f"it has faults on the bus ({kinds}), and this run has no bus",
            where=f"scenario {scenario.name}",
            remedy="run it with `codegen hil`, or with `codegen sil --can`",
        )


def run_through_can(software: Software, scenario: Scenario, *, sensors: bool = False, seed: int = 0) -> BenchResult:
    """Run a scenario through the generated task and its CAN frames, faults included, in this process.

    Args:
        sensors: whether to simulate the configured sensors.
        seed: seed of noise and random faults.
    """
    node = PlantNode(software.config, scenario, precision=software.precision, sensors=sensors, seed=seed)
    return run_in_process(node, software)
