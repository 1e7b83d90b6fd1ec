"""Magic Formula tyre, its cornering stiffness and its linear range, and the shapes of the force over the slip angle.

The formula gives the *magnitude-signed* force F(alpha), rising with slip. With the slip angles of the paper,
alpha = beta + ... - delta, the force on the car is Fy = -F(alpha); the models in `dynamics` apply that sign. The shapes are one
list for numbers, for CasADi and for the solvers: a curve runs from -1 to 1 over X = B (alpha - S_H), and the force is D times
its value.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config, Tyre
from codegen.errors import ConfigError

STEPS_MAX = 200


def bracketed_root(
    function: Callable[[float], float], low: float, high: float, atol: float = 1e-15, rtol: float = 1e-14
) -> float:
    """Return the root between `low` and `high`, where the function has opposite signs.

    R. P. Brent, Algorithms for Minimization without Derivatives, chapter 4: secant or inverse quadratic steps as long as they
    shrink fast enough, else bisection. It ends with the root within atol + rtol |x|.
    """
    # The iterate before, the best one, and the end on the other side of the root; each with its value.
    before, best = (low, function(low)), (high, function(high))
    other = before
    last = step = high - low
    for _ in range(STEPS_MAX):
        if (before[1] < 0.0) != (best[1] < 0.0):
            other = before
            last = step = best[0] - before[0]
        if abs(other[1]) < abs(best[1]):
            before, best, other = best, other, best
        near = 0.5 * (atol + rtol * abs(best[0]))
        half = 0.5 * (other[0] - best[0])
        if best[1] == 0.0 or abs(half) < near:
            break
        tried = half
        if abs(last) > near and abs(best[1]) < abs(before[1]):
            tried = _extrapolated(before, best, other)
        shrinks = 2.0 * abs(tried) < min(abs(last), 3.0 * abs(half) - near)
        last, step = (step, tried) if shrinks else (half, half)
        before = best
        moved = step if abs(step) > near else (near if half > 0.0 else -near)
        best = (best[0] + moved, function(best[0] + moved))
    return best[0]


def _extrapolated(before: tuple[float, float], best: tuple[float, float], other: tuple[float, float]) -> float:
    """Step from the best point to the root of the line through two points, or of the inverse parabola through three."""
    if before[0] == other[0]:
        return -best[1] * (best[0] - before[0]) / (best[1] - before[1])
    slope = (before[1] - best[1]) / (before[0] - best[0])
    slope_other = (other[1] - best[1]) / (other[0] - best[0])
    # Zero differences only where the values repeat, far below what the tolerance resolves: any step is then refused.
    below = slope_other * slope * (other[1] - before[1])
    return -best[1] * (other[1] * slope_other - before[1] * slope) / below if below != 0.0 else float("inf")


class CurveFactors(Protocol):
    """Factors of a tyre that a curve may use: numbers or CasADi symbols; see `tyre.MagicFormulaTyre`."""

    @property
    def stiffness_factor(self) -> Any:
        """B in 1/rad."""

    @property
    def shape_factor(self) -> Any:
        """C."""

    @property
    def curvature_factor(self) -> Any:
        """E."""


@dataclass(frozen=True)
class TyreCurve:
    """One curve.

    Attributes:
        value: (factors, X, functions) -> value, where `functions` is numpy or casadi.
        value_and_slope: (factors, X) -> value and its derivative by the slip angle in 1/rad, for arrays.
        tabulated: (factors, X) -> value for arrays, also at infinite X.
        initial_slope: factors -> derivative by X at zero.
        peak: factors -> X of the largest value, infinite where the curve rises throughout.
    """

    value: Callable[[CurveFactors, Any, Any], Any]
    value_and_slope: Callable[[CurveFactors, FloatArray], tuple[FloatArray, FloatArray]]
    tabulated: Callable[[CurveFactors, FloatArray], FloatArray]
    initial_slope: Callable[[CurveFactors], Any]
    peak: Callable[[CurveFactors], float]


def _magic_formula(tyre: CurveFactors, x: Any, functions: Any) -> Any:
    bent = x - tyre.curvature_factor * (x - functions.arctan(x))
    return functions.sin(tyre.shape_factor * functions.arctan(bent))


def _magic_formula_and_slope(tyre: CurveFactors, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    b, c, e = tyre.stiffness_factor, tyre.shape_factor, tyre.curvature_factor
    bent = x - e * (x - np.arctan(x))
    angle = c * np.arctan(bent)
    slope = np.cos(angle) * (b * c) * (1.0 - e + e / (1.0 + x * x)) / (1.0 + bent * bent)
    return np.sin(angle), slope


def _magic_formula_tabulated(tyre: CurveFactors, x: FloatArray) -> FloatArray:
    straight = (1.0 - tyre.curvature_factor) * x if tyre.curvature_factor < 1.0 else 0.0
    value: FloatArray = np.sin(tyre.shape_factor * np.arctan(straight + tyre.curvature_factor * np.arctan(x)))
    return value


def _magic_formula_peak(tyre: CurveFactors) -> float:
    """Solve C atan(X - E (X - atan X)) = pi/2 for X."""
    if tyre.shape_factor <= 1.0:
        return math.inf
    bent, e = math.tan(0.5 * math.pi / tyre.shape_factor), tyre.curvature_factor
    if e == 1.0:
        return math.tan(bent) if bent < 0.5 * math.pi else math.inf
    # X - E (X - atan X) rises by at least the smaller of 1 and 1 - E, and by at most the larger one.
    return bracketed_root(lambda x: x - e * (x - math.atan(x)) - bent, 0.0, bent / min(1.0, 1.0 - e))


MAGIC_FORMULA = TyreCurve(
    value=_magic_formula,
    value_and_slope=_magic_formula_and_slope,
    tabulated=_magic_formula_tabulated,
    initial_slope=lambda tyre: tyre.shape_factor,
    peak=_magic_formula_peak,
)

CURVES = {"magic-formula": MAGIC_FORMULA}
"""All curves, by `configuration.Tyre.curve`."""


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

    def slip_at_use(self, use: float) -> float:
        """Return the smallest slip angle in rad, without shifts, at which the force is a share `use` of its largest one.

        Load and friction do not move it: both scale the whole curve. A tyre without a peak counts up to 45 degrees.
        """
        peak = min(self.peak_slip, SLIP_SEARCH_MAX)
        wanted = use * float(self._shape(np.array(peak)))
        return bracketed_root(lambda slip: float(self._shape(np.array(slip))) - wanted, 0.0, peak)

    def use_at_slip(self, slip_angle: float) -> float:
        """Return the largest force up to a slip angle in rad, without shifts, over the largest one; see `slip_at_use`."""
        peak = min(self.peak_slip, SLIP_SEARCH_MAX)
        return float(self._shape(np.array(min(slip_angle, peak))) / self._shape(np.array(peak)))

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
    """The tyre of each axle, with the slip angles in rad that end its linear range and, where configured, its use of grip.

    Attributes:
        front_slip_bound, rear_slip_bound: end of the linear range, or of what the drives of an identification reached of it.
        grip_slips: of front and rear axle, where they use `limits.grip_use_max` of their grip; None without that key.
    """

    front: MagicFormulaTyre
    rear: MagicFormulaTyre
    front_slip_bound: float
    rear_slip_bound: float
    grip_slips: tuple[float, float] | None

    @classmethod
    def from_config(cls, config: Config) -> AxleTyres:
        """Return the tyres at the static wheel loads of the car.

        Raises:
            ConfigError: a tyre has no end to its linear range (see `slip_bound`), and its use of grip is not bounded either.
        """
        limits, friction = config.limits, config.road.friction
        front, rear = (
            MagicFormulaTyre.from_config(tyre, load, friction)
            for tyre, load in zip((config.tyre.front, config.tyre.rear), static_wheel_loads(config), strict=True)
        )
        departure = limits.slip_departure_percent / 100.0
        known = grip_known(config)
        if limits.grip_use_max is None:
            bounds = [
                min(tyre.slip_bound(departure, f"tyre.{axle}"), known_slip(tyre, share))
                for axle, tyre, share in zip(("front", "rear"), (front, rear), known, strict=True)
            ]
            return cls(front, rear, bounds[0], bounds[1], None)
        # The force of an axle over its largest one is the tyre's curve, whatever load, load transfer and friction are.
        grip = [tyre.slip_at_use(limits.grip_use_max * share) for tyre, share in zip((front, rear), known, strict=True)]
        linear = [
            min(_slip_bound(tyre, departure) or math.inf, known_slip(tyre, share))
            for tyre, share in zip((front, rear), known, strict=True)
        ]
        return cls(front, rear, linear[0], linear[1], (grip[0], grip[1]))

    @property
    def slip_limits(self) -> tuple[float, float]:
        """Slip angles in rad of front and rear axle that bound a map: use of grip (nonlinear tyre), else the linear range."""
        return self.grip_slips or (self.front_slip_bound, self.rear_slip_bound)


def grip_known(config: Config) -> tuple[float, float]:
    """Return the shares of its largest lateral force that the front and the rear axle are known to carry.

    Below one where the drives of an identification did not reach that force.
    """
    return config.identified.front_grip_reached, config.identified.rear_grip_reached


def known_slip(tyre: MagicFormulaTyre, share: float) -> float:
    """Return the slip angle in rad up to which a curve is known, if drives reached a share of its largest force: all if 1."""
    return tyre.slip_at_use(share) if share < 1.0 else math.inf


def slip_bounds(config: Config) -> tuple[float, float] | None:
    """Return the slip bounds of front and rear axle in a map of the configured car, in rad; None for tyres without bounds."""
    try:
        return AxleTyres.from_config(config).slip_limits
    except ConfigError:  # nearly linear tyres; a map from another tool needs no bound
        return None


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
