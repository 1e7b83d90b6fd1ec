"""Limits that most cars of a population keep when they follow one map.

A car with feedback reaches the map's yaw rate whatever its tyres are; its rear angle, sideslip and slip angles then differ from
those of the nominal car, which meets some of its limits exactly. A map solved with tighter limits leaves room for that. Each
limit is tightened in proportion to what the wanted share of the cars needs of it, and all of them by one factor, the smallest
with which that share keeps the original limits in every cell of the map: a car counts as a whole.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config, parse
from codegen.errors import MapError
from codegen.map_file.bounds import BOUNDS, Binding
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.optimum.turns import turns_of
from codegen.vehicle.tyre import AxleTyres

LIMITS = {
    "slip_departure_percent": Binding.SLIP_FRONT | Binding.SLIP_REAR,
    "sideslip_max_deg": Binding.SIDESLIP,
    "rear_angle_max_deg": Binding.REAR_ANGLE,
}
"""Key of `[limits]` -> bounds that it sets and that differ between cars at one yaw rate; lateral acceleration does not."""

FACTOR_MAX = 4.0
"""Largest common factor of the tightening that is tried."""
FACTOR_STEPS = 7
"""Bisections of the factor."""
POINTS_MAX = 600
"""Cells in which the cars are compared during the search, of those in which a constraint is active."""
ROUNDING = 1e-6
"""Excess of a limit, as a fraction of it, that still counts as keeping it: rounding of cells at a limit."""


@dataclass(frozen=True)
class Points:
    """Cells of a map: speed in m/s, front angle in rad, yaw rate in rad/s; arrays (p,)."""

    speed: FloatArray
    front_angle: FloatArray
    yaw_rate: FloatArray

    @classmethod
    def of_map(cls, reference_map: ReferenceMap, most: int | None = None) -> Points:
        """Return all feasible cells or, with `most`, about so many of those with an active constraint, evenly chosen."""
        active = reference_map.feasible if reference_map.active is None else reference_map.active
        chosen = np.flatnonzero(reference_map.feasible if most is None else active)
        if most is not None and chosen.size > most:
            chosen = chosen[np.linspace(0, chosen.size - 1, most).astype(int)]
        speed, front_angle = np.meshgrid(reference_map.speed, reference_map.front_angle, indexing="ij")
        return cls(*(values.ravel()[chosen] for values in (speed, front_angle, reference_map.yaw_rate)))


def uses(points: Points, case: str, config: Config) -> FloatArray:
    """Return the largest value of each bound, as a fraction of its limit, for one car at the points; in the order of BOUNDS.

    inf where the car has no steady turn at one of them.
    """
    turns = turns_of(config, config.case(case))
    quantities = turns.quantities(points.speed, points.front_angle, points.yaw_rate)
    values = (np.abs(bound.value(quantities)) / turns.problem.limit_of(bound) for bound in BOUNDS)
    return np.array([np.max(np.where(np.isnan(each), np.inf, each), initial=0.0) for each in values])


def uses_of(points: Points, case: str, cars: Sequence[Config]) -> FloatArray:
    """Return the uses (k, 5) of k cars, on all processors."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(partial(uses, points, case), cars, chunksize=max(1, len(cars) // 64)))
    return np.array(found).reshape(len(cars), len(BOUNDS))


def keeping(reference_map: ReferenceMap, case: str, cars: Sequence[Config], most: int | None = None) -> BoolArray:
    """Return which of k cars keep their limits in the cells of a map (see `Points.of_map`) when they have its yaw rate."""
    kept: BoolArray = uses_of(Points.of_map(reference_map, most), case, cars).max(axis=1) <= 1.0 + ROUNDING
    return kept


def tightened(
    config: Config, case: str, cars: Sequence[Config], share: float, progress: Callable[[int, int], None] | None = None
) -> Config:
    """Return the configuration with the widest limits with which a share of the cars keeps the original ones.

    Args:
        config: the nominal car.
        cars: cars of the population, with the limits of `config`; about a thousand.
        share: below 1, such as 0.99.
        progress: called with (steps done, steps in all).

    Raises:
        ConfigError, MapError: see `solve_case`.
        MapError: no limits that a map can have are enough.
    """
    nominal = uses_of(Points.of_map(solve_case(config, case), POINTS_MAX), case, cars)
    needed = {
        key: max(0.0, float(np.quantile(nominal[:, [bound.flag in flags for bound in BOUNDS]].max(axis=1), share)) - 1.0)
        for key, flags in LIMITS.items()
    }
    lost_allowed = int((1.0 - share) * len(cars))
    low, high = 0.0, FACTOR_MAX
    open_cars = [car for car, use in zip(cars, nominal, strict=True) if use.max() > 1.0 + ROUNDING]
    if len(open_cars) <= lost_allowed:
        return config
    # A car that keeps its limits with one factor does so with any larger one; only the others are looked at again.
    lost = 0
    for step in range(FACTOR_STEPS + 1):
        factor = high if step == 0 else 0.5 * (low + high)
        candidate = tighter(config, needed, factor)
        kept = keeping(solve_case(candidate, case), case, open_cars, POINTS_MAX)
        failed = [car for car, is_kept in zip(open_cars, kept, strict=True) if not is_kept]
        if step == 0 and len(failed) > lost_allowed:
            raise MapError(
                f"{len(failed)} of {len(cars)} cars exceed the limits however tight the map's are",
                where=f"[cases.{case}]",
                remedy="measure with more excitation, relax [limits] or ask for a smaller share",
            )
        if lost + len(failed) <= lost_allowed:
            high, found = factor, candidate
            open_cars = [car for car, is_kept in zip(open_cars, kept, strict=True) if is_kept]
            lost += len(failed)
        else:
            low, open_cars = factor, failed
        if progress is not None:
            progress(step + 1, FACTOR_STEPS + 1)
    return found


def tighter(config: Config, needed: dict[str, float], factor: float) -> Config:
    """Return the configuration with each limit tightened by `factor` times the fraction that is needed of it."""
    limits = config.limits.model_dump()
    for key, fraction in needed.items():
        left = max(1.0 - factor * fraction, 0.02)
        limits[key] = departure_at(config, left) if key == "slip_departure_percent" else limits[key] * left
    return parse(config.model_dump(mode="json") | {"limits": limits}, "tightened limits")


def departure_at(config: Config, share: float) -> float:
    """Return the departure of the tyre curve from its tangent, in percent, at a share of the slip bound: the smaller axle's."""
    tyres = AxleTyres.from_config(config)
    pairs = ((tyres.front, tyres.front_slip_bound), (tyres.rear, tyres.rear_slip_bound))
    return 100.0 * min(float(tyre.departure(share * bound)) for tyre, bound in pairs)
