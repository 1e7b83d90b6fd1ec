"""The CasADi models: Jacobians, limits for small angles, load transfer, signs."""

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
    RELAXATION_STATES,
    SINGLE_TRACK_INPUTS,
    SINGLE_TRACK_STATES,
    WHEEL_SPEED_MIN,
    Model,
    TyreModel,
    load_transfer_per_lateral_acceleration,
    single_track,
    single_track_from_shapes,
    two_track,
)
from codegen.vehicle.tyre import AxleTyres, static_wheel_loads

FloatArray = npt.NDArray[np.float64]

SPEED = 42.5 / 3.6
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


def evaluate(function: Any, *arguments: Any) -> FloatArray:
    return np.array(function(*arguments)).ravel()


def plant_state(**values: float) -> FloatArray:
    return np.array([values.get(name, 0.0) for name in PLANT_STATES])


def plant_input(**values: float) -> FloatArray:
    defaults = {"speed": SPEED, "friction": 0.9}
    return np.array([{**defaults, **values}.get(name, 0.0) for name in PLANT_INPUTS])


# --- Jacobians -----------------------------------------------------------------------------------------------------


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

    size_x, size_u = sizes(x.size, u.size)
    return along(x, size_x, u, True), along(u, size_u, x, False)


def sizes(states: int, inputs: int) -> tuple[FloatArray, FloatArray]:
    """The size over which each variable's effect changes: angles over a degree or so, where the tyre bends."""
    if states == 2:
        return np.array([0.02, 0.3]), np.array([5.0, 0.02, 0.02, 0.5])
    of_tyres = [0.02] * (states - len(PLANT_STATES))
    return np.array([0.3, 0.3, 0.2, 0.02, 10.0, 10.0, 1.0, *of_tyres]), np.array([5.0, 0.2, 0.02, 0.5, 1_000.0])


def assert_jacobians_match(model: Model, x: FloatArray, u: FloatArray) -> None:
    dfdx, dfdu = (np.array(matrix) for matrix in model.jacobian(x, u))
    by_x, by_u = finite_difference(model.derivative, x, u)
    assert dfdx.shape == by_x.shape
    assert dfdu.shape == by_u.shape
    size_x, size_u = sizes(x.size, u.size)
    # Compared as the change over each variable's size, relative to the largest such change in the row (measured: 3e-9,
    # at crawling speed, where a slip angle bends within a few cm/s).
    changes = np.hstack([dfdx * size_x, dfdu * size_u])
    expected = np.hstack([by_x * size_x, by_u * size_u])
    scale = np.abs(expected).max(axis=1, keepdims=True)
    # Rows that are zero, where a rate limit holds: 1e-12 is the rounding of the difference quotient.
    assert np.all(np.abs(changes - expected) <= 1e-8 * scale + 1e-12)


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
def test_jacobians_of_the_single_track_models(tyre_model: TyreModel) -> None:
    model = single_track(parse({"tyre": LOADED_TYRES}, "test"), tyre_model)
    rng = np.random.default_rng(1)
    for _ in range(40):
        x = rng.normal(size=2) * [0.04, 0.4]
        u = np.array([rng.uniform(4.0, 50.0), *rng.normal(size=2) * 0.05, rng.uniform(0.3, 1.1)])
        assert_jacobians_match(model, x, u)


@pytest.mark.parametrize("regime", ["free", "rate limits", "rear stop", "wheels in the air", "crawling"])
def test_jacobians_of_the_plant(regime: str) -> None:
    """In each region between its kinks; at a kink there is no derivative to compare."""
    model = two_track(parse({"tyre": LOADED_TYRES}, "test"))
    rng = np.random.default_rng(2)
    for _ in range(20):
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
        assert_jacobians_match(model, x, u)


def test_jacobians_of_the_plant_with_relaxed_tyres() -> None:
    model = two_track(parse({"tyre": LOADED_TYRES, "plant": {"relaxation_length_m": 0.6}}, "test"))
    rng = np.random.default_rng(5)
    for _ in range(20):
        wheel, rear = rng.normal() * 0.5, rng.uniform(-0.03, 0.03)
        x = np.array(
            [rng.normal() * 0.4, rng.normal() * 0.15, wheel, rear, 3.0, -2.0, rng.normal(), *rng.normal(size=4) * 0.04]
        )
        u = np.array([rng.uniform(8.0, 40.0), wheel + 0.008, rear + rng.uniform(-0.01, 0.01), rng.uniform(0.4, 1.1), 300.0])
        assert_jacobians_match(model, x, u)


