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

from codegen.config import Config
from codegen.vehicle.expressions import Model, curve, curve_argument, make_model, shaped_force
from codegen.vehicle.plant_car import PLANT_PARAMETERS, load_transfer_per_lateral_acceleration, plant_parameters
from codegen.vehicle.two_track import (
    PLANT_INPUTS,
    PLANT_OUTPUTS,
    PLANT_STATES,
    RELAXATION_STATES,
    WHEEL_SPEED_MIN,
    ParametricModel,
    two_track,
    two_track_of_parameters,
)
from codegen.vehicle.tyre import AxleTyres

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
    "ShapedSingleTrack",
    "TyreModel",
    "load_transfer_per_lateral_acceleration",
    "plant_parameters",
    "single_track",
    "single_track_from_shapes",
    "two_track",
    "two_track_of_parameters",
]

TyreModel = Literal["linear", "magic-formula"]

SINGLE_TRACK_STATES = ("sideslip_angle", "yaw_rate")
SINGLE_TRACK_INPUTS = ("speed", "front_angle", "rear_angle", "friction")


@dataclass(frozen=True)
class ShapedSingleTrack:
    """The single-track model with its tyres' curve left open, so that a caller may evaluate that curve in its own way.

    With s = (sin(C atan(X - E (X - atan X))) of the front and of the rear tyre) at X = arguments(x, u), derivative(x, u, s)
    is that of `single_track(config, "magic-formula")`.

    Attributes:
        states, inputs: names of the elements of x and u: SINGLE_TRACK_STATES, SINGLE_TRACK_INPUTS.
        arguments: (x, u) -> X (2,): B (alpha - S_H) of the front and of the rear tyre.
        derivative: (x, u, shape (2,)) -> x'.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    arguments: Any
    derivative: Any


class _SingleTrackTerms:
    """Expressions of the single-track model over its symbols x and u."""

    def __init__(self, config: Config) -> None:
        self.tyres = AxleTyres.from_config(config)
        self.vehicle = config.vehicle
        beta, self.yaw_rate = ca.SX.sym("beta"), ca.SX.sym("r")
        self.speed, front, rear, self.friction = (ca.SX.sym(name) for name in ("vx", "delta_f", "delta_r", "mu"))
        self.x = ca.vertcat(beta, self.yaw_rate)
        self.u = ca.vertcat(self.speed, front, rear, self.friction)
        self.slip_front = beta + self.vehicle.cg_to_front_axle_m * self.yaw_rate / self.speed - front
        self.slip_rear = beta - self.vehicle.cg_to_rear_axle_m * self.yaw_rate / self.speed - rear

    @property
    def arguments(self) -> tuple[Any, Any]:
        """X of front and rear."""
        return curve_argument(self.tyres.front, self.slip_front), curve_argument(self.tyres.rear, self.slip_rear)

    def derivative_of_shapes(self, front: Any, rear: Any) -> Any:
        """x' from the values of both curves, at static wheel loads."""
        tyres = self.tyres
        return self.derivative(
            -2.0 * shaped_force(tyres.front, front, tyres.front.static_load, self.friction),
            -2.0 * shaped_force(tyres.rear, rear, tyres.rear.static_load, self.friction),
        )

    def derivative(self, force_front: Any, force_rear: Any) -> Any:
        """x' from the side forces of the axles in N, positive to the left."""
        vehicle = self.vehicle
        moment = vehicle.cg_to_front_axle_m * force_front - vehicle.cg_to_rear_axle_m * force_rear
        return ca.vertcat(
            (force_front + force_rear) / (vehicle.mass_kg * self.speed) - self.yaw_rate,
            moment / vehicle.yaw_inertia_kg_m2,
        )


def single_track(config: Config, tyre_model: TyreModel) -> Model:
    """The bicycle model of the paper's equation 1, forces of both tyres of an axle, at static wheel loads.

    States [beta (rad), r (rad/s)], inputs [vx (m/s, above zero), delta_f (rad), delta_r (rad), friction]. With linear tyres
    the friction has no effect.
    """
    terms = _SingleTrackTerms(config)
    tyres = terms.tyres
    if tyre_model == "linear":
        derivative = terms.derivative(
            -2.0 * tyres.front.cornering_stiffness * terms.slip_front,
            -2.0 * tyres.rear.cornering_stiffness * terms.slip_rear,
        )
    else:
        front, rear = terms.arguments
        derivative = terms.derivative_of_shapes(curve(tyres.front, front), curve(tyres.rear, rear))
    return make_model(
        f"single_track_{tyre_model.replace('-', '_')}",
        (SINGLE_TRACK_STATES, SINGLE_TRACK_INPUTS, ()),
        terms.x,
        terms.u,
        derivative,
        None,
    )


def single_track_from_shapes(config: Config) -> ShapedSingleTrack:
    """`single_track(config, "magic-formula")` in two parts, around the tyres' curve."""
    terms = _SingleTrackTerms(config)
    shape = ca.SX.sym("shape", 2)
    derivative = terms.derivative_of_shapes(shape[0], shape[1])
    x, u = terms.x, terms.u
    return ShapedSingleTrack(
        states=SINGLE_TRACK_STATES,
        inputs=SINGLE_TRACK_INPUTS,
        arguments=ca.Function("single_track_arguments", [x, u], [ca.vertcat(*terms.arguments)], ["x", "u"], ["argument"]),
        derivative=ca.Function("single_track_from_shapes", [x, u, shape], [derivative], ["x", "u", "shape"], ["dx"]),
    )
