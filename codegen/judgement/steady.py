"""Figures of a map against the steady turns of the same car with straight rear wheels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.ecu_map.extend import extend
from codegen.judgement.passive import PassiveTurns
from codegen.map_file.bounds import binding_text
from codegen.map_file.map import ReferenceMap
from codegen.units import KM_H

LOW_KM_H, HIGH_KM_H = (20.0, 60.0), (80.0, 120.0)
"""Ranges of the two comparisons of yaw rate."""
LOW_UP_TO = 0.95
"""The first goes up to this share of the lateral acceleration that the car can use at a speed, the smaller of the passive car's
largest and the limit. Beyond, the yaw rate bends towards its cap, which leaves a reserve of grip."""
HIGH_LATERAL_ACCELERATION_G = 0.4
CHARACTERISTIC_SPEED = 100.0 * KM_H
"""m/s, of the understeering car that is the measure at high speed where the passive car turns more."""
GAIN_SPEEDS_KM_H = (60.0, 80.0, 120.0)
"""Speeds of the yaw gains; that of the map's last speed follows."""
FALL_RAD_S = 1e-9
"""Smallest fall of the yaw rate between two cells that is not rounding, in rad/s."""
FLAT_SLOPE_FRACTION = 0.03
"""Steering is flat where the yaw rate rises by less than this fraction of its slope at a straight wheel."""
FLAT_BELOW_FRACTION = 0.92
"""Flat steering is dead only below this fraction of the lateral acceleration that the car can use at the speed. Above it the
yaw rate bends towards the cap."""


@dataclass(frozen=True)
class Dead:
    """Shares of the steps between neighbouring front angles, in %: the yaw rate falls, or is flat below the cap."""

    falling_percent: float
    flat_percent: float

    @property
    def percent(self) -> float:
        """Share of all dead steps."""
        return self.falling_percent + self.flat_percent


@dataclass(frozen=True)
class Least:
    """Smallest ratio of the map's yaw rate to a measure, with its speed and front angle; NaN for all three without a cell."""

    ratio: float
    speed_km_h: float
    front_angle_deg: float


@dataclass(frozen=True)
class SteadyFigures:
    """Figures of a map, in g, ratios and percent.

    Attributes:
        largest_g, passive_g, limit_g: largest lateral acceleration of the map, of the passive car at the speeds and angles of
            the map (NaN where it has no turn at any of them), and the configured limit.
        binding_percent: share of the feasible cells by what binds in them; empty for a map without that.
        dead, dead_on_ecu: dead steering of the map, and of the table of the ECU from the first speed of the map up to the
            steering stop.
        low: smallest yaw rate over the passive car's, LOW_KM_H, up to LOW_UP_TO of what the car can use.
        high: the same over the smaller of the passive car's and that of a car with CHARACTERISTIC_SPEED, HIGH_KM_H, up to a
            lateral acceleration of 0.4 g of the passive car.
        gains: speed in km/h -> smallest yaw rate over the passive car's up to 0.4 g; speeds of the map only.
    """

    largest_g: float
    passive_g: float
    limit_g: float
    binding_percent: Mapping[str, float]
    dead: Dead
    dead_on_ecu: Dead
    low: Least
    high: Least
    gains: Mapping[float, Least]

    @property
    def available_g(self) -> float:
        """Lateral acceleration that the car could use: the smaller of the passive car's largest and the configured limit."""
        return float(np.fmin(self.passive_g, self.limit_g))

    @property
    def grip(self) -> float:
        """Largest lateral acceleration over what the car could use."""
        return self.largest_g / self.available_g


def dead_steering(speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray, usable: FloatArray) -> Dead:
    """Return the dead steps of yaw rates (n, m) in rad/s; a step to or from NaN is none.

    Args:
        speed, front_angle: (n,) m/s and (m,) rad.
        usable: (n,) m/s^2, lateral acceleration that the car can use at each speed.
    """
    rises, widths = np.diff(yaw_rate, axis=1), np.diff(front_angle)
    first = 1 if front_angle[0] == 0.0 else 0
    at_zero = (yaw_rate[:, first] / front_angle[first])[:, np.newaxis]
    falling = rises < -FALL_RAD_S
    is_below = speed[:, np.newaxis] * yaw_rate[:, 1:] < FLAT_BELOW_FRACTION * usable[:, np.newaxis]
    flat = ~falling & (rises < FLAT_SLOPE_FRACTION * at_zero * widths) & is_below
    steps = max(int(np.isfinite(rises).sum()), 1)
    return Dead(100.0 * float(falling.sum()) / steps, 100.0 * float(flat.sum()) / steps)