def test_rate_limits_and_stops_cut_the_influence() -> None:
    model = two_track(parse({}, "test"))
    rear, wheel = PLANT_STATES.index("rear_angle"), PLANT_STATES.index("steering_wheel_angle")
    x = plant_state()
    dfdx, dfdu = (np.array(m) for m in model.jacobian(x, plant_input(steering_wheel_command=1.0, rear_angle_command=0.05)))
    assert not dfdx[[wheel, rear]].any()
    assert not dfdu[[wheel, rear]].any()


# --- the single-track model around the tyres' curve ----------------------------------------------------------------


def test_single_track_in_two_parts_is_the_whole() -> None:
    """Bit for bit, with the curve evaluated by the same machine between the parts."""
    config = parse({"tyre": LOADED_TYRES}, "test")
    whole, parts, tyres = single_track(config, "magic-formula"), single_track_from_shapes(config), AxleTyres.from_config(config)
    assert (parts.states, parts.inputs) == (SINGLE_TRACK_STATES, SINGLE_TRACK_INPUTS)
    argument = ca.SX.sym("X")
    curves = [
        ca.Function("curve", [argument], [ca.sin(t.shape_factor * ca.atan(bent))])
        for t in (tyres.front, tyres.rear)
        for bent in [argument - t.curvature_factor * (argument - ca.atan(argument))]
    ]
    rng = np.random.default_rng(6)
    for _ in range(200):
        x = rng.normal(size=2) * [0.1, 0.6]
        u = np.array([rng.uniform(1.0, 60.0), *rng.normal(size=2) * 0.1, rng.uniform(0.1, 1.2)])
        arguments = evaluate(parts.arguments, x, u)
        shapes = [float(curve(value)) for curve, value in zip(curves, arguments, strict=True)]
        assert np.array_equal(evaluate(parts.derivative, x, u, shapes), evaluate(whole.derivative, x, u))


def test_arguments_of_the_curve_are_normalised_slip_angles() -> None:
    config = parse({"tyre": LOADED_TYRES}, "test")
    tyres = AxleTyres.from_config(config)
    beta, yaw_rate, front, rear = 0.02, 0.3, 0.05, -0.03
    slips = beta + 1.574 * yaw_rate / SPEED - front, beta - 1.566 * yaw_rate / SPEED - rear
    found = evaluate(single_track_from_shapes(config).arguments, [beta, yaw_rate], [SPEED, front, rear, 0.9])
    wanted = [
        tyre.stiffness_factor * (slip - math.radians(0.1)) for tyre, slip in zip((tyres.front, tyres.rear), slips, strict=True)
    ]
    assert found == pytest.approx(wanted, rel=1e-13)


# --- limits for small angles ---------------------------------------------------------------------------------------


def test_magic_formula_tends_to_linear_tyres(paper: Config) -> None:
    linear, curved = single_track(paper, "linear"), single_track(paper, "magic-formula")
    u = np.array([SPEED, 0.0, 0.0, 0.9])
    for exact, bent in zip(linear.jacobian(np.zeros(2), u), curved.jacobian(np.zeros(2), u), strict=True):
        # Equal derivatives at zero but for roundings.
        np.testing.assert_allclose(np.array(bent), np.array(exact), rtol=1e-13, atol=1e-13)
    differences = []
    for angle in (2e-3, 1e-3):
        u[1] = angle
        differences.append(evaluate(linear.derivative, np.zeros(2), u) - evaluate(curved.derivative, np.zeros(2), u))
    # The next term of the odd formula is cubic: a factor of eight (the fifth-order term changes it by (B alpha)^2 = 1e-3).
    assert differences[0] / differences[1] == pytest.approx([8.0, 8.0], rel=5e-3)


def test_straight_ahead_the_plant_is_the_single_track_car(paper: Config) -> None:
    linear = single_track(paper, "linear")
    a, b = (np.array(m) for m in linear.jacobian(np.zeros(2), np.array([SPEED, 0.0, 0.0, 0.9])))
    dfdx, _ = (np.array(m) for m in two_track(paper).jacobian(plant_state(), plant_input()))
    ratio = 90.0 / 6.75
    # beta = vy/vx, front angle = wheel angle/ratio, the rear angle is a state of the plant.
    expected = np.array(
        [
            [a[0, 0], SPEED * a[0, 1], SPEED * b[0, 1] / ratio, SPEED * b[0, 2]],
            [a[1, 0] / SPEED, a[1, 1], b[1, 1] / ratio, b[1, 2]],
        ]
    )
    np.testing.assert_allclose(dfdx[:2, :4], expected, rtol=1e-12)  # a few dozen roundings


