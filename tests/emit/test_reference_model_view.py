"""The reference model's view: the table of a tyre curve with its stated error, and the step of any plausible car."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from codegen.arrays import FloatArray
from codegen.emit.dynamics_view import LATERAL_ACCELERATION_MAX, SIDESLIP_MAX, ReferenceModelView, tabulate
from codegen.errors import BuildError
from codegen.vehicle.dynamics import single_track
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre
from hil_sim.suite.cars import DEVELOPMENT_SEED, random_cars
from tests import builds
from tests.oracle.tracking import SecondReferenceModel, TableCurve

CONFIG = builds.TRACKING_CONFIG
SHAPES = [(c, e) for c in (0.5, 1.3, 2.5) for e in (-20.0, -0.5, 0.5, 0.99, 1.0)]
"""Shape and curvature factors over the whole range of a configuration."""


def tyre(shape_factor: float = 1.3, curvature_factor: float = -0.5) -> MagicFormulaTyre:
    """Return the paper's front tyre with another curve."""
    front = AxleTyres.from_config(CONFIG).front
    return dataclasses.replace(front, shape_factor=shape_factor, curvature_factor=curvature_factor)


def axle_curve(of: MagicFormulaTyre, x: Any, loss: float) -> Any:
    """Return the curve c: the root of loss s c^2 + c = s with s = sin(C atan(x - E (x - atan x)))."""
    s = np.sin(of.shape_factor * np.arctan(x - of.curvature_factor * (x - np.arctan(x))))
    return 2.0 * s / (1.0 + np.sqrt(1.0 + 4.0 * loss * s * s))


@pytest.mark.parametrize("loss", [0.0, 0.2, -0.1])
@pytest.mark.parametrize(("c", "e"), SHAPES)
def test_the_stated_error_holds_and_is_not_far_above(c: float, e: float, loss: float) -> None:
    """The points differ from those of the search: evenly spaced ones, and geometric ones far out."""
    table, curve, step = tabulate(tyre(c, e), loss), TableCurve.of(tyre(c, e), np.float64, loss), 1e-7
    x = np.concatenate([np.linspace(0.0, 40.0, 60_007), np.geomspace(1e-5, 1e6, 40_003)])
    (value, slope), (ahead, _) = curve(x), curve(x + step)
    error = float(np.abs(value - axle_curve(tyre(c, e), x, loss)).max())
    assert error <= table.error <= 1.05 * error
    assert table.values[0] == 0.0 and np.array_equal(curve(-x)[0], -value)
    # The difference quotient errs by half a step of the second derivative, 2 slope / (x + compression), and by rounding.
    off = np.abs(np.maximum((ahead - value) / step, 0.0) - slope)
    assert (off <= 1.01 * step * slope / table.compression + 4.0 * np.finfo(float).eps / step)[x < 40.0].all()


def test_a_curve_that_no_table_keeps_is_refused() -> None:
    """The curve is steeper than any tyre of a configuration."""
    with pytest.raises(BuildError, match=r"tyre\.front: no table of 512 cells follows the tyre's curve within 0\.001"):
        tabulate(tyre(1.3, -1e6), where="tyre.front")


@pytest.mark.parametrize("relaxation", [0.0, 0.1, 0.4, 1.0])
@pytest.mark.parametrize("seed", range(6))
def test_the_step_is_stable_and_accurate_from_the_enabling_speed_for_any_plausible_car(seed: int, relaxation: float) -> None:
    """States up to 6 degrees and 45 deg/s converge to one turn, and a ramp of 0.2 s to 4 degrees follows the exact solution.

    For 60 cars the error of the yaw rate is at most 0.15 % of its peak; twice that is allowed. The slowest mode of a car decays
    within about 0.1 s at the enabling speed, and by far more than to 1e-6 in 2 s. With a relaxation length sigma it decays with
    the time constant 2 sigma / vx. The rear angle decays with its lag of up to 0.16 s; 20 more time
    constants leave 2e-9 of it.
    """
    config = random_cars(DEVELOPMENT_SEED, seed + 1)[seed].replace({"plant.relaxation_length_m": relaxation}, "test")
    model, period, friction = SecondReferenceModel(config, np.float64), config.controller.sampling_time_s, config.road.friction
    speeds = np.array([config.controller.enable_speed_km_h, 30.0, 60.0, 90.0]) / 3.6
    car, ones = single_track(config, "load-transfer").derivative, np.ones(speeds.size)

    def inputs(time: float) -> FloatArray:
        return np.stack([speeds, math.radians(4.0) * min(time / 0.2, 1.0) * ones, 0.0 * ones, friction * ones])

    arms = np.array([[config.vehicle.cg_to_front_axle_m], [-config.vehicle.cg_to_rear_axle_m]])

    def rates(time: float, states: FloatArray) -> FloatArray:
        motion, slips = states.reshape(-1, speeds.size)[:2], states.reshape(-1, speeds.size)[2:]
        u = inputs(time)
        steady = motion[0] + arms * motion[1] / speeds - u[1:3]
        if not relaxation:
            return np.array(car(motion, u)).ravel()
        # At these angles the wheels would have the slip that lags.
        at_slips = np.stack([speeds, *(steady + u[1:3] - slips), u[3]])
        return np.concatenate([np.array(car(motion, at_slips)), speeds / relaxation * (steady - slips)]).ravel()

    count = 4 if relaxation else 2
    times = period * np.arange(1, 51)
    solution = solve_ivp(
        rates, (0.0, times[-1]), np.zeros(count * speeds.size), t_eval=times, rtol=1e-8, atol=1e-10, max_step=period
    )
    exact = solution.y.reshape(count, speeds.size, -1)[1]
    state, error = model.start(speeds, 0.0 * ones, 0.0 * ones), 0.0 * ones
    for k in range(50):
        state = model.step(state, inputs((k + (0.0 if relaxation else 0.5)) * period))
        error = np.maximum(error, np.abs(state[1] - exact[:, k]))
    assert (error <= 0.003 * np.abs(exact).max(axis=1)).all()
    largest = np.array([SIDESLIP_MAX, model.yaw_rate_max, model.rear_angle_max, LATERAL_ACCELERATION_MAX, 1.0, 1.0])
    size = 2 + count
    state = tuple(np.random.default_rng(seed).uniform(-0.3, 0.3, (size, 20)) * largest[:size, np.newaxis])
    for _ in range(200 + round(50.0 * relaxation / speeds[0] / period) + round(20.0 / model.share)):
        state = model.step(state, np.tile(inputs(1.0)[:, :1], 20))
    assert np.ptp(state, axis=1).max() < 1e-6


def test_the_rear_angle_of_the_model_waits_for_lag_and_bus() -> None:
    """A command acts at least one sample late, so the model of a car without a delay is that of one with one sample."""
    period, lag = CONFIG.controller.sampling_time_s, CONFIG.rear_actuator.lag_s
    shares = []
    for delay in (0, 1, 20):
        config = CONFIG.replace({"plant.command_delay_samples": delay})
        shares.append(ReferenceModelView(config, "double").actuator_share)
        assert SecondReferenceModel(config, np.float64).share == shares[-1]
    assert shares == pytest.approx([1.0 - math.exp(-period / (lag + late * period)) for late in (1, 1, 20)], rel=1e-15)
    assert shares[0] == shares[1]
