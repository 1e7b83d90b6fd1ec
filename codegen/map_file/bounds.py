"""What can bind in a map: one list for the solvers, the `active` flags of the map file, the report and the explorer."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any


class Binding(enum.IntFlag):
    """Set of the bounds that bind in a cell; several may be reached together."""

    NONE = 0
    SIDESLIP = 1
    LATERAL_ACCELERATION = 2
    SLIP_FRONT = 4
    SLIP_REAR = 8
    REAR_ANGLE = 16
    ENVELOPE_YAW_RATE = 32
    ENVELOPE_SIDESLIP = 64
    FLOOR = 128


@dataclass(frozen=True)
class TurnQuantities:
    """Quantities of a steady turn, or their derivatives: numbers, arrays or CasADi expressions. SI units, rad."""

    speed: Any
    front_angle: Any
    yaw_rate: Any
    sideslip: Any
    slip_front: Any
    slip_rear: Any
    rear_angle: Any

    @property
    def lateral_acceleration(self) -> Any:
        """Steady lateral acceleration vx r in m/s^2."""
        return self.speed * self.yaw_rate


@dataclass(frozen=True)
class Mark:
    """What can bind in a cell.

    Attributes:
        flag: bit in `active`.
        label: name in texts and legends.
        colour: colour of the cells in which it alone binds.
        key: key of the case, or of `[limits]`, that switches it on; "" for a bound of every map.
    """

    flag: Binding
    label: str
    colour: str
    key: str = field(default="", kw_only=True)


@dataclass(frozen=True)
class Bound(Mark):
    """One bound, |value| <= limit.

    Attributes:
        unit: SI unit of value and limit.
        limit: attribute of `optimum.problem.SteadyTurnProblem` with the limit; infinite where there is none.
        value: the bounded quantity. It must be linear in all quantities but the speed, so that the same function gives its
            derivatives, and must not rise with the yaw rate unless `is_yaw_rate`.
        is_grip: the value of the linear car is proportional to the lateral acceleration.
        is_yaw_rate: the value is proportional to the yaw rate at each speed.
        is_variable: the value is a variable of IPOPT, which bounds it directly.
    """

    unit: str
    limit: str
    value: Callable[[TurnQuantities], Any]
    is_grip: bool = False
    is_yaw_rate: bool = False
    is_variable: bool = False


BOUNDS = (
    Bound(Binding.SIDESLIP, "sideslip", "#E69F00", "rad", "sideslip_max", lambda turn: turn.sideslip, is_variable=True),
    Bound(
        Binding.LATERAL_ACCELERATION,
        "lateral acceleration",
        "#009E73",
        "m/s^2",
        "lateral_acceleration_max",
        lambda turn: turn.lateral_acceleration,
        is_grip=True,
        is_yaw_rate=True,
    ),
    Bound(Binding.SLIP_FRONT, "front grip", "#CC79A7", "rad", "front_slip_max", lambda turn: turn.slip_front, is_grip=True),
    Bound(Binding.SLIP_REAR, "rear grip", "#56B4E9", "rad", "rear_slip_max", lambda turn: turn.slip_rear, is_grip=True),
    Bound(Binding.REAR_ANGLE, "rear angle", "#0072B2", "rad", "rear_angle_max", lambda turn: turn.rear_angle, is_variable=True),
    # The stable handling envelope (C. E. Beal, J. C. Gerdes, Model Predictive Control for Vehicle Stabilization at the Limits
    # of Handling, IEEE Trans. Control Systems Technology 21(4), 2013): |r| is at most what the rear axle can hold in a steady
    # turn, and |beta - lr r/vx| at most the slip at which the rear tyre saturates: it would not with its wheels straight.
    Bound(
        Binding.ENVELOPE_YAW_RATE,
        "yaw-rate envelope",
        "#117733",
        "m/s^2",
        "envelope_lateral_acceleration_max",
        lambda turn: turn.lateral_acceleration,
        is_grip=True,
        is_yaw_rate=True,
        key="envelope",
    ),
    Bound(
        Binding.ENVELOPE_SIDESLIP,
        "sideslip envelope",
        "#7F3C8D",
        "rad",
        "envelope_rear_slip_max",
        lambda turn: turn.slip_rear + turn.rear_angle,
        key="envelope",
    ),
)
"""All bounds, by rising flag."""

MARKS = (*BOUNDS, Mark(Binding.FLOOR, "floor", "#8B5A2B", key="yaw_gain_floor"))
"""All that can bind, by rising flag. The cap of the nonlinear tyre (`optimum.demand`) is one of the lateral acceleration."""


def binding_text(flags: int) -> str:
    """Name a set of binding bounds, such as "front slip + rear slip"; "none" for an optimum inside all of them."""
    return " + ".join(bound.label for bound in MARKS if flags & bound.flag) or "none"
