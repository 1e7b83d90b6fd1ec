"""The design keeps its own demands between its own speeds and members, is the best of its kind, and says where it cannot be."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from codegen.config import KM_H, Config, Schedule
from codegen.design.family import Member, members, nominal
from codegen.design.margins import gains_of, loop_margins, nominal_margins, weakest
from codegen.design.sampled import frequency_grid, sample
from codegen.design.search import Cars, Demands, Shortfall, best_gains
from codegen.design.tune import BETWEEN, STEP_BEYOND, Design, breakpoints, design, round_down, tune
from codegen.errors import ConfigError

from .conftest import small_config

FINE = 400
"""Points a decade of the frequency grid that judges: four times the design's."""


def worst(config: Config, family: list[Member], schedule: Schedule, speed_km_h: float) -> tuple[float, float, float]:
    """dB, deg and sensitivity of a family with a schedule at one speed, on the finer grid."""
    speed = np.array([speed_km_h * KM_H])
    frequency = frequency_grid(config.controller.sampling_time_s, FINE)
    found = loop_margins(sample(config, family, speed), *gains_of(schedule)(speed), frequency)
    assert found.stable.all()
    return found.gain_margin_db.min(), found.phase_margin_deg.min(), found.sensitivity.max()


def inside(rng: np.random.Generator, config: Config) -> Member:
    """A car anywhere between the ends of the family."""
    tuning = config.tuning

    def draw(values: list[float]) -> float:
        return float(rng.uniform(min(values), max(values)))

    mass, front, rear = (1.0 + 0.01 * draw(v) for v in (tuning.mass_percent, *[tuning.stiffness_percent] * 2))
    return Member(draw(tuning.actuator_lag_s), mass, front, rear, draw(tuning.relaxation_length_m))


# --- what the default design promises ---


def test_every_member_keeps_the_demands_on_a_finer_grid_of_speeds(default_design: Design) -> None:
    """20 speeds up to the grid's last, which the design did not look at, and the speed at which the controller switches off."""
    config = Config()
    tuning, family = config.tuning, list(members(config))
    rng = np.random.default_rng(4)
    for speed in (config.controller.disable_speed_km_h, *rng.uniform(12.0, 120.0, 20)):
        gain, phase, peak = worst(config, family, default_design.schedule, float(speed))
        assert gain >= tuning.gain_margin_db
        assert phase >= tuning.phase_margin_deg
        assert peak <= tuning.sensitivity_max


def test_cars_inside_the_family_keep_the_demands(default_design: Design) -> None:
    config = Config()
    rng = np.random.default_rng(5)
    cars = [inside(rng, config) for _ in range(200)]
    for speed in rng.uniform(12.0, 120.0, 10):
        gain, phase, peak = worst(config, cars, default_design.schedule, float(speed))
        # Among the listed deviations are the ends and the middle; in between nothing is worse than these.
        assert gain >= config.tuning.gain_margin_db
        assert phase >= config.tuning.phase_margin_deg
        assert peak <= config.tuning.sensitivity_max


def test_the_configured_car_is_far_from_the_warning_up_to_the_largest_speed(default_design: Design) -> None:
    config = Config()
    least = weakest(config, gains_of(default_design.schedule))
    assert least.enough
    assert least.gain_margin_db > 8.0
    assert least.phase_margin_deg > 45.0


def test_cars_that_are_stable_on_their_own_keep_the_demands_beyond_the_grid(default_design: Design) -> None:
    config = Config()
    rng = np.random.default_rng(6)
    for speed in rng.uniform(120.0, 400.0, 10):
        sampled = sample(config, members(config), [speed * KM_H])
        family = [member for member, stable in zip(members(config), sampled.open_loop_stable()[:, 0], strict=True) if stable]
        gain, phase, peak = worst(config, family, default_design.schedule, float(speed))
        assert gain >= config.tuning.gain_margin_db
        assert phase >= config.tuning.phase_margin_deg
        assert peak <= config.tuning.sensitivity_max