def test_friction_has_no_effect_on_linear_tyres(paper: Config) -> None:
    model = single_track(paper, "linear")
    x = np.array([0.01, 0.2])
    values = [evaluate(model.derivative, x, [SPEED, 0.05, 0.0, friction]) for friction in (0.1, 0.9)]
    assert np.array_equal(values[0], values[1])


# --- load transfer -------------------------------------------------------------------------------------------------


def test_load_transfer_balances_the_roll_moment(paper: Config) -> None:
    front, rear = load_transfer_per_lateral_acceleration(paper)
    assert 1.627 * (front + rear) == pytest.approx(2335.07 * 0.42, rel=1e-14)
    assert front / (front + rear) == pytest.approx(0.6, rel=1e-14)
    # At the paper's slip bound (5.61 m/s^2) the front axle moves 2029 N.
    assert front * 5.61 == pytest.approx(2029.0, abs=1.0)


def test_printed_load_transfer_is_half(paper: Config) -> None:
    printed = load_transfer_per_lateral_acceleration(parse({"plant": {"load_transfer": "paper"}}, "test"))
    balance = load_transfer_per_lateral_acceleration(paper)
    assert printed == pytest.approx([0.5 * value for value in balance], rel=1e-14)


SATURATED = {
    axle: {
        "stiffness_factor_b_per_rad": 100.0,
        "shape_factor_c": 1.0,
        "curvature_factor_e": -20.0,
    }
    for axle in ("front", "rear")
}
"""Tyres that give friction * load at any large slip: with x = B slip > 70 the formula is within 1e-6 of its peak. They turn
the loads of the wheels, which the plant keeps to itself, into forces that its derivative shows."""
SLIDING = 25.0
"""m/s sideways: slip angles around one radian at every wheel."""


def saturated_plant(**tables: Any) -> tuple[Model, Config]:
    config = parse({"tyre": SATURATED, "limits": {"slip_departure_percent": 5.0}, **tables}, "test")
    return two_track(config), config


@pytest.mark.parametrize("yaw_rate", [-2.0, -1.2, -0.3, 0.0, 0.3, 1.2, 2.0])
def test_wheel_loads_always_sum_to_the_weight(yaw_rate: float) -> None:
    """The last ones with the inner wheels in the air."""
    model, _ = saturated_plant()
    assert model.output is not None
    x, u = plant_state(lateral_speed=SLIDING, yaw_rate=yaw_rate), plant_input(friction=0.8)
    acceleration = evaluate(model.output, x, u)[model.outputs.index("lateral_acceleration")]
    # Sum of the forces over the mass is friction * g; 1e-6 is how near to its peak the tyre is.
    assert acceleration == pytest.approx(-0.8 * 9.81, rel=1e-6)


@pytest.mark.parametrize("yaw_rate", [-2.2, -0.5, 0.2, 0.5, 2.2])
@pytest.mark.parametrize("axle", ["front", "rear"])
def test_load_moves_from_the_inner_to_the_outer_wheel(axle: str, yaw_rate: float) -> None:
    """Steered wheels have a moment from left less right forces: (w/2) sin(delta) friction 2 dFz. At 0.5 rad/s both wheels
    carry, at 2.2 the inner one is in the air and all the axle's load is outside."""
    model, config = saturated_plant(rear_actuator={"angle_max_deg": 20.0}, controller={"inputs": {"rear_angle_max_deg": 30.0}})
    angle, friction = 0.3, 0.8
    x = plant_state(
        lateral_speed=SLIDING,
        yaw_rate=yaw_rate,
        steering_wheel_angle=angle * config.steering.ratio if axle == "front" else 0.0,
        rear_angle=angle if axle == "rear" else 0.0,
    )
    straight = plant_state(lateral_speed=SLIDING, steering_wheel_angle=x[2], rear_angle=x[3])
    moments = [5376.432 * evaluate(model.derivative, point, plant_input(friction=friction))[1] for point in (straight, x)]
    moved = (moments[1] - moments[0]) / (1.627 * math.sin(angle) * friction)
    index = ("front", "rear").index(axle)
    wanted = load_transfer_per_lateral_acceleration(config)[index] * SPEED * yaw_rate
    carried = static_wheel_loads(config)[index]
    wanted = math.copysign(min(abs(wanted), carried), wanted)
    # Peak of the tyre to 1e-6 of the axle's load.
    assert moved == pytest.approx(wanted, abs=1e-5 * carried)


