"""The two-track plant as CasADi functions: four loaded wheels with Magic Formula tyres, actuators included.

One set of expressions for the car of a configuration and for a car that is left open. Signs: see `dynamics`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from codegen.configuration import Config
from codegen.vehicle.expressions import Model, clamp, is_zero, magic_formula, make_model
from codegen.vehicle.plant_car import PLANT_PARAMETERS, PlantCar, plant_symbols
from codegen.vehicle.tyre import WHEEL_SPEED_MIN, AxleTyres

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
    Where `plant.relaxation_length_m` (sigma) is above zero, the force of each tyre follows its slip angle with a first-order
    lag over the distance rolled, alpha' = v/sigma (alpha_steady - alpha) with v of that wheel (H. B. Pacejka, Tire and Vehicle
    Dynamics, the single-point contact model). States, inputs and outputs: PLANT_STATES and, with a relaxation length,
    RELAXATION_STATES after them; PLANT_INPUTS, PLANT_OUTPUTS.
    """
    AxleTyres.from_config(config)  # refuses a tyre that has no slip bound
    x, u, derivative, output = _two_track(PlantCar.from_config(config))
    return make_model("two_track", (_plant_states(config), PLANT_INPUTS, PLANT_OUTPUTS), x, u, derivative, output)


def two_track_of_parameters(config: Config) -> ParametricModel:
    """Return `two_track` for any car. The configuration only decides whether the tyres have a relaxation length.

    With p = `plant_parameters(config)` its functions are those of `two_track(config)`.
    """
    p = plant_symbols()
    car = PlantCar.from_symbols(p, config.tyre)
    if config.plant.relaxation_length_m <= 0.0:
        car = replace(car, chassis=replace(car.chassis, relaxation_length=0.0))
    x, u, derivative, output = _two_track(car)
    names = ["x", "u", "p"]
    return ParametricModel(
        states=_plant_states(config),
        inputs=PLANT_INPUTS,
        parameters=PLANT_PARAMETERS,
        outputs=PLANT_OUTPUTS,
        derivative=ca.Function("two_track_of_parameters_derivative", [x, u, p], [derivative], names, ["dx"]),
        output=ca.Function("two_track_of_parameters_output", [x, u, p], [output], names, ["y"]),
    )


def _plant_states(config: Config) -> tuple[str, ...]:
    return (*PLANT_STATES, *RELAXATION_STATES) if config.plant.relaxation_length_m > 0.0 else PLANT_STATES


def _two_track(car: PlantCar) -> tuple[Any, Any, Any, Any]:
    """x, u, x' and y of the plant."""
    chassis = car.chassis
    relaxed = not is_zero(chassis.relaxation_length)
    x = ca.SX.sym("x", len(PLANT_STATES) + (len(RELAXATION_STATES) if relaxed else 0))
    u = ca.SX.sym("u", len(PLANT_INPUTS))
    lateral_speed, yaw_rate, wheel_angle, rear, _, _, heading = (x[i] for i in range(len(PLANT_STATES)))
    speed, wheel_command, rear_command, friction, yaw_moment = (u[i] for i in range(len(PLANT_INPUTS)))
    front = wheel_angle / chassis.steering_ratio

    load_front, load_rear = car.front.static_load, car.rear.static_load
    lateral_acceleration_steady = speed * yaw_rate
    moved_front = clamp(chassis.load_transfer_front * lateral_acceleration_steady, load_front)
    moved_rear = clamp(chassis.load_transfer_rear * lateral_acceleration_steady, load_rear)

    half_track = 0.5 * chassis.track
    axles = (
        (car.front, chassis.cg_to_front_axle, front, load_front, moved_front),
        (car.rear, -chassis.cg_to_rear_axle, rear, load_rear, moved_rear),
    )
    force_y: Any = 0.0
    moment: Any = yaw_moment
    slips: list[Any] = []
    slip_rates: list[Any] = []
    lagged = [x[i] for i in range(len(PLANT_STATES), x.numel())]
    for tyre, arm, angle, load, moved in axles:
        axle_lateral_speed = lateral_speed + arm * yaw_rate
        slips.append(ca.atan(axle_lateral_speed / ca.fmax(speed, WHEEL_SPEED_MIN)) - angle)
        along, across = ca.cos(angle), ca.sin(angle)
        for side in (1.0, -1.0):  # left (inner in a left turn), right
            wheel_speed = ca.fmax(speed - side * half_track * yaw_rate, WHEEL_SPEED_MIN)
            slip = ca.atan(axle_lateral_speed / wheel_speed) - angle
            if lagged:
                held = lagged[len(slip_rates)]
                slip_rates.append(wheel_speed / chassis.relaxation_length * (slip - held))
                slip = held
            force = -magic_formula(tyre, slip, load - side * moved, friction)
            force_y += force * along
            moment += arm * force * along + side * half_track * force * across

    acceleration = force_y / chassis.mass
    rear_demand = clamp(rear_command, chassis.rear_angle_max)
    derivative = ca.vertcat(
        acceleration - speed * yaw_rate,
        moment / chassis.yaw_inertia,
        clamp((wheel_command - wheel_angle) / chassis.steering_lag, chassis.steering_rate_max),
        clamp((rear_demand - rear) / chassis.rear_lag, chassis.rear_rate_max),
        speed * ca.cos(heading) - lateral_speed * ca.sin(heading),
        speed * ca.sin(heading) + lateral_speed * ca.cos(heading),
        yaw_rate,
        *slip_rates,
    )
    output = ca.vertcat(ca.atan(lateral_speed / ca.fmax(speed, WHEEL_SPEED_MIN)), acceleration, front, slips[0], slips[1])
    return x, u, derivative, output
