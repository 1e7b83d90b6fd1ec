"""The car while it brakes or accelerates, as the configuration of another car for steady turns at constant speed.

A tyre that brakes has less lateral force left: the friction ellipse leaves an axle the share sqrt(1 - (Fx / D)^2) of its peak D
(H. B. Pacejka, Tire and Vehicle Dynamics, section 3.2). Load moves between the axles by m ax h / L. Both change the peak of an
axle's tyres and nothing else. As on another road (`map.on_road`), the factor B stays, so that cornering stiffness goes with the
peak and the slip bounds stay.

The turn is quasi-steady: the speed counts as constant. Neglected are drag and rolling resistance, the lateral part of the
longitudinal force of the steered wheels, and yaw moments of unequal braking left and right. The peak of each axle is exact for
any lateral load transfer. The share of each of its wheels is not, nor the small moment about the middle of the axle.
"""

from __future__ import annotations

import math

from codegen.configuration import Config
from codegen.errors import ConfigError
from codegen.vehicle.tyre import MagicFormulaTyre, static_wheel_loads

AXLES = ("front", "rear")


def under_acceleration(config: Config, acceleration: float) -> Config:
    """Return the configuration of the car at a longitudinal acceleration in m/s^2, negative while it brakes.

    Raises:
        ConfigError: a wheel lifts, an axle has not enough grip, or a tyre leaves the range of a configuration.
    """
    where = f"at {acceleration:g} m/s^2"
    changes = {}
    moving = force_shares(config, acceleration)
    for axle, load, share in zip(AXLES, static_wheel_loads(config), moving, strict=True):
        moved = load_transfer(config, acceleration) * (-0.5 if axle == "front" else 0.5)
        factor = 1.0 + moved / load
        if factor <= 0.0:
            raise ConfigError(f"the {axle} wheels lift", where=where, remedy="check vehicle.cg_height_m")
        tyre = MagicFormulaTyre.from_config(getattr(config.tyre, axle), load, config.road.friction)
        peak = tyre.peak(load * factor, config.road.friction)
        force = 0.5 * share * config.vehicle.mass_kg * acceleration
        if abs(force) >= peak:
            raise ConfigError(
                f"the {axle} wheels need {abs(force):.0f} N each, and have {peak:.0f} N of grip",
                where=where,
                remedy="check [longitudinal]",
            )
        left = math.sqrt(1.0 - (force / peak) ** 2)
        changes[f"tyre.{axle}"] = {
            "cornering_stiffness_n_per_rad": None,
            "stiffness_factor_b_per_rad": tyre.stiffness_factor,
            # The sum of D over both wheels, load (1 + x) and load (1 - x), is right for every x.
            "peak_factor_p1": left * factor * (tyre.peak_factor + tyre.peak_load_sensitivity * (factor - 1.0)),
            "peak_load_sensitivity_p2": left * tyre.peak_load_sensitivity,
        }
    return config.replace(changes, where)


def like_friction(config: Config, acceleration: float) -> float:
    """Return the friction of a road that leaves the weaker axle as much lateral grip at constant speed.

    Raises ConfigError: see `under_acceleration`.
    """
    return float(config.road.friction * min(axle_shares(config, acceleration)))


def axle_shares(config: Config, acceleration: float) -> tuple[float, float]:
    """Return the lateral peak of the front and of the rear axle as fractions of those at constant speed.

    Raises ConfigError: see `under_acceleration`.
    """
    changed = under_acceleration(config, acceleration)
    front, rear = (getattr(changed.tyre, axle).peak_factor_p1 / getattr(config.tyre, axle).peak_factor_p1 for axle in AXLES)
    return front, rear


def load_transfer(config: Config, acceleration: float) -> float:
    """Return the load in N that moves from the front to the rear axle; negative when the car brakes."""
    vehicle = config.vehicle
    return float(vehicle.mass_kg * acceleration * vehicle.cg_height_m / vehicle.wheelbase)


def force_shares(config: Config, acceleration: float) -> tuple[float, float]:
    """Return the shares of the longitudinal force at the front and at the rear axle."""
    own = config.longitudinal
    front = own.brake_front_share if acceleration < 0.0 else own.drive_front_share
    return front, 1.0 - front
