"""Vehicle dynamics as CasADi functions, with Jacobians.

Two families:

- the single-track (bicycle) model with linear or Magic Formula tyres, states [beta, r]: for the optimisation and the ECU;
- the two-track plant, four loaded wheels with Magic Formula tyres, actuators included: for the closed loop.

Signs follow ISO 8855. Slip angles are alpha = (direction of travel) - (steering angle), so the force is Fy = -F(alpha); the
paper prints Fy = +C alpha, with which no car is stable.

Every function is pure SX: `emit.casadi_c` turns it into C.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca

from codegen.configuration import Config
from codegen.vehicle.plant_car import (
    OPTIONAL_PARTS,
    PLANT_PARAMETERS,
    Chassis,
    PlantCar,
    load_shares_per_lateral_acceleration,
    load_transfer_losses,
    optional_parts,
    plant_symbols,
)
from codegen.vehicle.tyre import WHEEL_SPEED_MIN, AxleTyres, MagicFormulaTyre


@dataclass(frozen=True)
class Model:
    """A dynamic model x' = f(x, u), y = h(x, u) with its Jacobians, as CasADi functions of column vectors.

    Attributes:
        name: also the name of the C function.
        states, inputs, outputs: the names of the elements of x, u and y, in order, SI units.
        derivative: (x, u) -> x'.
        jacobian: (x, u) -> (df/dx, df/du).
        output: (x, u) -> y, None if the model has no outputs.
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    derivative: Any
    jacobian: Any
    output: Any | None


def is_zero(value: Any) -> bool:
    """Return whether a quantity of a car is the number zero; a symbol is not."""
    return isinstance(value, int | float) and value == 0.0


def curve_argument(tyre: MagicFormulaTyre, slip: Any) -> Any:
    """X: the slip angle as the formula's curve takes it."""
    return tyre.stiffness_factor * (slip - tyre.horizontal_shift)


def keep_stiffness(chassis: Chassis, tyre: MagicFormulaTyre, friction: Any) -> MagicFormulaTyre:
    """Return a tyre on a road that keeps a share of the cornering stiffness which the constant factor B loses."""
    share = chassis.slippery_stiffness_share
    if is_zero(share):
        return tyre
    kept = 1.0 + share * (chassis.nominal_friction / friction - 1.0)
    return replace(tyre, stiffness_factor=tyre.stiffness_factor * kept)


def curve(tyre: MagicFormulaTyre, x: Any) -> Any:
    """The formula's curve, from -1 to 1."""
    return tyre.curve.value(tyre, x, ca)


def axle_curve(tyre: MagicFormulaTyre, x: Any, loss: float) -> Any:
    """The curve of an axle with a loss by load transfer, see `plant_car.load_transfer_losses`: c = s - loss s c^2."""
    value = curve(tyre, x)
    return 2.0 * value / (1.0 + ca.sqrt(ca.fmax(1.0 + 4.0 * loss * value * value, 0.0))) if loss else value


def magic_formula(tyre: MagicFormulaTyre, slip: Any, load: Any, friction: Any) -> Any:
    """F in N for one wheel; see `tyre.MagicFormulaTyre.force`."""
    relative: Any = tyre.peak_factor
    if not is_zero(tyre.peak_load_sensitivity):
        relative = ca.fmax(tyre.peak_factor + tyre.peak_load_sensitivity * (load / tyre.static_load - 1.0), 0.0)
    return friction * relative * load * curve(tyre, curve_argument(tyre, slip)) + tyre.vertical_shift


def clamp(value: Any, limit: Any) -> Any:
    """The value, kept within plus and minus the limit."""
    return ca.fmin(ca.fmax(value, -limit), limit)


def make_model(
    name: str,
    names: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]],
    x: Any,
    u: Any,
    derivative: Any,
    output: Any | None,
) -> Model:
    """The model of these expressions over the symbols x and u; `names` of states, inputs and outputs."""
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
ROLL_STATES = (
    "roll",  # rad, positive to the right
    "roll_rate",  # rad/s
)
"""Further states of a plant that rolls."""
MOTOR_ANGLE, MOTOR_RATE = "motor_angle", "motor_rate"  # rad and rad/s at the wheels
"""Further states of the rear actuator: before its backlash, and of second order."""

