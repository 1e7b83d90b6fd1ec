"""Magic Formula tyre, its cornering stiffness and its linear range.

The formula gives the *magnitude-signed* force F(alpha), rising with slip. With the slip angles of the paper,
alpha = beta + ... - delta, the force on the car is Fy = -F(alpha); the models in `dynamics` apply that sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config, Tyre
from codegen.errors import ConfigError
from codegen.vehicle.curves import CURVES, MAGIC_FORMULA, TyreCurve, bracketed_root

SLIP_SEARCH_MAX = math.radians(45.0)
SLIP_SEARCH_POINTS = 2000


WHEEL_SPEED_MIN = 0.5
"""Lower limit in m/s of the rolling speed from which the plant computes slip angles. Their quotient is unbounded at zero."""


@dataclass(frozen=True)
class MagicFormulaTyre:
    """One tyre (H. B. Pacejka, Tire and Vehicle Dynamics, section 4.3; paper, equation of the magic formula).

    Attributes:
        stiffness_factor: B, 1/rad; fixed when load or friction change.
        shape_factor: C.
        curvature_factor: E.
        peak_factor: p1, and
        peak_load_sensitivity: p2, of D = friction * (p1 + p2 * dFz) * Fz with dFz = Fz/static_load - 1.
        horizontal_shift: S_H, rad; the formula's argument is alpha - S_H, as the paper has it.
        vertical_shift: S_V, N.
        static_load: Fz0, N.
        curve: shape of the force.
        nominal_friction: the friction at which `cornering_stiffness` and the slip bound are taken.
    """

    stiffness_factor: float
    shape_factor: float
    curvature_factor: float
    peak_factor: float
    peak_load_sensitivity: float
    horizontal_shift: float
    vertical_shift: float
    static_load: float
    nominal_friction: float
    curve: TyreCurve = MAGIC_FORMULA

    @classmethod
    def from_config(cls, tyre: Tyre, static_load: float, nominal_friction: float) -> MagicFormulaTyre:
        """Resolve B from the cornering stiffness if that is given: B = C_alpha/(C D), at static load (N) and friction."""
        peak = nominal_friction * tyre.peak_factor_p1 * static_load
        factor = tyre.stiffness_factor_b_per_rad
        resolved = cls(
            stiffness_factor=1.0 if factor is None else factor,
            shape_factor=tyre.shape_factor_c,
            curvature_factor=tyre.curvature_factor_e,
            peak_factor=tyre.peak_factor_p1,
            peak_load_sensitivity=tyre.peak_load_sensitivity_p2,
            horizontal_shift=math.radians(tyre.horizontal_shift_deg),
            vertical_shift=tyre.vertical_shift_n,
            static_load=static_load,
            nominal_friction=nominal_friction,
            curve=CURVES[tyre.curve],
        )
        if tyre.cornering_stiffness_n_per_rad is None:
            return resolved
        slope = float(resolved.curve.initial_slope(resolved))
        return replace(resolved, stiffness_factor=tyre.cornering_stiffness_n_per_rad / (slope * peak))

    def peak(self, load: float, friction: float) -> float:
        """D in N at a wheel load (N) and friction; zero where the load sensitivity would make it negative."""
        relative = self.peak_factor + self.peak_load_sensitivity * (load / self.static_load - 1.0)
        return friction * max(relative, 0.0) * load

    @property
    def cornering_stiffness(self) -> float:
        """C_alpha in N/rad (B C D): slope at zero slip, static load and nominal friction, without shifts."""
        slope = self.stiffness_factor * float(self.curve.initial_slope(self))
        return slope * self.peak(self.static_load, self.nominal_friction)

    @property
    def peak_slip(self) -> float:
        """Slip angle in rad, without shifts, at which the force is largest.

        Load and friction do not move it. inf where the force rises all the way.
        """
        return self.curve.peak(self) / self.stiffness_factor

    def force(self, slip_angle: npt.ArrayLike, load: float | None = None, friction: float | None = None) -> FloatArray:
        """F in N for slip angles (rad, any shape) with the shifts; load and friction default to static and nominal."""
        load = self.static_load if load is None else load
        friction = self.nominal_friction if friction is None else friction
        slip = np.asarray(slip_angle, dtype=np.float64) - self.horizontal_shift
        return self._shape(slip) * self.peak(load, friction) + self.vertical_shift

    def _shape(self, slip: FloatArray) -> FloatArray:
        result: FloatArray = self.curve.value(self, self.stiffness_factor * slip, np)
        return result

    def departure(self, slip_angle: npt.ArrayLike) -> FloatArray:
        """|F/(C_alpha alpha) - 1| at static load without shifts, for slip angles (rad) other than zero."""
        slip = np.asarray(slip_angle, dtype=np.float64)
        result: FloatArray = np.abs(self._shape(slip) / (self.stiffness_factor * self.curve.initial_slope(self) * slip) - 1.0)
        return result

    def slip_bound(self, departure: float, where: str = "tyre") -> float:
        """Return the smallest slip angle (rad) at which F departs from its tangent at zero by `departure` (0.1 for 10 %).

        This is the bound alpha_bar of the paper. Static load, nominal friction, no shifts.

        Args:
            departure: share, above zero.
            where: the place that an error names.

        Raises:
            ConfigError: the tyre stays within `departure` of its tangent up to 45 degrees.
        """
        found = _slip_bound(self, departure)
        if found is None:
            raise ConfigError(
                f"the tyre never departs {100.0 * departure:.3g} % from its tangent below 45 deg of slip",
                where=where,
                remedy="check its Magic Formula factors or lower limits.slip_departure_percent",
            )
        return found


# One configuration asks for the same bound in many places.
@lru_cache(maxsize=64)
def _slip_bound(tyre: MagicFormulaTyre, departure: float) -> float | None:
    """See `MagicFormulaTyre.slip_bound`; None where there is none."""
    slips = np.linspace(0.0, SLIP_SEARCH_MAX, SLIP_SEARCH_POINTS + 1)[1:]
    beyond = np.flatnonzero(tyre.departure(slips) >= departure)
    if not beyond.size:
        return None
    high = float(slips[beyond[0]])
    low = 0.5 * SLIP_SEARCH_MAX / SLIP_SEARCH_POINTS if beyond[0] == 0 else float(slips[beyond[0] - 1])
    while tyre.departure(low) >= departure:
        low *= 0.5
    return bracketed_root(lambda slip: float(tyre.departure(slip)) - departure, low, high)


@dataclass(frozen=True)
class AxleTyres:
    """The tyre of each axle with its slip bound in rad."""

    front: MagicFormulaTyre
    rear: MagicFormulaTyre
    front_slip_bound: float
    rear_slip_bound: float

    @classmethod
    def from_config(cls, config: Config) -> AxleTyres:
        """Return the tyres at the static wheel loads of the car. Raises ConfigError (see `slip_bound`)."""
        front_load, rear_load = static_wheel_loads(config)
        friction = config.road.friction
        front = MagicFormulaTyre.from_config(config.tyre.front, front_load, friction)
        rear = MagicFormulaTyre.from_config(config.tyre.rear, rear_load, friction)
        departure = config.limits.slip_departure_percent / 100.0
        return cls(front, rear, front.slip_bound(departure, "tyre.front"), rear.slip_bound(departure, "tyre.rear"))


def load_transfer_per_lateral_acceleration(config: Config) -> tuple[float, float]:
    """Return the load that moves from the inner to the outer wheel of the front and of the rear axle, N for each m/s^2.

    "moment-balance": rho m h / w and (1 - rho) m h / w, so that w (dFz_f + dFz_r) = m ay h. "paper": as printed, half of it.
    """
    vehicle = config.vehicle
    total = vehicle.mass_kg * vehicle.cg_height_m / vehicle.track_m
    if config.plant.load_transfer == "paper":
        total *= 0.5
    return vehicle.front_roll_share * total, (1.0 - vehicle.front_roll_share) * total


def static_wheel_loads(config: Config) -> tuple[float, float]:
    """Return the load of one front and one rear wheel at rest, N: m g lr/(2 L) and m g lf/(2 L)."""
    vehicle = config.vehicle
    weight = vehicle.mass_kg * config.road.gravity_m_s2
    return (
        weight * vehicle.cg_to_rear_axle_m / (2.0 * vehicle.wheelbase),
        weight * vehicle.cg_to_front_axle_m / (2.0 * vehicle.wheelbase),
    )
