"""The nine cells on the third party's multi-body car."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Mapping
from dataclasses import dataclass

from codegen.configuration import Config
from codegen.emit.laws import LAWS
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.sil.software import Software
from codegen.units import KM_H
from hil_sim.suite.cells import Cell
from hil_sim.suite.runs import CellResult, judge
from hil_sim.suite.subjects import DELAY_SAMPLES, PASSIVE, baseline_configs, of_config, tuned

CONDITION = "third-party"


def available() -> bool:
    """Return whether the package of the third party's plant is installed."""
    return importlib.util.find_spec("vehiclemodels") is not None


def third_party_cells(
    reference_map: ReferenceMap,
    config: Config,
    software: Software,
    *,
    controlled: bool = True,
    delay_samples: int = DELAY_SAMPLES,
) -> tuple[CellResult, ...]:
    """Run and evaluate the cells.

    Args:
        reference_map, config: map and configuration of that car (`hil_sim.second_plant.car_of`), solved and tuned for it.
        software: build of both.
        controlled: False for the passive car.

    Raises:
        CodegenError: the third party's package is missing.
    """
    from hil_sim import second_plant
    from hil_sim.second_plant.run import STEER_TIME

    results = []
    for driven in second_plant.cells(reference_map):
        cell = Cell(driven.speed_km_h, math.degrees(driven.front_angle), driven.share)
        record = second_plant.run(software if controlled else None, config, driven.scenario, delay_samples=delay_samples)
        asked = float(software.map_yaw_rate(cell.speed_km_h * KM_H, driven.front_angle))
        results.append(judge(record, cell, CONDITION, asked, STEER_TIME))
    return tuple(results)


@dataclass(frozen=True)
class Job:
    """A subject to drive on the third party's plant: its configuration, for a car of its own, and the case of its map."""

    config: Config
    case: str
    controlled: bool = True

    def __call__(self) -> tuple[CellResult, ...]:
        """Solve, tune and build for the third party's car, and simulate it.

        Raises:
            CodegenError: the package is missing, the map does not reach the cells, or solving, tuning or building fails.
        """
        from hil_sim import second_plant

        config = second_plant.car_of(second_plant.published(), self.config)
        reference_map = solve_case(config, self.case)
        if not self.controlled:
            config = baseline_configs(config)["pi"]  # any controller; only its map is used
        elif LAWS[config.controller.kind].scheduled:
            config = tuned(reference_map, config)
        software = of_config(CONDITION, reference_map, config).around(config)
        return third_party_cells(reference_map, config, software, controlled=self.controlled)


def jobs(contenders: Mapping[str, Config], case: str) -> dict[str, Job]:
    """Return the cells of each contender (name -> configuration) and of the passive car."""
    driven = {name: Job(config, case) for name, config in contenders.items()}
    return {**driven, PASSIVE: Job(next(iter(contenders.values())), case, controlled=False)}
