"""Search for gains that suit several cars: the largest Ki with which each car keeps its margins.

A constant disturbance of the rear angle leaves a yaw-rate error whose integral is that disturbance over Ki, so the largest Ki
rejects best; margins and peak sensitivity keep the loop damped (K. J. Åström, T. Hägglund, Advanced PID Control, chapter 6).
The search has two dimensions: Kp on a grid that is refined around the best, and for each Kp the largest Ki by bisection. Few
cars bind, so the search runs for those that did before. All cars are checked with its result, and the worst of them join it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from codegen.arrays import BoolArray, ComplexArray, FloatArray, IndexArray
from codegen.configuration import Tuning
from codegen.configuration.controller import INTEGRAL_GAIN_MAX, INTEGRAL_GAIN_MIN, PROPORTIONAL_GAIN_MAX_S
from codegen.design.family import Member
from codegen.design.margins import Margins, loop_margins, worst_of
from codegen.design.sampled import SampledCar

ROUNDING = (0.025, 0.015, 0.011)
"""Allowance in dB, deg and sensitivity: 0.005 for margins written with two decimals, the rest for the frequency grid."""

RESERVE = (0.05, 0.25, 0.005)
"""Step of reserve on top of the demands, in dB, deg and sensitivity."""

KP_GRID = np.unique(np.minimum(np.concatenate([[0.0], np.geomspace(1e-3, 10.0, 25)]), PROPORTIONAL_GAIN_MAX_S))
KI_MIN, KI_MAX = 1e-4, 100.0
REFINEMENTS = 3
REFINED_POINTS = 9
BISECTIONS = 14
"""Bisections over the six decades of Ki, which find it within 0.1 %."""


@dataclass(frozen=True)
class Shortfall:
    """Gains that do not meet the demands: the worst car and the margins that it reaches, in dB, deg and peak sensitivity."""

    member: Member
    speed_km_h: float
    gain_margin_db: float
    phase_margin_deg: float
    sensitivity: float

    @property
    def reached(self) -> str:
        """Text of the margins for messages."""
        if math.isinf(self.sensitivity):
            return "is unstable"
        return (
            f"reaches {self.gain_margin_db:.1f} dB, {self.phase_margin_deg:.1f} deg and a peak sensitivity of "
            f"{self.sensitivity:.2f}"
        )


@dataclass(frozen=True)
class Demands:
    """Demands on each counted car, arrays (k,): margins in dB and deg, and the peak sensitivity."""

    gain_margin_db: FloatArray
    phase_margin_deg: FloatArray
    sensitivity_max: FloatArray

    @classmethod
    def of(cls, tuning: Tuning, members: Sequence[Member], reserves: int = 0) -> Demands:
        """Return the demands of a configuration on members, with ROUNDING and a number of RESERVEs on top."""
        is_slow = np.array([member.is_slow for member in members])
        gain, phase, peak = (least + reserves * step for least, step in zip(ROUNDING, RESERVE, strict=True))
        largest = np.where(is_slow, tuning.slow_sensitivity_max, tuning.sensitivity_max)
        return cls(
            np.where(is_slow, tuning.slow_gain_margin_db, tuning.gain_margin_db) + gain,
            np.where(is_slow, tuning.slow_phase_margin_deg, tuning.phase_margin_deg) + phase,
            # A peak below 1 does not exist: near 1, the reserve is a share of the distance to it.
            largest - np.minimum(peak, 0.5 * (largest - 1.0)),
        )

    def pick(self, places: Sequence[int]) -> Demands:
        """Return the demands on the cars at the indices `places`."""
        chosen = list(places)
        return Demands(self.gain_margin_db[chosen], self.phase_margin_deg[chosen], self.sensitivity_max[chosen])

    def score(self, margins: Margins) -> FloatArray:
        """Return the worst margin as a fraction of its demand: met from 1, and 0 for an unstable loop."""
        shares = (
            margins.gain_margin_db / self.gain_margin_db,
            margins.phase_margin_deg / self.phase_margin_deg,
            self.sensitivity_max / margins.sensitivity,
        )
        result: FloatArray = np.minimum.reduce(shares)
        return result

    def reserves_missing(self, short: Shortfall) -> int:
        """Return the number of reserves that a car, on which alone these are demands, lacks, at least one."""
        missing = (
            float(self.gain_margin_db[0]) - short.gain_margin_db,
            float(self.phase_margin_deg[0]) - short.phase_margin_deg,
            short.sensitivity - float(self.sensitivity_max[0]),
        )
        steps = max(one / reserve for one, reserve in zip(missing, RESERVE, strict=True))
        return max(1, math.ceil(min(steps, 1e3)))

    def met(self, margins: Margins) -> BoolArray:
        """Return whether the demands are met, in the shape of the margins."""
        result: BoolArray = self.score(margins) >= 1.0
        return result


@dataclass(frozen=True, eq=False)
class Cars:
    """Cars (k) that count together: car i of `sampled` is `members[i]` at `speeds[i]` (km/h)."""

    members: tuple[Member, ...]
    speeds: tuple[float, ...]
    sampled: SampledCar
    frequency: FloatArray
    response: ComplexArray

    @classmethod
    def of(
        cls, members: Sequence[Member], speeds: Sequence[float], sampled: SampledCar, keep: BoolArray, frequency: FloatArray
    ) -> Cars:
        """Return the cars of a SampledCar (m, n) where `keep` (m, n) is true."""
        places = np.flatnonzero(keep)
        chosen = sampled.pick(places.tolist())
        rows, columns = np.divmod(places, len(speeds))
        return cls(
            tuple(members[row] for row in rows),
            tuple(speeds[column] for column in columns),
            chosen,
            frequency,
            chosen.response(frequency),
        )

    def __len__(self) -> int:
        return len(self.members)

    def pick(self, places: Sequence[int]) -> Cars:
        """Return the cars at the indices `places`."""
        chosen = list(places)
        return Cars(
            tuple(self.members[place] for place in chosen),
            tuple(self.speeds[place] for place in chosen),
            self.sampled.pick(chosen),
            self.frequency,
            self.response[chosen],
        )

    def margins(self, kp: FloatArray | float, ki: FloatArray | float) -> Margins:
        """Return margins (..., k) with gains that broadcast against (k,)."""
        return loop_margins(self.sampled, kp, ki, self.frequency, self.response)

    def worst_for(self, demands: Demands, kp: FloatArray | float, ki: FloatArray | float) -> Shortfall | None:
        """Return the worst car with gains that broadcast to (k,); None where all meet the demands."""
        margins = self.margins(kp, ki)
        place = int(demands.score(margins).argmin())
        if demands.met(margins).all():
            return None
        return Shortfall(self.members[place], self.speeds[place], *(float(x[place]) for x in margins.figures()))


def best_gains(cars: Cars, demands: Demands, binding: list[Member]) -> tuple[float, float] | Shortfall:
    """Return (Kp, Ki) with the largest Ki with which all cars meet the demands, or the shortfall where there are none.

    Both are within the range of a schedule, whose smallest Ki may be too large.

    Args:
        cars: at least one.
        demands: demands on each car.
        binding: members of the first search; those that bind are added.
    """
    active = [place for place, member in enumerate(cars.members) if member in binding] or [0]
    while True:
        kp, ki = _search(cars.pick(active), demands.pick(active))
        ki = min(max(ki, INTEGRAL_GAIN_MIN), INTEGRAL_GAIN_MAX)
        short = cars.worst_for(demands, kp, ki)
        if short is None:
            return kp, ki
        margins = cars.margins(kp, ki)
        worst = (*worst_of(margins)[1], int(demands.score(margins).argmin()))
        joining = [place for place in dict.fromkeys(worst) if place not in active]
        if not joining:
            return short
        active += joining
        binding += [cars.members[place] for place in joining if cars.members[place] not in binding]


def _search(cars: Cars, demands: Demands) -> tuple[float, float]:
    """Return (Kp, Ki) with the largest Ki for a few cars. If no gains suffice, return KI_MIN and the best Kp."""
    kps = KP_GRID
    kis = _largest(cars, demands, kps)
    if not kis.any():
        score = demands.score(cars.margins(kps[:, np.newaxis], KI_MIN)).min(axis=-1)
        return float(kps[score.argmax()]), KI_MIN
    for _ in range(REFINEMENTS):
        best = int(kis.argmax())
        around = np.linspace(kps[max(best - 1, 0)], kps[min(best + 1, kps.size - 1)], REFINED_POINTS)
        kps = np.union1d(around, kps[best])
        kis = _largest(cars, demands, kps, float(kis[best]))
    best = int(kis.argmax())
    return float(kps[best]), float(kis[best])


def _largest(cars: Cars, demands: Demands, kps: FloatArray, least: float = KI_MIN) -> FloatArray:
    """Return the largest Ki for each Kp (n,), by bisection of its logarithm; 0 where even `least` is too much.

    A Kp that can no longer reach the largest Ki keeps the smaller Ki found so far.
    """

    def met(some: IndexArray, ki: FloatArray) -> BoolArray:
        return np.asarray(demands.met(cars.margins(kps[some, np.newaxis], ki[:, np.newaxis])).all(axis=-1))

    low: FloatArray = np.full(kps.shape, KI_MIN)
    high: FloatArray = np.full(kps.shape, KI_MAX)
    possible = met(np.arange(kps.size), np.full(kps.shape, least))
    low[~possible] = high[~possible] = 0.0
    for _ in range(BISECTIONS):
        some = np.flatnonzero(possible & (high > low.max()))
        middle = np.sqrt(low[some] * high[some])
        inside = middle <= least
        inside[~inside] = met(some[~inside], middle[~inside])
        low[some], high[some] = np.where(inside, middle, low[some]), np.where(inside, high[some], middle)
    return low
