"""Measured drives on a uniform time grid, in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from codegen.arrays import FloatArray


@dataclass(frozen=True)
class Drive:
    """One measured drive.

    Attributes:
        name: name of the log, for messages.
        time: (n,) s, uniform.
        signals: quantity -> (n,) in its SI unit; NaN where no value is known. Quantities: "vx" m/s, "yaw_rate" rad/s,
            "lateral_acceleration" m/s^2, "steering_wheel_angle" rad, "delta_f" rad, "delta_r" rad, "delta_r_command" rad,
            "sideslip" rad.
    """

    name: str
    time: FloatArray
    signals: Mapping[str, FloatArray]
