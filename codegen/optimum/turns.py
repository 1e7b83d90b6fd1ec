"""One interface to the steady-turn problem for all tyre models.

`turns_of` a case and `turns_behind` a map return optima and edges independent of the tyre model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Case, Config
from codegen.map_file.bounds import TurnQuantities
from codegen.map_file.map import ReferenceMap
from codegen.optimum import exact
from codegen.optimum.demand import Demand
from codegen.optimum.exact import Edge, Solution
from codegen.optimum.problem import SteadyTurnProblem

__all__ = ["Edge", "LinearTurns", "Solution", "SteadyTurns", "passively_feasible", "turns_behind", "turns_of"]


class SteadyTurns(Protocol):
    """The optima of one case, or the turns of its law, on the continuous problem. Speeds in m/s above zero, front angles in rad
    from zero up.

    All but `problem` may raise MapError where a steady turn is not found, with its operating point.
    """

    @property
    def problem(self) -> SteadyTurnProblem:
        """Bounds and weight."""
        ...

    @property
    def method(self) -> str:
        """Name of the method in the `meta` of a map."""
        ...

    def without_rear_steering(self) -> SteadyTurns:
        """The same car under the same bounds with its rear wheels straight."""
        ...

    def solve(self, speed: FloatArray, front_angle: FloatArray) -> Solution:
        """Optima (n, m) for speeds (n,) and front angles (m,)."""
        ...

    def at(self, speed: FloatArray, front_angle: FloatArray) -> Solution:
        """Optima (n,) for speeds (n,) and front angles (n,) that belong together."""
        ...

    def edge(self, speed: FloatArray, front_angle_max: float = ...) -> Edge:
        """Return the largest feasible front angles for speeds (n,); inf beyond the largest angle searched (rad)."""
        ...

    def cap(self, speed: FloatArray, /) -> FloatArray:
        """Return the lateral accelerations (n,) in m/s^2 towards which the yaw rate bends; infinite where it does not."""
        ...

    def demand(self, speed: FloatArray, front_angle: FloatArray) -> Demand | None:
        """Return floor and cap at speeds (n,) and front angles (n,) that belong together; None without both."""
        ...

    def quantities(self, speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray) -> TurnQuantities:
        """Return the turns (p,) of the car at speeds, front angles and yaw rates (p,); NaN where it has none."""
        ...

    def lateral_acceleration_cap(self, asked: FloatArray, /) -> float:
        """ay_cap in m/s^2, from the lateral accelerations (any shape, NaN where infeasible) of a map's optima and its edges."""
        ...


@dataclass(frozen=True)
class LinearTurns:
    """Steady turns of the single-track car with linear tyres, in closed form (see `exact`)."""

    problem: SteadyTurnProblem
    method = "exact"

    def without_rear_steering(self) -> LinearTurns:
        """See `SteadyTurns`."""
        return LinearTurns(self.problem.without_rear_steering())

    def solve(self, speed: FloatArray, front_angle: FloatArray) -> Solution:
        """See `SteadyTurns`."""
        return exact.solve(self.problem, speed, front_angle)

    def at(self, speed: FloatArray, front_angle: FloatArray) -> Solution:
        """See `SteadyTurns`."""
        return exact.solve(self.problem, speed, front_angle[:, np.newaxis]).reshaped(speed.shape)

    def edge(self, speed: FloatArray, _front_angle_max: float = math.inf) -> Edge:
        """See `SteadyTurns`."""
        return exact.edge(self.problem, speed)

    def cap(self, speed: FloatArray, /) -> FloatArray:
        """See `SteadyTurns`."""
        return np.full(speed.shape, math.inf)

    def demand(self, speed: FloatArray, front_angle: FloatArray) -> Demand | None:
        """See `SteadyTurns`."""
        return exact.demand(self.problem, speed, front_angle)

    def quantities(self, speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray) -> TurnQuantities:
        """See `SteadyTurns`."""
        car = self.problem.car
        rear_angle = front_angle - yaw_rate / car.yaw_gain(speed)
        sideslip = rear_angle + car.sideslip_per_yaw_rate(speed) * yaw_rate
        return self.problem.linear_turn(speed, front_angle, yaw_rate, sideslip, rear_angle)

    def lateral_acceleration_cap(self, _asked: FloatArray, /) -> float:
        """Return the lateral acceleration that the grip bounds allow, the same at every speed."""
        return self.problem.lateral_acceleration_cap


def turns_of(config: Config, case: Case) -> SteadyTurns:
    """The problem of a case. Raises ConfigError where the tyre has no end to its linear range."""
    if case.tyre_model == "linear":
        return LinearTurns(SteadyTurnProblem.from_config(config, case))
    from codegen.optimum.nonlinear import NonlinearTurns

    return NonlinearTurns.from_config(config, case)


def turns_behind(reference_map: ReferenceMap) -> SteadyTurns | None:
    """The optimisation behind a solved map, None for a bare one. Raises ConfigError (see `turns_of`)."""
    if not reference_map.solved or reference_map.config is None or reference_map.case is None:
        return None
    return turns_of(reference_map.config, reference_map.config.case(reference_map.case))


def passively_feasible(turns: SteadyTurns, speed: FloatArray, front_angle: FloatArray) -> npt.NDArray[np.bool_]:
    """(n, m): where the car meets the same bounds with its rear wheels straight, for speeds (n,) m/s, front angles (m,) rad."""
    return turns.without_rear_steering().solve(speed, front_angle).feasible
