"""What must hold of the generated reference model. Each check takes the units of a build and raises AssertionError where it
does not hold."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import root

from codegen.emit.reference_model_view import ARGUMENT_MAX, tabulate
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import AxleTyres
from codegen.verify.law.reference_model import (
    SIDESLIP_MAX,
    SecondReferenceModel,
    TableCurve,
    speed_min,
)
from tests.sil.checks_lookup import RealArray, any_numbers, special_values
from tests.sil.exact_dynamics import exact_slope, exact_step, magic_formula
from tests.sil.units import Units

KM_H = 1.0 / 3.6


def limits(units: Units) -> tuple[RealArray, RealArray]:
    """Of the state (3,) and of the inputs (4,)."""
    inputs = units.config.controller.inputs
    rear = math.radians(units.config.rear_actuator.angle_max_deg)
    yaw_rate, front = math.radians(inputs.yaw_rate_max_deg_s), math.radians(inputs.front_angle_max_deg)
    states = np.array([SIDESLIP_MAX, yaw_rate, rear], dtype=units.real)
    return states, np.array([inputs.speed_max_km_h * KM_H, front, rear, units.config.road.friction], dtype=units.real)


def random_states(units: Units, count: int, seed: int) -> RealArray:
    """States (count, 3) as the C can leave them: plain ones, some at their bounds, some next to zero."""
    rng, real = np.random.default_rng(seed), units.real
    states = rng.uniform(-1.0, 1.0, (count, 3)) * rng.choice([1.0, 0.2, 0.01], (count, 1))
    states = np.where(rng.random((count, 3)) < 0.05, rng.choice([-1.0, 1.0, 0.0, -0.0], (count, 3)), states)
    tiny = rng.choice([float(np.finfo(real).smallest_subnormal), float(np.finfo(real).tiny), -1e-30], (count, 3))
    states = np.where(rng.random((count, 3)) < 0.02, tiny, states).astype(real) * limits(units)[0]
    return states.astype(real)


def random_inputs(units: Units, count: int, seed: int) -> RealArray:
    """Inputs (count, 4): plausible ones, a tenth of them beyond their limits."""
    rng = np.random.default_rng(seed)
    inputs = rng.uniform(-0.1, 1.0, (count, 4)) * rng.choice([0.1, 0.4, 1.0, 1.4], (count, 4))
    inputs[:, 1:3] *= rng.choice([-1.0, 1.0], (count, 2))
    result: RealArray = (inputs * limits(units)[1]).astype(units.real)
    return result


def wild_inputs(units: Units, count: int, seed: int) -> RealArray:
    """Inputs (count, 4) of any bit pattern."""
    rng = np.random.default_rng(seed)
    special = np.concatenate([special_values(units.real), limits(units)[1]])
    return np.stack([any_numbers(rng, units.real, count, special) for _ in range(4)], axis=1)


def check_model_finite(units: Units) -> None:
    """Whatever drives it, from whatever state: finite and within its stated bounds, the start too."""
    most, _ = limits(units)
    inputs = np.concatenate([random_inputs(units, 50_000, 7), wild_inputs(units, 50_000, 8)])
    for after in (units.model_from(random_states(units, inputs.shape[0], 6), inputs), units.model_start(inputs[:, :3])):
        assert np.isfinite(after).all()
        assert (np.abs(after) <= most).all()


def check_model_physics(units: Units) -> None:
    """One step is Heun's on the equations of the single-track car with Magic Formula tyres.

    Tolerance: the slope is some 30 operations on terms of at most mu g L / v_min and mu g m L / Iz; each rounds by half a unit.
    The curve's argument is of size B times the slip, its rounding goes through a slope of at most C B.
    """
    config, count = units.config, 20_000
    states = random_states(units, count, 11).astype(np.float64)
    inputs = random_inputs(units, count, 12).astype(np.float64)
    model = SecondReferenceModel(config, np.float64)
    tyres = AxleTyres.from_config(config)
    after = units.model_from(states, inputs).astype(np.float64)
    moved = np.clip(
        float(model.share) * (np.clip(inputs[:, 2], -model.rear_angle_max, model.rear_angle_max) - states[:, 2]),
        -model.travel,
        model.travel,
    )
    assert np.abs(after[:, 2] - (states[:, 2] + moved)).max() <= 4.0 * units.eps * model.rear_angle_max
    u = np.stack(
        [
            np.clip(inputs[:, 0], *model.speeds),
            np.clip(inputs[:, 1], -model.front_angle_max, model.front_angle_max),
            states[:, 2] + 0.5 * moved,
            np.clip(inputs[:, 3], 0.0, model.friction),
        ]
    )
    exact = exact_step(
        config, states[:, :2].T, u, [TableCurve.of(tyre, np.float64) for tyre in (tyres.front, tyres.rear)], float(model.period)
    )
    bounds = limits(units)[0][:2, np.newaxis].astype(np.float64)
    exact = np.clip(exact, -bounds, bounds)
    largest = 9.81 * 0.9 * np.stack([3.0 / u[0], np.full(count, 3.0)])
    slip = np.abs(states[:, 0]) + 2.0 * np.abs(states[:, 1]) / u[0] + np.abs(u[1]) + 0.1
    tolerance = units.eps * (np.abs(exact) + float(model.period) * largest * (30.0 + 60.0 * slip))
    assert (np.abs(after[:, :2].T - exact) <= tolerance).all()


def settled(units: Units, speed: float, front: float, rear: float, friction: float, samples: int = 3000) -> RealArray:
    """The state (3,) after half a minute of the same inputs, from a start straight ahead."""
    start = units.model_start(np.array([[speed, 0.0, 0.0]]))[0]
    last: RealArray = units.model(start, np.array([[speed, front, rear, friction]] * samples))[-1]
    return last


def _steady_turn(units: Units, u: RealArray) -> tuple[RealArray, RealArray]:
    """Sideslip and yaw rate (2,) of the exact car's steady turn, and how far the stated errors of both curves may move them."""
    tyres = AxleTyres.from_config(units.config)

    def slope(x: Any, wrong: tuple[float, float] = (0.0, 0.0)) -> RealArray:
        curves = [
            lambda argument, tyre=tyre, error=error: magic_formula(tyre, argument) + error
            for tyre, error in zip((tyres.front, tyres.rear), wrong, strict=True)
        ]
        result: RealArray = exact_slope(units.config, np.reshape(x, (2, 1)), u[:, np.newaxis], curves)[:, 0]
        return result

    turn = root(slope, [0.0, 0.0], tol=1e-13).x
    jacobian = np.stack([(slope(turn + d) - slope(turn - d)) / 2e-6 for d in 1e-6 * np.eye(2)], axis=1)
    errors = np.diag([tabulate(tyre).error for tyre in (tyres.front, tyres.rear)])
    moved = [np.abs(np.linalg.solve(jacobian, slope(turn, tuple(error)) - slope(turn))) for error in errors]
    return turn, np.sum(moved, axis=0)


