"""The CasADi models: Jacobians, and the single-track model against an independent car."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from codegen.config import Config, parse
from codegen.vehicle.dynamics import (
    PLANT_INPUTS,
    PLANT_STATES,
    WHEEL_SPEED_MIN,
    Model,
    TyreModel,
    single_track,
    single_track_from_shapes,
    two_track,
)
from codegen.vehicle.tyre import AxleTyres
from tests.vehicle.reference_plant import Car, TyreData

FloatArray = npt.NDArray[np.float64]

LOADED_TYRES = {
    axle: {
        "cornering_stiffness_n_per_rad": stiffness,
        "peak_load_sensitivity_p2": -0.15,
        "horizontal_shift_deg": 0.1,
        "vertical_shift_n": 80.0,
    }
    for axle, stiffness in (("front", 110_000.0), ("rear", 125_000.0))
}
"""Every term of the formula at work."""
LOADED = parse({"tyre": LOADED_TYRES}, "test")
LOADED_CAR = Car(
    **{
        axle: TyreData(stiffness, peak_with_load=-0.15, shift_angle=math.radians(0.1), shift_force=80.0)
        for axle, stiffness in (("front", 110_000.0), ("rear", 125_000.0))
    }
)


def evaluate(function: Any, *arguments: Any) -> FloatArray:
    return np.array(function(*arguments)).ravel()


def finite_difference(function: Any, x: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Central differences of fourth order.

    With a step of 3e-4 of each variable's size the truncation error is (3e-4)^4 of the derivative's own variation and the
    rounding error 1e-16/3e-4 of the function.
    """

    def along(point: FloatArray, size: FloatArray, other: FloatArray, first: bool) -> FloatArray:
        columns = []
        for k in range(point.size):
            step = np.zeros_like(point)
            step[k] = 3e-4 * size[k]
            samples = [point + m * step for m in (-2.0, -1.0, 1.0, 2.0)]
            values = [evaluate(function, sample, other) if first else evaluate(function, other, sample) for sample in samples]
            columns.append((values[0] - 8.0 * values[1] + 8.0 * values[2] - values[3]) / (12.0 * step[k]))
        return np.array(columns).T

    size_x, size_u = sizes(x.size)
    return along(x, size_x, u, True), along(u, size_u, x, False)


def sizes(states: int) -> tuple[FloatArray, FloatArray]:
    """The change over which the effect of each variable changes: angles over a degree or so, where the tyre bends."""
    if states == 2:
        return np.array([0.02, 0.3]), np.array([5.0, 0.02, 0.02, 0.5])
    of_tyres = [0.02] * (states - len(PLANT_STATES))
    return np.array([0.3, 0.3, 0.2, 0.02, 10.0, 10.0, 1.0, *of_tyres]), np.array([5.0, 0.2, 0.02, 0.5, 1_000.0])


def assert_jacobians_match(model: Model, x: FloatArray, u: FloatArray) -> None:
    dfdx, dfdu = (np.array(matrix) for matrix in model.jacobian(x, u))
    by_x, by_u = finite_difference(model.derivative, x, u)
    assert (dfdx.shape, dfdu.shape) == (by_x.shape, by_u.shape)
    size_x, size_u = sizes(x.size)
    # Compared as the change over each variable's size, relative to the largest such change in the row (measured: 3e-9,
    # at crawling speed, where a slip angle bends within a few cm/s).
    changes = np.hstack([dfdx * size_x, dfdu * size_u])
    expected = np.hstack([by_x * size_x, by_u * size_u])
    scale = np.abs(expected).max(axis=1, keepdims=True)
    # Rows that are zero, where a rate limit holds: 1e-12 is the rounding of the difference quotient.
    assert np.all(np.abs(changes - expected) <= 1e-8 * scale + 1e-12)


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
def test_jacobians_of_the_single_track_models(tyre_model: TyreModel) -> None:
    model = single_track(LOADED, tyre_model)
    rng = np.random.default_rng(1)
    for _ in range(20):
        x = rng.normal(size=2) * [0.04, 0.4]
        u = np.array([rng.uniform(4.0, 50.0), *rng.normal(size=2) * 0.05, rng.uniform(0.3, 1.1)])
        assert_jacobians_match(model, x, u)


