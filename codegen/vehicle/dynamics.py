"""Vehicle dynamics as CasADi functions, with Jacobians.

Two families:

- the single-track (bicycle) model with linear or Magic Formula tyres, states [beta, r]: for the optimisation and the ECU;
- the two-track plant, four loaded wheels with Magic Formula tyres, actuators included: for the closed loop.

Signs follow ISO 8855. Slip angles are alpha = (direction of travel) - (steering angle), so the force is Fy = -F(alpha); the
paper prints Fy = +C alpha, with which no car is stable.

Every function is pure SX: `emit.casadi_c` turns it into C.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca

from codegen.config import Config
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre, static_wheel_loads

TyreModel = Literal["linear", "magic-formula"]

SINGLE_TRACK_STATES = ("sideslip_angle", "yaw_rate")
SINGLE_TRACK_INPUTS = ("speed", "front_angle", "rear_angle", "friction")

PLANT_STATES = (
    "lateral_speed",  # m/s, of the centre of gravity, to the left
    "yaw_rate",  # rad/s
    "steering_wheel_angle",  # rad
    "rear_angle",  # rad
    "position_x",  # m, in the road frame
    "position_y",  # m
    "heading",  # rad
)
RELAXATION_STATES = (
    "slip_front_left",  # rad, of each tyre: what its force follows from
    "slip_front_right",
    "slip_rear_left",
    "slip_rear_right",
)
"""Further states of the plant where its tyres have a relaxation length."""

PLANT_INPUTS = (
    "speed",  # m/s, forward, above zero
    "steering_wheel_command",  # rad
    "rear_angle_command",  # rad
    "friction",  # peak friction of the road
    "yaw_moment",  # N m, from outside: split friction, a gust
)
PLANT_OUTPUTS = (
    "sideslip_angle",  # rad
    "lateral_acceleration",  # m/s^2, of the centre of gravity
    "front_angle",  # rad, road wheel
    "slip_front",  # rad, at the middle of the axle, from the motion: ahead of the tyres where they have a relaxation length
    "slip_rear",
)

WHEEL_SPEED_MIN = 0.5
"""m/s. Below, the slip angle of a rolling wheel has no meaning and its quotient no bound; the plant takes this instead."""


@dataclass(frozen=True)
class Model:
    """A dynamic model x' = f(x, u), y = h(x, u) with its Jacobians, as CasADi functions of column vectors.

    Attributes:
        name: also the name of the C function.
        states, inputs, outputs: the names of the elements of x, u and y, in order, SI units.
        derivative: (x, u) -> x'.
        jacobian: (x, u) -> (df/dx, df/du).
        output: (x, u) -> y, where the model has outputs beside its states.
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    derivative: Any
    jacobian: Any
    output: Any | None


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


def _argument(tyre: MagicFormulaTyre, slip: Any) -> Any:
    """X: the slip angle as the formula's curve takes it."""
    return tyre.stiffness_factor * (slip - tyre.horizontal_shift)


def _shape(tyre: MagicFormulaTyre, x: Any) -> Any:
    """The formula's curve, from -1 to 1."""
    return ca.sin(tyre.shape_factor * ca.atan(x - tyre.curvature_factor * (x - ca.atan(x))))


def _shaped_force(tyre: MagicFormulaTyre, shape: Any, load: Any, friction: Any) -> Any:
    """F in N for one wheel from the value of its curve."""
    relative: Any = tyre.peak_factor
    if tyre.peak_load_sensitivity != 0.0:
        relative = ca.fmax(tyre.peak_factor + tyre.peak_load_sensitivity * (load / tyre.static_load - 1.0), 0.0)
    return friction * relative * load * shape + tyre.vertical_shift