def test_the_written_margins_are_those_of_the_written_gains(default_design: Design) -> None:
    config, schedule = Config(), default_design.schedule
    written = zip(schedule.speed_km_h, schedule.gain_margin_db, schedule.phase_margin_deg, schedule.sensitivity, strict=True)
    for speed, *margins in list(written)[:8]:
        assert speed in config.tuning.speed_km_h
        # Two decimals, and 0.02 dB, 0.01 deg, 0.006 for the grid of frequencies.
        for found, told, tolerance in zip(
            worst(config, list(members(config)), schedule, speed), margins, (0.025, 0.015, 0.011), strict=True
        ):
            assert told == pytest.approx(found, abs=tolerance)
            assert told == round(told, 2)
        assert margins[0] >= config.tuning.gain_margin_db
        assert margins[1] >= config.tuning.phase_margin_deg
        assert margins[2] <= config.tuning.sensitivity_max


def test_who_counts(default_design: Design) -> None:
    config, schedule = Config(), default_design.schedule
    assert default_design.family_size == 243
    assert default_design.counted[:8] == (243,) * 8
    for speed, counted in list(zip(schedule.speed_km_h, default_design.counted, strict=True))[8:]:
        stable = sample(config, members(config), [speed * KM_H]).open_loop_stable()
        assert counted == stable.sum()
        assert counted > 100


def test_gains_have_four_digits(default_design: Design) -> None:
    schedule = default_design.schedule
    for gain in (*schedule.proportional_gain_s, *schedule.integral_gain):
        assert gain == float(f"{gain:.4g}")


# --- the search ---


def cars_at(config: Config, speed_km_h: float) -> Cars:
    family = members(config)
    sampled = sample(config, family, [speed_km_h * KM_H])
    keep = np.full((len(family), 1), True)
    return Cars.of(family, (speed_km_h,), sampled, keep, frequency_grid(config.controller.sampling_time_s))


@pytest.mark.parametrize("speed_km_h", [20.0, 60.0, 120.0])
def test_no_other_gains_have_a_larger_ki(speed_km_h: float) -> None:
    config = small_config()
    cars, demands = cars_at(config, speed_km_h), Demands.of(config.tuning)
    found = best_gains(cars, demands, [])
    assert not isinstance(found, Shortfall)
    kp, ki = found
    assert cars.worst_for(demands, kp, ki) is None
    # Every Kp up to four times as large, with a Ki 2 % larger: the refined grid of Kp may miss the top by 1 %.
    others = np.linspace(0.0, max(4.0 * kp, 0.3), 400)
    margins = cars.margins(others[:, np.newaxis], 1.02 * ki)
    assert not demands.met(margins).all(axis=-1).any()


def test_the_search_does_not_depend_on_what_bound_before() -> None:
    config = small_config()
    cars, demands = cars_at(config, 80.0), Demands.of(config.tuning)
    first = best_gains(cars, demands, [])
    again = best_gains(cars, demands, list(members(config)))
    assert first == pytest.approx(again, rel=0.02)  # Ki to 0.1 %, Kp as flat as its top is


def test_reserves_only_tighten() -> None:
    tuning = small_config(sensitivity_max=1.1).tuning
    all_demands = [Demands.of(tuning, reserves) for reserves in range(100)]
    for less, more in pairwise(all_demands):
        assert more.gain_margin_db > less.gain_margin_db
        assert more.phase_margin_deg > less.phase_margin_deg
        assert 1.0 < more.sensitivity_max <= less.sensitivity_max
    assert all_demands[0].gain_margin_db > tuning.gain_margin_db
    assert all_demands[0].sensitivity_max < tuning.sensitivity_max


