"""The paper's optimisation problem at one operating point, and the grid on which it is solved.

    minimise over delta_r   -r^2 + weight * beta^2
    subject to              steady state, |beta| <= beta_max, |vx r| <= ay_max,
                            |alpha_f| <= alpha_f_max, |alpha_r| <= alpha_r_max, |delta_r| <= delta_r_max

A case may add the bounds of the stable handling envelope (`map_file.bounds`), or follow a law instead (`rear_law`). The solvers
(`exact`, `nonlinear`, `ipopt`) all solve this problem.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Case, Config
from codegen.errors import ConfigError
from codegen.map_file.bounds import BOUNDS, Bound, TurnQuantities
from codegen.optimum.demand import Floor
from codegen.optimum.rear_law import STRAIGHT, RearLaw, law_of
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

BINDING_TOLERANCE = 1e-6
"""A constraint binds where it is used to within this share of its bound (the front and rear slip bounds of the paper's car
are reached together up to rounding, so binding constraints are a set)."""


CRITICAL_SPEED_SHARE = 0.98
"""Largest speed of a map as a fraction of an oversteering car's critical speed."""

STABILITY_MARGIN = 1.0 - CRITICAL_SPEED_SHARE**2
"""The same for a turn: the rear angle must fall with the yaw rate by at least this share of the neutral car's L/vx. With linear
tyres it falls by 1/G = (L/vx) (1 - (vx/critical speed)^2)."""


PEAK_SHARE = 0.9
"""Largest slip bound of the nonlinear tyre, as a fraction of the slip angle of peak force. More slip hardly adds force."""


@dataclass(frozen=True)
class SteadyTurnProblem:
    """Car, bounds (SI, rad) and weight (1/s^2) of one case. `rear_angle_max` is 0 where the rear wheels do not steer.

    `law` gives the turn instead of the optimisation; None for an optimisation. `floor` raises its yaw rate, and with `is_bent`
    it bends towards the largest lateral acceleration (see `demand`).
    """

    car: SingleTrack
    sideslip_max: float
    lateral_acceleration_max: float
    front_slip_max: float
    rear_slip_max: float
    rear_angle_max: float
    sideslip_weight: float
    envelope_lateral_acceleration_max: float = math.inf
    envelope_rear_slip_max: float = math.inf
    law: RearLaw | None = None
    floor: Floor | None = None
    is_bent: bool = False

    @classmethod
    def from_config(cls, config: Config, case: Case) -> SteadyTurnProblem:
        """The problem of one case, with `[tightening]`. Raises ConfigError where the tyre has no end to its linear range."""
        tyres = AxleTyres.from_config(config)
        car = SingleTrack.from_config(config, tyres)
        capacity, rear_slip = _envelope(config, tyres.rear) if case.envelope else (math.inf, math.inf)
        slips, is_bent = _slips(tyres, case), case.tyre_model != "linear" and tyres.grip_slips is not None
        whole = cls(
            car=car,
            sideslip_max=config.limits.sideslip_max,
            lateral_acceleration_max=config.limits.lateral_acceleration_max_g * config.road.gravity_m_s2,
            front_slip_max=slips[0],
            rear_slip_max=slips[1],
            rear_angle_max=config.limits.rear_angle_max if case.rear_steering else 0.0,
            sideslip_weight=case.sideslip_weight_per_s2,
            envelope_lateral_acceleration_max=capacity,
            envelope_rear_slip_max=rear_slip,
            law=law_of(case, car, config.grid.last_speed_km_h * KM_H),
            floor=Floor.of(config.limits, config.vehicle.wheelbase),
            is_bent=is_bent,
        )
        tightened: dict[str, Any] = {bound.limit: fraction_of(config, bound) * whole.limit_of(bound) for bound in BOUNDS}
        return replace(whole, **tightened)

    @property
    def given(self) -> RearLaw | None:
        """Law that leaves nothing to optimise: that of the case, or straight rear wheels; None for an optimisation."""
        return self.law if self.rear_angle_max > 0.0 else STRAIGHT

    def without_rear_steering(self) -> SteadyTurnProblem:
        """Return the problem of the same car with its rear wheels straight."""
        return replace(self, rear_angle_max=0.0, law=None)

    @property
    def lateral_acceleration_cap(self) -> float:
        """ay_cap in m/s^2: the largest steady lateral acceleration that the grip bounds allow."""
        unit = self.linear_turn(1.0, 0.0, 1.0, 0.0, 0.0)
        return min(self.limit_of(bound) / abs(float(bound.value(unit))) for bound in BOUNDS if bound.is_grip)

    def limit_of(self, bound: Bound) -> float:
        """Return the limit of a bound, in its unit."""
        return float(getattr(self, bound.limit))

    def linear_turn(self, speed: Any, front_angle: Any, yaw_rate: Any, sideslip: Any, rear_angle: Any) -> TurnQuantities:
        """Return the quantities of a steady turn with linear tyres, SI units; the slip angles follow from the others."""
        lateral_acceleration = speed * yaw_rate
        slip_front = -lateral_acceleration * self.car.front_slip_per_lateral_acceleration
        slip_rear = -lateral_acceleration * self.car.rear_slip_per_lateral_acceleration
        return TurnQuantities(speed, front_angle, yaw_rate, sideslip, slip_front, slip_rear, rear_angle)


