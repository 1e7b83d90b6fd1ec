"""The compiled models against finite differences, against the plant, and against a formula."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from codegen.configuration import preset
from codegen.identify.model import OUTPUTS
from codegen.identify.parameters import configured
from codegen.identify.shooting import DriveSamples, Problem, actuator_problem, between, filled, held, vehicle_problem
from codegen.units import DEGREE
from tests.identify.drives import SENSOR, Course, Drive, Errors, drive

CONFIG = preset("recommended").with_ideal_plant()
NO_ERRORS = Errors(bias={}, speed_factor=1.0, jitter_steps=0, command_delay=0.0)
DIFFERENCE = 1e-5
"""Relative step of central differences: their error is some 1e-10, and rounding adds 1e-11."""


def exact(**plant: float) -> Drive:
    """Return a drive without sensor errors of a car with a relaxation length of 0.3 m."""
    data = CONFIG.model_dump(mode="json")
    data["plant"]["relaxation_length_m"] = 0.3
    for sensor in data["sensors"].values():
        sensor |= {key: 0 if key.startswith("delay") else 0.0 for key in sensor}
    config = type(CONFIG).model_validate(data)
    course = Course(config)
    parts = (course.front_sweep(60.0, 5.0, 6.0), course.rear_sweep(60.0, 1.5, 4.0))
    return drive(config, parts, errors=NO_ERRORS, signals=(*SENSOR, "sideslip", "delta_r_command"))


@pytest.fixture(scope="module")
def samples() -> DriveSamples:
    return DriveSamples.of([exact()])


def problem_of(samples: DriveSamples) -> tuple[Problem, np.ndarray]:
    values = {**configured(CONFIG), "relaxation_length": 0.3, "steering_ratio": 1.0, "yaw_rate_delay": 0.0}
    problem = vehicle_problem(samples, CONFIG, values, values, samples.signal("delta_r"))
    return problem, np.array([values[name] for name in problem.prior.names])


def test_the_model_is_the_plant(samples: DriveSamples) -> None:
    problem, values = problem_of(samples)
    starts = problem.starts.copy()
    first = problem.segments.first
    starts[:, 0] = samples.signal("vx")[first] * np.tan(filled(samples.signal("sideslip"))[first])
    output = problem.simulation(values, starts).output()
    for k, (name, noise) in enumerate(zip(OUTPUTS, (0.0, 0.0, 0.1 * DEGREE), strict=True)):
        error = output[:, k] - problem.measured[:, k]
        size = float(np.nanstd(problem.measured[:, k]))
        # Between samples the angles follow a cubic: 0.1 % of the motion; sideslip is measured with noise.
        assert np.sqrt(np.nanmean(error**2)) < 2e-3 * size + 1.1 * noise, name


@pytest.mark.parametrize("which", ["vehicle", "actuator"])
def test_derivatives_are_those_of_the_outputs(samples: DriveSamples, which: str) -> None:
    if which == "vehicle":
        problem, values = problem_of(samples)
        values[problem.prior.names.index("yaw_rate_delay")] = 0.003
    else:
        found = actuator_problem(samples, CONFIG, configured(CONFIG))
        assert found is not None
        # Off the samples and off the grid of the integration, where a step of the command changes nothing at once.
        problem, values = found, np.array([0.04, 0.5, 0.001, 0.0137])
    starts = problem.starts + 0.01
    _, slopes = problem.simulation(values, starts).slopes()
    count = len(values)
    spread = problem.prior.slope(np.where(values == 0.0, 1.0, values))
    for k, name in enumerate((*problem.prior.names, *problem.model.starts)):
        step = DIFFERENCE * (spread[k] if k < count else 1.0)
        moved = []
        for way in (1.0, -1.0):
            by_value, by_start = values.copy(), starts.copy()
            if k < count:
                by_value[k] += way * step
            else:
                by_start[:, k - count] += way * step
            moved.append(problem.simulation(by_value, by_start).output())
        difference = (moved[0] - moved[1]) / (2.0 * step)
        size = max(float(np.abs(difference).max()), 1e-9)
        np.testing.assert_allclose(slopes[:, :, k], difference, rtol=0.0, atol=1e-4 * size, err_msg=name)


@pytest.mark.parametrize("average", [1, 7])
def test_normal_equations_are_sums_over_the_samples(samples: DriveSamples, average: int) -> None:
    problem, values = problem_of(samples)
    problem = replace(problem, average=average)
    simulation = problem.simulation(values, problem.starts)
    output, slopes = simulation.slopes()
    scale, count = np.linspace(0.5, 2.0, len(values)), len(problem.segments.first)
    noise = np.array([0.01, 0.2, 0.01]) * np.linspace(1.0, 3.0, count)[:, None]
    measured = problem.measured.copy()
    measured[100, 0] += 1.0  # an outlier, 100 times the noise
    found = simulation.normal(measured, 1.0 / noise, scale, 2.0, average)
    error = problem.averaged(output - measured) / problem.of_blocks(noise)
    rows = slopes / np.repeat(noise, problem.segments.length, axis=0)[:, :, None] * np.append(scale, [1.0, 1.0])
    for k, (low, high) in enumerate(pairwise(problem.segments.offsets)):
        cost, gradient, hessian, place = 0.0, np.zeros(rows.shape[2]), np.zeros(2 * rows.shape[2:]), problem.blocks[1][k]
        for block, begin in enumerate(range(low, high, average)):
            for column in range(3):
                chosen = [row for row in range(begin, min(begin + average, high)) if np.isfinite(measured[row, column])]
                if not chosen:
                    continue
                each = float((output - measured)[chosen, column].sum()) / (noise[k, column] * math.sqrt(len(chosen)))
                assert error[place + block, column] == pytest.approx(each, abs=1e-12)
                slope = rows[chosen, column].sum(axis=0) / math.sqrt(len(chosen))
                weight = min(2.0 / max(abs(each), 1e-300), 1.0)
                cost += 0.5 * each**2 if abs(each) <= 2.0 else 2.0 * (abs(each) - 1.0)
                gradient += weight * each * slope
                hessian += weight * np.outer(slope, slope)
        assert found.cost[k] == pytest.approx(cost)
        np.testing.assert_allclose(found.gradient[k], gradient, rtol=1e-9, atol=1e-8)
        np.testing.assert_allclose(found.hessian[k], hessian, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("delay", [0.0, 0.0034, 0.0137, 0.02])
def test_the_actuator_follows_a_delayed_step_exactly(delay: float) -> None:
    time = np.arange(100) * 0.01
    command = np.where(time >= 0.095, 0.01, 0.0)
    samples = DriveSamples.of([Drive("step", time, {"delta_r_command": command, "delta_r": np.zeros(100)})])
    problem = actuator_problem(samples, CONFIG, configured(CONFIG))
    assert problem is not None
    output = problem.simulation(np.array([0.05, 10.0, 0.0, delay]), problem.starts).output()[:, 0]
    since = np.maximum(time - 0.1 - delay, 0.0)
    # Runge-Kutta over 2 ms with a lag of 50 ms: (0.04)^5 / 120 of the step.
    np.testing.assert_allclose(output, 0.01 * -np.expm1(-since / 0.05), atol=1e-10)


def test_inputs_between_samples() -> None:
    time = np.arange(20) * 0.1
    samples = DriveSamples.of([Drive("parabola", time, {"vx": time**2})])
    found, rate = between(samples, (samples.signal("vx"),), 2).reshape(20, 2, 3, 2).transpose(3, 0, 1, 2)
    at = time[:, None, None] + 0.1 * np.array([[0.0, 0.25, 0.5], [0.5, 0.75, 1.0]])
    np.testing.assert_allclose(found[1:-2], at[1:-2] ** 2, atol=1e-12)  # the ends have one neighbour only
    np.testing.assert_allclose(rate[1:-2], 2.0 * at[1:-2], atol=1e-12)
    held_back = held(samples, np.arange(20.0), 0.25, 2)[:, 0].reshape(20, 2, 3)
    np.testing.assert_array_equal(held_back[5, :, 0], [2.0, 3.0])  # the step of sample 3 acts at 0.55 s
    assert math.isclose(held(samples, np.arange(20.0), 0.25, 2)[::3, 1].reshape(20, 2)[5, 0], 1.0)