def least_ratio(values: FloatArray, measure: FloatArray, where: BoolArray, speed: FloatArray, front_angle: FloatArray) -> Least:
    """Return the smallest ratio of values (n, m) to a measure where a condition holds and both are known."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.where(where & (measure > 0.0), values / measure, np.nan)
    if not np.isfinite(ratio).any():
        return Least(math.nan, math.nan, math.nan)
    row, column = np.unravel_index(int(np.nanargmin(ratio)), ratio.shape)
    return Least(float(ratio[row, column]), float(speed[row] / KM_H), math.degrees(front_angle[column]))


def steady_figures(reference_map: ReferenceMap, config: Config) -> SteadyFigures:
    """Return the figures of a map. The yaw rates are those that the ECU looks up, beyond the feasible cells too.

    Raises:
        MapError: see `extend`.
    """
    speed, angle = reference_map.speed, reference_map.front_angle
    moving = speed > 0.0
    speed = speed[moving]
    gravity, column = config.road.gravity_m_s2, speed[:, np.newaxis]
    turns = PassiveTurns.of(config, speed)
    passive = turns.yaw_rate(angle)
    own = reference_map.yaw_rate[moving]
    total = extend(reference_map, config)
    rows = np.isin(total.speed, speed)
    table = np.minimum(total.yaw_rate[rows], total.lateral_acceleration_cap / column)
    reference = table[:, np.isin(total.front_angle, angle)]
    limit = config.limits.lateral_acceleration_max_g
    passive_g = column * passive / gravity
    usable = np.minimum(turns.largest, gravity * limit)
    understeering = column * angle / (config.vehicle.wheelbase * (1.0 + (column / CHARACTERISTIC_SPEED) ** 2))

    def between(first: float, last: float) -> BoolArray:
        return np.asarray((column >= first * KM_H * (1.0 - 1e-9)) & (column <= last * KM_H * (1.0 + 1e-9)))

    def least(measure: FloatArray, where: BoolArray) -> Least:
        return least_ratio(reference, measure, where, speed, angle)

    def gain(kmh: float) -> Least:
        nearest = np.zeros(passive_g.shape, dtype=np.bool_)
        nearest[np.argmin(np.abs(speed - kmh * KM_H))] = True
        return least(passive, nearest & (passive_g <= HIGH_LATERAL_ACCELERATION_G))

    top = float(speed[-1] / KM_H)
    speeds = sorted({kmh for kmh in GAIN_SPEEDS_KM_H if speed[0] / KM_H <= kmh < top * (1.0 - 1e-9)} | {round(top, 6)})
    return SteadyFigures(
        largest_g=float(np.nanmax(column * own)) / gravity,
        passive_g=float(np.nanmax(passive_g)) if np.isfinite(passive_g).any() else math.nan,
        limit_g=limit,
        binding_percent=_binding(reference_map),
        dead=dead_steering(speed, angle, own, usable),
        dead_on_ecu=dead_steering(speed, total.front_angle, table, usable),
        low=least(passive, between(*LOW_KM_H) & (column * passive <= LOW_UP_TO * usable[:, np.newaxis])),
        high=least(np.fmin(passive, understeering), between(*HIGH_KM_H) & (passive_g <= HIGH_LATERAL_ACCELERATION_G)),
        gains={kmh: gain(kmh) for kmh in speeds},
    )


def _binding(reference_map: ReferenceMap) -> dict[str, float]:
    """Return the share of the feasible cells by what binds in them, in %, the largest first."""
    active, feasible = reference_map.active, reference_map.feasible
    if active is None:
        return {}
    flags, counts = np.unique(active[feasible], return_counts=True)
    shares = {
        binding_text(int(flag)): 100.0 * float(count) / int(feasible.sum()) for flag, count in zip(flags, counts, strict=True)
    }
    return dict(sorted(shares.items(), key=lambda item: -item[1]))
