"""Stability margins compared with python-control and with published figures."""

import warnings
from typing import Any

import control
import numpy as np
import pytest

from codegen.arrays import FloatArray
from codegen.design.family import Member, members
from codegen.design.margins import (
    family_margins,
    family_range_km_h,
    loop_margins,
    margin_range_km_h,
    margin_speeds,
    nominal_margins,
    weakest,
)
from codegen.design.sampled import frequency_grid, sample
from codegen.units import KM_H

from .conftest import small_config
from .oracle import loop

CARS = [Member(0.05), Member(0.1, 1.2, 1.15, 0.8, 0.6), Member(0.02, 0.8, 0.8, 1.15, 0.3), Member(0.05, relaxation_length=0.6)]
LOOPS = [
    (0, 15.0, 0.002, 1.8),
    (1, 30.0, 0.0, 1.5),
    (2, 80.0, 0.13, 0.6),
    (3, 120.0, 0.1, 0.0),
    (2, 120.0, 0.1, 0.0),
    (0, 300.0, 0.1, 0.3),
]
"""Car, speed in km/h, Kp and Ki."""
UNSTABLE = {"front": {"cornering_stiffness_n_per_rad": 119_540.0}, "rear": {"cornering_stiffness_n_per_rad": 89_000.0}}
"""Tyres whose car needs the loop above its critical speed, 144 km/h: its gain margin is a reduction."""


@pytest.mark.parametrize(
    ("car", "speed_km_h", "kp", "ki", "other"), [*((*each, {}) for each in LOOPS), (0, 180.0, 0.1, 0.4, {"tyre": UNSTABLE})]
)
def test_margins_are_those_of_python_control(car: int, speed_km_h: float, kp: float, ki: float, other: dict[str, Any]) -> None:
    config, member = small_config(other), CARS[car]
    frequency = frequency_grid(config.controller.sampling_time_s)
    found = loop_margins(sample(config, [member], [speed_km_h * KM_H]), kp, ki, frequency)
    expected = loop(config, member, speed_km_h * KM_H, kp, ki)
    stable = bool((np.abs(control.feedback(expected, 1.0).poles()) < 1.0).all())
    assert bool(found.stable[0, 0]) == stable
    if not stable:
        assert np.isinf(found.sensitivity).all()
        return
    fine = np.geomspace(0.02, np.pi / config.controller.sampling_time_s, 4_000)
    response = control.frequency_response(expected, fine).complex
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # python-control warns about its treatment of data
        gain, phase, _, _, _, _ = control.stability_margins(control.frd(response, fine), returnall=True)
    # 0.02 dB, 0.01 deg, 0.4 %: the resolution of 100 points per decade.
    smallest = np.abs(20.0 * np.log10(gain)).min() if gain.size else np.inf
    assert found.gain_margin_db[0, 0] == pytest.approx(smallest, abs=0.02)
    assert found.phase_margin_deg[0, 0] == pytest.approx(np.abs(phase).min() if phase.size else np.inf, abs=0.01)
    assert found.sensitivity[0, 0] == pytest.approx((1.0 / np.abs(1.0 + response)).max(), rel=0.004)


def test_the_gain_margin_may_be_at_half_the_sampling_frequency() -> None:
    """With a fast actuator and no delay the phase reaches -180 deg only at pi/T, where the command alternates."""
    config, car, speed, kp = small_config(delay_samples=0), Member(0.002), 120.0 * KM_H, 0.1
    found = loop_margins(sample(config, [car], [speed]), kp, 0.0, frequency_grid(config.controller.sampling_time_s))
    at_end = -kp * sample(config, [car], [speed]).response(np.array([np.pi / config.controller.sampling_time_s]))[0, 0, 0]
    assert at_end.real < 0.0
    assert found.gain_margin_db[0, 0] == pytest.approx(-20.0 * np.log10(-at_end.real), rel=1e-9)