def test_lifted_wheels_are_reached_in_that_test() -> None:
    _, config = saturated_plant()
    for transfer, carried in zip(load_transfer_per_lateral_acceleration(config), static_wheel_loads(config), strict=True):
        assert transfer * SPEED * 0.5 < carried < transfer * SPEED * 2.2


# --- signs ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])
def test_signs_of_the_single_track_models(paper: Config, tyre_model: TyreModel) -> None:
    model = single_track(paper, tyre_model)
    at_rest = np.zeros(2)
    front_beta, front_yaw = evaluate(model.derivative, at_rest, [SPEED, 0.02, 0.0, 0.9])
    rear_beta, rear_yaw = evaluate(model.derivative, at_rest, [SPEED, 0.0, 0.02, 0.9])
    assert front_beta > 0.0  # to the left
    assert front_yaw > 0.0
    assert rear_beta > 0.0
    assert rear_yaw < 0.0


def test_signs_of_the_plant(paper: Config) -> None:
    model = two_track(paper)
    ratio = paper.steering.ratio
    front = evaluate(model.derivative, plant_state(steering_wheel_angle=0.02 * ratio), plant_input())
    rear = evaluate(model.derivative, plant_state(rear_angle=0.02), plant_input())
    assert front[0] > 0.0
    assert front[1] > 0.0
    assert rear[0] > 0.0
    assert rear[1] < 0.0


def test_tyres_oppose_the_motion(paper: Config) -> None:
    """What the printed sign of the force gets wrong: a car that slides to the left is pushed to the right."""
    for model, x, u in (
        (single_track(paper, "linear"), np.array([0.02, 0.0]), np.array([SPEED, 0.0, 0.0, 0.9])),
        (single_track(paper, "magic-formula"), np.array([0.02, 0.0]), np.array([SPEED, 0.0, 0.0, 0.9])),
        (two_track(paper), plant_state(lateral_speed=0.2), plant_input()),
    ):
        assert evaluate(model.derivative, x, u)[0] < 0.0
        a = np.array(model.jacobian(x * 0.0, u)[0])[:2, :2]
        assert np.linalg.eigvals(a).real.max() < 0.0


