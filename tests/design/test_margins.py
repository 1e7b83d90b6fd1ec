"""Margins against python-control, against the loop run as the controller runs it, and against published figures."""

import warnings

import control
import numpy as np
import numpy.typing as npt
import pytest

from codegen import config as configuration
from codegen.config import KM_H, Config, Schedule
from codegen.design.family import Member, members, nominal
from codegen.design.margins import (
    WARN_GAIN_MARGIN_DB,
    WARN_PHASE_MARGIN_DEG,
    Margins,
    Weakest,
    family_margins,
    gains_of,
    loop_margins,
    nominal_margins,
    weakest,
)
from codegen.design.sampled import YAW_RATE, frequency_grid, sample
from codegen.vehicle.single_track import SingleTrack

from .conftest import small_config
from .oracle import loop

FloatArray = npt.NDArray[np.float64]


def with_lag(config: Config, lag: float) -> Config:
    return config.model_copy(update={"rear_actuator": config.rear_actuator.model_copy(update={"lag_s": lag})})


def paper_margins(lag: float, speed_km_h: float) -> Margins:
    """Margins of the published PI: Kp 0.01, Ki 1, one sample of delay."""
    return nominal_margins(with_lag(configuration.preset(), lag), [speed_km_h * KM_H], [0.01], [1.0])


