"""The CasADi models: Jacobians, and the single-track model compared with an independent car."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from codegen.configuration import parse
from codegen.vehicle.dynamics import Model, TyreModel, single_track, two_track
from tests.vehicle.reference_plant import COMPLETE, OTHER, tables

CONFIG = parse(tables(OTHER), "test")
SIZES = ([0.02, 0.3], [5.0, 0.02, 0.02, 0.5])
PLANT_SIZES = ([0.3, 0.3, 0.2, 0.02, 10.0, 10.0, 1.0, *[0.02] * 5, 0.1, 0.02, 0.1], [5.0, 0.2, 0.02, 0.5, 1e3, 1e3])
"""Scales of each state and input over which the derivative changes; for angles, where the tyre becomes nonlinear."""


def evaluate(function: Any, *arguments: Any) -> np.ndarray:
    return np.array(function(*arguments)).ravel()


@pytest.mark.parametrize(
    "model",
    [
        single_track(CONFIG, "linear"),
        single_track(CONFIG, "magic-formula"),
        single_track(CONFIG, "load-transfer"),
        two_track(CONFIG),
        two_track(parse(tables(replace(OTHER, relaxation_length=0.4)), "test")),
        two_track(parse(tables(COMPLETE), "test")),
    ],
    ids=lambda model: f"{model.name}-{len(model.states)}",
)
def test_jacobians_are_the_slopes_of_the_derivative(model: Model) -> None:
    """The slopes along random directions come from central differences of fourth order.

    With steps of 3e-4 the truncation error is (3e-4)^4 of the derivative's own variation, the rounding error 1e-16/3e-4 of it.
    """
    rng = np.random.default_rng(1)
    states, is_plant, step = len(model.states), model.name == "two_track", 3e-4
    size_x, size_u = (np.array(size) for size in (PLANT_SIZES if is_plant else SIZES))
    size_x = size_x[:states]
    functions = (model.derivative, model.jacobian, *([model.output] if model.output else []))
    assert all(one.is_a("SXFunction") and one.sparsity_out(k).is_dense() for one in functions for k in range(one.n_out()))
    for _ in range(40):
        x, u = rng.normal(size=states) * size_x, rng.normal(size=size_u.size) * size_u
        u[0], u[3] = rng.uniform(8.0, 40.0), rng.uniform(0.4, 1.1)
        if is_plant:  # commands near the angles and a slow turn avoid the kinks of actuators and lifting wheels
            x[1] *= 0.5
            u[1:3] = x[2:4] + 0.008 * rng.uniform(-1.0, 1.0, 2)
        if "motor_angle" in model.states:  # the same for the motor, well beyond the play
            x[model.states.index("motor_angle")], u[2] = x[3] + 0.03, x[3] + 0.03 + 0.008 * rng.uniform(-1.0, 1.0)
        dx, du = rng.normal(size=x.size) * size_x, rng.normal(size=u.size) * size_u
        values = [evaluate(model.derivative, x + m * step * dx, u + m * step * du) for m in (-2.0, -1.0, 1.0, 2.0)]
        slope = (values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * step)
        dfdx, dfdu = (np.array(matrix) for matrix in model.jacobian(x, u))
        scale = np.abs(dfdx * dx).max(axis=1) + np.abs(dfdu * du).max(axis=1)
        assert np.all(np.abs(dfdx @ dx + dfdu @ du - slope) <= 1e-8 * scale + 1e-12)


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
def test_single_track_is_that_of_the_independent_car(tyre_model: TyreModel) -> None:
    """The independent car provides the axle forces at static loads."""
    model, car, loads = single_track(CONFIG, tyre_model), OTHER, OTHER.static_loads()
    rng = np.random.default_rng(6)
    for _ in range(100):
        x = beta, yaw_rate = rng.normal(size=2) * [0.1, 0.6]
        u = speed, front, rear, friction = [rng.uniform(1.0, 60.0), *rng.normal(size=2) * 0.1, rng.uniform(0.1, 1.2)]
        slips = beta + car.to_front * yaw_rate / speed - front, beta - car.to_rear * yaw_rate / speed - rear
        forces = [-2.0 * car.tyre_force(wheel, slip, loads[wheel], friction) for wheel, slip in zip((0, 2), slips, strict=True)]
        if tyre_model == "linear":
            forces = [-2.0 * tyre.slope * slip for tyre, slip in zip((car.front, car.rear), slips, strict=True)]
        torque = car.to_front * forces[0] - car.to_rear * forces[1]
        expected = [sum(forces) / (car.mass * speed) - yaw_rate, torque / car.inertia]
        # Forces of 1e5 N over 1e3 kg, a dozen roundings each.
        assert evaluate(model.derivative, x, u) == pytest.approx(expected, rel=1e-12, abs=1e-12)
