"""Solve one case of a configuration on its grid: the entry to both solvers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.errors import MapError
from codegen.map_file.map import ReferenceMap, make_meta
from codegen.optimum.problem import breakpoints
from codegen.optimum.turns import Solution, passively_feasible, turns_of

Method = Literal["exact", "ipopt"]


def solve_case(
    config: Config, case: str, method: Method = "exact", progress: Callable[[int, int], None] | None = None
) -> ReferenceMap:
    """The optimal map of a case.

    A `passive_safe` case keeps of its operating points those that the car could drive without its rear steering as well.

    Args:
        method: "exact" (the whole grid at once: closed form, or Newton's method with the nonlinear tyre) or "ipopt" (point by
            point; the reference).
        progress: called with (cells done, cells in all); only "ipopt" takes long enough to call it.

    Raises:
        ConfigError: no such case, or a grid beyond the critical speed of an oversteering car.
        MapError: no operating point of the grid is feasible, or none is left of a passive_safe case; or a steady turn is not
            found.
    """
    chosen = config.case(case)
    turns = turns_of(config, chosen)
    speed, front_angle = breakpoints(config)
    if method == "exact":
        solution = turns.solve(speed, front_angle)
    else:
        from codegen.optimum import ipopt

        solution = ipopt.solve(config, turns.problem, speed, front_angle, progress, chosen.tyre_model)
    if not solution.feasible.any():
        raise MapError(
            "no operating point of the grid is feasible",
            where=f"[cases.{case}]",
            remedy="relax [limits], start the grid at smaller front angles, or check the vehicle data",
        )
    if chosen.passive_safe:
        solution = _keep(solution, solution.feasible & passively_feasible(turns, speed, front_angle))
        if not solution.feasible.any():
            raise MapError(
                "no operating point of the grid is feasible without rear steering",
                where=f"[cases.{case}].passive_safe",
                remedy="set it to false, relax [limits], or start the grid at smaller front angles",
            )
    return ReferenceMap(
        speed=speed,
        front_angle=front_angle,
        yaw_rate=solution.yaw_rate,
        sideslip=solution.sideslip,
        rear_angle=solution.rear_angle,
        feasible=solution.feasible,
        active=solution.active,
        config=config,
        case=case,
        meta=make_meta(config, case, turns.method if method == "exact" else method),
    )


def _keep(solution: Solution, kept: npt.NDArray[np.bool_]) -> Solution:
    """The solution with all cells but `kept` (n, m) infeasible."""
    yaw_rate, sideslip, rear_angle = (
        np.where(kept, values, np.nan) for values in (solution.yaw_rate, solution.sideslip, solution.rear_angle)
    )
    active = np.where(kept, solution.active, np.uint8(0))
    return replace(solution, yaw_rate=yaw_rate, sideslip=sideslip, rear_angle=rear_angle, feasible=kept, active=active)
