"""The benchmarks' own checks: the hand-written plant equals the one made from CasADi. No time is asserted."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import better, cortex_m, judged_car, law_grip, minimal_error, response
from benchmarks.__main__ import main
from benchmarks.closed_loop import Loops, slalom, step_steer
from benchmarks.judged_cars import PAPER, five_cars
from benchmarks.law_car import FLICKS, IDEAL, PLANTS, Drives, LawCar, Setting, per_setting, road, spun, step_to
from benchmarks.law_figures import Figure, lines
from benchmarks.tyre_curves import Shape, generated
from codegen.judgement.drives import SweepFigures
from codegen.judgement.steady import Dead, Least, SteadyFigures
from codegen.map_file import map as npz
from codegen.metrics import StepResponse
from codegen.sil.batch import NOISES
from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.vehicle.dynamics import PLANT_STATES
from hil_sim.suite.cells import Cell, Condition, peak, stiffness, together
from hil_sim.suite.runs import run_table
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
    works["check"]()  # warnings of the committed map are no failure


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


def test_the_minimal_error_is_that_of_the_ideal_car(law_car: LawCar, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(minimal_error, "AFTER_S", 0.4)
    assert law_car.config.plant != law_car.config.with_ideal_plant().plant
    assert minimal_error.compare(law_car.tested, minimal_error.chosen(law_car.cells)[0]).ratio > 1.0


def test_the_generated_tyre_curve_is_counted(law_car: LawCar) -> None:
    shape = Shape(1.3, -0.5)
    name, worst, *_ = cortex_m.curve_row(generated(law_car.tested.around.generated.files), shape, 100).cells
    assert name.endswith("as generated") and 10 < int(worst) < 100


def test_a_displacement_is_judged_by_the_easier_requirement() -> None:
    assert better.dwell_reserve(judged_car.Dwell("two-track", "tracking", 2.0, 2.1)) == pytest.approx(2.0 - 0.95 * 2.1)
    assert better.dwell_reserve(judged_car.Dwell("two-track", "tracking", 2.0, 3.0)) == pytest.approx(-0.1)


def test_the_table_names_the_worst_car_and_what_it_misses() -> None:
    none = Dead(0.0, 0.0)

    def car(name: str, low: float, named: frozenset[str] = frozenset()) -> judged_car.CarFigures:
        return judged_car.CarFigures(
            name,
            steady=SteadyFigures(0.79, 0.85, 0.8, {}, none, none, Least(low, 30.0, 2.0), Least(1.0, 90.0, 2.0), {}),
            dwells=(judged_car.Dwell("two-track", "tracking", 2.2, 3.0),),
            sweep=SweepFigures(60, 40, 0, 0),
            lane_changes=(judged_car.LaneChanges("two-track", 56.0, 56.0, 0.5, 1.0),),
            named=named,
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
    named = better.report([step], [good, car("bad", 0.6, frozenset({"yaw_rate_low"}))], [], 1)
    assert {row.cells[0] for row in named.comparisons if not row.met} == {low}


@pytest.fixture(scope="module")
def law_car() -> LawCar:
    """Return the car of the committed build."""
    reference_map, tested = judged_car.prepared(PAPER, five_cars()[PAPER])
    return LawCar("P", tested, reference_map)


def test_a_line_of_the_law_is_met_by_all_cars_or_by_their_sum() -> None:
    def line(*figures: Figure) -> tuple[tuple[str, ...], bool]:
        (row,) = lines(figures, "PS")
        return row.cells, row.met

    good, bad = (Figure(5, "cells", "ideal", "0", car, text, text == "0") for car, text in (("P", "0"), ("S", "2")))
    assert line(good, bad) == (("5", "cells", "ideal", "0", "0", "2", "-", "MISSED"), False)
    assert line(good) == (("5", "cells", "ideal", "0", "0", "-", "-", "met"), True)
    terms = [Figure(8, "spins", "ideal", "3 of all", car, "2", value=2.0, sum_max=3.0) for car in "PS"]
    assert line(*terms) == (("8", "spins", "ideal", "3 of all", "2", "2", "4", "MISSED"), False)
    assert line(replace(bad, goal="")) == (("5", "cells", "ideal", "-", "-", "2", "-", "-"), True)


def test_steps_of_the_law_are_those_of_the_suite(law_car: LawCar) -> None:
    """One batch has cars and roads of several settings; each must have the figures of the suite."""
    conditions = [
        replace(road(0.15, keeps_stiffness=False), estimate=0.5),
        Condition("tyres", "soft front tyres", "tyre", plant=stiffness(-25.0, 0.0)),
    ]
    settings = [Setting(condition) for condition in conditions]
    runs = law_car.drive(law_car.steps, IDEAL, settings)
    errors = per_setting(StepResponse(runs).map_error_percent, settings)
    is_spun = spun(runs, settings)
    on_ideal = [replace(each, plant=together(PLANTS[IDEAL], each.plant)) for each in conditions]
    expected = run_table(law_car.tested, on_ideal, law_car.cells)
    assert is_spun.any() and not is_spun.all()
    dry = law_car.map_yaw_rate(law_car.steps.speed, law_car.steps.front_angle)
    for condition, found, lost in zip(conditions, errors, is_spun, strict=True):
        for result, error, rate, is_lost in zip(expected[condition.name], found, dry, lost, strict=True):
            assert result.spun == is_lost
            if result.yaw_rate_steady_deg_s is not None:
                assert error == pytest.approx(100.0 * (math.radians(result.yaw_rate_steady_deg_s) / rate - 1.0), abs=1e-6)


def test_each_setting_of_the_law_has_its_own_sensors(law_car: LawCar) -> None:
    settings = [Setting(), Setting(acceleration_bias=0.3), Setting(yaw_rate_bias=0.01), Setting(is_noisy=True)]
    noise = [each.noise(law_car.config, 400, 2) for each in settings]
    means = [each.mean(axis=(0, 2)) for each in noise]
    assert not noise[0].any() and means[1].tolist() == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.3])
    assert means[2].tolist() == pytest.approx([0.0, 0.0, 0.01, 0.0, 0.0])
    sensors = [getattr(law_car.config.sensors, name) for name in NOISES]
    wanted = [math.hypot(sensor.noise, sensor.resolution / math.sqrt(12.0)) for sensor in sensors]
    assert noise[3].std(axis=(0, 2)) == pytest.approx(wanted, rel=0.1)
    runs = law_car.drive(Drives.straight(3.0, [100.0]), IDEAL, settings)
    rate = runs.signals["yaw_rate_rad_s"]
    assert not rate[:, 0].any() and abs(rate[-1, 2]) > 1e-4 and rate[:, 3].std() > 0.0


def test_a_slippery_road_keeps_the_stiffness_or_the_factor_b(law_car: LawCar) -> None:
    """A small slip angle gives the same force as on the dry road, or one that falls with the friction."""
    small = Drives("step", lambda time: np.ones(time.size), 2.0, 0.0, np.array([20.0]), np.array([1e-3]))
    settings = [Setting(controlled=False), *(Setting(road(0.45, keeps), controlled=False) for keeps in (True, False))]
    dry, kept, lost = law_car.drive(small, IDEAL, settings).signals["slip_front_rad"][-1]
    assert kept == pytest.approx(dry, rel=1e-3)
    assert lost == pytest.approx(2.0 * dry, rel=0.05)
    large = replace(small, front_angle=np.array([0.2]))
    forces = np.abs(law_car.drive(large, IDEAL, settings).signals["lateral_acceleration_m_s2"]).max(axis=0)
    assert forces[1:] == pytest.approx([0.5 * forces[0]] * 2, rel=0.15)


def test_the_possible_yaw_rate_is_that_of_the_map_with_its_own_tyres(law_car: LawCar) -> None:
    own, weak = (law_grip.possible(law_car, peak(percent)(law_car.config)) for percent in (0.0, -30.0))
    assert (own >= 0.995).all()
    assert weak.min() == pytest.approx(0.75, abs=0.05) and weak.max() == 1.0


def test_steps_of_a_flick_follow_each_other() -> None:
    course = step_to((-1.0, 1.0), 0.8, 0.5)
    assert course(np.array([0.0, 0.499, 0.5, 1.299, 1.3, 5.0])).tolist() == [0.0, 0.0, -1.0, -1.0, 1.0, 1.0]
    assert FLICKS.after(2.0).course(np.array([2.499, 2.5])).tolist() == [0.0, -1.0]


@pytest.mark.parametrize(
    ("words", "where"),
    [
        ("nothing", "there is no benchmark"),
        ("minimal-error --cars 2", "--cars is an option of better and law"),
        ("better --plant wet", "--plant"),
        ("law --plant wet", "--plant"),
        ("identify --plants wet", "--plants"),
        ("law --plants foreign", "--plants is an option of identify"),
        ("law --only 5,99", "--only"),
        ("law --only 1 --cars 0", "--cars"),
        ("law --cars -1", "--cars"),
        ("law --shown X", "--shown"),
        ("law --straight -5", "--straight"),
        ("law --straight nan", "--straight"),
        ("law --set a", "--set"),
        ("law --set tuning.gain_margin_db=-1", "--set"),
        ("law --maps /dev/null/x", "--maps"),
        ("law --write /dev/null/x", "--write"),
    ],
)
def test_a_wrong_option_is_one_line(
    words: str, where: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["benchmarks", *words.split()])
    with pytest.raises(SystemExit) as left:
        main()
    answer = capsys.readouterr()
    assert left.value.code == 2 and not answer.out
    assert answer.err.count("\n") == 1 and where in answer.err
