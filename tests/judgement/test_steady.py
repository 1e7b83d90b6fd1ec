"""Steady turns of the passive car, and the figures of a map against them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen import configuration
from codegen.configuration import Config
from codegen.judgement.model import Row
from codegen.judgement.passive import PassiveTurns
from codegen.judgement.rows import steady_rows
from codegen.judgement.steady import dead_steering, least_ratio, steady_figures
from codegen.map_file.bounds import Binding
from codegen.map_file.map import ReferenceMap
from codegen.optimum.turns import turns_of
from codegen.units import KM_H

CONFIG = configuration.preset("recommended")
SPEED, ANGLE = np.linspace(20.0, 120.0, 21) * KM_H, np.radians(np.linspace(0.2, 8.0, 40))


def passive_map(config: Config = CONFIG, factor: float = 1.0) -> ReferenceMap:
    """Return a map of a share of the yaw rates of the passive car, up to the configured limit."""
    rates = PassiveTurns.of(config, SPEED).yaw_rate(ANGLE)
    limit = config.limits.lateral_acceleration_max_g * config.road.gravity_m_s2
    feasible = np.isfinite(rates) & (SPEED[:, np.newaxis] * rates <= limit)
    active = np.where(feasible, np.uint8(Binding.REAR_ANGLE), np.uint8(0))
    rates = np.where(feasible, factor * rates, np.nan)
    return ReferenceMap(SPEED, ANGLE, rates, feasible, active=active, config=config)


def rows_of(reference_map: ReferenceMap, config: Config = CONFIG) -> dict[str, Row]:
    return {row.key: row for row in steady_rows(steady_figures(reference_map, config))}


def test_passive_turns_go_on_from_those_of_the_map() -> None:
    speed, angle = np.array([6.0, 20.0, 33.0]), np.radians([0.1, 1.0, 2.0, 4.0])
    bounded = turns_of(CONFIG, CONFIG.case("4ws-2")).without_rear_steering().solve(speed, angle)
    passive = PassiveTurns.of(CONFIG, speed)
    found = passive.yaw_rate(angle)
    # The yaw rate is linear between points 0.5 % of the friction apart; its curvature leaves less than 1e-4 rad/s.
    np.testing.assert_allclose(found[bounded.feasible], bounded.yaw_rate[bounded.feasible], atol=1e-4)
    beyond = np.isfinite(found) & ~bounded.feasible
    assert beyond.any()
    assert 0.85 < passive.largest.max() / 9.81 < 0.9  # the friction of the road, less what load transfer and angles cost
    back = passive.front_angle_at(speed[:, np.newaxis] * found)
    np.testing.assert_allclose(back[np.isfinite(found)], np.broadcast_to(angle, found.shape)[np.isfinite(found)], rtol=1e-9)


def test_dead_steps_of_arrays_by_hand() -> None:
    """Slope at zero: 1 for each step. Usable: 4 m/s^2 at 1 m/s, so flat steps above 3.68 rad/s are no fault."""
    speed, angle = np.array([1.0, 1.0]), np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    rates = np.array([[1.0, 2.0, 1.5, np.nan, np.nan], [1.0, 2.0, 2.02, 3.99, 4.0]])
    found = dead_steering(speed, angle, rates, np.full(2, 4.0))
    assert (found.falling_percent, found.flat_percent) == (100.0 / 6.0, 100.0 / 6.0)
    assert dead_steering(speed, angle, rates, np.full(2, 5.0)).flat_percent == 100.0 / 3.0
    from_zero = dead_steering(speed[:1], np.array([0.0, 1.0, 2.0]), np.array([[0.0, 1.0, 1.02]]), np.full(1, 4.0))
    assert (from_zero.falling_percent, from_zero.flat_percent) == (0.0, 50.0)


def test_the_least_ratio_has_its_place() -> None:
    rates, where = np.array([[1.0, 2.0], [3.0, np.nan]]), np.array([[True, True], [False, True]])
    speed, angle = np.array([10.0, 20.0]), np.radians([1.0, 2.0])
    found = least_ratio(rates, np.array([[2.0, 8.0], [30.0, 1.0]]), where, speed, angle)
    assert (found.ratio, found.speed_km_h, found.front_angle_deg) == pytest.approx((0.25, 36.0, 2.0))
    assert math.isnan(least_ratio(rates, rates, ~np.ones_like(where), speed, angle).ratio)


def test_a_map_of_the_passive_car_has_no_fault_of_its_own() -> None:
    found = rows_of(passive_map())
    assert [row.warning for row in found.values() if row.warning] == []
    assert found["yaw_rate_low"].value == pytest.approx(100.0, abs=0.1)
    assert found["lateral_acceleration"].verdict == "equal"
    assert [key for key in found if key.startswith("yaw_gain")] == ["yaw_gain_60", "yaw_gain_80", "yaw_gain_120"]


def test_a_map_that_turns_60_percent_of_the_passive_car_is_worse() -> None:
    found = rows_of(passive_map(factor=0.6))
    # Nearly neutral, the passive car turns twice as much at 120 km/h as the understeering one that is the measure there.
    assert {key for key, row in found.items() if row.warning} >= {"lateral_acceleration", "yaw_rate_low"}
    assert found["yaw_rate_low"].value == pytest.approx(60.0, abs=0.1)
    assert found["yaw_gain_80"].value == pytest.approx(60.0, abs=0.1)
    warning = found["lateral_acceleration"].warning
    assert "% of what the car can use" in warning and warning.endswith("what binds in most cells: rear angle")


def test_one_falling_step_is_dead_steering() -> None:
    own = passive_map()
    rates = own.yaw_rate.copy()
    rates[3, 20] = rates[3, 19] - 1e-4
    found = rows_of(replace(own, yaw_rate=rates))
    assert rows_of(own)["dead_steering_map"].warning == ""
    assert found["dead_steering_map"].verdict == "worse"
    assert "dead steering in the map 0." in found["dead_steering_map"].warning


def test_a_map_whose_top_speed_is_low_has_only_what_it_can_have() -> None:
    own = passive_map()
    slow = SPEED <= 50.0 * KM_H
    cut = replace(own, speed=SPEED[slow], yaw_rate=own.yaw_rate[slow], feasible=own.feasible[slow], active=None)
    found = rows_of(cut)
    assert "yaw_rate_high" not in found
    assert [key for key in found if key.startswith("yaw_gain")] == ["yaw_gain_50"]
