"""The linearised plant: straight ahead the linear single-track car, in a turn the slope of the plant by differences."""

import numpy as np
import pytest
from scipy.linalg import expm

from codegen import config as configuration
from codegen.config import Config
from codegen.design.family import Member
from codegen.design.linearised import linearised
from codegen.design.sampled import frequency_grid, sample
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, two_track
from hil_sim.suite import plants

CONFIG = configuration.preset()
RELAXED = plants.relaxation(0.4)(CONFIG)
FREQUENCY = frequency_grid(CONFIG.controller.sampling_time_s)
SPEEDS = np.array([6.0, 15.0, 33.0, 70.0])

SAME = 1e-9
"""Relative: both are exact but for rounding; the matrix exponential and the powers of z - 1 lose some six of sixteen digits."""


@pytest.mark.parametrize(("config", "mass", "friction"), [(CONFIG, 1.0, 0.9), (RELAXED, 1.2, 0.89), (RELAXED, 0.8, 0.3)])
def test_straight_ahead_it_is_the_single_track_car(config: Config, mass: float, friction: float) -> None:
    turns = linearised(config, SPEEDS, friction, mass)
    stiffness = friction / config.road.friction
    member = Member(config.rear_actuator.lag_s, mass, stiffness, stiffness, config.plant.relaxation_length_m)
    expected = sample(config, (member,), SPEEDS).response(FREQUENCY)[0]
    found = turns.sampled.response(FREQUENCY)
    assert turns.found.all()
    assert np.abs(found / expected - 1.0).max() < SAME
    assert not turns.front_angle.any()


def test_in_a_turn_it_is_the_slope_of_the_plant() -> None:
    """Central differences of the configuration's own plant at the turn that was found, sampled the same way."""
    change, factor = plants.mass(20.0), 1.2
    speed, friction, share = 20.0, 0.7, 0.5
    turns = linearised(CONFIG, speed, friction, factor, share)
    assert turns.found.all()
    model = two_track(change(CONFIG))
    x, u = np.zeros(len(PLANT_STATES)), np.zeros(len(PLANT_INPUTS))
    x[PLANT_STATES.index("yaw_rate")] = share * friction * CONFIG.road.gravity_m_s2 / speed
    x[PLANT_STATES.index("steering_wheel_angle")] = turns.front_angle[0] * CONFIG.steering.ratio
    u[PLANT_INPUTS.index("speed")], u[PLANT_INPUTS.index("friction")] = speed, friction
    u[PLANT_INPUTS.index("steering_wheel_command")] = x[PLANT_STATES.index("steering_wheel_angle")]

    def rate(state: np.ndarray) -> np.ndarray:
        return np.asarray(model.derivative(state, u)).ravel()

    # The lateral speed at which the side forces hold the turn, by bisection: nothing of Newton's method.
    low, high = -5.0, 5.0
    for _ in range(200):
        x[0] = 0.5 * (low + high)
        low, high = (x[0], high) if rate(x)[0] > 0.0 else (low, x[0])
    assert abs(rate(x)[1]) < 1e-6  # rad/s^2: the yaw moment is then in balance too
    kept = [PLANT_STATES.index(name) for name in ("lateral_speed", "yaw_rate", "rear_angle")]
    step = 1e-6
    slopes = []
    for index in kept:
        ends = [x.copy(), x.copy()]
        ends[0][index] -= step
        ends[1][index] += step
        slopes.append((rate(ends[1]) - rate(ends[0]))[kept] / (2.0 * step))
    expected = np.array(slopes).T
    found = turns.sampled.transition[0]
    # Differences over 1e-6 of values of order 100 carry some 1e-8.
    assert np.abs(found - expm(expected * CONFIG.controller.sampling_time_s)).max() < 1e-7


def test_a_turn_beyond_the_grip_is_not_found() -> None:
    turns = linearised(CONFIG, [20.0, 20.0], [0.7, 0.7], 1.0, grip_share=1.2)
    assert not turns.found.any()
    assert np.isfinite(turns.sampled.transition).all()