def check_model_settles(units: Units) -> None:
    """It converges to the steady turn of the single-track car with the exact tyre curve, within what the curve's stated error
    moves that turn; at small angles that is the linear car."""
    car = SingleTrack.from_config(units.config)
    for speed in (2.3, 4.0, 10.0, 20.0, 33.0):
        for share, rear, friction in ((0.1, 0.0, 0.9), (0.4, 0.01, 0.9), (0.5, -0.004, 0.7), (-0.6, 0.0, 0.5)):
            grip_angle = share * friction * 9.81 / (speed * float(car.yaw_gain(speed)))
            front = float(np.clip(grip_angle, -0.2, 0.2)) + rear
            turn, moved = _steady_turn(units, np.array([speed, front, rear, friction]))
            state = settled(units, speed, front, rear, friction).astype(np.float64)
            # To first order in the error of the curves; each step rounds the state, and they add up over its time constant.
            tolerance = 1.2 * moved + 300.0 * units.eps * np.abs(turn).max()
            assert (np.abs(state[:2] - turn) <= tolerance).all(), (speed, front, rear, state, turn)
    small = settled(units, 15.0, 1e-3, 0.0, 0.9)
    # The first chord of the table departs from the tangent at zero by about its cell, 1/64 of the compression.
    assert abs(float(small[1]) / (float(car.yaw_gain(15.0)) * 1e-3) - 1.0) < 0.02


