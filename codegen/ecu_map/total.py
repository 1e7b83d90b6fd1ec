"""A total map: a yaw rate and a rear angle for every speed and front angle that an ECU meets. `extend` makes it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.ecu_map.storage import Scales
from codegen.map_file.tables import ACCELERATION_STACK, FRICTION_STACK, Stack
from codegen.vehicle.single_track import SingleTrack


class Rule(StrEnum):
    """Rule that gave a cell of the total map; one letter, as in the manifest."""

    SOLVED = "s"
    ZERO = "z"
    HOLD = "h"
    PASSIVE_SLOPE = "p"
    BETWEEN = "i"
    NEIGHBOUR = "n"
    CONTINUED = "c"


RULE_TEXT = {
    Rule.SOLVED: "as in the map",
    Rule.ZERO: "zero at zero speed or zero front angle",
    Rule.HOLD: "beyond an edge set by grip: ay_cap / speed",
    Rule.PASSIVE_SLOPE: "beyond an edge set by sideslip or rear angle, or beyond the last angle: on with the passive gain",
    Rule.BETWEEN: "infeasible between feasible cells: interpolated over the front angle",
    Rule.NEIGHBOUR: "no feasible cell at this speed: interpolated between the neighbouring speeds",
    Rule.CONTINUED: "above the cap, which cuts it off: the optimum without the bounds on grip (nonlinear tyre: its slope)",
}


@dataclass(frozen=True)
class CapSteering:
    """Rear steering for the yaw rate that the cap removes: 1/G = L/vx + K vx rad for each rad/s.

    Attributes:
        wheelbase: L, m. understeer_coefficient: K, s^2/m.
        rear_arm: m, and rear_slip_per_lateral_acceleration: rad s^2/m, of the sideslip beta = delta_r + r (lr/vx - slip vx);
            for a nonlinear optimum, that of `placement_grip.GripSurfaces`.
        sideslip_max: rad; such steering ends where the steady sideslip would reach it.
        rear_angle_max: rad.
    """

    wheelbase: float
    understeer_coefficient: float
    rear_arm: float
    rear_slip_per_lateral_acceleration: float
    sideslip_max: float
    rear_angle_max: float

    @classmethod
    def from_config(cls, config: Config) -> CapSteering:
        """Return the values of a configuration's car and limits."""
        car = SingleTrack.from_config(config)
        return cls(
            car.wheelbase,
            car.understeer_coefficient,
            car.rear_arm,
            car.rear_slip_per_lateral_acceleration,
            config.limits.sideslip_max,
            min(config.limits.rear_angle_max, config.rear_actuator.angle_max),
        )


@dataclass(frozen=True)
class GripTable:
    """Fraction of ay_cap that grip leaves, bilinear.

    Attributes:
        speed: (a,) m/s, front_angle: (b,) rad, both from zero. share: (a, b), above 0 and up to 1.
        scale: of shares that are stored as int16, as in `TotalMap.scales`; None for real numbers.
    """

    speed: FloatArray
    front_angle: FloatArray
    share: FloatArray
    scale: float | None = None


@dataclass(frozen=True)
class TotalMap:
    """A map over the whole domain of an ECU.

    Attributes:
        speed: (n,) m/s, from 0. front_angle: (m,) rad, from 0 to the mechanical stop or beyond.
        yaw_rate: (n, m) rad/s, before the cap.
        rear_angle: (n, m) rad, before the cap, which on placed breakpoints may exceed the actuator's range; the laws clip it.
        rule: (n, m) of `Rule` letters.
        lateral_acceleration_cap: ay_cap, m/s^2.
        friction: the road friction that the map assumes.
        acceleration: the longitudinal acceleration that it assumes, m/s^2, negative while the car brakes.
        axle_shares: lateral peaks of the front and of the rear axle, as fractions of those at constant speed.
        steering: constants of the lookup where the cap removes yaw rate.
        layers: the total maps of lower frictions, or of other accelerations, on the same axes.
        grip: the share of ay_cap that grip leaves, where that is not the same everywhere; of a stack on the same axes.
        scales: of tables that are stored as int16, whose numbers here are then the stored ones; None for real numbers.
    """

    speed: FloatArray
    front_angle: FloatArray
    yaw_rate: FloatArray
    rear_angle: FloatArray
    rule: npt.NDArray[np.str_]
    lateral_acceleration_cap: float
    friction: float
    steering: CapSteering
    layers: tuple[TotalMap, ...] = ()
    scales: Scales | None = None
    grip: GripTable | None = None
    acceleration: float = 0.0
    axle_shares: tuple[float, float] = (1.0, 1.0)

    @property
    def stack(self) -> tuple[TotalMap, ...]:
        """All total maps, rising by friction or by acceleration."""
        return tuple(sorted((*self.layers, self), key=lambda layer: (layer.friction, layer.acceleration)))

    @property
    def quantity(self) -> Stack | None:
        """Quantity of the stack; None without layers."""
        if not self.layers:
            return None
        return ACCELERATION_STACK if any(layer.acceleration for layer in self.layers) else FRICTION_STACK

    @classmethod
    def of_stack(cls, maps: Iterable[TotalMap]) -> TotalMap:
        """Return the map at constant speed on the road of the highest friction, with the others as its layers."""
        *layers, own = sorted(maps, key=lambda layer: (layer.acceleration == 0.0, layer.friction))
        return replace(own, layers=tuple(layers))
