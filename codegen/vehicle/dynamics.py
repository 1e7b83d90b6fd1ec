"""Vehicle dynamics as CasADi functions, with Jacobians.

Two families:

- the single-track (bicycle) model with linear or Magic Formula tyres, states [beta, r]: for the optimisation and the ECU;
- the two-track plant, four loaded wheels with Magic Formula tyres, actuators included: for the closed loop.

Signs follow ISO 8855. Slip angles are alpha = (direction of travel) - (steering angle), so the force is Fy = -F(alpha); the
paper prints Fy = +C alpha, with which no car is stable.

Every function is pure SX: `emit.casadi_c` turns it into C.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca

from codegen.configuration import Config
from codegen.vehicle.expressions import Model, axle_curve, curve_argument, magic_formula, make_model
from codegen.vehicle.plant_car import (
    PLANT_PARAMETERS,
    load_shares_per_lateral_acceleration,
    load_transfer_losses,
    plant_parameters,
)
from codegen.vehicle.two_track import (
    PLANT_INPUTS,
    PLANT_OUTPUTS,
    PLANT_STATES,
    RELAXATION_STATES,
    ParametricModel,
    two_track,
    two_track_of_parameters,
)
from codegen.vehicle.tyre import WHEEL_SPEED_MIN, AxleTyres, load_transfer_per_lateral_acceleration

__all__ = [
    "PLANT_INPUTS",
    "PLANT_OUTPUTS",
    "PLANT_PARAMETERS",
    "PLANT_STATES",
    "RELAXATION_STATES",
    "SINGLE_TRACK_INPUTS",
    "SINGLE_TRACK_STATES",
    "WHEEL_SPEED_MIN",
    "Model",
    "ParametricModel",
    "SingleTrackStep",
    "TyreModel",
    "load_transfer_per_lateral_acceleration",
    "plant_parameters",
    "single_track",
    "single_track_step",
    "two_track",
    "two_track_of_parameters",
]

TyreModel = Literal["linear", "magic-formula", "load-transfer"]

SINGLE_TRACK_STATES = ("sideslip_angle", "yaw_rate")
SINGLE_TRACK_INPUTS = ("speed", "front_angle", "rear_angle", "friction")


@dataclass(frozen=True)
class SingleTrackStep:
    """One linearly implicit step of the single-track model with Magic Formula tyres, split around the tyre curves.

    The caller evaluates the axle's curve and its slope in its own way, at X = arguments(x, u): sin(C atan(X - E (X - atan X)))
    less the loss by load transfer (`plant_car.load_transfer_losses`).

    Attributes:
        arguments: (x, u) -> X (2,): B (alpha - S_H) of the front and of the rear tyre.
        change: (x, u, curve (2,), slope (2,)) -> change of x over the step.

    x is [beta (rad), r (rad/s)], u is [1/vx (s/m), delta_f (rad), delta_r (rad), friction].
    """

    arguments: Any
    change: Any


def single_track(config: Config, tyre_model: TyreModel) -> Model:
    """The bicycle model of the paper's equation 1, forces of both tyres of an axle, at static wheel loads.

    States [beta (rad), r (rad/s)], inputs [vx (m/s, above zero), delta_f (rad), delta_r (rad), friction]. With linear tyres
    the friction has no effect.

    "load-transfer" has in steady turns the yaw rate of the two-track car, within 1 % of it: the curve of an axle
    includes what load transfer costs it, and of two steered wheels the one that carries more pulls its axle back by more. That
    moment is half a track times the steering angle times the difference of both side forces, which is the force of the axle
    times the share of the load that has moved.
    """
    tyres, vehicle = AxleTyres.from_config(config), config.vehicle
    beta, yaw_rate = ca.SX.sym("beta"), ca.SX.sym("r")
    speed, front, rear, friction = (ca.SX.sym(name) for name in ("vx", "delta_f", "delta_r", "mu"))
    slips = (
        beta + vehicle.cg_to_front_axle_m * yaw_rate / speed - front,
        beta - vehicle.cg_to_rear_axle_m * yaw_rate / speed - rear,
    )
    arms: tuple[Any, Any] = vehicle.cg_to_front_axle_m, vehicle.cg_to_rear_axle_m
    both = tuple(zip((tyres.front, tyres.rear), slips, strict=True))
    if tyre_model == "load-transfer":
        force_front, force_rear = (
            -2.0
            * (
                tyre.peak(tyre.static_load, 1.0) * friction * axle_curve(tyre, curve_argument(tyre, slip), loss)
                + tyre.vertical_shift
            )
            for (tyre, slip), loss in zip(both, load_transfer_losses(config), strict=True)
        )
        acceleration = (force_front + force_rear) / vehicle.mass_kg
        shorter = (front * acceleration, -rear * acceleration)
        arms = tuple(arm - by * way for arm, by, way in zip(arms, _arm_losses(config), shorter, strict=True))
    elif tyre_model == "linear":
        force_front, force_rear = (-2.0 * tyre.cornering_stiffness * slip for tyre, slip in both)
    else:
        force_front, force_rear = (-2.0 * magic_formula(tyre, slip, tyre.static_load, friction) for tyre, slip in both)
    moment = arms[0] * force_front - arms[1] * force_rear
    return make_model(
        f"single_track_{tyre_model.replace('-', '_')}",
        (SINGLE_TRACK_STATES, SINGLE_TRACK_INPUTS, ()),
        ca.vertcat(beta, yaw_rate),
        ca.vertcat(speed, front, rear, friction),
        ca.vertcat(
            (force_front + force_rear) / (vehicle.mass_kg * speed) - yaw_rate,
            moment / vehicle.yaw_inertia_kg_m2,
        ),
        None,
    )


def _arm_losses(config: Config) -> tuple[float, float]:
    """Return the loss of a steered axle's arm in m for each rad and m/s^2: half the track times the load transfer share."""
    front, rear = load_shares_per_lateral_acceleration(config)
    return 0.5 * config.vehicle.track_m * front, 0.5 * config.vehicle.track_m * rear


