"""Models of the identification as CasADi functions with their Jacobians, made from the two-track model.

Both have the form x' = f(x, u, p, c), y = h(x, u, p, c), x(0) = g(s, u, p, c): p are the quantities to identify, c the known
ones, s the free part of the initial state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.vehicle.dynamics import (
    PLANT_INPUTS,
    PLANT_OUTPUTS,
    PLANT_STATES,
    RELAXATION_STATES,
    ParametricModel,
    two_track_of_parameters,
)
from codegen.vehicle.plant_car import PLANT_PARAMETERS, plant_parameters
from codegen.vehicle.tyre import CURVES

AXLES = ("front", "rear")
OUTPUTS = ("yaw_rate", "lateral_acceleration", "sideslip")
INPUTS = ("vx", "front", "delta_r", "vx_rate", "front_rate", "delta_r_rate")
VEHICLE_PARAMETERS = (
    *(f"{axle}_{name}" for axle in AXLES for name in ("stiffness", "peak", "shape", "curvature", "load_sensitivity")),
    "yaw_inertia",
    "relaxation_length",
    "steering_ratio",
    "front_offset",
    "speed_factor",
    "speed_offset",
    "lateral_acceleration_factor",
    *(f"{output}_offset" for output in OUTPUTS),
    *(f"{output}_delay" for output in OUTPUTS),
)
ACTUATOR_PARAMETERS = ("actuator_lag", "actuator_rate", "rear_offset", "actuator_delay")
"""The delay is last: it also moves the input."""


@dataclass(frozen=True)
class ShootingModel:
    """A model with the derivatives that the identification needs, as CasADi functions of column vectors.

    Attributes:
        name: also the name of the compiled library.
        states, starts, inputs, outputs, parameters, constants: names of the elements of x, s, u, y, p and c.
        initial: (s, u, p, c) -> x, dx/ds, dx/dp.
        derivative: (x, u, p, c) -> f. slopes: (x, u, p, c) -> f, df/dx, df/dp.
        output: (x, u, p, c) -> y. output_slopes: (x, u, p, c) -> y, dy/dx, dy/dp.
    """

    name: str
    states: tuple[str, ...]
    starts: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    constants: tuple[str, ...]
    initial: Any
    derivative: Any
    slopes: Any
    output: Any
    output_slopes: Any


def _made(
    names: tuple[str, Sequence[str], Sequence[str], Sequence[str], Sequence[str], Sequence[str], Sequence[str]],
    symbols: tuple[Any, Any, Any, Any, Any],
    initial: Any,
    rates: Any,
    outputs: Any,
) -> ShootingModel:
    x, s, u, p, c = symbols
    given, arguments = [x, u, p, c], ["x", "u", "p", "c"]

    def with_slopes(name: str, value: Any, first: Any, free: list[Any], labels: list[str], results: list[str]) -> Any:
        # Row-major, so that a row of the Jacobian is contiguous in C.
        slopes = [ca.densify(ca.jacobian(value, by)).T for by in (first, p)]
        return ca.Function(name, free, [value, *slopes], labels, results)

    return ShootingModel(
        name=names[0],
        states=tuple(names[1]),
        starts=tuple(names[2]),
        inputs=tuple(names[3]),
        outputs=tuple(names[4]),
        parameters=tuple(names[5]),
        constants=tuple(names[6]),
        initial=with_slopes("initial", initial, s, [s, u, p, c], ["s", "u", "p", "c"], ["x", "dx_ds", "dx_dp"]),
        derivative=ca.Function("derivative", given, [rates], arguments, ["f"]),
        slopes=with_slopes("slopes", rates, x, given, arguments, ["f", "df_dx", "df_dp"]),
        output=ca.Function("output", given, [outputs], arguments, ["y"]),
        output_slopes=with_slopes("output_slopes", outputs, x, given, arguments, ["y", "dy_dx", "dy_dp"]),
    )


VEHICLE_CONSTANTS = (*PLANT_PARAMETERS, "friction", *(f"{output}_shift" for output in OUTPUTS))
"""Known quantities of the vehicle: the plant's parameters, the friction of the road, and the time in s by which the
measured outputs were moved forward already."""


def vehicle_constants(config: Config, shifts: FloatArray) -> FloatArray:
    """Return the values of VEHICLE_CONSTANTS; `shifts` (3,) in s."""
    return np.concatenate([plant_parameters(config), [config.road.friction], shifts])


def vehicle_model(config: Config, is_relaxed: bool) -> ShootingModel:
    """Return the car: the two-track model driven by measured speed and steering angles, seen through sensors with errors.

    Inputs: speed (m/s), front angle (rad; or the steering wheel's, with its ratio) and rear angle (rad), as measured; and their
    rates, for the delay of an output that follows them at once.
    Initial states: lateral speed and yaw rate; the slip of tyres with a relaxation length starts at its steady value.

    Args:
        config: gives the curves of the tyres; all its numbers are data of the model.
        is_relaxed: whether the tyres have a relaxation length.
    """
    curves = (config.tyre.front.curve, config.tyre.rear.curve)
    key = (is_relaxed, *curves)
    if key not in _vehicle_models:
        length = RELAXATION_ANY_M if is_relaxed else 0.0
        relaxed = config.with_ideal_plant().unchecked({"plant.relaxation_length_m": length})
        _vehicle_models[key] = _vehicle_model(two_track_of_parameters(relaxed), is_relaxed, curves)
    return _vehicle_models[key]


RELAXATION_ANY_M = 0.3
_vehicle_models: dict[tuple[bool, str, str], ShootingModel] = {}


def _vehicle_model(plant: ParametricModel, is_relaxed: bool, curves: tuple[str, str]) -> ShootingModel:
    slips = RELAXATION_STATES if is_relaxed else ()
    states = ("lateral_speed", "yaw_rate", *slips)
    x, s = ca.SX.sym("x", len(states)), ca.SX.sym("s", 2)
    u = ca.SX.sym("u", 6)
    p, c = ca.SX.sym("p", len(VEHICLE_PARAMETERS)), ca.SX.sym("c", len(VEHICLE_CONSTANTS))
    parameter = dict(zip(VEHICLE_PARAMETERS, ca.vertsplit(p), strict=True))
    known = dict(zip(VEHICLE_CONSTANTS, ca.vertsplit(c), strict=True))

    car = {name: known[name] for name in PLANT_PARAMETERS}
    car |= {name: parameter[name] for name in ("yaw_inertia", "relaxation_length", "steering_ratio")}
    for axle, curve in zip(AXLES, curves, strict=True):
        stiffness, peak, shape, curvature, sensitivity = (
            parameter[f"{axle}_{name}"] for name in ("stiffness", "peak", "shape", "curvature", "load_sensitivity")
        )
        slope = CURVES[curve].initial_slope(
            SimpleNamespace(stiffness_factor=1.0, shape_factor=shape, curvature_factor=curvature)
        )
        car |= {
            f"{axle}_stiffness_factor": stiffness / (slope * known["friction"] * peak * known[f"{axle}_static_load"]),
            f"{axle}_peak_factor": peak,
            f"{axle}_shape_factor": shape,
            f"{axle}_curvature_factor": curvature,
            f"{axle}_peak_load_sensitivity": sensitivity,
        }
    symbols = ca.vertcat(*(car[name] for name in PLANT_PARAMETERS))
    speed = (u[0] - parameter["speed_offset"]) / parameter["speed_factor"]
    wheel = u[1] - parameter["front_offset"] * parameter["steering_ratio"]
    moving = {"lateral_speed": x[0], "yaw_rate": x[1], "steering_wheel_angle": wheel, "rear_angle": u[2]}
    moving |= {name: x[2 + index] for index, name in enumerate(slips)}
    driven = {"speed": speed, "friction": known["friction"]}
    given = (
        ca.vertcat(*(moving.get(name, 0.0) for name in plant.states)),
        ca.vertcat(*(driven.get(name, 0.0) for name in PLANT_INPUTS)),
        symbols,
    )
    plant_rates = plant.derivative(*given)
    rates = ca.vertcat(*(plant_rates[plant.states.index(name)] for name in states))
    seen = dict(zip(PLANT_OUTPUTS, ca.vertsplit(plant.output(*given)), strict=True))

    # Each output is seen late; what whole samples leave of the delay is small, and a tangent follows it.
    acceleration = parameter["lateral_acceleration_factor"] * seen["lateral_acceleration"]
    true = {"yaw_rate": x[1], "lateral_acceleration": acceleration, "sideslip": seen["sideslip_angle"]}
    outputs = ca.vertcat(
        *(
            value
            - (parameter[f"{name}_delay"] - known[f"{name}_shift"])
            * (ca.jtimes(value, x, rates) + ca.jtimes(value, u, ca.vertcat(u[3:], ca.SX.zeros(3))))
            + parameter[f"{name}_offset"]
            for name, value in true.items()
        )
    )
    start = s
    if is_relaxed:
        at_zero = ca.substitute(rates[2:], x, ca.vertcat(s, ca.SX.zeros(4)))
        fall = -ca.substitute(ca.diag(ca.jacobian(rates[2:], x[2:])), x, ca.vertcat(s, ca.SX.zeros(4)))
        start = ca.vertcat(s, at_zero / fall)
    names = ("identify_vehicle", states, states[:2], INPUTS, OUTPUTS, VEHICLE_PARAMETERS, VEHICLE_CONSTANTS)
    return _made(names, (x, s, u, p, c), start, rates, outputs)


@lru_cache(maxsize=1)
def actuator_model() -> ShootingModel:
    """Return the rear actuator of the two-track model: output angle (rad) with the sensor's offset.

    A step of the command lies between two samples, where its delay puts it. Time is stretched before and after it, so that
    the step falls between two integration steps. Inputs: command (rad), stretch, and derivative of the stretch by the delay.
    Constants: the largest angle (rad) and the delay (s) of these inputs, from which the parameter departs only in derivatives.
    """
    plant = two_track_of_parameters(configuration.preset())
    x, s, u = ca.SX.sym("x"), ca.SX.sym("s"), ca.SX.sym("u", 3)
    p, c = ca.SX.sym("p", len(ACTUATOR_PARAMETERS)), ca.SX.sym("c", 2)
    lag, rate, offset, delay = ca.vertsplit(p)
    car = {"rear_lag": lag, "rear_rate_max": rate, "rear_angle_max": c[0]}
    stretch = u[1] + (delay - c[1]) * u[2]
    rates = (
        stretch
        * plant.derivative(
            ca.vertcat(*(x if name == "rear_angle" else 0.0 for name in PLANT_STATES)),
            ca.vertcat(*(u[0] if name == "rear_angle_command" else 1.0 for name in PLANT_INPUTS)),
            ca.vertcat(*(car.get(name, 1.0) for name in PLANT_PARAMETERS)),
        )[PLANT_STATES.index("rear_angle")]
    )
    names = (
        "identify_actuator",
        ("rear_angle",),
        ("rear_angle",),
        ("delta_r_command", "stretch", "stretch_by_delay"),
        ("delta_r",),
        ACTUATOR_PARAMETERS,
        ("rear_angle_max", "delay"),
    )
    return _made(names, (x, s, u, p, c), s, rates, x + offset)
