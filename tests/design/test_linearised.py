"""The linearised plant: the linear single-track car straight ahead, the slope of the plant in a turn."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from codegen import configuration
from codegen.configuration import Config
from codegen.design.family import Member
from codegen.design.margins import loop_margins, nominal_margins
from codegen.design.sampled import frequency_grid, linearised, sample
from codegen.vehicle.dynamics import PLANT_INPUTS, PLANT_STATES, two_track
from hil_sim.suite import cells

CONFIG = configuration.preset()
RELAXED = cells.relaxation(0.4)(CONFIG)
ACTUATOR = RELAXED.replace({"plant.actuator_motor_share": 0.5, "plant.backlash_deg": 0.1, "plant.rear_relaxation_factor": 1.2})
RECOMMENDED = configuration.preset("recommended")
FREQUENCY = frequency_grid(CONFIG.controller.sampling_time_s)
SPEEDS = np.array([6.0, 15.0, 33.0, 70.0])

RELATIVE_TOLERANCE = 1e-9
"""Relative tolerance. Only rounding differs; the matrix exponential and the powers of z - 1 lose about six of sixteen
digits."""


@pytest.mark.parametrize(("config", "mass", "friction"), [(CONFIG, 1.0, 0.9), (RELAXED, 1.2, 0.89), (ACTUATOR, 0.8, 0.3)])
def test_straight_ahead_it_is_the_single_track_car(config: Config, mass: float, friction: float) -> None:
    turns = linearised(config, SPEEDS, friction, mass)
    stiffness = friction / config.road.friction
    member = Member(config.rear_actuator.lag_s, mass, stiffness, stiffness, config.plant.relaxation_length_m)
    expected = sample(config, (member,), SPEEDS).response(FREQUENCY)[0]
    found = turns.sampled.response(FREQUENCY)
    assert turns.found.all()
    assert np.abs(found / expected - 1.0).max() < RELATIVE_TOLERANCE
    assert not turns.front_angle.any()


def test_margins_of_the_design_are_those_of_the_recommended_plant() -> None:
    """The body's roll, which the design omits, changes them by less than 0.02 dB, 0.05 deg and 0.005."""
    kp, ki = np.full(SPEEDS.size, 0.1), np.full(SPEEDS.size, 0.8)
    found = nominal_margins(RECOMMENDED, SPEEDS, kp, ki)
    driven = loop_margins(linearised(RECOMMENDED, SPEEDS, RECOMMENDED.road.friction).sampled, kp, ki, FREQUENCY)
    assert RECOMMENDED.plant.actuator_motor_share and RECOMMENDED.plant.backlash_deg and RECOMMENDED.plant.relaxation_length_m
    for one, other, tolerance in zip(found.figures(), driven.figures(), (0.02, 0.05, 0.005), strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=tolerance)


def test_in_a_turn_it_is_the_slope_of_the_plant() -> None:
    """The reference is the Jacobian of the configuration's plant (see `tests/vehicle`) at the same turn, sampled the same
    way."""
    change, factor = cells.mass(20.0), 1.2
    speed, friction, share = 20.0, 0.7, 0.5
    turns = linearised(CONFIG, speed, friction, factor, share)
    assert turns.found.all()
    model = two_track(change(CONFIG))
    x, u = np.zeros(len(PLANT_STATES)), np.zeros(len(PLANT_INPUTS))
    x[PLANT_STATES.index("yaw_rate")] = share * friction * CONFIG.road.gravity_m_s2 / speed
    x[PLANT_STATES.index("steering_wheel_angle")] = turns.front_angle[0] * CONFIG.steering.ratio
    u[PLANT_INPUTS.index("speed")], u[PLANT_INPUTS.index("friction")] = speed, friction
    u[PLANT_INPUTS.index("steering_wheel_command")] = x[PLANT_STATES.index("steering_wheel_angle")]

    def rates(lateral_speed: float) -> np.ndarray:
        x[PLANT_STATES.index("lateral_speed")] = lateral_speed
        return np.asarray(model.derivative(x, u)).ravel()

    # The lateral speed of the steady turn, found by bracketing instead of Newton's method.
    held = brentq(lambda lateral_speed: rates(lateral_speed)[0], -5.0, 5.0, xtol=1e-14)
    assert abs(rates(held)[1]) < 1e-6  # rad/s^2: the yaw moment is then balanced too
    kept = [PLANT_STATES.index(name) for name in ("lateral_speed", "yaw_rate", "rear_angle")]
    slopes = np.array(model.jacobian(x, u)[0])[np.ix_(kept, kept)]
    found = turns.sampled.transition[0]
    np.testing.assert_allclose(found, expm(slopes * CONFIG.controller.sampling_time_s), rtol=0.0, atol=RELATIVE_TOLERANCE)


def test_a_turn_beyond_the_grip_is_not_found() -> None:
    turns = linearised(CONFIG, [20.0, 20.0], [0.7, 0.7], 1.0, grip_share=1.2)
    assert not turns.found.any()
    assert np.isfinite(turns.sampled.transition).all()
