"""The benchmarks' own checks: the hand-written plant equals the one made from CasADi. No time is asserted."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import better, judged_car, lane_change, minimal_error, response
from benchmarks.closed_loop import Loops, slalom, step_steer
from benchmarks.steady_passive import PassiveTurns
from codegen import configuration
from codegen.map_file import map as npz
from codegen.optimum.turns import turns_of
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop, LoopOptions
from codegen.vehicle.dynamics import PLANT_STATES
from hil_sim.manoeuvres import Hands
from hil_sim.suite.cells import Cell
from tests import builds

DURATION = 0.5

SAME = 1e-11
"""Absolute and relative tolerance in SI units. Both loops use double precision and differ only in the order of operations.

A few 1e-16 of each quantity grow over 500 steps to a measured 1e-13. A different equation differs by 1e-6 or more.
"""
TIME = np.linspace(0.0, DURATION, len(step_steer(DURATION, 0.1)))
MANOEUVRES: dict[str, dict[str, Any]] = {
    "step": {},
    "slalom, and ESC acts for a while": {"inhibit": (TIME > 0.2) & (TIME < 0.3)},
    "slalom, slower than a wheel needs to roll, then up to where the controller wakes": {"speed": 0.1 + 11.8 * TIME},
    "step with a gust that lifts the inner wheels, a road that changes, and an estimate of the friction": {
        "speed": 40.0 - 20.0 * TIME,
        "friction": np.where(TIME < 0.3, 1.5, 0.5),
        "friction_estimate": np.where(TIME < 0.4, np.nan, 0.6),
        "yaw_moment": 2e5 * np.sin(4.0 * math.pi * TIME),
    },
}


def test_the_hand_written_plant_equals_that_from_casadi() -> None:
    loops = Loops.compile()
    for name, columns in MANOEUVRES.items():
        inputs = slalom(DURATION) if name.startswith("slalom") else step_steer(DURATION, 0.1)
        for column, values in columns.items():
            inputs[:, INPUT_COLUMNS.index(column)] = values
        (generated, generated_state), (by_hand, hand_state) = loops.generated(inputs), loops.by_hand(inputs)
        assert np.ptp(by_hand[:, 1:], axis=0)[2] > 1e-3  # the car turns
        np.testing.assert_allclose(by_hand, generated, rtol=SAME, atol=SAME)
        for state in PLANT_STATES:
            assert getattr(hand_state, state) == pytest.approx(getattr(generated_state, state), rel=SAME, abs=SAME), state


def test_solve_is_timed_with_the_preset_and_with_the_file_that_init_writes(tmp_path: Path) -> None:
    works = response.Tree(response.ROOT, tmp_path).works()
    assert works.keys() == response.TARGETS_S.keys() | response.CPU_TARGETS_S.keys()
    for name, tyre_model in (("solve", "linear"), ("solve, codegen init", "magic-formula")):
        works[name]()
        found = npz.load(tmp_path / ("map.npz" if name == "solve" else "car.npz"))
        assert found.tyre_model == tyre_model


def test_no_control_near_the_minimal_one_has_a_smaller_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(minimal_error, "AFTER_S", 0.4)
    step = minimal_error.StepSteer(builds.paper().software, Cell(100.0, 3.0))
    found = step.optimum()
    assert found.rms < 0.2 * step.rms(step.replay(np.zeros_like(found.command))[0][:: step.per_sample])
    assert found.rear_angle.min() < 0.0 < found.yaw_rate[-1]  # opposite phase first
    sooner, later = np.roll(found.command, -step.per_sample), np.roll(found.command, step.per_sample)
    for other in (0.9 * found.command, 1.1 * found.command, sooner, later):
        # 1 %: the optimum belongs to a coarser integration.
        assert step.rms(step.replay(other)[0][:: step.per_sample]) > 0.99 * found.rms
    assert step.optimum(rear_slip_max=math.radians(1.0)).rms > found.rms


def test_passive_turns_go_on_from_those_of_the_map() -> None:
    config = configuration.preset("recommended")
    speed, angle = np.array([6.0, 20.0, 33.0]), np.radians([0.1, 1.0, 2.0, 4.0])
    bounded = turns_of(config, config.case("4ws-2")).without_rear_steering().solve(speed, angle)
    passive = PassiveTurns.of(config, speed)
    found = passive.yaw_rate(angle)
    # The yaw rate is linear between points 0.5 % of the friction apart; its curvature leaves less than 1e-4 rad/s.
    np.testing.assert_allclose(found[bounded.feasible], bounded.yaw_rate[bounded.feasible], atol=1e-4)
    beyond = np.isfinite(found) & ~bounded.feasible
    assert beyond.any()
    largest = np.where(np.isfinite(passive.front_angle), passive.lateral_acceleration, 0.0).max()
    assert 0.85 < largest / 9.81 < 0.9  # the friction of the road, less what the load transfer and the angles cost


def test_figures_of_a_map_from_arrays_by_hand() -> None:
    rates = np.array([[1.0, 2.0, 1.5, np.nan], [1.0, 1.0, 3.0, 4.0]])
    assert judged_car.falling_share(rates) == 1 / 5
    where = np.array([[True, True, False, True], [True, True, True, True]])
    assert judged_car.least_ratio(rates, np.full(rates.shape, 2.0), where) == 0.5
    assert judged_car.least_ratio(rates, np.where(rates == 1.0, np.nan, 2.0), where) == 1.0
    assert math.isnan(judged_car.least_ratio(rates, rates, np.zeros(rates.shape, dtype=np.bool_)))
    assert better.dwell_reserve(judged_car.Dwell("two-track", "tracking", 2.0, 2.1)) == pytest.approx(2.0 - 0.95 * 2.1)
    assert better.dwell_reserve(judged_car.Dwell("two-track", "tracking", 2.0, 3.0)) == pytest.approx(-0.1)


def test_the_table_names_the_worst_car_and_what_it_misses() -> None:
    def car(name: str, low: float, warnings: tuple[str, ...] = ()) -> judged_car.CarFigures:
        return judged_car.CarFigures(
            name,
            steady=judged_car.SteadyFigures(0.79, 0.85, 0.8, 0.0, low, 1.0, 0.0),
            dwells=(judged_car.Dwell("two-track", "tracking", 2.2, 3.0),),
            sweep=judged_car.Sweep(60, 40, 0, 0),
            lane_changes=(judged_car.LaneChanges("two-track", 56.0, 56.0, 0.5, 1.0),),
            warnings=warnings,
        )

    good, bad, failed = car("good", 1.0), car("bad", 0.6), judged_car.CarFigures("failed", "no gains")
    step = judged_car.PaperStep("two-track", "tracking", 30.0, 25.0, 25.0, 1.0, 1.5)
    assert all(row.met for row in better.report([step], [good], [good], 1).comparisons)
    rows = {row.cells[0]: row for row in better.report([step], [good, bad], [good, bad, failed], 1).comparisons}
    missed = {title for title, row in rows.items() if not row.met}
    low = "yaw rate over passive, 20 to 60 km/h, up to the cap"
    assert missed == {low, "random cars that meet every row above, seed 1", "`codegen check` on the five cars"}
    assert rows[low].cells[1:3] == ("60.0 %", "bad")
    assert rows["random cars that meet every row above, seed 1"].cells[1].startswith("1 of 3")
    named = better.report([step], [good, car("bad", 0.6, ("the car turns less",))], [], 1)
    assert {row.cells[0] for row in named.comparisons if not row.met} == {low}


def test_the_largest_entry_speed_is_that_of_the_best_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    def passes_below(_drive: Any, _config: Any, speed_km_h: float, hands: Hands) -> float | None:
        return hands.preview_time_s if speed_km_h <= 50.0 * hands.gain and speed_km_h != 40.0 else None

    monkeypatch.setattr(lane_change, "_sideslip", passes_below)
    config = builds.paper().software.config
    drivers = (Hands(0.5, 0.1, 1.0), Hands(0.4, 0.1, 1.2), Hands(0.3, 0.1, 0.8))
    drive: Any = None
    assert lane_change.largest_entry_speed(drive, config, drivers) == 60.0
    assert lane_change.largest_entry_speed(drive, config, (Hands(0.5, 0.1, 0.1),)) == 0.0
    assert lane_change.least_sideslip(drive, config, 45.0, drivers) == 0.4
    assert lane_change.least_sideslip(drive, config, 61.0, drivers) == math.inf


def test_a_driver_passes_the_lane_change_only_when_slow_enough() -> None:
    software = builds.paper().software
    passed = {}
    for speed in (40.0, 60.0):
        scenario = lane_change.LaneChange.at(speed, Hands(0.4, 0.1, 0.9))
        driver = scenario.driver(software.config)
        assert driver is not None
        record = ClosedLoop(software, LoopOptions(controlled=False)).run_stepped(scenario.inputs(software.config), driver.steer)
        passed[speed] = lane_change.sideslip_if_passed(record, scenario, software.config)
    assert passed[60.0] is None  # it does not spin, but hits cones
    assert passed[40.0] is not None
    assert 0.1 < passed[40.0] < 3.0