@pytest.mark.parametrize("regime", ["free", "rate limits", "rear stop", "wheels in the air", "crawling", "relaxed"])
def test_jacobians_of_the_plant(regime: str) -> None:
    """Each region between its kinks is tested; at a kink there is no derivative to compare."""
    relaxation = {"plant": {"relaxation_length_m": 0.6}} if regime == "relaxed" else {}
    model = two_track(parse({"tyre": LOADED_TYRES, **relaxation}, "test"))
    rng = np.random.default_rng(2)
    for _ in range(8):
        wheel, rear = rng.normal() * 0.5, rng.uniform(-0.03, 0.03)
        x = np.array([rng.normal() * 0.4, rng.normal() * 0.15, wheel, rear, 3.0, -2.0, rng.normal()])
        u = np.array([rng.uniform(8.0, 40.0), wheel + 0.008, rear + rng.uniform(-0.01, 0.01), rng.uniform(0.4, 1.1), 300.0])
        if regime == "rate limits":
            u[1], u[2] = wheel + 1.0, rear - math.copysign(0.032, rear)
        elif regime == "rear stop":
            x[3], u[2] = 0.05, 0.09
        elif regime == "wheels in the air":
            x[1], u[0] = math.copysign(1.2, x[1]), 35.0
        elif regime == "crawling":
            x[1], u[0] = x[1] * 0.5, 0.2  # every wheel slower than the least rolling speed
        elif regime == "relaxed":
            x = np.append(x, rng.normal(size=4) * 0.04)
        assert_jacobians_match(model, x, u)
        if regime in ("rate limits", "rear stop"):  # the rear command has no influence
            assert not np.array(model.jacobian(x, u)[1])[:, 2].any()


@pytest.mark.parametrize("speed", [0.0, WHEEL_SPEED_MIN, 150.0])
def test_jacobians_of_the_plant_are_finite_at_any_speed(paper: Config, speed: float) -> None:
    model = two_track(paper)
    rng = np.random.default_rng(4)
    for _ in range(20):
        x = rng.normal(size=7) * [5.0, 5.0, 5.0, 0.1, 100.0, 100.0, 5.0]
        u = np.array([speed, *rng.normal(size=2), 0.9, 0.0])
        assert all(np.isfinite(np.array(matrix)).all() for matrix in model.jacobian(x, u))


def single_track_points(count: int) -> list[tuple[FloatArray, FloatArray]]:
    rng = np.random.default_rng(6)
    return [
        (
            rng.normal(size=2) * [0.1, 0.6],
            np.array([rng.uniform(1.0, 60.0), *rng.normal(size=2) * 0.1, rng.uniform(0.1, 1.2)]),
        )
        for _ in range(count)
    ]


def independent_rates(car: Car, tyre_model: TyreModel, x: FloatArray, u: FloatArray) -> list[float]:
    """Rates of sideslip angle and yaw rate from the axle forces of the independent car at static loads."""
    (beta, yaw_rate), (speed, front, rear, friction), loads = x, u, car.static_loads()
    slips = beta + car.to_front * yaw_rate / speed - front, beta - car.to_rear * yaw_rate / speed - rear
    forces = [-2.0 * car.tyre_force(wheel, slip, loads[wheel], friction) for wheel, slip in zip((0, 2), slips, strict=True)]
    if tyre_model == "linear":
        forces = [-2.0 * tyre.slope * slip for tyre, slip in zip((car.front, car.rear), slips, strict=True)]
    side, torque = sum(forces), car.to_front * forces[0] - car.to_rear * forces[1]
    return [side / (car.mass * speed) - yaw_rate, torque / car.inertia]


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
def test_single_track_is_that_of_the_independent_car(tyre_model: TyreModel) -> None:
    model = single_track(LOADED, tyre_model)
    for x, u in single_track_points(100):
        # Forces of 1e5 N over 1e3 kg, a dozen roundings each.
        expected = independent_rates(LOADED_CAR, tyre_model, x, u)
        assert evaluate(model.derivative, x, u) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_single_track_in_two_parts_is_the_whole() -> None:
    """Bit for bit, with the curve evaluated by the same machine between the parts."""
    whole, parts, tyres = single_track(LOADED, "magic-formula"), single_track_from_shapes(LOADED), AxleTyres.from_config(LOADED)
    assert (parts.states, parts.inputs) == (whole.states, whole.inputs)
    argument = ca.SX.sym("X")
    curves = [
        ca.Function("curve", [argument], [ca.sin(t.shape_factor * ca.atan(bent))])
        for t in (tyres.front, tyres.rear)
        for bent in [argument - t.curvature_factor * (argument - ca.atan(argument))]
    ]
    for x, u in single_track_points(100):
        arguments = evaluate(parts.arguments, x, u)
        shapes = [float(curve(value)) for curve, value in zip(curves, arguments, strict=True)]
        assert np.array_equal(evaluate(parts.derivative, x, u, shapes), evaluate(whole.derivative, x, u))


def test_models_are_pure_sx_and_dense(paper: Config) -> None:
    """The C printer walks their instructions, and the C writes arrays, not patterns."""
    for model in (single_track(paper, "linear"), single_track(paper, "magic-formula"), two_track(paper)):
        for function in (model.derivative, model.jacobian, model.output):
            if function is not None:
                assert isinstance(function, ca.Function) and function.is_a("SXFunction")
                assert all(function.sparsity_out(k).is_dense() for k in range(function.n_out()))
    assert two_track(paper).inputs == PLANT_INPUTS