def _magic_formula(tyre: MagicFormulaTyre, slip: Any, load: Any, friction: Any) -> Any:
    """F in N for one wheel; see `tyre.MagicFormulaTyre.force`."""
    return _shaped_force(tyre, _shape(tyre, _argument(tyre, slip)), load, friction)


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
        return _argument(self.tyres.front, self.slip_front), _argument(self.tyres.rear, self.slip_rear)

    def derivative_of_shapes(self, front: Any, rear: Any) -> Any:
        """x' from the values of both curves, at static wheel loads."""
        tyres = self.tyres
        return self.derivative(
            -2.0 * _shaped_force(tyres.front, front, tyres.front.static_load, self.friction),
            -2.0 * _shaped_force(tyres.rear, rear, tyres.rear.static_load, self.friction),
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
        derivative = terms.derivative_of_shapes(_shape(tyres.front, front), _shape(tyres.rear, rear))
    return _model(
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


def load_transfer_per_lateral_acceleration(config: Config) -> tuple[float, float]:
    """Load that moves from the inner to the outer wheel of the front and of the rear axle, N for each m/s^2.

    "moment-balance": rho m h / w and (1 - rho) m h / w, so that w (dFz_f + dFz_r) = m ay h. "paper": as printed, half of it.
    """
    vehicle = config.vehicle
    total = vehicle.mass_kg * vehicle.cg_height_m / vehicle.track_m
    if config.plant.load_transfer == "paper":
        total *= 0.5
    return vehicle.front_roll_share * total, (1.0 - vehicle.front_roll_share) * total


def _clamp(value: Any, limit: Any) -> Any:
    return ca.fmin(ca.fmax(value, -limit), limit)


def two_track(config: Config) -> Model:
    """The plant: four wheels, lateral load transfer, Magic Formula at each wheel, steering and rear actuator.

    Planar motion at a given forward speed (Rajamani, section 8.3, without longitudinal forces). The load transfer takes the
    quasi-steady lateral acceleration vx r, as the paper does, and saturates where the inner wheel lifts, so the four loads
    always sum to m g. Actuators: first-order lag with a rate limit; the rear command saturates at the actuator's angle.
    Where `plant.relaxation_length_m` (sigma) is above zero, the force of each tyre follows its slip angle with a first-order
    lag over the distance rolled, alpha' = v/sigma (alpha_steady - alpha) with v of that wheel (H. B. Pacejka, Tire and Vehicle
    Dynamics, the single-point contact model). States, inputs and outputs: PLANT_STATES and, with a relaxation length,
    RELAXATION_STATES after them; PLANT_INPUTS, PLANT_OUTPUTS.
    """
    tyres = AxleTyres.from_config(config)
    vehicle, steering, actuator = config.vehicle, config.steering, config.rear_actuator
    relaxation = config.plant.relaxation_length_m
    states = (*PLANT_STATES, *RELAXATION_STATES) if relaxation > 0.0 else PLANT_STATES
    x = ca.SX.sym("x", len(states))
    u = ca.SX.sym("u", len(PLANT_INPUTS))
    lateral_speed, yaw_rate, wheel_angle, rear, _, _, heading = (x[i] for i in range(len(PLANT_STATES)))
    speed, wheel_command, rear_command, friction, yaw_moment = (u[i] for i in range(len(PLANT_INPUTS)))
    front = wheel_angle / steering.ratio

    load_front, load_rear = static_wheel_loads(config)
    per_ay_front, per_ay_rear = load_transfer_per_lateral_acceleration(config)
    lateral_acceleration_steady = speed * yaw_rate
    moved_front = _clamp(per_ay_front * lateral_acceleration_steady, load_front)
    moved_rear = _clamp(per_ay_rear * lateral_acceleration_steady, load_rear)

    half_track = 0.5 * vehicle.track_m
    axles = (
        (tyres.front, vehicle.cg_to_front_axle_m, front, load_front, moved_front),
        (tyres.rear, -vehicle.cg_to_rear_axle_m, rear, load_rear, moved_rear),
    )
    force_y: Any = 0.0
    moment: Any = yaw_moment
    slips: list[Any] = []
    slip_rates: list[Any] = []
    lagged = [x[i] for i in range(len(PLANT_STATES), len(states))]
    for tyre, arm, angle, load, moved in axles:
        axle_lateral_speed = lateral_speed + arm * yaw_rate
        slips.append(ca.atan(axle_lateral_speed / ca.fmax(speed, WHEEL_SPEED_MIN)) - angle)
        along, across = ca.cos(angle), ca.sin(angle)
        for side in (1.0, -1.0):  # left (inner in a left turn), right
            wheel_speed = ca.fmax(speed - side * half_track * yaw_rate, WHEEL_SPEED_MIN)
            slip = ca.atan(axle_lateral_speed / wheel_speed) - angle
            if lagged:
                held = lagged[len(slip_rates)]
                slip_rates.append(wheel_speed / relaxation * (slip - held))
                slip = held
            force = -_magic_formula(tyre, slip, load - side * moved, friction)
            force_y += force * along
            moment += arm * force * along + side * half_track * force * across

    acceleration = force_y / vehicle.mass_kg
    rear_demand = _clamp(rear_command, actuator.angle_max)
    derivative = ca.vertcat(
        acceleration - speed * yaw_rate,
        moment / vehicle.yaw_inertia_kg_m2,
        _clamp((wheel_command - wheel_angle) / steering.lag_s, math.radians(steering.wheel_rate_max_deg_s)),
        _clamp((rear_demand - rear) / actuator.lag_s, math.radians(actuator.rate_max_deg_s)),
        speed * ca.cos(heading) - lateral_speed * ca.sin(heading),
        speed * ca.sin(heading) + lateral_speed * ca.cos(heading),
        yaw_rate,
        *slip_rates,
    )
    output = ca.vertcat(ca.atan(lateral_speed / ca.fmax(speed, WHEEL_SPEED_MIN)), acceleration, front, slips[0], slips[1])
    return _model("two_track", (states, PLANT_INPUTS, PLANT_OUTPUTS), x, u, derivative, output)


def _model(
    name: str,
    names: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]],
    x: Any,
    u: Any,
    derivative: Any,
    output: Any | None,
) -> Model:
    states, inputs, outputs = names
    return Model(
        name=name,
        states=states,
        inputs=inputs,
        outputs=outputs,
        derivative=ca.Function(f"{name}_derivative", [x, u], [derivative], ["x", "u"], ["dx"]),
        jacobian=ca.Function(
            f"{name}_jacobian",
            [x, u],
            [ca.densify(ca.jacobian(derivative, x)), ca.densify(ca.jacobian(derivative, u))],
            ["x", "u"],
            ["dfdx", "dfdu"],
        ),
        output=None if output is None else ca.Function(f"{name}_output", [x, u], [output], ["x", "u"], ["y"]),
    )