def test_plant_mirrors_left_and_right(paper: Config) -> None:
    model = two_track(paper)
    rng = np.random.default_rng(3)
    mirror_x = np.array([-1.0, -1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
    mirror_u = np.array([1.0, -1.0, -1.0, 1.0, -1.0])
    for _ in range(30):
        x = rng.normal(size=7) * [1.0, 0.8, 1.5, 0.05, 20.0, 20.0, 2.0]
        u = np.array([rng.uniform(1.0, 50.0), *rng.normal(size=2), 0.9, rng.normal() * 1_000.0])
        left = evaluate(model.derivative, x, u)
        right = evaluate(model.derivative, x * mirror_x, u * mirror_u)
        # Sums in another order: some roundings of forces of 1e4 N.
        np.testing.assert_allclose(right, left * mirror_x, rtol=1e-12, atol=1e-12)


# --- the rest of the plant -----------------------------------------------------------------------------------------


def test_outside_yaw_moment_turns_the_car(paper: Config) -> None:
    model = two_track(paper)
    derivative = evaluate(model.derivative, plant_state(), plant_input(yaw_moment=1_000.0))
    assert derivative[1] == pytest.approx(1_000.0 / 5376.432, rel=1e-15)
    assert not derivative[[0, 2, 3, 5, 6]].any()


def test_position_and_heading_follow_the_velocity(paper: Config) -> None:
    model = two_track(paper)
    heading = math.radians(30.0)
    derivative = evaluate(
        model.derivative, plant_state(lateral_speed=2.0, yaw_rate=0.1, heading=heading), plant_input(speed=10.0)
    )
    # 10 m/s along the car, 2 m/s to its left.
    assert derivative[4] == pytest.approx(10.0 * math.cos(heading) - 2.0 * 0.5, rel=1e-14)
    assert derivative[5] == pytest.approx(10.0 * 0.5 + 2.0 * math.cos(heading), rel=1e-14)
    assert derivative[6] == 0.1


def test_actuators(paper: Config) -> None:
    model = two_track(paper)
    wheel, rear = PLANT_STATES.index("steering_wheel_angle"), PLANT_STATES.index("rear_angle")

    def rates(wheel_command: float, rear_command: float) -> FloatArray:
        u = plant_input(steering_wheel_command=wheel_command, rear_angle_command=rear_command)
        return evaluate(model.derivative, plant_state(), u)[[wheel, rear]]

    # First-order lag while the rate is small, ...
    assert rates(0.01, 0.01) == pytest.approx([0.01 / 0.005, 0.01 / 0.05], rel=1e-15)
    # ... the rate limit beyond it, to both sides, ...
    assert rates(2.0, 0.06) == pytest.approx([math.radians(300.0), math.radians(30.0)], rel=1e-15)
    assert rates(-2.0, -0.06) == pytest.approx([-math.radians(300.0), -math.radians(30.0)], rel=1e-15)
    # ... and a rear command beyond the stop counts as the stop: at 3.5 degrees nothing moves any more.
    at_stop = plant_state(rear_angle=math.radians(3.5))
    assert evaluate(model.derivative, at_stop, plant_input(rear_angle_command=0.2))[rear] == 0.0


def test_outputs(paper: Config) -> None:
    model = two_track(paper)
    assert model.output is not None
    x = plant_state(lateral_speed=0.5, yaw_rate=0.3, steering_wheel_angle=1.2, rear_angle=-0.02)
    u = plant_input()
    sideslip, acceleration, front, slip_front, slip_rear = evaluate(model.output, x, u)
    assert sideslip == pytest.approx(math.atan2(0.5, SPEED), rel=1e-15)
    assert front == pytest.approx(1.2 * 6.75 / 90.0, rel=1e-15)
    assert slip_front == pytest.approx(math.atan2(0.5 + 1.574 * 0.3, SPEED) - front, rel=1e-13)
    assert slip_rear == pytest.approx(math.atan2(0.5 - 1.566 * 0.3, SPEED) + 0.02, rel=1e-13)
    # Of the centre of gravity: the change of the lateral speed and the turning of the frame.
    assert acceleration == pytest.approx(evaluate(model.derivative, x, u)[0] + SPEED * 0.3, rel=1e-13)


@pytest.mark.parametrize("speed", [0.0, 1e-6, WHEEL_SPEED_MIN, 1.0, 150.0])
def test_plant_is_finite_at_any_speed(paper: Config, speed: float) -> None:
    model = two_track(paper)
    assert model.output is not None
    rng = np.random.default_rng(4)
    for _ in range(20):
        x = rng.normal(size=7) * [5.0, 5.0, 5.0, 0.1, 100.0, 100.0, 5.0]
        u = np.array([speed, *rng.normal(size=2), 0.9, 0.0])
        for function in (model.derivative, model.jacobian, model.output):
            results = function(x, u)
            for result in results if isinstance(results, tuple | list) else (results,):
                assert np.isfinite(np.array(result)).all()


def test_models_are_pure_sx(paper: Config) -> None:
    """The C printer walks their instructions."""
    for model in (single_track(paper, "linear"), single_track(paper, "magic-formula"), two_track(paper)):
        functions = [function for function in (model.derivative, model.jacobian, model.output) if function is not None]
        assert all(isinstance(function, ca.Function) and function.is_a("SXFunction") for function in functions)
        # Every element is stored: the C writes arrays, not patterns.
        for function in functions:
            assert all(function.sparsity_out(k).is_dense() for k in range(function.n_out()))


# --- tyres with a relaxation length --------------------------------------------------------------------------------


def relaxed(length: float) -> Model:
    return two_track(parse({"plant": {"relaxation_length_m": length}}, "test"))


def test_states_of_relaxed_tyres_follow_those_of_the_plant(paper: Config) -> None:
    assert two_track(paper).states == PLANT_STATES
    model = relaxed(0.3)
    assert model.states == (*PLANT_STATES, *RELAXATION_STATES)
    assert model.derivative.size1_out(0) == len(model.states)


def wheel_slips(x: FloatArray, speed: float) -> FloatArray:
    front, rear = x[2] * 6.75 / 90.0, x[3]
    sides = np.array([1.0, -1.0, 1.0, -1.0]) * 0.5 * 1.627
    along = speed - sides * x[1]
    across = x[0] + np.array([1.574, 1.574, -1.566, -1.566]) * x[1]
    result: FloatArray = np.arctan2(across, along) - np.array([front, front, rear, rear])
    return result


def test_relaxed_tyres_at_their_steady_slip_are_those_without_relaxation(paper: Config) -> None:
    model, plain = relaxed(0.3), two_track(paper)
    assert model.output is not None
    assert plain.output is not None
    x = plant_state(lateral_speed=-0.4, yaw_rate=0.35, steering_wheel_angle=0.9, rear_angle=-0.02)
    full = np.append(x, wheel_slips(x, SPEED))
    u = plant_input(steering_wheel_command=0.9, rear_angle_command=-0.02)
    derivative = evaluate(model.derivative, full, u)
    # The slip angles of this test and of the model differ by some roundings, times a slope of 1e5 N/rad over the mass.
    assert derivative[:7] == pytest.approx(evaluate(plain.derivative, x, u), abs=1e-12)
    assert derivative[7:] == pytest.approx([0.0] * 4, abs=1e-13)
    assert evaluate(model.output, full, u) == pytest.approx(evaluate(plain.output, x, u), abs=1e-12)


@pytest.mark.parametrize("length", [0.05, 0.6])
def test_relaxed_slip_follows_at_the_speed_of_its_wheel(length: float) -> None:
    model = relaxed(length)
    x = plant_state(lateral_speed=-0.4, yaw_rate=0.35, steering_wheel_angle=0.9, rear_angle=-0.02)
    held = np.array([0.01, -0.02, 0.03, 0.0])
    rates = evaluate(model.derivative, np.append(x, held), plant_input())[7:]
    rolling = SPEED - 0.35 * 0.5 * 1.627 * np.array([1.0, -1.0, 1.0, -1.0])
    assert rates == pytest.approx(rolling / length * (wheel_slips(x, SPEED) - held), rel=1e-12)


def test_standing_wheels_still_relax() -> None:
    """At the least rolling speed, so that nothing is divided by zero and nothing stays for ever."""
    rates = evaluate(relaxed(0.5).derivative, np.append(plant_state(), [0.1] * 4), plant_input(speed=0.0))[7:]
    assert rates == pytest.approx([-0.1 * WHEEL_SPEED_MIN / 0.5] * 4, rel=1e-14)


def test_force_follows_the_slip_that_the_tyre_holds(paper: Config) -> None:
    """Straight ahead with all tyres at a slip: the motion says zero, the forces do not."""
    tyres = AxleTyres.from_config(paper)
    derivative = evaluate(relaxed(0.6).derivative, np.append(plant_state(), [0.02, 0.02, 0.01, 0.01]), plant_input())
    front, rear = 2.0 * float(tyres.front.force(0.02)), 2.0 * float(tyres.rear.force(0.01))
    assert derivative[0] == pytest.approx(-(front + rear) / 2335.07, rel=1e-13)
    assert derivative[1] == pytest.approx(-(1.574 * front - 1.566 * rear) / 5376.432, rel=1e-12)


def test_peak_load_sensitivity_reaches_the_plant() -> None:
    """With p2 < 0 the loaded outer wheel gains less than the inner one loses: at the same slip, less force in all."""
    x, u = plant_state(lateral_speed=-1.2, yaw_rate=0.5), plant_input()
    forces = []
    for p2 in (0.0, -0.3):
        tyres = {axle: {"stiffness_factor_b_per_rad": 18.0, "peak_load_sensitivity_p2": p2} for axle in ("front", "rear")}
        model = two_track(parse({"tyre": tyres}, "test"))
        assert model.output is not None
        forces.append(abs(evaluate(model.output, x, u)[1]))
    assert 0.8 * forces[0] < forces[1] < 0.99 * forces[0]


def test_slip_bound_tyres_are_those_of_the_plant(paper: Config) -> None:
    """One wheel of the model by hand: straight ahead, all four wheels at the same slip."""
    tyres = AxleTyres.from_config(paper)
    slip = math.atan2(0.4, SPEED)
    derivative = evaluate(two_track(paper).derivative, plant_state(lateral_speed=0.4), plant_input())
    front, rear = float(tyres.front.force(slip)), float(tyres.rear.force(slip))
    assert derivative[0] == pytest.approx(-2.0 * (front + rear) / 2335.07, rel=1e-13)
    # The two moments cancel to a part in a thousand.
    assert derivative[1] == pytest.approx(-2.0 * (1.574 * front - 1.566 * rear) / 5376.432, rel=1e-10)