_PARTS_STATES = {
    "relaxation_length": RELAXATION_STATES,
    "sprung_moment": ROLL_STATES,
    "backlash": (MOTOR_ANGLE,),
    "motor_share": (MOTOR_RATE,),
}
PLAY_TIME_CONSTANT = 0.004
"""Time constant in s with which the wheels follow the motor: stiff compared with the rest, and slow enough for a step of 1
ms."""

PLANT_INPUTS = (
    "speed",  # m/s, forward, above zero
    "steering_wheel_command",  # rad
    "rear_angle_command",  # rad
    "friction",  # peak friction of the road
    "yaw_moment",  # N m, from outside: split friction, a gust
    "lateral_force",  # N, from outside at the centre of gravity, or at the roll axis below it, to the left
)
PLANT_OUTPUTS = (
    "sideslip_angle",  # rad
    "lateral_acceleration",  # m/s^2, of the centre of gravity
    "front_angle",  # rad, road wheel
    "slip_front",  # rad, at the middle of the axle, from the motion: ahead of the tyres where they have a relaxation length
    "slip_rear",
    "measured_rear_angle",  # rad, of the actuator's motor: no sensor sees the play behind it
    "measured_lateral_acceleration",  # m/s^2, of an accelerometer that rolls with the body
)


@dataclass(frozen=True)
class ParametricModel:
    """A dynamic model whose car is left open: x' = f(x, u, p), y = h(x, u, p), as CasADi functions of column vectors.

    Attributes:
        states, inputs, parameters, outputs: the names of the elements of x, u, p and y, in order, SI units.
        derivative: (x, u, p) -> x'.
        output: (x, u, p) -> y.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    outputs: tuple[str, ...]
    derivative: Any
    output: Any


def two_track(config: Config) -> Model:
    """The plant: four wheels, lateral load transfer, Magic Formula at each wheel, steering and rear actuator.

    Planar motion at a given forward speed (Rajamani, section 8.3, without longitudinal forces). The load transfer takes the
    quasi-steady lateral acceleration vx r, as the paper does, and saturates where the inner wheel lifts, so the four loads
    always sum to m g. Actuators: first-order lag with a rate limit; the rear command saturates at the actuator's angle.
    States, inputs and outputs: `plant_states`, PLANT_INPUTS, PLANT_OUTPUTS.

    Each of these parts is in the equations where its key of `[plant]` is above zero:

    - relaxation length sigma: the force of each tyre follows its slip angle with a first-order lag over the distance rolled,
      alpha' = v/sigma (alpha_steady - alpha) with v of that wheel (H. B. Pacejka, Tire and Vehicle Dynamics, the single-point
      contact model);
    - stiffness on a slippery road: see `keep_stiffness`;
    - roll about an axis along the road (Rajamani; L. Segel, Theoretical prediction and experimental substantiation of the
      response of the automobile to steering control, 1956): the springs and the roll centres move the load;
    - motor of the rear actuator: its rate follows what lag and rate limit ask for;
    - backlash: the rear wheels follow the motor beyond the play.
    """
    AxleTyres.from_config(config)  # refuses a tyre that has no slip bound
    x, u, derivative, output = _two_track(PlantCar.from_config(config), plant_states(config))
    return make_model("two_track", (plant_states(config), PLANT_INPUTS, PLANT_OUTPUTS), x, u, derivative, output)


def two_track_of_parameters(config: Config) -> ParametricModel:
    """Return `two_track` for any car. The configuration only decides which of `plant_car.OPTIONAL_PARTS` it has.

    With p = `plant_parameters(config)` its functions are those of `two_track(config)`.
    """
    p = plant_symbols()
    car = PlantCar.from_symbols(p, config.tyre)
    absent = dict.fromkeys(OPTIONAL_PARTS.keys() - optional_parts(config), 0.0)
    car = replace(car, chassis=replace(car.chassis, **absent))
    x, u, derivative, output = _two_track(car, plant_states(config))
    names = ["x", "u", "p"]
    return ParametricModel(
        states=plant_states(config),
        inputs=PLANT_INPUTS,
        parameters=PLANT_PARAMETERS,
        outputs=PLANT_OUTPUTS,
        derivative=ca.Function("two_track_of_parameters_derivative", [x, u, p], [derivative], names, ["dx"]),
        output=ca.Function("two_track_of_parameters_output", [x, u, p], [output], names, ["y"]),
    )


def plant_states(config: Config) -> tuple[str, ...]:
    """Return the states of the plant: PLANT_STATES, then those of the parts that it has."""
    parts = optional_parts(config)
    return (*PLANT_STATES, *(state for part, states in _PARTS_STATES.items() if part in parts for state in states))


def _size(speed: Any) -> Any:
    """Return the rolling speed in m/s in either direction, at least WHEEL_SPEED_MIN."""
    return ca.fmax(ca.fmax(speed, -speed), WHEEL_SPEED_MIN)


def _rolling(speed: Any, lateral_speed: Any, angle: Any) -> tuple[Any, Any]:
    """Return the rolling speed of a wheel and its slip angle.

    In reverse the same steering angle slips to the other side; at standstill there is no slip.
    """
    return _size(speed), ca.atan(lateral_speed / _size(speed)) - clamp(speed / WHEEL_SPEED_MIN, 1.0) * angle


def _two_track(car: PlantCar, states: tuple[str, ...]) -> tuple[Any, Any, Any, Any]:
    """x, u, x' and y of the plant."""
    chassis = car.chassis
    x, u = ca.SX.sym("x", len(states)), ca.SX.sym("u", len(PLANT_INPUTS))
    state = dict(zip(states, ca.vertsplit(x), strict=True))
    lateral_speed, yaw_rate, wheel_angle, rear, _, _, heading = (state[name] for name in PLANT_STATES)
    speed, wheel_command, rear_command, friction, yaw_moment, lateral_force = (u[i] for i in range(len(PLANT_INPUTS)))
    front = wheel_angle / chassis.steering_ratio

    load_front, load_rear = car.front.static_load, car.rear.static_load
    lateral_acceleration_steady = speed * yaw_rate
    moved_front = chassis.load_transfer_front * lateral_acceleration_steady
    moved_rear = chassis.load_transfer_rear * lateral_acceleration_steady
    springs: Any = None  # moment about the roll axis
    if not is_zero(chassis.sprung_moment):
        springs = chassis.roll_stiffness * state["roll"] + chassis.roll_damping * state["roll_rate"]
        moved_front += chassis.front_roll_share / chassis.track * springs
        moved_rear += (1.0 - chassis.front_roll_share) / chassis.track * springs

    half_track = 0.5 * chassis.track
    relaxation = chassis.relaxation_length
    axles = (
        (car.front, chassis.cg_to_front_axle, front, load_front, moved_front, relaxation),
        (car.rear, -chassis.cg_to_rear_axle, rear, load_rear, moved_rear, relaxation * chassis.rear_relaxation_factor),
    )
    force_y: Any = lateral_force
    moment: Any = yaw_moment
    slips: list[Any] = []
    slip_rates: list[Any] = []
    lagged = [state[name] for name in RELAXATION_STATES if name in state]
    for axle_tyre, arm, angle, load, axle_moved, length in axles:
        tyre, moved = keep_stiffness(chassis, axle_tyre, friction), clamp(axle_moved, load)
        axle_lateral_speed = lateral_speed + arm * yaw_rate
        slips.append(_rolling(speed, axle_lateral_speed, angle)[1])
        along, across = ca.cos(angle), ca.sin(angle)
        for side in (1.0, -1.0):  # left (inner in a left turn), right
            wheel_speed, slip = _rolling(speed - side * half_track * yaw_rate, axle_lateral_speed, angle)
            if lagged:
                held = lagged[len(slip_rates)]
                slip_rates.append(wheel_speed / length * (slip - held))
                slip = held
            force = -magic_formula(tyre, slip, load - side * moved, friction)
            force_y += force * along
            moment += arm * force * along + side * half_track * force * across

    acceleration = measured_acceleration = force_y / chassis.mass
    drift = acceleration  # of the roll axis
    rates: dict[str, Any] = dict(zip(RELAXATION_STATES, slip_rates, strict=False))
    if springs is not None:
        # m a - s p = F and J p - s a = M for the acceleration a of the roll axis and the roll acceleration p.
        gravity_side = chassis.gravity * ca.sin(state["roll"])
        roll_moment = chassis.sprung_moment * gravity_side - springs
        determinant = chassis.mass * chassis.roll_inertia - chassis.sprung_moment**2
        drift = (chassis.roll_inertia * force_y + chassis.sprung_moment * roll_moment) / determinant
        rates["roll"] = state["roll_rate"]
        rates["roll_rate"] = (chassis.mass * roll_moment + chassis.sprung_moment * force_y) / determinant
        measured_acceleration = acceleration + gravity_side
    motor = state.get(MOTOR_ANGLE, rear)
    motor_rate = clamp((clamp(rear_command, chassis.rear_angle_max) - motor) / chassis.rear_lag, chassis.rear_rate_max)
    if not is_zero(chassis.motor_share):
        rates[MOTOR_RATE] = (motor_rate - state[MOTOR_RATE]) / (chassis.motor_share * chassis.rear_lag)
        motor_rate = state[MOTOR_RATE]
    rates[MOTOR_ANGLE] = rates["rear_angle"] = motor_rate
    if not is_zero(chassis.backlash):
        play = motor - rear
        rates["rear_angle"] = (play - clamp(play, chassis.backlash)) / PLAY_TIME_CONSTANT
    rates |= {
        "lateral_speed": drift - speed * yaw_rate,
        "yaw_rate": moment / chassis.yaw_inertia,
        "steering_wheel_angle": clamp((wheel_command - wheel_angle) / chassis.steering_lag, chassis.steering_rate_max),
        "position_x": speed * ca.cos(heading) - lateral_speed * ca.sin(heading),
        "position_y": speed * ca.sin(heading) + lateral_speed * ca.cos(heading),
        "heading": yaw_rate,
    }
    sideslip = ca.atan(lateral_speed / _size(speed))
    output = ca.vertcat(sideslip, acceleration, front, slips[0], slips[1], motor, measured_acceleration)
    return x, u, ca.vertcat(*(rates[name] for name in states)), output