@pytest.mark.parametrize(
    ("value", "rounded"),
    [
        (0.0, 0.0),
        (0.123456, 0.1234),
        (0.12345, 0.1234),
        (1.9999, 1.999),
        (99.999, 99.99),
        (0.09, 0.09),
        (0.0012, 0.0012),
        (5e-5, 5e-5),
    ],
)
def test_gains_are_rounded_down(value: float, rounded: float) -> None:
    assert round_down(value) == rounded
    assert round_down(rounded) == rounded


# --- the design as a whole ---


def test_the_same_configuration_gives_the_same_gains(small_design: Design) -> None:
    assert tune(small_config()) == small_design.schedule


def test_progress_goes_up_to_its_end() -> None:
    told: list[tuple[int, int]] = []
    design(small_config({"controller": {"inputs": {"speed_max_km_h": 120.0}}}), lambda done, total: told.append((done, total)))
    assert told == [(k, 5) for k in range(1, 6)]


def test_demands_that_ask_for_more_leave_smaller_gains(small_design: Design) -> None:
    careful = tune(small_config(gain_margin_db=12.0, phase_margin_deg=60.0, sensitivity_max=1.5))
    for less, more in zip(careful.integral_gain, small_design.schedule.integral_gain, strict=True):
        assert less < more


def test_more_delay_leaves_smaller_gains(small_design: Design) -> None:
    late = tune(small_config(delay_samples=3))
    for less, more in zip(late.integral_gain, small_design.schedule.integral_gain, strict=True):
        assert less < more


def test_between_far_breakpoints_the_demands_hold_too() -> None:
    """From 15 to 120 km/h the gains bend; a straight line fits only with less at its ends."""
    config = small_config(
        {"controller": {"inputs": {"speed_max_km_h": 120.0}}}, speed_km_h=[15.0, 120.0], relaxation_length_m=[0.6]
    )
    schedule = tune(config)
    alone = best_gains(cars_at(config, 120.0), Demands.of(config.tuning, 1), [])
    assert not isinstance(alone, Shortfall)
    assert schedule.integral_gain[-1] < 0.98 * alone[1]
    for speed in np.linspace(15.0, 120.0, 5 * (BETWEEN + 1) + 1):
        gain, phase, peak = worst(config, list(members(config)), schedule, float(speed))
        assert gain >= config.tuning.gain_margin_db - 0.05  # between the checked speeds, a fifth of the range apart
        assert phase >= config.tuning.phase_margin_deg - 0.5
        assert peak <= config.tuning.sensitivity_max + 0.01


def test_below_the_first_breakpoint_the_held_gains_keep_the_demands() -> None:
    """Gains for 80 km/h alone would leave 5.9 dB at 12 km/h."""
    config = small_config(
        {"controller": {"inputs": {"speed_max_km_h": 120.0}}},
        speed_km_h=[80.0, 120.0],
        actuator_lag_s=[0.02, 0.1],
        mass_percent=[-20.0, 20.0],
    )
    schedule = tune(config)
    for speed in np.linspace(12.0, 80.0, 23):
        gain, phase, peak = worst(config, list(members(config)), schedule, float(speed))
        assert gain >= config.tuning.gain_margin_db
        assert phase >= config.tuning.phase_margin_deg
        assert peak <= config.tuning.sensitivity_max


def test_breakpoints_reach_the_largest_speed_in_small_steps() -> None:
    points = breakpoints(Config())
    speeds = [point.speed_km_h for point in points]
    assert speeds[:8] == Config().tuning.speed_km_h
    assert [point.beyond for point in points] == [False] * 8 + [True] * (len(points) - 8)
    assert speeds[-1] == 400.0
    assert all(1.0 < right / left <= STEP_BEYOND + 0.001 for left, right in pairwise(speeds[7:]))


