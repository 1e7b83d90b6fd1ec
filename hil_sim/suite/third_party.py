"""The nine cells on the third party's multi-body car."""

from __future__ import annotations

import math

from codegen.config import KM_H, Config
from codegen.refmap.map import ReferenceMap
from codegen.sil.software import Software
from hil_sim.suite.cells import Cell
from hil_sim.suite.runs import CellResult, judge
from hil_sim.suite.subjects import DELAY_SAMPLES

CONDITION = "third-party"


def third_party_cells(
    reference_map: ReferenceMap,
    config: Config,
    software: Software,
    *,
    controlled: bool = True,
    delay_samples: int = DELAY_SAMPLES,
) -> tuple[CellResult, ...]:
    """Drive and judge them.

    Args:
        reference_map, config: of that car (`hil_sim.second_plant.car_of`), solved and tuned for it.
        software: the build of both.
        controlled: False is the passive car.

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