@pytest.mark.parametrize("slow", [False, True])
def test_the_family_is_as_good_as_its_worst_members(slow: bool) -> None:
    """Its members are evaluated one by one. One unstable member makes the family unstable."""
    config = small_config(relaxation_length_m=[0.0, 0.3, 0.6], actuator_lag_s=[0.02, 0.1])
    speed, kp, ki = np.array([20.0, 70.0, 120.0]) * KM_H, np.array([0.02, 0.1, 0.12]), np.array([1.5, 0.7, 0.4])
    found, worst = family_margins(config, speed, kp, ki, slow=slow)
    frequency = frequency_grid(config.controller.sampling_time_s)
    family = [car for car in members(config) if (car.actuator_lag == 0.1 and car.relaxation_length > 0.0) == slow]
    assert 1 < len(family) < len(members(config))
    each = [loop_margins(sample(config, [car], speed), kp, ki, frequency) for car in family]
    for name, cars, ends in (
        ("gain_margin_db", worst.gain_margin, np.min),
        ("phase_margin_deg", worst.phase_margin, np.min),
        ("sensitivity", worst.sensitivity, np.max),
    ):
        figures = [getattr(one, name)[0] for one in each]
        np.testing.assert_allclose(getattr(found, name), ends(figures, axis=0), rtol=1e-9)
        of_worst = [figures[family.index(car)][k] for k, car in enumerate(cars)]
        np.testing.assert_allclose(of_worst, getattr(found, name), rtol=1e-9)
    found, worst = family_margins(small_config(actuator_lag_s=[0.02, 0.5]), [120.0 * KM_H], [0.1], [1.0], slow=slow)
    assert not found.stable[0]
    assert (found.gain_margin_db[0], found.phase_margin_deg[0], found.sensitivity[0]) == (0.0, 0.0, np.inf)
    assert worst.sensitivity[0].actuator_lag == 0.5


def test_weakest_finds_a_dip_and_reaches_the_largest_speed() -> None:
    """One PI has three times the gain at a medium speed; fixed gains are weakest at the largest speed."""

    def with_dip(speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        dip = 1.0 + 2.0 * np.exp(-(((speed / KM_H - 60.0) / 8.0) ** 2))
        return 0.01 * dip, 0.4 * dip

    config = small_config({"controller": {"inputs": {"speed_max_km_h": 90.0}}})
    found = weakest(config, with_dip)
    speed = np.linspace(15.0, 90.0, 1501) * KM_H
    fine = nominal_margins(config, speed, *with_dip(speed))
    # Neighbouring speeds are 1.1 % apart.
    assert found.gain_margin_speed == pytest.approx(speed[fine.gain_margin_db.argmin()], rel=0.012)
    assert found.gain_margin_db == pytest.approx(fine.gain_margin_db.min(), abs=0.05)
    assert found.phase_margin_deg == pytest.approx(fine.phase_margin_deg.min(), abs=0.3)
    config = small_config({"vehicle": {"top_speed_km_h": 150.0}})
    found = weakest(config, lambda speed: (np.full(speed.shape, 0.01), np.full(speed.shape, 1.0)))
    at_end = nominal_margins(config, [150.0 * KM_H], [0.01], [1.0])
    assert found.gain_margin_db == pytest.approx(at_end.gain_margin_db[0], rel=1e-9)
    assert (found.gain_margin_speed, found.phase_margin_speed) == pytest.approx((150.0 * KM_H, 150.0 * KM_H))
    assert not found.enough


@pytest.mark.parametrize(
    ("kind", "top", "last", "family"),
    [
        ("tracking", None, 120.0, 120.0),
        ("tracking", 160.0, 160.0, 120.0),
        ("tracking", 90.0, 90.0, 90.0),
        ("pi", None, 400.0, 120.0),
        ("pi", 160.0, 160.0, 120.0),
    ],
)
def test_margins_end_at_the_top_speed(kind: str, top: float | None, last: float, family: float) -> None:
    """Fixed gains have no last designed speed: without a top speed of the car, the range of the sensor counts."""
    vehicle = {} if top is None else {"top_speed_km_h": top}
    config = small_config({"vehicle": vehicle, "controller": {"kind": kind}})
    assert margin_range_km_h(config) == (15.0, last) and family_range_km_h(config) == (15.0, family)
    assert margin_speeds(config)[[0, -1]] / KM_H == pytest.approx([15.0, last])