@pytest.mark.parametrize(
    ("grid", "top", "listed", "inside", "last"),
    [
        ({"speed_max_km_h": 100.0}, 400.0, [15.0, 100.0, 120.0], [15.0, 100.0], 400.0),
        ({"speed_max_km_h": 110.0}, 400.0, [15.0, 100.0, 120.0], [15.0, 100.0, 110.0], 400.0),
        ({"speed_max_km_h": 200.0}, 90.0, [15.0, 80.0, 120.0], [15.0, 80.0, 90.0], 90.0),
        ({"speed_max_km_h": 120.0}, 120.0, [150.0, 200.0], [12.0, 120.0], 120.0),
        ({"speed_breakpoints_km_h": [20.0, 60.0, 70.0]}, 400.0, [15.0, 80.0], [15.0, 70.0], 400.0),
    ],
)
def test_breakpoints_follow_the_grid(
    grid: dict[str, object], top: float, listed: list[float], inside: list[float], last: float
) -> None:
    config = small_config({"grid": grid, "controller": {"inputs": {"speed_max_km_h": top}}}, speed_km_h=listed)
    points = breakpoints(config)
    assert [point.speed_km_h for point in points if not point.beyond] == inside
    assert points[-1].speed_km_h == last


def test_too_many_breakpoints_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"^tuning\.speed_km_h: .* at most 32; list 15 less$"):
        tune(small_config(speed_km_h=[float(speed) for speed in range(10, 50)]))


def test_where_no_gains_suit_the_family_the_speed_and_the_car_are_named() -> None:
    """With half of the rear stiffness the car is unstable far below the grid's end."""
    with pytest.raises(ConfigError) as refused:
        tune(small_config(stiffness_percent=[-50.0, 50.0]))
    text = str(refused.value)
    assert text.startswith("[tuning]: no gains meet the demands at 120 km/h: the car with lag 50 ms")
    assert "stiffness +50/-50 %" in text
    assert "dB" in text
    assert "narrow the family" in text
    assert "\n" not in text


def test_where_straight_lines_cannot_hold_a_breakpoint_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("codegen.design.tune.RESERVES_MAX", 1)  # nothing can be mended
    with pytest.raises(ConfigError) as refused:
        tune(small_config())
    text = str(refused.value)
    assert text.startswith(
        "tuning.speed_km_h: straight lines between the gains at 15 and 42.5 km/h do not meet the demands: at "
    )
    assert text.endswith("; list a breakpoint between them")


def test_beyond_the_grid_fewer_count_where_straight_lines_cannot_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("codegen.design.tune.RESERVES_MAX", 1)
    grid = {"speed_min_km_h": 10.0, "speed_max_km_h": 16.0}
    made = design(small_config({"grid": grid, "controller": {"inputs": {"speed_max_km_h": 60.0}}}, speed_km_h=[15.0, 16.0]))
    assert made.counted[:2] == (9, 9)
    assert 1 in made.counted
    assert 0 not in made.counted  # the configured car alone can always be suited here


def test_where_nobody_can_be_suited_beyond_the_grid_the_gains_hold_and_it_is_said() -> None:
    """An oversteering car, late in everything: near the largest speed no gains give it the margins."""
    rear = {"cornering_stiffness_n_per_rad": 100_000.0}
    config = small_config(
        {"tyre": {"front": {"cornering_stiffness_n_per_rad": 119_540.0}, "rear": rear}},
        stiffness_percent=[0.0],
        relaxation_length_m=[0.6],
        actuator_lag_s=[0.1],
        delay_samples=5,
    )
    made = design(config)
    schedule = made.schedule
    assert made.counted[0] == made.family_size == 2
    assert made.counted[-1] == 0
    assert schedule.proportional_gain_s[-1] == schedule.proportional_gain_s[-2]
    assert schedule.integral_gain[-1] == schedule.integral_gain[-2]
    # What the configured car has there is written as it is, below the demands.
    own = nominal_margins(config, [400.0 * KM_H], schedule.proportional_gain_s[-1:], schedule.integral_gain[-1:])
    assert schedule.gain_margin_db[-1] == pytest.approx(float(own.gain_margin_db[0]), abs=0.006)
    assert schedule.gain_margin_db[-1] < config.tuning.gain_margin_db
    assert made.limiting[-1] == nominal(config)