def _slips(tyres: AxleTyres, case: Case) -> tuple[float, float]:
    """Return the slip bounds in rad of front and rear axle.

    Those of the linear tyre end its linear range. Those of the nonlinear tyre are the configured use of grip or, without it,
    the same as of the linear tyre, at most PEAK_SHARE of the slip at which the force is largest.

    Raises:
        ConfigError: a linear tyre has no end to its linear range.
    """
    if case.tyre_model == "linear":
        if math.isinf(max(tyres.front_slip_bound, tyres.rear_slip_bound)):
            raise ConfigError(
                "a tyre without an end to its linear range has no slip bound",
                where="limits.slip_departure_percent",
                remedy='lower it, or take tyre_model = "magic-formula"',
            )
        return tyres.front_slip_bound, tyres.rear_slip_bound
    front, rear = tyres.slip_limits
    if tyres.grip_slips is None:
        front, rear = min(front, PEAK_SHARE * tyres.front.peak_slip), min(rear, PEAK_SHARE * tyres.rear.peak_slip)
    return front, rear


def fraction_of(config: Config, bound: Bound) -> float:
    """Return the fraction of a limit that `[tightening]` leaves to the map; 1 for a bound without a key there."""
    return float(getattr(config.tightening, bound.limit, 1.0))


def _envelope(config: Config, rear: MagicFormulaTyre) -> tuple[float, float]:
    """Return the limits of the stable handling envelope: lateral acceleration in m/s^2, and slip of the rear axle in rad.

    In a steady turn the rear axle holds m ay lf/L, at most 2 D of its tyres. Without a key of its own, the slip is that of the
    largest force; infinite where the force rises throughout.
    """
    vehicle, slip = config.vehicle, config.limits.envelope_rear_slip_deg
    force = 2.0 * rear.peak(rear.static_load, rear.nominal_friction)
    capacity = force * vehicle.wheelbase / (vehicle.mass_kg * vehicle.cg_to_front_axle_m)
    return capacity, rear.peak_slip if slip is None else math.radians(slip)


def breakpoints(config: Config) -> tuple[FloatArray, FloatArray]:
    """Speeds (n,) in m/s and front angles (m,) in rad of the configured grid.

    Raises:
        ConfigError: the grid reaches the speed at which an oversteering car becomes unstable, where no steady turn is safe.
    """
    grid = config.grid
    if grid.speed_breakpoints_km_h is not None:
        speed = np.asarray(grid.speed_breakpoints_km_h) * KM_H
    else:
        speed = np.linspace(grid.speed_min_km_h, grid.speed_max_km_h, grid.speed_points) * KM_H
    if grid.front_angle_breakpoints_deg is not None:
        front_angle = np.deg2rad(np.asarray(grid.front_angle_breakpoints_deg))
    else:
        front_angle = np.deg2rad(np.linspace(grid.front_angle_min_deg, grid.front_angle_max_deg, grid.front_angle_points))
    critical = SingleTrack.from_config(config).critical_speed
    highest = CRITICAL_SPEED_SHARE * critical
    if math.isfinite(critical) and speed[-1] >= highest:
        raise ConfigError(
            f"the car oversteers and is unstable from {critical / KM_H:.1f} km/h",
            where="grid.speed_max_km_h",
            remedy=f"keep it below {highest / KM_H:.0f} km/h, or check the tyre stiffnesses and the centre of gravity",
        )
    return speed, front_angle
