"""Map whose limits a share of a population of cars keeps: the nominal optimum with tighter limits.

A car with feedback reaches the map's yaw rate whatever its tyres are. Its rear angle, sideslip and slip angles then differ from
those of the nominal car, which meets some of its limits exactly. A map solved with `[tightening]` leaves room for that. A first
sample of the cars determines by how much each quantity spreads where it meets its limit. All limits are tightened in proportion
to that, by a common factor: the smallest with which a second sample loses at most `lost_allowed` cars. A car is lost if it
exceeds one of its own limits in one cell.

A larger factor loses fewer cars, so each car has a smallest factor of its own, and the common one is at least an order
statistic of these. By the binomial distribution, the share of the whole population that keeps its limits is then at least the
wanted one, with the probability CONFIDENCE.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config, Tightening
from codegen.configuration.tightening import CARS_SHARE_MAX, CARS_SHARE_MIN, FRACTION_MIN
from codegen.errors import ConfigError, MapError
from codegen.map_file.bounds import BOUNDS
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.optimum.turns import turns_of
from codegen.vehicle.population import draw, require_accepted

SHARE_ARGUMENT = "`share=`"
CONFIDENCE_LEVEL = 0.95
EXPECTED_BEYOND = 20
"""Cars of the second sample that lie beyond the wanted share on average; more cars need less margin for the sample."""
FIRST_CARS = 300
"""Cars of the first sample."""
SEED = 1
SPREAD_ROUNDS_MAX = 4
SPREAD_TOLERANCE = 1e-3
"""Growth of a spread, as a fraction of the limit, that no longer matters."""
ROUNDS_MAX = 8
TOLERANCE = 0.03
"""Step of the common factor that no longer matters: of the tightening, which itself is a small part of a limit."""
STEP_MAX = 1.0
USE_MAX = 2.0
"""Largest use of a limit that counts in the first sample; a car without a steady turn would need infinitely much."""
ROUNDING = 1e-6
"""Tolerance of a limit, as a fraction of it: cells at a limit exceed it by rounding."""

KEYS = {bound.limit: index for index, bound in enumerate(BOUNDS) if bound.limit in Tightening.model_fields}
"""Key of `[tightening]` -> index of the bound. The lateral acceleration is the same for all cars, and has none."""

HAS_KEY = np.array([bound.limit in KEYS for bound in BOUNDS])

Progress = Callable[[int, int], None]
Counted = Callable[[Sequence[Config]], Iterator[Config]]


@dataclass(frozen=True)
class Points:
    """Cells of a map: speed in m/s, front angle in rad, yaw rate in rad/s; arrays (p,)."""

    speed: FloatArray
    front_angle: FloatArray
    yaw_rate: FloatArray

    @classmethod
    def of_map(cls, reference_map: ReferenceMap) -> Points:
        """Return all feasible cells at speeds above zero."""
        row, column = np.nonzero(reference_map.feasible & (reference_map.speed > 0.0)[:, np.newaxis])
        return cls(reference_map.speed[row], reference_map.front_angle[column], reference_map.yaw_rate[row, column])


@dataclass(frozen=True)
class UncertainMap:
    """Solution for a share of the cars.

    Attributes:
        map: the map; its configuration has `[tightening]`.
        nominal: the map with the whole limits.
        lost_by_nominal: share of the cars that exceed a limit when they follow `nominal`, from the first sample.
    """

    map: ReferenceMap
    nominal: ReferenceMap
    lost_by_nominal: float

    @property
    def tightening(self) -> Tightening:
        """`[tightening]` of the map."""
        assert self.map.config is not None  # it was solved
        return self.map.config.tightening


def uses(points: Points, case: str, car: Config) -> FloatArray:
    """Return the largest value of each bound, as a fraction of its limit, for one car that has the yaw rates of the points.

    The order is that of BOUNDS. inf where the car has no steady turn at one of them.
    """
    turns = turns_of(car, car.case(case))
    quantities = turns.quantities(points.speed, points.front_angle, points.yaw_rate)
    values = (np.abs(bound.value(quantities)) / turns.problem.limit_of(bound) for bound in BOUNDS)
    return np.array([np.max(np.where(np.isnan(each), np.inf, each), initial=0.0) for each in values])


def uses_of(reference_map: ReferenceMap, cars: Iterable[Config]) -> FloatArray:
    """Return the uses (k, number of BOUNDS) of k cars that follow a solved map."""
    assert reference_map.case is not None  # it was solved
    points = Points.of_map(reference_map)
    return np.array([uses(points, reference_map.case, car) for car in cars])


def keeps(used: FloatArray) -> BoolArray:
    """Return which of k cars keep all limits, from their uses (k, ...)."""
    kept: BoolArray = used.max(axis=1) <= 1.0 + ROUNDING
    return kept


def car_count(share: float) -> int:
    """Return the number of cars in the second sample."""
    return math.ceil(EXPECTED_BEYOND / (1.0 - share) - 1e-9)


def lost_allowed(share: float, count: int) -> int:
    """Return how many of `count` drawn cars may be lost; -1 if there are too few cars to show the share.

    With at most so many, the one-sided Clopper-Pearson bound on the lost share of the population is at most 1 - share.
    """
    from scipy.special import bdtr  # the binomial distribution; scipy.stats takes a second to import

    return int(np.searchsorted(bdtr(np.arange(count + 1), count, 1.0 - share), 1.0 - CONFIDENCE_LEVEL, side="right")) - 1


def solve_uncertain(config: Config, case: str, share: float, progress: Progress | None = None) -> UncertainMap:
    """Return the map that a share of the cars keeps, with the widest limits, and the nominal map.

    The cars are drawn from `[identified]`. A `[tightening]` of `config` is ignored.

    Args:
        share: below 1, such as 0.99.
        progress: called with (cars done, about how many in all).

    Raises:
        ConfigError: the share is impossible, the case has no rear steering, the identification of the car is in doubt; see also
            `solve_case` and `draw`.
        MapError: no limits that a map can have are enough; see also `solve_case`.
    """
    if not CARS_SHARE_MIN <= share <= CARS_SHARE_MAX:
        remedy = f"give a share from {CARS_SHARE_MIN:g} to {CARS_SHARE_MAX:g}, such as 0.99"
        raise ConfigError(f"{share:g} is not such a share of the cars", where=SHARE_ARGUMENT, remedy=remedy)
    if not config.case(case).rear_steering:
        what = "without rear steering no car can follow the map of another one"
        raise ConfigError(what, where=f"{SHARE_ARGUMENT}: [cases.{case}]", remedy="choose a case with rear_steering = true")
    require_accepted(config)
    whole, count = config.with_whole_limits.with_case(case), car_count(share)
    cars, allowed = draw(whole, count, SEED), lost_allowed(share, count)
    counted = _counter(progress, 3 * (FIRST_CARS + count))  # about three rounds each
    nominal = solve_case(whole, case)
    spread, lost_by_nominal = _spread(whole, case, nominal, counted, share)
    found = _widest(whole, case, spread, lambda tried: uses_of(tried, counted(cars)), allowed)
    if found is None:
        raise MapError(
            f"no map is so tight that {count - allowed} of {count} cars keep the limits",
            where=f"{SHARE_ARGUMENT}: [cases.{case}]",
            remedy="measure with more excitation, relax [limits] or ask for a smaller share",
        )
    factor, tightest, lost = found
    record = {"share": share, "cars": count, "lost": lost, "seed": SEED}
    return UncertainMap(tightest.with_config(_tightened(whole, factor * spread, record)), nominal, lost_by_nominal)


def _widest(
    whole: Config, case: str, spread: FloatArray, used_of: Callable[[ReferenceMap], FloatArray], allowed: int
) -> tuple[float, ReferenceMap, int] | None:
    """Return the smallest factor of the spread with which few enough cars are lost, its map and the lost cars; None if none."""
    found: tuple[float, ReferenceMap, int] | None = None
    too_small, factor = 0.0, 1.0
    for _ in range(ROUNDS_MAX):
        try:
            tried = solve_case(_tightened(whole, factor * spread), case)
        except MapError:  # no cell is left inside such limits
            break
        used = used_of(tried)
        lost = int((~keeps(used)).sum())
        step = float(np.sort(_missing(used, spread, factor))[-allowed - 1])
        if lost <= allowed:
            found = factor, tried, lost
            if step > -TOLERANCE or not spread.any():
                break
        else:
            too_small, step = factor, max(step, TOLERANCE)
        factor += min(max(step, -STEP_MAX), STEP_MAX)
        if found is not None and not too_small < factor < found[0]:
            factor = 0.5 * (too_small + found[0])
    return found


def _spread(whole: Config, case: str, nominal: ReferenceMap, counted: Counted, share: float) -> tuple[FloatArray, float]:
    """Return the spread of each bounded quantity (number of BOUNDS,), as a fraction of its limit, and the lost share.

    The spread is that where the quantity of the nominal car meets its limit in the map. A quantity that meets it only in a
    tightened map, such as the sideslip at smaller yaw rates, is found by solving with what is known so far.
    """
    cars, lost_share, tried = draw(whole, FIRST_CARS, SEED + 1), 0.0, nominal
    spread = np.zeros(len(BOUNDS))
    for number in range(SPREAD_ROUNDS_MAX):
        used = uses_of(tried, counted(cars))
        if number == 0:
            lost_share = float(np.mean(~keeps(used)))
        # Half of the cars that may be lost exceed one limit more than this; only the proportions of the limits count.
        high = np.quantile(np.minimum(used, USE_MAX), 0.5 * (1.0 + share), axis=0)
        larger = np.maximum(spread, high / np.maximum(1.0 - spread, FRACTION_MIN) - 1.0)
        larger[~HAS_KEY | (larger < ROUNDING)] = 0.0
        if (larger - spread).max() <= SPREAD_TOLERANCE:
            break
        spread = larger
        try:
            tried = solve_case(_tightened(whole, spread), case)
        except MapError:  # no cell is left inside such limits
            break
    return spread, lost_share


def _missing(used: FloatArray, spread: FloatArray, factor: float) -> FloatArray:
    """Return by how much the factor must rise for each of k cars, or may fall, from its uses (k, number of BOUNDS).

    A use falls about in proportion to its limit in the map. Tightening does not help where nothing spreads.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.maximum(1.0 - factor * spread, FRACTION_MIN) * (1.0 - 1.0 / np.maximum(used, ROUNDING)) / spread
    missing: FloatArray = np.where(spread > 0.0, steps, np.where(used > 1.0 + ROUNDING, np.inf, -np.inf)).max(axis=1)
    return missing


def _counter(progress: Progress | None, total: int) -> Counted:
    """Return a function that yields cars and reports how many it has yielded so far, over all calls."""
    done = 0

    def counted(cars: Sequence[Config]) -> Iterator[Config]:
        nonlocal done
        for car in cars:
            yield car
            done += 1
            if progress is not None:
                progress(min(done, total), total)

    return counted


def _tightened(whole: Config, tightening: FloatArray, record: Mapping[str, float] | None = None) -> Config:
    """Return the configuration with each limit tightened by a fraction of it (number of BOUNDS,)."""
    fractions = {key: min(max(1.0 - float(tightening[index]), FRACTION_MIN), 1.0) for key, index in KEYS.items()}
    return whole.model_copy(update={"tightening": Tightening.model_validate({**fractions, **(record or {})})})
