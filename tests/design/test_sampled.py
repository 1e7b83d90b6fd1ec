"""The family of cars, and the sampled car compared with python-control and the closed form of the steady turn."""

import itertools
from typing import Any

import control
import numpy as np
import pytest

from codegen.design.family import MEMBERS_MAX, Member, members, nominal
from codegen.design.margins import loop_margins
from codegen.design.sampled import frequency_grid, linearised, sample
from codegen.errors import ConfigError
from codegen.vehicle.single_track import SingleTrack
from tests.whole_car import car

from .conftest import small_config
from .oracle import loop, sampled_car

CARS = [
    Member(0.05),
    Member(0.02, 0.8, 0.8, 1.15, 0.6),
    Member(0.1, 1.2, 1.15, 0.8, 0.3, 1.1),
    Member(0.002, 1.0, 1.0, 1.0, 0.05),
]
SPEEDS = np.array([12.0, 42.5, 120.0, 400.0]) / 3.6


ACTUATOR = {"plant": {"actuator_motor_share": 0.5, "backlash_deg": 0.1, "rear_relaxation_factor": 1.2}}


@pytest.mark.parametrize("parts", [{}, {"plant": {"backlash_deg": 0.1}}, ACTUATOR])
@pytest.mark.parametrize(("car", "delay"), [(0, 0), (1, 1), (2, 4), (3, 0)])
def test_the_frequency_response_is_that_of_python_control(car: int, delay: int, parts: dict[str, Any]) -> None:
    config = small_config(parts, delay_samples=delay)
    frequency = frequency_grid(config.controller.sampling_time_s, 20)
    found = sample(config, CARS, SPEEDS).response(frequency)[car]
    for k, speed in enumerate(SPEEDS):
        expected = control.frequency_response(sampled_car(config, CARS[car], speed, delay), frequency).complex
        # 1e-8: python-control combines up to 7 states without balancing, with entries that differ by 1e5.
        np.testing.assert_allclose(found[k], expected, rtol=1e-8, atol=0.0)


def test_relaxation_lags_and_keeps_the_closed_form_of_the_steady_turn() -> None:
    config = car()
    cars = sample(config, [Member(0.05, relaxation_length=sigma) for sigma in (0.0, 0.05, 0.6)], SPEEDS)
    # Near neutral steer at 400 km/h, cancellation leaves six or seven digits.
    closed_form = -SingleTrack.from_config(config).yaw_gain(SPEEDS)
    np.testing.assert_allclose(cars.steady_gain(), np.broadcast_to(closed_form, (3, SPEEDS.size)), rtol=1e-6)
    # The phase lag at 5 rad/s grows with the relaxation length, continuously from zero.
    none, short, long = np.unwrap(np.angle(-cars.response(np.array([5.0])))[..., 0], axis=0)
    assert (long < short).all()
    assert (short < none).all()
    assert (none - short < 0.2 * (none - long)).all()


def test_open_loop_stability_ends_at_the_critical_speed() -> None:
    stiffness = {"front": 119_540.0, "rear": 90_000.0}
    config = small_config({"tyre": {axle: {"cornering_stiffness_n_per_rad": value} for axle, value in stiffness.items()}})
    critical = SingleTrack.from_config(config).critical_speed
    assert 20.0 < critical < 60.0
    car = sample(config, [nominal(config)], critical * np.array([0.5, 0.999, 1.001, 1.5]))
    assert car.open_loop_stable()[0].tolist() == [True, True, False, False]


@pytest.mark.parametrize(("delay", "parts"), [(0, {}), (3, {}), (3, ACTUATOR)])
def test_closed_loop_stability_is_that_of_python_controls_poles(delay: int, parts: dict[str, Any]) -> None:
    config = small_config(parts, delay_samples=delay)
    rng = np.random.default_rng(delay)
    found = []
    for _ in range(40):
        car, speed = CARS[rng.integers(len(CARS))], float(rng.uniform(4.0, 80.0))
        kp, ki = float(10.0 ** rng.uniform(-2.5, 0.5)), float(rng.choice([0.0, 10.0 ** rng.uniform(-1.0, 1.5)]))
        poles = control.feedback(loop(config, car, speed, kp, ki), 1.0).poles()
        found.append(bool(sample(config, [car], [speed]).closed_loop_stable(kp, ki)[0, 0]))
        assert found[-1] == (np.abs(poles).max() < 1.0), (car, speed, kp, ki)
    assert 4 < sum(found) < 36  # both kinds occur


def test_the_default_family_is_all_combinations() -> None:
    expected = set(itertools.product((0.02, 0.05, 0.1), (0.8, 1.0, 1.2), (0.8, 1.0, 1.15), (0.8, 1.0, 1.15), (0.0, 0.3, 0.6)))
    family = members(car())
    assert len(family) == len(set(family)) == len(expected) == 243
    found = [
        (m.actuator_lag, m.mass_factor, m.front_stiffness_factor, m.rear_stiffness_factor, m.relaxation_length) for m in family
    ]
    # The factors are percentages divided by 100, with one rounding.
    assert sorted(found) == [pytest.approx(values, rel=1e-15) for values in sorted(expected)]
    assert family.count(nominal(car())) == 1
    slow = {member.actuator_lag for member in members(car({"rear_actuator": {"lag_s": 0.09}}))}
    assert slow == {0.036, 0.09, 0.18}
    # The configured car is a member even if no combination equals it.
    config = small_config({"plant": {"relaxation_length_m": 0.25}}, mass_percent=[0.0, 0.0])
    assert len(members(config)) == 9 and members(config).count(Member(0.05, relaxation_length=0.25)) == 1


def test_empty_and_too_long_lists_are_refused() -> None:
    for key in ("actuator_lag_s", "mass_percent", "stiffness_percent", "relaxation_length_m"):
        with pytest.raises(ConfigError, match=rf"tuning\.{key}: the list is empty; give at least one"):
            small_config(**{key: []})
    # A million combinations of each stiffness would fill the memory if made before the check.
    with pytest.raises(ConfigError, match=f"at most {MEMBERS_MAX} are taken; list fewer"):
        members(small_config(stiffness_percent=[0.01 * k for k in range(1000)]))


@pytest.mark.parametrize(("asked", "plant", "delay"), [(0, 0, 0), (1, 0, 1), (1, 20, 20), (5, 2, 5)])
def test_the_loop_has_the_delay_of_the_bus(asked: int, plant: int, delay: int) -> None:
    config = small_config({"plant": {"command_delay_samples": plant}}, delay_samples=asked)
    assert sample(config, [Member(0.05)], SPEEDS).delay == delay
    assert linearised(config, SPEEDS, 0.9).sampled.delay == delay


def test_poles_decide_with_a_long_delay_too() -> None:
    """Half of the gain at the stability boundary is stable, twice that gain is not; 0.2 s of delay."""
    config = small_config({"plant": {"command_delay_samples": 20}})
    cars = sample(config, [Member(0.05, relaxation_length=0.4)], SPEEDS[:3])
    gain = 10.0 ** (loop_margins(cars, 0.01, 0.02, frequency_grid(0.01)).gain_margin_db / 20.0)
    assert (gain > 1.0).all()
    assert cars.closed_loop_stable(0.005 * gain, 0.01 * gain).all()
    assert not cars.closed_loop_stable(0.02 * gain, 0.04 * gain).any()
