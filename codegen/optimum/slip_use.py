"""Slip angles of the plant in percent of their bounds, at every operating point of a map.

The plant is the two-track car with Magic Formula tyres of the map's own configuration, in the steady turn with the map's yaw
rate: as if the map were tracked exactly, whatever rear angle that takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.errors import ConfigError
from codegen.map_file.map import ReferenceMap

ABOVE = 100.0 * (1.0 + 1e-6)
"""Percent: a bound is exceeded by more than rounding."""


@dataclass(frozen=True)
class SlipUse:
    """Slip angles at the middle of both axles, in percent of their bounds.

    The bound is that of the steady-turn problem on the plant: the end of the linear range, at the latest short of the peak.

    Attributes:
        front, rear: (n, m) percent, NaN where the map is infeasible or the plant has no such turn.
        unreached: (n, m) cells with a yaw rate for which the plant has no steady turn up to its tyres' peak.
    """

    front: FloatArray
    rear: FloatArray
    unreached: npt.NDArray[np.bool_]


def slip_use(reference_map: ReferenceMap) -> SlipUse | None:
    """Return the slip use of a map; None if it has no car, or if the linear range of its tyres has no end."""
    config, case = reference_map.config, reference_map.case
    if config is None or case is None:
        return None
    from codegen.optimum.nonlinear import NonlinearTurns

    try:
        steady = NonlinearTurns.from_config(config, config.case(case))
    except ConfigError:
        return None
    moving = reference_map.feasible & (reference_map.speed > 0.0)[:, np.newaxis]
    row, column = np.nonzero(moving)
    turns = steady.turns_at(reference_map.speed[row], reference_map.front_angle[column], reference_map.yaw_rate[moving])

    def percent_of_bound(slip: FloatArray, bound: float) -> FloatArray:
        percent = np.full(moving.shape, np.nan)
        percent[moving] = np.where(turns.converged, 100.0 * np.abs(slip) / bound, np.nan)
        return percent

    unreached = np.zeros(moving.shape, dtype=np.bool_)
    unreached[moving] = ~turns.converged
    problem = steady.problem
    return SlipUse(
        percent_of_bound(turns.slip_front, problem.front_slip_max),
        percent_of_bound(turns.slip_rear, problem.rear_slip_max),
        unreached,
    )
