"""Spread of the optimal map over the cars that the measured drives leave possible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.errors import CodegenError
from codegen.optimum.problem import breakpoints
from codegen.optimum.turns import turns_of
from codegen.units import KM_H
from codegen.vehicle.population import BAND, draw

CARS = 60
SEED = 1
SPEED_SHARES = (1.0 / 3.0, 7.0 / 12.0, 5.0 / 6.0)
"""Fractions of the last speed of the map: 40, 70 and 100 km/h for a map that ends at 120 km/h."""
FRONT_ANGLES = 41
FEASIBLE_MIN = 0.5
"""The band ends where fewer of the cars have a feasible turn."""


@dataclass(frozen=True)
class MapSpread:
    """Yaw rates of a map over front angles (m,) in rad at speeds (n,) in m/s, in rad/s.

    Attributes:
        case: name of the case.
        nominal: (n, m) of the identified car; NaN where infeasible.
        low, high: (n, m) quantiles BAND of the cars that have a feasible turn; NaN where few have one.
        cars: number of cars. failed: cars without a map on this grid.
    """

    case: str
    speed: FloatArray
    front_angle: FloatArray
    nominal: FloatArray
    low: FloatArray
    high: FloatArray
    cars: int
    failed: int


def map_spread(identified: Config) -> MapSpread | None:
    """Solve `rear_steer_case` for cars drawn from `[identified]`; None without such a case or key.

    Raises:
        CodegenError: no car can be drawn, or the identified car has no map.
    """
    case = identified.rear_steer_case
    if case is None or not identified.identified.keys:
        return None
    speeds, angles = breakpoints(identified)
    speed = np.round(np.array(SPEED_SHARES) * speeds[-1] / KM_H, 1) * KM_H
    speed = speed[speed >= speeds[0]]
    front_angle = np.linspace(angles[0], angles[-1], FRONT_ANGLES)

    def optimum(car: Config) -> FloatArray:
        breakpoints(car)  # a car that becomes unstable on this grid has no map
        solution = turns_of(car, car.case(case)).solve(speed, front_angle)
        return np.where(solution.feasible, solution.yaw_rate, np.nan)

    nominal, found, failed = optimum(identified), [], 0
    for car in draw(identified, CARS, SEED):
        try:
            found.append(optimum(car))
        except CodegenError:
            failed += 1
    tables = np.array(found or [np.full_like(nominal, np.nan)])
    wide = np.isfinite(tables).mean(axis=0) >= FEASIBLE_MIN
    ends = np.full((2, *nominal.shape), np.nan)
    ends[:, wide] = np.nanquantile(tables[:, wide], BAND, axis=0)
    return MapSpread(case, speed, front_angle, nominal, ends[0], ends[1], CARS, failed)
