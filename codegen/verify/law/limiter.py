"""The safety limiter as its header describes it, in Python, bit for bit.

One number type throughout; the order of the operations is that of the formulas in the header's words.
"""

from __future__ import annotations

import math
from typing import Any


def clip(value: Any, low: Any, high: Any) -> Any:
    """Limit a value. The upper bound wins if the bounds cross; NaN becomes the lower bound."""
    return min(max(value, low), high)


class SecondLimiter:
    """Second implementation of the limiter. `parameters` has the fields of the C parameter struct; `period` in s; initial
    `angle` in rad."""

    def __init__(self, parameters: Any, period: float, real: Any, angle: Any = 0.0) -> None:
        self.real = real
        self.period = real(period)
        self.parameters = parameters
        self.angle = real(angle) if abs(real(angle)) <= 1.0 else real(0.0)
        self.speed: Any = None
        self.front_angle = real(0.0)

    def parameter(self, name: str) -> Any:
        return self.real(getattr(self.parameters, name))

    def step(self, speed: Any, front_angle: Any, demand: Any) -> Any:
        speed, front_angle, demand = (self.real(value) for value in (speed, front_angle, demand))
        if abs(speed) <= self.parameter("speed_max"):
            self.speed = abs(speed)
        if abs(front_angle) <= self.parameter("front_angle_max"):
            self.front_angle = front_angle
        wanted = self.angle
        if self.speed is not None:
            low, high = self.range()
            wanted = clip(wanted if math.isnan(demand) else demand, low, high)
        travel = self.parameter("rear_rate_max") * self.period
        wanted = clip(wanted, self.angle - travel, self.angle + travel)
        bound = self.parameter("rear_angle_max")
        self.angle = clip(wanted, -bound, bound)
        return self.angle

    def range(self) -> tuple[Any, Any]:
        """Return the range of the rear angle in rad at the speed and front angle."""
        opposite = self.opposite_phase_bound()
        share = min(abs(self.front_angle) / self.parameter("in_phase_from_front_angle"), self.real(1.0))
        in_phase = opposite + share * (self.parameter("rear_angle_max") - opposite)
        if self.front_angle < 0.0:
            return -in_phase, opposite
        return -opposite, in_phase if self.front_angle > 0.0 else opposite

    def opposite_phase_bound(self) -> Any:
        speeds, bounds = (
            [self.real(value) for value in getattr(self.parameters, name)]
            for name in ("opposite_phase_speed", "opposite_phase_max")
        )
        if self.speed <= speeds[0]:
            return bounds[0]
        for k in range(1, len(speeds)):
            if self.speed < speeds[k]:
                share = (self.speed - speeds[k - 1]) / (speeds[k] - speeds[k - 1])
                return bounds[k - 1] + share * (bounds[k] - bounds[k - 1])
        return bounds[-1]