def single_track_step(config: Config, step: float) -> SingleTrackStep:
    """Return the step over `step` seconds of the model of `single_track(config, "load-transfer")`.

    The change d of the state solves (I - step/2 J) d = step f(x): the linearly implicit midpoint rule, a Rosenbrock method of
    one stage (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.7). It is of second order, needs one
    evaluation of each tyre curve, and damps whatever the car damps at any speed, as long as no slope is negative. J leaves out
    what load transfer does, which is slow and small.
    """
    tyres, vehicle = AxleTyres.from_config(config), config.vehicle
    mass, inertia = vehicle.mass_kg, vehicle.yaw_inertia_kg_m2
    front_arm, rear_arm = vehicle.cg_to_front_axle_m, vehicle.cg_to_rear_axle_m
    x, u, value, slope = (ca.SX.sym(name, size) for name, size in (("x", 2), ("u", 4), ("curve", 2), ("slope", 2)))
    beta, yaw_rate = x[0], x[1]
    slowness, front, rear, friction = u[0], u[1], u[2], u[3]
    turning = yaw_rate * slowness
    arguments = (
        curve_argument(tyres.front, beta + front_arm * turning - front),
        curve_argument(tyres.rear, beta - rear_arm * turning - rear),
    )
    # Side force of an axle against its slip, times step / mass, and half of its slope against the slip.
    force, stiffness = [], []
    for k, tyre in enumerate((tyres.front, tyres.rear)):
        scale = 2.0 * step / mass
        peak = scale * tyre.peak(tyre.static_load, 1.0) * friction
        force.append(peak * value[k] + scale * tyre.vertical_shift)
        stiffness.append(0.5 * tyre.stiffness_factor * peak * slope[k])
    sum_of_forces = force[0] + force[1]  # the lateral acceleration, times -step
    lost_front, lost_rear = (loss / step for loss in _arm_losses(config))
    front_moment = (front_arm + lost_front * (front * sum_of_forces)) * force[0]
    rear_moment = (rear_arm - lost_rear * (rear * sum_of_forces)) * force[1]
    front_yaw, rear_yaw = (mass * arm / inertia * half for arm, half in zip((front_arm, rear_arm), stiffness, strict=True))
    # (I - step/2 J) = [[m00, m01], [m10, m11]], and step f(x) = [-drift, yaw].
    drift = slowness * sum_of_forces + step * yaw_rate
    yaw = mass / inertia * (rear_moment - front_moment)
    m00 = 1.0 + slowness * (stiffness[0] + stiffness[1])
    m10 = front_yaw - rear_yaw
    m01 = 0.5 * step + inertia / mass * (slowness * slowness) * m10
    m11 = 1.0 + slowness * (front_arm * front_yaw + rear_arm * rear_yaw)
    # No plausible car comes near the bound, which keeps the division defined for all inputs.
    determinant = ca.fmax(m00 * m11 - m01 * m10, 0.5)
    change = ca.vertcat(-(m11 * drift + m01 * yaw) / determinant, (m00 * yaw + m10 * drift) / determinant)
    return SingleTrackStep(
        arguments=ca.Function("single_track_arguments", [x, u], [ca.vertcat(*arguments)], ["x", "u"], ["argument"]),
        change=ca.Function("single_track_step", [x, u, value, slope], [change], ["x", "u", "curve", "slope"], ["change"]),
    )
