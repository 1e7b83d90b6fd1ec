"""Constant quantities of the two-track plant's car in SI units, as numbers of a configuration or as symbols."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Config, Tyres
from codegen.vehicle.tyre import CURVES, MagicFormulaTyre, load_transfer_per_lateral_acceleration, static_wheel_loads

_TYRE = tuple(field.name for field in fields(MagicFormulaTyre) if field.name not in ("nominal_friction", "curve"))
"""Factors of a tyre that the plant uses; the stiffness factor already includes the nominal friction."""


@dataclass(frozen=True)
class Chassis:
    """Mass, geometry and actuators. Each a number, or a symbol of CasADi.

    Attributes:
        mass: kg. yaw_inertia: kg m^2.
        cg_to_front_axle, cg_to_rear_axle, track: m.
        load_transfer_front, load_transfer_rear: load that moves from the inner to the outer wheel, N for each m/s^2.
        steering_ratio: angle of the steering wheel over that of the front wheels.
        steering_lag: s. steering_rate_max: rad/s, of the steering wheel.
        rear_lag: s. rear_rate_max: rad/s. rear_angle_max: rad.
        relaxation_length: m, of the front tyres; zero for tyres without one. rear_relaxation_factor: that of the rear tyres
            over it.
        nominal_friction: friction for which the stiffness of the tyres holds. slippery_stiffness_share: share of the stiffness
            lost on another road that the road keeps.
        sprung_moment: kg m, sprung mass times its height above the roll axis; zero for a car that does not roll, otherwise
            load_transfer_front and load_transfer_rear are those of the roll centres alone.
        roll_inertia: kg m^2. roll_stiffness: N m/rad and roll_damping: N m s/rad, of springs and dampers.
        front_roll_share: of their moment, on the front axle. gravity: m/s^2.
        motor_share: time constant of the motor's rate over rear_lag; zero for an actuator of first order.
        backlash: rad, half of the play between motor and rear wheels.
    """

    mass: Any
    yaw_inertia: Any
    cg_to_front_axle: Any
    cg_to_rear_axle: Any
    track: Any
    load_transfer_front: Any
    load_transfer_rear: Any
    steering_ratio: Any
    steering_lag: Any
    steering_rate_max: Any
    rear_lag: Any
    rear_rate_max: Any
    rear_angle_max: Any
    relaxation_length: Any
    rear_relaxation_factor: Any
    nominal_friction: Any
    slippery_stiffness_share: Any
    sprung_moment: Any
    roll_inertia: Any
    roll_stiffness: Any
    roll_damping: Any
    front_roll_share: Any
    gravity: Any
    motor_share: Any
    backlash: Any


OPTIONAL_PARTS = {
    "relaxation_length": "a relaxation length",
    "slippery_stiffness_share": "tyres that keep stiffness on a slippery road",
    "sprung_moment": "roll",
    "motor_share": "an actuator of second order",
    "backlash": "backlash",
}
"""Parameters that add their part to the equations of the plant unless they are zero, with the name of the part."""

SPRUNG_FRACTION = 0.88
"""Fraction of the mass on the springs of a car that rolls."""
ROLL_CENTRE_HEIGHT_M = 0.1
"""Height of both roll centres, at most half of that of the centre of gravity."""
ROLL_RADIUS_M = 0.55
"""Radius of gyration of the sprung mass about its own axis."""
ROLL_DAMPING_RATIO = 0.3

_CHASSIS = tuple(field.name for field in fields(Chassis))

PLANT_PARAMETERS = (*_CHASSIS, *(f"{axle}_{name}" for axle in ("front", "rear") for name in _TYRE))
"""Names of the plant's parameters, in order: those of `Chassis`, then `front_` and `rear_` with the factors of
`tyre.MagicFormulaTyre`. SI units."""


@dataclass(frozen=True)
class PlantCar:
    """A car: its chassis and the tyre of each axle, with numbers or with symbols."""

    chassis: Chassis
    front: MagicFormulaTyre
    rear: MagicFormulaTyre

    @classmethod
    def from_config(cls, config: Config) -> PlantCar:
        """The car of a configuration, in numbers."""
        vehicle, steering, actuator, plant = config.vehicle, config.steering, config.rear_actuator, config.plant
        load_front, load_rear = static_wheel_loads(config)
        friction = config.road.friction
        return cls(
            Chassis(
                mass=vehicle.mass_kg,
                yaw_inertia=vehicle.yaw_inertia_kg_m2,
                cg_to_front_axle=vehicle.cg_to_front_axle_m,
                cg_to_rear_axle=vehicle.cg_to_rear_axle_m,
                track=vehicle.track_m,
                **_load_transfer(config),
                steering_ratio=steering.ratio,
                steering_lag=steering.lag_s,
                steering_rate_max=math.radians(steering.wheel_rate_max_deg_s),
                rear_lag=actuator.lag_s,
                rear_rate_max=math.radians(actuator.rate_max_deg_s),
                rear_angle_max=actuator.angle_max,
                relaxation_length=plant.relaxation_length_m,
                rear_relaxation_factor=plant.rear_relaxation_factor,
                nominal_friction=friction,
                slippery_stiffness_share=plant.slippery_stiffness_share,
                front_roll_share=vehicle.front_roll_share,
                gravity=config.road.gravity_m_s2,
                motor_share=plant.actuator_motor_share,
                backlash=0.5 * math.radians(plant.backlash_deg),
            ),
            MagicFormulaTyre.from_config(config.tyre.front, load_front, friction),
            MagicFormulaTyre.from_config(config.tyre.rear, load_rear, friction),
        )

    @classmethod
    def from_symbols(cls, parameters: Any, tyres: Tyres) -> PlantCar:
        """Make a car of a column of symbols, in the order of PLANT_PARAMETERS, with the curves of `tyres`."""
        symbols = {name: parameters[index] for index, name in enumerate(PLANT_PARAMETERS)}
        front, rear = (
            MagicFormulaTyre(
                **{name: symbols[f"{axle}_{name}"] for name in _TYRE}, nominal_friction=math.nan, curve=CURVES[tyre.curve]
            )
            for axle, tyre in (("front", tyres.front), ("rear", tyres.rear))
        )
        return cls(Chassis(**{name: symbols[name] for name in _CHASSIS}), front, rear)


def _load_transfer(config: Config) -> dict[str, Any]:
    """Return the parameters of load transfer and roll.

    The springs carry the sprung mass against its moment of inertia and gravity; what does not pass through them is transferred
    at once, at the roll centres.
    """
    vehicle, roll = config.vehicle, math.radians(config.plant.roll_deg_per_g) / config.road.gravity_m_s2
    if roll == 0.0:
        front, rear = load_transfer_per_lateral_acceleration(config)
        names = ("sprung_moment", "roll_inertia", "roll_stiffness", "roll_damping")
        return {"load_transfer_front": front, "load_transfer_rear": rear, **dict.fromkeys(names, 0.0)}
    mass = vehicle.mass_kg
    centre_height = np.minimum(ROLL_CENTRE_HEIGHT_M, 0.5 * vehicle.cg_height_m)
    centres = mass * centre_height / (vehicle.track_m * vehicle.wheelbase)
    sprung, moment = SPRUNG_FRACTION * mass, mass * (vehicle.cg_height_m - centre_height)
    inertia = sprung * ROLL_RADIUS_M**2 + moment**2 / sprung
    restoring = moment / roll  # springs less gravity
    return {
        "load_transfer_front": centres * vehicle.cg_to_rear_axle_m,
        "load_transfer_rear": centres * vehicle.cg_to_front_axle_m,
        "sprung_moment": moment,
        "roll_inertia": inertia,
        "roll_stiffness": restoring + moment * config.road.gravity_m_s2,
        "roll_damping": 2.0 * ROLL_DAMPING_RATIO * np.sqrt(restoring * inertia),
    }


def optional_parts(config: Config) -> frozenset[str]:
    """Return those of OPTIONAL_PARTS that the plant of a configuration has."""
    chassis = PlantCar.from_config(config).chassis
    return frozenset(name for name in OPTIONAL_PARTS if np.any(getattr(chassis, name)))


def plant_parameters(config: Config) -> FloatArray:
    """Return the car of a configuration as a row (k,) of numbers in the order of PLANT_PARAMETERS, SI units.

    Values (n,) in the configuration (see `Config.unchecked`) give n rows, (n, k).
    """
    car = PlantCar.from_config(config)
    tyres = (getattr(tyre, name) for tyre in (car.front, car.rear) for name in _TYRE)
    values = (np.asarray(value, dtype=np.float64) for value in (*astuple(car.chassis), *tyres))
    return np.stack(np.broadcast_arrays(*values), axis=-1)


def deviations(
    config: Config,
    mass: Any = 1.0,
    yaw_inertia: Any = 1.0,
    cg_shift: Any = 0.0,
    tyre_peak: Any = 1.0,
    front_stiffness: Any = 1.0,
    rear_stiffness: Any = 1.0,
) -> dict[str, Any]:
    """Return the keys of `ars.toml`, with their values, of a car that deviates from the configured one.

    The slope of the tyres at zero slip is kept under changes of mass, centre of gravity and peak: with a constant factor B it
    would change with them, and a change of the mass would not affect the motion of the linear car.

    Args:
        mass, yaw_inertia, tyre_peak, front_stiffness, rear_stiffness: factors, numbers or (n,); the yaw inertia's on top of the
            mass's, which it goes with.
        cg_shift: m forward; less than either arm.
    """
    vehicle = config.vehicle
    changes = {
        "vehicle.mass_kg": mass * vehicle.mass_kg,
        "vehicle.yaw_inertia_kg_m2": mass * yaw_inertia * vehicle.yaw_inertia_kg_m2,
        "vehicle.cg_to_front_axle_m": vehicle.cg_to_front_axle_m - cg_shift,
        "vehicle.cg_to_rear_axle_m": vehicle.cg_to_rear_axle_m + cg_shift,
    }
    for axle, load, factor in zip(
        ("front", "rear"), static_wheel_loads(config), (front_stiffness, rear_stiffness), strict=True
    ):
        tyre = MagicFormulaTyre.from_config(getattr(config.tyre, axle), load, config.road.friction)
        changes |= {
            f"tyre.{axle}.cornering_stiffness_n_per_rad": factor * tyre.cornering_stiffness,
            f"tyre.{axle}.stiffness_factor_b_per_rad": None,
            f"tyre.{axle}.peak_factor_p1": tyre_peak * tyre.peak_factor,
        }
    return changes


def varied_cars(config: Config, **given: npt.ArrayLike) -> FloatArray:
    """Return cars with `deviations` as rows (n, k) in the order of PLANT_PARAMETERS; numbers or (n,).

    A validated configuration for each row would take a thousand times as long.
    """
    arrays = {name: np.asarray(values, dtype=np.float64) for name, values in given.items()}
    return np.atleast_2d(plant_parameters(config.unchecked(deviations(config, **arrays))))


def plant_symbols() -> Any:
    """A column of symbols, one for each of PLANT_PARAMETERS."""
    return ca.vertcat(*(ca.SX.sym(name) for name in PLANT_PARAMETERS))


def load_shares_per_lateral_acceleration(config: Config) -> tuple[float, float]:
    """Return the share of a wheel's static load that moves across the front and the rear axle, for each m/s^2."""
    moved, loads = load_transfer_per_lateral_acceleration(config), static_wheel_loads(config)
    return moved[0] / loads[0], moved[1] / loads[1]


def load_transfer_losses(config: Config) -> tuple[float, float]:
    """Loss factors q of the front and the rear axle: reduction of side force by the load sensitivity of the tyres in a steady
    turn.

    With a tyre's curve s, the axle's curve c is s (1 + p2/p1 x^2). The share x of the load that moves follows from the axle's
    own force: x = x1 mu p1 g c, x1 being the share for each m/s^2. Hence c = s - q s c^2. Zero for tyres without load
    sensitivity. (H. B. Pacejka, Tire and Vehicle Dynamics, section 1.3.1: effective axle characteristics.)
    """
    shares = load_shares_per_lateral_acceleration(config)
    largest = config.road.friction * config.road.gravity_m_s2
    front, rear = (
        -tyre.peak_load_sensitivity_p2 * tyre.peak_factor_p1 * (share * largest) ** 2
        for tyre, share in zip((config.tyre.front, config.tyre.rear), shares, strict=True)
    )
    return front, rear
