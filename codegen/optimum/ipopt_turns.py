"""The steady turn as CasADi expressions for IPOPT: of the single-track car with linear tyres, and of the two-track plant.

Both use `vehicle.dynamics` alone and share no equations with `exact` or `nonlinear`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.map_file.bounds import BOUNDS, TurnQuantities
from codegen.optimum.problem import STABILITY_MARGIN, SteadyTurnProblem
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, WHEEL_SPEED_MIN, TyreModel, single_track, two_track

STABILITY_SCALE = 100.0
"""Divisor of the stability constraint, in determinants of a neutral car. It exceeds every turn's, so only one side binds."""


@dataclass(frozen=True)
class TurnExpressions:
    """A steady turn over z (3,), the sideslip, yaw rate and rear angle, each divided by its element of `scale`.

    Attributes:
        residual: (2,) zero in a steady turn, of order one.
        used: shares of bounds, each between -1 and 1 where they are kept; |z[0]| and |z[2]| are also bounded by one.
        slips: (2,) rad, of the front and the rear axle.
        objective: as in `problem`.
    """

    residual: Any
    used: Any
    slips: Any
    objective: Any
    scale: FloatArray


def turn_expressions(
    config: Config, problem: SteadyTurnProblem, tyre_model: TyreModel, z: Any, speed: Any, front: Any
) -> TurnExpressions:
    """Return the expressions of one case over the symbols z, speed (m/s) and front angle (rad)."""
    scale = np.array([problem.sideslip_max, 1.0, problem.rear_angle_max or math.radians(1.0)])
    beta, yaw_rate, rear = (z[i] * scale[i] for i in range(3))
    equations = _single_track if tyre_model == "linear" else _two_track
    rates, slips, further = equations(config, (beta, yaw_rate, rear), speed, front)
    # Residuals as angles over a slip bound, so that all constraints are of order one.
    car = problem.car
    residual = ca.vertcat(
        rates[0] * car.mass * speed / (car.front_stiffness * problem.front_slip_max),
        rates[1] * car.yaw_inertia / (car.front_arm * car.front_stiffness * problem.front_slip_max),
    )
    turn = TurnQuantities(speed, front, yaw_rate, beta, *slips, rear)
    limits = [(bound, problem.limit_of(bound)) for bound in BOUNDS if not bound.is_variable]
    used = ca.vertcat(*(bound.value(turn) / limit for bound, limit in limits if math.isfinite(limit)), *further)
    objective = -(yaw_rate**2) + problem.sideslip_weight * beta**2
    return TurnExpressions(residual, used, ca.vertcat(*slips), objective, scale)


Turn = tuple[Any, Any, Any]


def _single_track(config: Config, turn: Turn, speed: Any, front: Any) -> tuple[Any, tuple[Any, Any], tuple[Any, ...]]:
    """(beta', r'), slip angles, and no further constraint."""
    beta, yaw_rate, rear = turn
    model, vehicle = single_track(config, "linear"), config.vehicle
    rates = model.derivative(ca.vertcat(beta, yaw_rate), ca.vertcat(speed, front, rear, 0.9))
    slip_front = beta + vehicle.cg_to_front_axle_m * yaw_rate / speed - front
    slip_rear = beta - vehicle.cg_to_rear_axle_m * yaw_rate / speed - rear
    return rates, (slip_front, slip_rear), ()


def _two_track(config: Config, turn: Turn, speed: Any, front: Any) -> tuple[Any, tuple[Any, Any], tuple[Any, ...]]:
    """(beta', r'), the slip outputs, and the share that keeps the turn off its stability limit."""
    beta, yaw_rate, rear = turn
    model = two_track(without_shifts(config))
    rolling = ca.fmax(speed, WHEEL_SPEED_MIN)
    x, u = ca.SX.zeros(len(PLANT_STATES)), ca.SX.zeros(len(PLANT_INPUTS))
    x[0], x[1], x[2], x[3] = rolling * ca.tan(beta), yaw_rate, front * config.steering.ratio, rear
    u[0], u[1], u[2], u[3] = speed, x[2], rear, config.road.friction
    assert model.output is not None  # the plant has outputs
    derivative, output = model.derivative(x, u), model.output(x, u)
    neutral = config.vehicle.wheelbase / rolling
    determinant, effect = _stability(model, x, u)
    _, straight = _stability(model, ca.SX.zeros(len(PLANT_STATES)), u)
    spare = (determinant - STABILITY_MARGIN * neutral * effect) / (STABILITY_SCALE * neutral * straight)
    rates = ca.vertcat(derivative[0] / speed, derivative[1])
    return rates, (output[3], output[4]), (1.0 - spare,)


def _stability(model: Any, x: Any, u: Any) -> tuple[Any, Any]:
    """Determinant of the plant's Jacobian over lateral speed and yaw rate, and over it -d r/d delta_r in steady turns."""
    jacobian = model.jacobian(x, u)[0]
    determinant = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
    return determinant, jacobian[0, 0] * jacobian[1, 3] - jacobian[1, 0] * jacobian[0, 3]


def without_shifts(config: Config) -> Config:
    """The configuration with tyres that have no shifts and no lag: what the map is solved for."""
    none = {"horizontal_shift_deg": 0.0, "vertical_shift_n": 0.0}
    tyres = {axle: getattr(config.tyre, axle).model_copy(update=none) for axle in ("front", "rear")}
    return config.model_copy(
        update={
            "tyre": config.tyre.model_copy(update=tyres),
            "plant": config.plant.model_copy(update={"relaxation_length_m": 0.0}),
        }
    )