def check_model_stable_when_slow(units: Units) -> None:
    """At any speed, standstill and reverse included, it stays small after a kick and comes to rest; steps do not ring."""
    for speed in (-3.0, 0.0, 0.1, 1.0, speed_min(units.config), 3.0, 5.0):
        states = units.model((0.05, 0.3, 0.0), np.array([[speed, 0.0, 0.0, 0.9]] * 400)).astype(np.float64)
        assert np.abs(states[:, 0]).max() <= 0.05 * 1.2
        assert np.abs(states[:, 1]).max() <= 0.3
        assert np.abs(states[-1]).max() < 1e-4
        crossings = int((np.diff(np.sign(states[:200, 1])) != 0).sum())
        assert crossings <= 2, "no ringing from step to step"


def check_model_actuator(units: Units) -> None:
    """Its rear angle follows the command as a first-order lag of actuator and one sample, no faster than the actuator."""
    actuator, period = units.config.rear_actuator, units.config.controller.sampling_time_s
    travel = math.radians(actuator.rate_max_deg_s) * period
    small = 0.4 * travel
    path = units.model((0.0, 0.0, 0.0), np.array([[20.0, 0.0, small, 0.9]] * 100))[:, 2].astype(np.float64)
    wanted = small * (1.0 - np.exp(-period * np.arange(1, 101) / (actuator.lag_s + period)))
    assert np.abs(path - wanted).max() <= 200.0 * units.eps * small
    path = units.model((0.0, 0.0, -0.06), np.array([[20.0, 0.0, 0.06, 0.9]] * 100))[:, 2].astype(np.float64)
    steps = np.diff(path)
    assert steps.max() <= travel + 0.1 * units.eps
    assert (steps[:10] > 0.999 * travel).all()
    assert abs(path[-1] - 0.06) < 1e-4


def check_curves(units: Units, count: int = 400_000) -> None:
    """Each curve is off by at most what is stated, as far as the table goes; it is odd, held beyond, and takes any number.

    Rounding: the position rounds by three units of the number of cells, worth at most a cell's rise each; the interpolation and
    the stored corners by four units of 1.
    """
    tyres = AxleTyres.from_config(units.config)
    x = np.concatenate([np.linspace(0.0, 30.0, count), np.geomspace(1e-6, ARGUMENT_MAX, count)]).astype(units.real)
    for tyre, values, mirrored in zip((tyres.front, tyres.rear), units.curves(x), units.curves(-x), strict=True):
        table = tabulate(tyre)
        rise = float(np.abs(np.diff(table.values)).max())
        rounding = units.eps * (3.0 * table.values.size * rise + 4.0)
        error = np.abs(values.astype(np.float64) - magic_formula(tyre, x.astype(np.float64)))
        assert error.max() <= table.error + rounding
        assert error.max() >= 0.9 * table.error, "the bound is not far above the error"
        assert np.array_equal(values, -mirrored)
    beyond = np.array([ARGUMENT_MAX, 2.0 * ARGUMENT_MAX, 1e6, np.inf], dtype=units.real)
    for values in units.curves(beyond):
        assert (values == values[0]).all(), "held"
    special = special_values(units.real)
    for values in units.curves(special):
        assert np.isfinite(values).all()
        assert (np.abs(values) <= 1.0).all()
        assert (values[np.isnan(special) | (special == 0.0)] == 0.0).all()