TyreModel = Literal["linear", "magic-formula", "load-transfer"]

SINGLE_TRACK_STATES = ("sideslip_angle", "yaw_rate")
SINGLE_TRACK_INPUTS = ("speed", "front_angle", "rear_angle", "friction")


@dataclass(frozen=True)
class SingleTrackStep:
    """One step of the single-track model with Magic Formula tyres, split around the tyre curves.

    The caller evaluates the axle's curve and its slope in its own way, at X = arguments(x, u): sin(C atan(X - E (X - atan X)))
    less the loss by load transfer (`plant_car.load_transfer_losses`).

    Attributes:
        arguments: (x, u) -> X (2,): B (alpha - S_H) of the front and of the rear tyre.
        is_relaxed: whether the tyres have a relaxation length. X is then a part of the state too, and no slope is needed:
            change is (x, u, curve (2,)).
        change: (x, u, curve (2,), slope (2,)) -> change of x over the step, and the lateral acceleration in m/s^2 with which
            it begins.

    x is [beta (rad), r (rad/s)], with a relaxation length [beta, r, X of the last step (2)] for the arguments. u is
    [1/vx (s/m), delta_f (rad), delta_r (rad), friction].
    """

    arguments: Any
    change: Any
    is_relaxed: bool


def single_track(config: Config, tyre_model: TyreModel, axle_shares: Sequence[float] = (1.0, 1.0)) -> Model:
    """The bicycle model of the paper's equation 1, forces of both tyres of an axle, at static wheel loads.

    States [beta (rad), r (rad/s)], inputs [vx (m/s, above zero), delta_f (rad), delta_r (rad), friction]. With linear tyres
    the friction has no effect.

    `axle_shares` multiply the peaks of front and rear axle, only with "load-transfer".

    "load-transfer" has in steady turns the yaw rate of the two-track car, within 1 % of it: the curve of an axle includes its
    loss of force by load transfer, and of two steered wheels the more loaded one pulls its axle back more. That moment is half
    a track times the steering angle times the difference of both side forces, which is the force of the axle times the share
    of the load that has moved.
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
                share * tyre.peak(tyre.static_load, 1.0) * friction * axle_curve(tyre, curve_argument(tyre, slip), loss)
                + tyre.vertical_shift
            )
            for (tyre, slip), loss, share in zip(both, load_transfer_losses(config), axle_shares, strict=True)
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


def single_track_step(config: Config, step: float, *, per_axle: bool = False) -> SingleTrackStep:
    """Return the step over `step` seconds of the model of `single_track(config, "load-transfer")`.

    The change d of the state solves (I - step/2 J) d = step f(x): the linearly implicit midpoint rule, a Rosenbrock method of
    one stage (E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section IV.7). It is of second order, needs one
    evaluation of each tyre curve, and damps whatever the car damps at any speed, as long as no slope is negative. J leaves out
    what load transfer does, which is slow and small.

    Tyres with the relaxation length sigma of the configured plant follow: X' = vx/sigma (B (alpha - S_H) - X). The force then
    depends on the motion only through X, so the leapfrog scheme is stable without J (E. Hairer, C. Lubich, G. Wanner,
    Geometric Numerical Integration, section I.1.4): X is known half a step after x, and each moves over the other by the
    midpoint rule. It is of second order too.

    With `per_axle`, u has a friction for each axle.
    """
    relaxation = config.plant.relaxation_length_m
    tyres, vehicle = AxleTyres.from_config(config), config.vehicle
    mass, inertia = vehicle.mass_kg, vehicle.yaw_inertia_kg_m2
    front_arm, rear_arm = vehicle.cg_to_front_axle_m, vehicle.cg_to_rear_axle_m
    sizes = (("x", 4 if relaxation else 2), ("u", 4 + per_axle), ("curve", 2), ("slope", 2))
    x, u, value, slope = (ca.SX.sym(name, size) for name, size in sizes)
    beta, yaw_rate = x[0], x[1]
    slowness, front, rear, frictions = u[0], u[1], u[2], (u[3], u[3 + per_axle])
    turning = yaw_rate * slowness
    arguments = ca.vertcat(
        curve_argument(tyres.front, beta + front_arm * turning - front),
        curve_argument(tyres.rear, beta - rear_arm * turning - rear),
    )
    if relaxation:
        arguments = x[2:] + (arguments - x[2:]) / (0.5 + relaxation / step * slowness)
    # Side force of an axle against its slip, times step / mass, and half of its slope against the slip.
    force, stiffness = [], []
    for k, tyre in enumerate((tyres.front, tyres.rear)):
        scale = 2.0 * step / mass
        peak = scale * tyre.peak(tyre.static_load, 1.0) * frictions[k]
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
    acceleration = (-1.0 / step) * sum_of_forces
    if relaxation:
        change = ca.vertcat(-drift - 0.5 * step * yaw, yaw, acceleration)
        return _step(arguments, change, x, u, value)
    m00 = 1.0 + slowness * (stiffness[0] + stiffness[1])
    m10 = front_yaw - rear_yaw
    m01 = 0.5 * step + inertia / mass * (slowness * slowness) * m10
    m11 = 1.0 + slowness * (front_arm * front_yaw + rear_arm * rear_yaw)
    # No plausible car comes near the bound, which keeps the division defined for all inputs.
    determinant = ca.fmax(m00 * m11 - m01 * m10, 0.5)
    change = ca.vertcat(-(m11 * drift + m01 * yaw) / determinant, (m00 * yaw + m10 * drift) / determinant, acceleration)
    return _step(arguments, change, x, u, value, slope)


def _step(arguments: Any, change: Any, x: Any, u: Any, *curves: Any) -> SingleTrackStep:
    """Return the step of these expressions over the symbols x, u, and the values of the curves and, where needed, slopes."""
    names = ["x", "u", "curve", "slope"][: 2 + len(curves)]
    return SingleTrackStep(
        arguments=ca.Function("single_track_arguments", [x, u], [arguments], ["x", "u"], ["argument"]),
        change=ca.Function("single_track_step", [x, u, *curves], [change], names, ["change"]),
        is_relaxed=len(curves) == 1,
    )
