"""The plant linearised and sampled: CasADi's Jacobian of the two-track car at steady turns.

`sampled` has the equations of the linear single-track car. Here, load transfer, tyre curve and relaxation are those of
`vehicle.dynamics.two_track`, at any speed, friction and mass, straight ahead or in a turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.design.sampled import SampledCar, sample_of
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, two_track_of_parameters
from codegen.vehicle.plant_car import PLANT_PARAMETERS, varied_cars

LATERAL, YAW, WHEEL, REAR = (
    PLANT_STATES.index(name) for name in ("lateral_speed", "yaw_rate", "steering_wheel_angle", "rear_angle")
)
COMMAND = PLANT_INPUTS.index("rear_angle_command")
LEFT_OUT = ("steering_wheel_angle", "position_x", "position_y", "heading")
"""States that the loop does not feed back: the driver's input, and the position of the car."""

NEWTON_STEPS = 40
TURN_TOLERANCE = 1e-9
"""Largest residual derivative of a steady turn, m/s^2 and rad/s^2: rounding of forces of some 10 kN."""


@dataclass(frozen=True, eq=False)
class SteadyTurns:
    """Steady turns at which the plant was linearised, (n,) each.

    Attributes:
        sampled: the cars, (n,); meaningless where `found` is false.
        found: whether the turn exists: grip may be insufficient, or the car may have no steady state.
        front_angle: rad.
    """

    sampled: SampledCar
    found: BoolArray
    front_angle: FloatArray


def linearised(
    config: Config, speed: npt.ArrayLike, friction: npt.ArrayLike, mass_factor: npt.ArrayLike = 1.0, grip_share: float = 0.0
) -> SteadyTurns:
    """Linearise the plant at steady turns with straight rear wheels; arguments (n,) broadcast together.

    The slope of the tyres is independent of the mass and proportional to the friction; the yaw inertia is proportional to the
    mass. The delay is `config.tuning.delay_samples`.

    Args:
        speed: m/s. friction: of the road. mass_factor: 1 is the configured car.
        grip_share: lateral acceleration over friction times gravity: 0 is straight ahead.
    """
    given = np.broadcast_arrays(*(np.atleast_1d(x) for x in (speed, friction, mass_factor)))
    vx, mu, factor = (np.ascontiguousarray(values, dtype=np.float64) for values in given)
    model = two_track_of_parameters(config)
    x, u, p = ca.SX.sym("x", len(model.states)), ca.SX.sym("u", len(PLANT_INPUTS)), ca.SX.sym("p", len(PLANT_PARAMETERS))
    rate = model.derivative(x, u, p)
    outputs = [rate, ca.densify(ca.jacobian(rate, x)), ca.densify(ca.jacobian(rate, u[COMMAND]))]
    linear = ca.Function("linear", [x, u, p], outputs).map(vx.size)
    cars = np.ascontiguousarray(varied_cars(config, mass=factor).T)
    states, inputs = np.zeros((len(model.states), vx.size)), np.zeros((len(PLANT_INPUTS), vx.size))
    inputs[PLANT_INPUTS.index("speed")], inputs[PLANT_INPUTS.index("friction")] = vx, mu
    found = _turn(linear, states, inputs, cars, grip_share * mu * config.road.gravity_m_s2)
    jacobian, column = (np.array(values) for values in linear(states, inputs, cars)[1:])
    count = len(model.states)
    a = jacobian.reshape(count, vx.size, count).transpose(1, 0, 2)
    kept = [index for index, name in enumerate(model.states) if name not in LEFT_OUT]
    b = column.T[:, kept]
    a = np.where(found[:, np.newaxis, np.newaxis], a[:, kept][:, :, kept], -np.eye(len(kept)))
    sampled = sample_of(a, b, config.controller.sampling_time_s, config.tuning.delay_samples)
    return SteadyTurns(sampled, found, states[WHEEL] / cars[PLANT_PARAMETERS.index("steering_ratio")])


def _turn(linear: ca.Function, states: FloatArray, inputs: FloatArray, cars: FloatArray, acceleration: FloatArray) -> BoolArray:
    """Solve steady turns at lateral accelerations (n,) in m/s^2 into `states`, and return which were found.

    Newton's method on lateral speed and steering wheel, in ten steps of acceleration from straight ahead, so that each step
    starts near its solution.
    """
    count = states.shape[0]
    slips = [index for index in range(count) if index >= len(PLANT_STATES)]
    unknowns, places = [LATERAL, WHEEL, *slips], [LATERAL, YAW, *slips]
    speed = inputs[PLANT_INPUTS.index("speed")]
    residual = np.zeros((len(places), speed.size))
    for share in np.linspace(0.1, 1.0, 10) if acceleration.any() else (0.0,):
        states[YAW] = share * acceleration / speed
        for _ in range(NEWTON_STEPS):
            inputs[PLANT_INPUTS.index("steering_wheel_command")] = states[WHEEL]
            rate, jacobian, _ = (np.array(values) for values in linear(states, inputs, cars))
            residual = rate[places]
            if np.all(np.abs(residual) < TURN_TOLERANCE):
                break
            square = jacobian.reshape(count, speed.size, count)[places][:, :, unknowns].transpose(1, 0, 2)
            solvable = np.isfinite(square).all(axis=(1, 2)) & (np.abs(np.linalg.det(np.nan_to_num(square))) > 0.0)
            step = np.zeros((speed.size, len(unknowns)))
            step[solvable] = np.linalg.solve(square[solvable], residual.T[solvable][..., np.newaxis])[..., 0]
            states[unknowns] -= step.T
    return np.asarray(np.all(np.abs(residual) < TURN_TOLERANCE, axis=0))