def grows(config: Config, car: Member, speed: float, kp: float, ki: float, seconds: float) -> bool:
    """Whether the loop, run from sample to sample as the controller runs it, ends farther from rest than half-way."""
    sampled = sample(config, [car], [speed])
    time, delay = config.controller.sampling_time_s, config.tuning.delay_samples
    state = np.full(5, 1e-3)
    waiting, integral, size = [0.0] * delay, 0.0, []
    for _ in range(round(seconds / time)):
        error = 0.0 - state[YAW_RATE]
        integral += ki * time * error
        waiting.append(-(kp * error + integral))
        state = sampled.transition[0, 0] @ state + sampled.input[0, 0] * waiting.pop(0)
        size.append(float(np.abs(state).max()))
    half = len(size) // 2
    return max(size[half:]) > max(size[half // 2 : half])


@pytest.mark.parametrize(
    ("lag", "speed_km_h", "phase", "gain", "phase_digit", "gain_digit"),
    [
        (0.05, 20.0, 82.0, 30.0, 0.5, 0.5),
        (0.05, 120.0, 24.0, 7.8, 0.5, 0.05),
        (0.1, 120.0, 13.0, 3.8, 0.5, 0.05),
        (0.1, 166.0, 0.0, 0.0, 0.0, 0.0),  # the first whole km/h at which it is unstable
    ],
)
def test_the_papers_pi_has_the_known_margins(
    lag: float, speed_km_h: float, phase: float, gain: float, phase_digit: float, gain_digit: float
) -> None:
    """The figures are known as rounded: half of their last digit is the tolerance."""
    found = paper_margins(lag, speed_km_h)
    assert found.stable.all() == np.isfinite(found.sensitivity).all() == (phase > 0.0)
    assert found.phase_margin_deg[0] == pytest.approx(phase, abs=phase_digit)
    assert found.gain_margin_db[0] == pytest.approx(gain, abs=gain_digit)
    assert paper_margins(lag, min(speed_km_h, 165.0)).stable.all()


CARS = [Member(0.05), Member(0.1, 1.2, 1.15, 0.8, 0.6), Member(0.02, 0.8, 0.8, 1.15, 0.3), Member(0.05, relaxation_length=0.6)]
GAINS = [(15.0, 0.002, 1.8), (30.0, 0.0, 1.5), (80.0, 0.13, 0.6), (120.0, 0.1, 0.0), (300.0, 0.1, 0.3)]


@pytest.mark.parametrize(("car", "gains"), [*enumerate(GAINS[:4]), (2, GAINS[3]), (0, GAINS[4])])
def test_margins_are_those_of_python_control(car: int, gains: tuple[float, float, float]) -> None:
    speed_km_h, kp, ki = gains
    config, member = Config(), CARS[car]
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
        warnings.simplefilter("ignore")  # of python-control, about what it does with data
        gain, phase, _, _, _, _ = control.stability_margins(control.frd(response, fine), returnall=True)
    # 0.02 dB, 0.01 deg, 0.4 %: what the grid of 100 points a decade is good for.
    smallest = np.abs(20.0 * np.log10(gain)).min() if gain.size else np.inf
    assert found.gain_margin_db[0, 0] == pytest.approx(smallest, abs=0.02)
    assert found.phase_margin_deg[0, 0] == pytest.approx(np.abs(phase).min() if phase.size else np.inf, abs=0.01)
    assert found.sensitivity[0, 0] == pytest.approx((1.0 / np.abs(1.0 + response)).max(), rel=0.004)


def test_a_loop_may_end_its_gain_margin_at_half_the_sampling_frequency() -> None:
    """A quick actuator and no delay: the phase reaches -180 deg at pi/T only, where the command alternates."""
    config, car, speed, kp = small_config(delay_samples=0), Member(0.002), 120.0 * KM_H, 0.1
    found = loop_margins(sample(config, [car], [speed]), kp, 0.0, frequency_grid(config.controller.sampling_time_s))
    at_end = -kp * sample(config, [car], [speed]).response(np.array([np.pi / config.controller.sampling_time_s]))[0, 0, 0]
    assert at_end.real < 0.0
    assert found.gain_margin_db[0, 0] == pytest.approx(-20.0 * np.log10(-at_end.real), rel=1e-9)
    for beyond, unstable in ((-0.1, False), (0.1, True)):
        factor = 10.0 ** ((float(found.gain_margin_db[0, 0]) + beyond) / 20.0)
        assert grows(config, car, speed, factor * kp, 0.0, 20.0) is unstable


def test_a_car_that_needs_the_loop_has_a_margin_downwards() -> None:
    """Its critical speed is 40 m/s."""
    rear, ki = {"cornering_stiffness_n_per_rad": 89_000.0}, 0.4
    config = small_config({"tyre": {"front": {"cornering_stiffness_n_per_rad": 119_540.0}, "rear": rear}})
    car, speed = nominal(config), 1.25 * SingleTrack.from_config(config).critical_speed
    found = nominal_margins(config, [speed], [0.1], [ki])
    assert found.stable.all()
    margin = float(found.gain_margin_db[0])
    for beyond, unstable in ((-0.2, False), (0.2, True)):
        factor = 10.0 ** (-(margin + beyond) / 20.0)
        assert grows(config, car, speed, factor * 0.1, factor * ki, 60.0) is unstable
    factor = 10.0 ** ((margin + 0.2) / 20.0)  # upwards there is more
    assert not grows(config, car, speed, factor * 0.1, factor * ki, 60.0)


def test_the_family_is_as_good_as_its_worst_members() -> None:
    """Found by its members alone. One unstable member makes the family unstable."""
    config = small_config(relaxation_length_m=[0.0, 0.3, 0.6], actuator_lag_s=[0.02, 0.1])
    speed, kp, ki = np.array([20.0, 70.0, 120.0]) * KM_H, np.array([0.02, 0.1, 0.12]), np.array([1.5, 0.7, 0.4])
    found, worst = family_margins(config, speed, kp, ki)
    frequency = frequency_grid(config.controller.sampling_time_s)
    each = [loop_margins(sample(config, [car], speed), kp, ki, frequency) for car in members(config)]
    for name, cars, ends in (
        ("gain_margin_db", worst.gain_margin, np.min),
        ("phase_margin_deg", worst.phase_margin, np.min),
        ("sensitivity", worst.sensitivity, np.max),
    ):
        figures = [getattr(one, name)[0] for one in each]
        np.testing.assert_allclose(getattr(found, name), ends(figures, axis=0), rtol=1e-9)
        of_worst = [figures[members(config).index(car)][k] for k, car in enumerate(cars)]
        np.testing.assert_allclose(of_worst, getattr(found, name), rtol=1e-9)
    found, worst = family_margins(small_config(actuator_lag_s=[0.02, 0.5]), [120.0 * KM_H], [0.1], [1.0])
    assert not found.stable[0]
    assert (found.gain_margin_db[0], found.phase_margin_deg[0], found.sensitivity[0]) == (0.0, 0.0, np.inf)
    assert worst.sensitivity[0].actuator_lag == 0.5


def test_the_gains_of_a_schedule_are_straight_lines_and_hold_beyond_its_ends() -> None:
    schedule = Schedule(speed_km_h=[36.0, 72.0], proportional_gain_s=[0.1, 0.2], integral_gain=[3.0, 1.0])
    kp, ki = gains_of(schedule)(np.array([1.0, 10.0, 12.5, 20.0, 50.0]))
    np.testing.assert_allclose(kp, [0.1, 0.1, 0.125, 0.2, 0.2])
    np.testing.assert_allclose(ki, [3.0, 3.0, 2.5, 1.0, 1.0])


def test_weakest_finds_a_dip_between_and_covers_all_speeds_from_enabling() -> None:
    """The PI, three times as strong at one speed in the middle; the published one is weakest at the largest speed."""

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
    seen: list[FloatArray] = []

    def published(speed: FloatArray) -> tuple[FloatArray, FloatArray]:
        seen.append(speed)
        return np.full(speed.shape, 0.01), np.full(speed.shape, 1.0)

    config = small_config({"controller": {"enable_speed_km_h": 50.0, "inputs": {"speed_max_km_h": 150.0}}})
    found, at_end = weakest(config, published), nominal_margins(config, [150.0 * KM_H], [0.01], [1.0])
    assert (seen[0][0], seen[0][-1]) == pytest.approx((50.0 * KM_H, 150.0 * KM_H))
    assert found.gain_margin_db == pytest.approx(at_end.gain_margin_db[0], rel=1e-9)
    assert found.phase_margin_deg == pytest.approx(at_end.phase_margin_deg[0], rel=1e-9)
    assert (found.gain_margin_speed, found.phase_margin_speed) == pytest.approx((150.0 * KM_H, 150.0 * KM_H))
    assert not found.enough


def test_what_is_enough_and_where_it_is_least() -> None:
    margins = ((0.0, 0.0), (-0.01, 10.0), (10.0, -0.01))
    found = [Weakest(WARN_GAIN_MARGIN_DB + gain, WARN_PHASE_MARGIN_DEG + phase, 1.0, 2.0) for gain, phase in margins]
    assert [each.enough for each in found] == [True, False, False]
    assert [each.speed for each in found[1:]] == [1.0, 2.0]
