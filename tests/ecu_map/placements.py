"""The total map's rules with the optimum solved at each point, and errors of placed tables relative to it."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup
from codegen.ecu_map.placement import Placed, Request, choose
from codegen.ecu_map.storage import Real
from codegen.ecu_map.total import TotalMap
from codegen.map_file.map import ReferenceMap
from codegen.optimum import exact
from codegen.optimum.problem import SteadyTurnProblem, breakpoints
from codegen.optimum.solve import solve_case
from codegen.optimum.turns import passively_feasible, turns_of
from tests.optimum.cars import changed

Truth = Callable[[FloatArray, FloatArray], FloatArray]

COARSE, FINE = math.radians(0.2), math.radians(0.05)
ROUNDING = 1e-6
"""Allowance in rad/s for single precision; the lookup's own bound (`lookup.error_bound`) is below it for these tables."""


def placed(reference_map: ReferenceMap, config: Config, bound: float, tables: int = 1, **changes: Any) -> Placed:
    """Return the placed tables of a map for a bound in rad/s."""
    return choose(reference_map, config, replace(Request(bound, None, "float", ""), **changes), tables, np.float32)


def with_coarse_grid(config: Config) -> Config:
    """Return a configuration with few grid points; the optimum is solved anew at each point, and the grid only bounds it."""
    return changed(config, grid={"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20})


def truth_of(config: Config, case: str) -> Truth:
    """Return the total map's rules with the optimum solved at each point by the bounded problem and its edges.

    Only the exact solution is shared with the code under test: grip bounds always apply, and there are no tables.
    """
    problem = SteadyTurnProblem.from_config(config, config.case(case))
    passive = replace(problem, rear_angle_max=0.0)
    is_safe = config.case(case).passive_safe
    grid = solve_case(config, case)
    first_speed, first, last = grid.speed[0], grid.front_angle[0], grid.front_angle[-1]
    cap = problem.lateral_acceleration_cap

    def row(speed: float, angles: FloatArray) -> FloatArray:
        v = np.array([max(speed, first_speed)])
        gain = float(problem.car.yaw_gain(v)[0])
        edge = exact.edge(passive if is_safe else problem, v)
        end = float(edge.front_angle[0])
        grip = bool(edge.grip_limited[0]) and not is_safe
        inside = np.clip(angles, first, last)
        solved = exact.solve(problem, v, np.minimum(inside, end * (1.0 - 1e-12))).yaw_rate[0]
        at_edge = float(exact.solve(problem, v, np.array([end * (1.0 - 1e-12)])).yaw_rate[0, 0])
        beyond = np.full_like(angles, cap / v[0]) if grip else at_edge + gain * (np.maximum(angles, first) - end)
        value = np.where(inside > end, beyond, solved + gain * np.maximum(angles - last, 0.0))
        # Linear to zero below the first breakpoints, before the cap.
        value = value * min(speed / first_speed, 1.0) * np.minimum(angles / first, 1.0)
        result: FloatArray = np.minimum(value, cap / max(speed, 1e-9))
        return result

    return lambda speed, angle: np.stack([row(float(v), angle) for v in speed])


def random_points(total: TotalMap, seed: int, count: int = 160) -> tuple[FloatArray, FloatArray]:
    """Return speeds and angles over the whole domain, half of them within the cells."""
    rng = np.random.default_rng(seed)

    def points(axis: FloatArray) -> FloatArray:
        anywhere = rng.uniform(0.0, axis[-1], count)
        cell = rng.integers(0, axis.size - 1, count)
        values = np.concatenate([anywhere, axis[cell] + rng.uniform(size=count) * np.diff(axis)[cell]])
        return values.astype(np.float32).astype(np.float64)

    return points(total.speed), points(total.front_angle)


def largest_error(total: TotalMap, truth: Truth, seed: int) -> float:
    """Return the largest error of the yaw rate at random points, rad/s."""
    speed, angle = random_points(total, seed)
    return float(np.abs(Lookup.from_map(total)(speed[:, np.newaxis], angle) - truth(speed, angle)).max())


def rear_angle_error(found: Placed, config: Config, case: str, storage: Real = np.float32) -> float:
    """Return the largest error of the rear angle as a yaw rate (rad/s), at random points with a feasible optimum."""
    rng = np.random.default_rng(12)
    speed, front_angle = (
        np.sort(rng.uniform(*ends, 300)).astype(storage).astype(np.float64) for ends in (found.own_speed, found.own_front_angle)
    )
    problem = SteadyTurnProblem.from_config(config, config.case(case))
    optimum = exact.solve(problem, speed, front_angle)
    _, rear_angle = Lookup.from_map(found.total, storage).reference(speed[:, np.newaxis], front_angle)
    largest = found.total.steering.rear_angle_max
    held = (np.clip(angle, -largest, largest) for angle in (rear_angle.astype(np.float64), optimum.rear_angle))
    error = np.abs(np.subtract(*held))
    inside = optimum.margin > 1e-9  # rad: at the edge, rounding decides
    assert inside.mean() > 0.3
    return float((error * problem.car.yaw_gain(speed)[:, np.newaxis])[inside].max())


def errors_against_optimum(config: Config, case: str, total: TotalMap) -> tuple[float, float]:
    """Return the largest errors of the stored yaw rate (rad/s) and rear angle (rad) where the optimum is feasible."""
    rng = np.random.default_rng(11)
    speed, front_angle = (np.sort(rng.uniform(axis[0], axis[-1], 140)) for axis in breakpoints(config))
    turns, chosen = turns_of(config, config.case(case)), config.case(case)
    optimum = turns.solve(speed, front_angle)
    feasible = optimum.feasible & (passively_feasible(turns, speed, front_angle) if chosen.passive_safe else True)
    assert 0.3 < np.mean(feasible) < 0.9
    stored = Lookup.from_map(total, np.float32).reference(speed[:, np.newaxis], front_angle, math.nan)
    largest = total.steering.rear_angle_max  # the control laws' limit
    yaw_rate = np.abs(stored[0] - optimum.yaw_rate)
    rear_angle = np.abs(np.clip(stored[1], -largest, largest) - np.clip(optimum.rear_angle, -largest, largest))
    return float(yaw_rate[feasible].max()), float(rear_angle[feasible].max())
