"""The yaw rate that a map demands, made from the optimum: raised to a floor, and bent towards a cap.

The yaw rate is the only free quantity of a steady turn: rear angle, sideslip and slip angles follow from it. So floor and cap
act on it after the optimisation, and the turn is then taken at the yaw rate asked for. Where that is not feasible, it is taken
at the nearest feasible yaw rate: the bounds win.

The floor is a share of the yaw rate of the passive car, whose rear wheels are straight. Up to PASSIVE_TO that car is the
measure. From REFERENCE_FROM it is the smaller of its yaw rate and that of an understeering car with a given characteristic
speed, because an oversteering car turns more than a driver wants. In between, both are blended.

The cap is a lateral acceleration. The yaw rate r bends towards its limit R = ay_cap/vx like r/(1 + (r/R)^n)^(1/n): it rises
with the front angle as long as the floor does, or the optimum up to BELOW_GRIP, and never reaches R.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Limits
from codegen.units import KM_H

PASSIVE_TO, REFERENCE_FROM = 60.0 * KM_H, 80.0 * KM_H
"""m/s."""

SHARPNESS = 50.0
"""n. The bend takes 1.4 % of a demand that is as large as the limit, and 0.15 % of one that is 5 % smaller."""

CAPPED = 2.0 ** (-1.0 / SHARPNESS)
"""Share of the limit to which a demand as large as the limit is bent. The cap counts as binding from here."""

BELOW_GRIP = 0.99
"""Cap over the smallest lateral acceleration at which grip ends the turns of a speed. The latter falls with the front angle,
and an optimum limited by it would fall too: beyond, the optimum is held constant."""


@dataclass(frozen=True)
class Floor:
    """Least yaw rate, as a share of that of the passive car or of one with a wheelbase (m) and a characteristic speed (m/s)."""

    share: float
    wheelbase: float
    characteristic_speed: float

    @classmethod
    def of(cls, limits: Limits, wheelbase: float) -> Floor | None:
        """Return the configured floor; None for none."""
        if limits.yaw_gain_floor == 0.0:
            return None
        return cls(limits.yaw_gain_floor, wheelbase, limits.reference_characteristic_speed_km_h * KM_H)

    def yaw_rate(self, speed: FloatArray, front_angle: FloatArray, passive: FloatArray) -> FloatArray:
        """Return the floor in rad/s for speeds in m/s, front angles in rad and passive yaw rates in rad/s, which broadcast."""
        understeering = speed * front_angle / (self.wheelbase * (1.0 + (speed / self.characteristic_speed) ** 2))
        share = np.clip((speed - PASSIVE_TO) / (REFERENCE_FROM - PASSIVE_TO), 0.0, 1.0)
        blend = share * share * (3.0 - 2.0 * share)  # without a kink at either end
        result: FloatArray = self.share * (passive + blend * (np.minimum(passive, understeering) - passive))
        return result


def bent(yaw_rate: FloatArray, limit: FloatArray) -> FloatArray:
    """Return yaw rates bent towards limits, both in rad/s; an infinite limit changes nothing."""
    result: FloatArray = yaw_rate / (1.0 + (yaw_rate / limit) ** SHARPNESS) ** (1.0 / SHARPNESS)
    return result


@dataclass(frozen=True)
class Demand:
    """Floor and cap at operating points, arrays that broadcast to one shape.

    Attributes:
        least: the floor in rad/s; zero without one.
        limit: ay_cap/vx in rad/s; infinite without a cap.
    """

    least: Any
    limit: Any

    def of_optimum(self, yaw_rate: FloatArray) -> FloatArray:
        """Return the yaw rates asked for, in rad/s, for those of the optimum."""
        return bent(np.maximum(np.minimum(yaw_rate, self.limit / BELOW_GRIP), self.least), self.limit)

    def is_capped(self, yaw_rate: FloatArray) -> BoolArray:
        """Return where yaw rates in rad/s are bent."""
        return np.asarray(yaw_rate >= CAPPED * self.limit)

    def is_floor(self, yaw_rate: FloatArray, tolerance: float) -> BoolArray:
        """Return where yaw rates in rad/s are those of the floor, within a share of them, and not bent."""
        floor = bent(np.asarray(self.least), self.limit)
        return np.asarray(np.abs(yaw_rate - floor) <= tolerance * floor) & ~self.is_capped(yaw_rate) & (floor > 0.0)
