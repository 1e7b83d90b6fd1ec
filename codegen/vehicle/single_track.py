"""The linear single-track car in steady state.

With axle cornering stiffnesses C_f and C_r (both tyres) the steady turn is affine in the steering angles:

    r    = G (delta_f - delta_r),              G = vx / (L + K vx^2),  K = m/L (lr/C_f - lf/C_r)
    beta = delta_r + r b,                      b = lr/vx - m vx lf/(L C_r)
    alpha_f = -m vx r lr/(L C_f),  alpha_r = -m vx r lf/(L C_r)

(R. Rajamani, Vehicle Dynamics and Control, sections 2.6 and 3.3, with the second steered axle added.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.vehicle.tyre import AxleTyres


@dataclass(frozen=True)
class SingleTrack:
    """Linear single-track car, SI units; stiffnesses are of whole axles (N/rad)."""

    mass: float
    yaw_inertia: float
    front_arm: float
    rear_arm: float
    front_stiffness: float
    rear_stiffness: float

    @classmethod
    def from_config(cls, config: Config, tyres: AxleTyres | None = None) -> SingleTrack:
        """The car of a configuration, its tyres linearised at zero slip."""
        tyres = AxleTyres.from_config(config) if tyres is None else tyres
        vehicle = config.vehicle
        return cls(
            mass=vehicle.mass_kg,
            yaw_inertia=vehicle.yaw_inertia_kg_m2,
            front_arm=vehicle.cg_to_front_axle_m,
            rear_arm=vehicle.cg_to_rear_axle_m,
            front_stiffness=2.0 * tyres.front.cornering_stiffness,
            rear_stiffness=2.0 * tyres.rear.cornering_stiffness,
        )

    @property
    def wheelbase(self) -> float:
        """L in m."""
        return self.front_arm + self.rear_arm

    @property
    def understeer_coefficient(self) -> float:
        """K in s^2/m (rad per m/s^2); negative for an oversteering car."""
        return self.mass / self.wheelbase * (self.rear_arm / self.front_stiffness - self.front_arm / self.rear_stiffness)

    @property
    def critical_speed(self) -> float:
        """Speed in m/s beyond which an oversteering car is unstable; inf for a neutral or understeering one."""
        coefficient = self.understeer_coefficient
        return math.sqrt(self.wheelbase / -coefficient) if coefficient < 0.0 else math.inf

    def yaw_gain(self, speed: npt.ArrayLike) -> FloatArray:
        """G in 1/s: steady yaw rate for each rad of front angle, for speeds (m/s, any shape) above zero."""
        vx = np.asarray(speed, dtype=np.float64)
        result: FloatArray = vx / (self.wheelbase + self.understeer_coefficient * vx * vx)
        return result

    def sideslip_per_yaw_rate(self, speed: npt.ArrayLike) -> FloatArray:
        """b in s, for speeds (m/s, any shape) above zero: beta = delta_r + b r."""
        vx = np.asarray(speed, dtype=np.float64)
        result: FloatArray = self.rear_arm / vx - self.mass * vx * self.front_arm / (self.wheelbase * self.rear_stiffness)
        return result

    @property
    def front_slip_per_lateral_acceleration(self) -> float:
        """|alpha_f / ay| in rad s^2/m in a steady turn."""
        return self.mass * self.rear_arm / (self.wheelbase * self.front_stiffness)

    @property
    def rear_slip_per_lateral_acceleration(self) -> float:
        """|alpha_r / ay| in rad s^2/m in a steady turn."""
        return self.mass * self.front_arm / (self.wheelbase * self.rear_stiffness)
