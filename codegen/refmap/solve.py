"""Solve one case of a configuration on its grid: the entry to both solvers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from codegen.config import Config
from codegen.errors import MapError
from codegen.refmap import exact
from codegen.refmap.map import ReferenceMap, make_meta
from codegen.refmap.problem import SteadyTurnProblem, breakpoints

Method = Literal["exact", "ipopt"]


def solve_case(
    config: Config, case: str, method: Method = "exact", progress: Callable[[int, int], None] | None = None
) -> ReferenceMap:
    """The optimal map of a case.

    Args:
        method: "exact" (closed form over the whole grid) or "ipopt" (point by point; the reference).
        progress: called with (cells done, cells in all); only "ipopt" takes long enough to call it.

    Raises:
        ConfigError: no such case, or a grid beyond the critical speed of an oversteering car.
        MapError: no operating point of the grid is feasible.
    """
    problem = SteadyTurnProblem.from_config(config, config.case(case))
    speed, front_angle = breakpoints(config)
    if method == "exact":
        solution = exact.solve(problem, speed, front_angle)
    else:
        from codegen.refmap import ipopt

        solution = ipopt.solve(config, problem, speed, front_angle, progress)
    if not solution.feasible.any():
        raise MapError(
            "no operating point of the grid is feasible",
            where=f"[cases.{case}]",
            remedy="relax [limits], start the grid at smaller front angles, or check the vehicle data",
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
        meta=make_meta(config, case, method),
    )
