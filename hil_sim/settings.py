"""Values of a manoeuvre that a user may change, and their ranges. The command line imports this module for its help."""

from __future__ import annotations

from dataclasses import dataclass

from codegen.units import KM_H

SPEED_RANGE_KM_H = (1.0, 400.0)
STEERING_WHEEL_ANGLE_RANGE_DEG = (-1500.0, 1500.0)


@dataclass(frozen=True)
class Settings:
    """Values that a user may change; None keeps those of the manoeuvre or the configuration."""

    speed_km_h: float | None = None
    steering_wheel_angle_deg: float | None = None
    friction: float | None = None
    friction_estimate: float | None = None

    @property
    def speed(self) -> float:
        """Speed in m/s of a manoeuvre that has one."""
        assert self.speed_km_h is not None  # every manoeuvre that uses it has one
        return self.speed_km_h * KM_H
