"""Tables and figures of the guide that come from maps and suites."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from codegen.design.family import Member
from codegen.optimum.turns import turns_of
from codegen.vehicle.single_track import SingleTrack
from scripts.guide import gust_margins, map_choice, suite_tables
from tests import builds
from tests.report.figures import check_layout, names
from tests.report.made_suite import CELLS, made, spun, with_table


def test_the_record_of_the_suite_is_of_the_committed_build() -> None:
    record = json.loads(suite_tables.TRACKING.read_text(encoding="utf-8"))
    assert record["manifest"] == suite_tables.build_digest(), "run `make generated`, and commit what it writes"
    assert str(suite_tables.BUILD.relative_to(suite_tables.ROOT)) in suite_tables.REFERENCES.read_text(encoding="utf-8")


def test_tables_of_a_suite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite_tables, "TRACKING", tmp_path / "docs/tracking.json")
    (tmp_path / "suite.json").write_text(json.dumps(made().to_dict()))
    suite_tables.write_record(tmp_path / "suite.json")
    required = [row for row in made().requirements if not row.stretch and row.passed is not None]
    assert suite_tables.missed() == f"The committed build meets all {len(required)} requirements.\n"
    rows = {
        line.split(" | ")[0].lstrip("| "): line.rstrip(" |").split(" | ")[1:] for line in suite_tables.results().splitlines()
    }
    assert rows["overshoot as configured, mean / largest"][:2] == ["1.2 / 2.0 %", "50.0 / 80.0 %"]
    # 20 deg/s at 120 km/h; the passive car spins in three of the cells at this speed.
    assert rows["lateral acceleration, largest steady"] == ["11.64 m/s²"] * 5
    (of_spins,) = (cells for title, cells in rows.items() if title.startswith("spins as configured"))
    assert of_spins == ["0; 0, 0; 0, 0", "0; 3, 3; 3, 3", "0; 0, 0; 0, 0", "0; 0, 0; 0, 0", "3; 3, 3; 3, 3"]
    (of_margins,) = (cells for title, cells in rows.items() if title.startswith("margins"))
    assert of_margins == ["8.5 dB, 46 deg", "unstable from 120 km/h", *["none needed"] * 3]
    (of_sine,) = (cells for title, cells in rows.items() if title.startswith("sine"))
    assert (of_sine[0], of_sine[-1]) == ("0.90, -30 deg", "-, -")
    assert "at most 1,040 instructions" in suite_tables.results()
    assert "| slalom | 0.100 |" in suite_tables.paths()
    assert "0.573 / 0.006" in suite_tables.clocks()


def test_a_missed_requirement_is_listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite_tables, "TRACKING", tmp_path / "tracking.json")
    rows = tuple(spun("tracking", cell, "friction-40-exact") for cell in CELLS)
    (tmp_path / "suite.json").write_text(json.dumps(with_table(made(), "tracking", "friction-40-exact", rows).to_dict()))
    suite_tables.write_record(tmp_path / "suite.json")
    assert "exit code 1 for these" in suite_tables.missed()
    assert f"| spins in {len(CELLS)} cells | {len(CELLS)} | at most 0 |" in suite_tables.missed()


def test_the_figure_of_a_car_shows_its_maps() -> None:
    figure = map_choice.maps_figure("paper")
    check_layout(figure, shared_labels=True)
    assert [*names(figure)][:3] == [title for title, _ in map_choice.MAPS.values()]
    solved = map_choice._of_map("paper", map_choice.RECOMMENDED)
    place = map_choice.SPEEDS_KM_H.index(60.0)
    one = solved.reference_map
    (drawn,) = (line for line in figure.axes[0].get_lines() if line.get_linewidth() > 2.0 and line.get_linestyle() == "-")
    inside = one.feasible[place]
    assert np.allclose(np.asarray(drawn.get_ydata())[inside], np.degrees(one.yaw_rate[place, inside]), rtol=1e-6)
    assert not np.isfinite(np.asarray(drawn.get_ydata())[~inside]).any()
    # The sideslip is that of the optimisation, which has the same tyres.
    (sideslip,) = (line for line in figure.axes[4].get_lines() if line.get_linewidth() > 2.0 and line.get_linestyle() == "-")
    optimum = turns_of(solved.config, solved.config.case(map_choice.CASE)).solve(one.speed[[place]], one.front_angle)
    assert np.allclose(np.asarray(sideslip.get_ydata())[inside], np.degrees(optimum.sideslip[0, inside]), atol=1e-3)


def test_without_feedback_a_gust_moves_the_car_as_in_continuous_time() -> None:
    gust, speed = gust_margins.Gust(2500.0, 1.5, 3.0), 100.0 / 3.6
    car, force = SingleTrack.from_config(builds.CONFIG), gust.force

    def rates(time: float, state: list[float]) -> list[float]:
        beta, yaw_rate, heading, _ = state
        wind = force if time < gust.duration else 0.0
        front = wind - car.front_stiffness * (beta + car.front_arm * yaw_rate / speed)
        rear = -car.rear_stiffness * (beta - car.rear_arm * yaw_rate / speed)
        turning = (car.front_arm * front - car.rear_arm * rear) / car.yaw_inertia
        return [(front + rear) / (car.mass * speed) - yaw_rate, turning, yaw_rate, speed * (heading + beta)]

    exact = solve_ivp(rates, (0.0, gust.duration + gust.read_after), np.zeros(4), max_step=0.002, rtol=1e-8).y[2:, -1]
    found = gust_margins.respond(builds.CONFIG, Member(0.05), gust, np.array([speed]), np.zeros(1), np.zeros(1))
    assert found[:, 0] == pytest.approx(exact, rel=1e-3)


def test_more_integral_gain_leaves_less_of_a_gust() -> None:
    ki, speed, kp = np.array([[0.4], [0.8]]), np.array([100.0 / 3.6]), np.array([0.14])
    member = Member(0.05, relaxation_length=0.4)
    heading, path = gust_margins.respond(builds.CONFIG, member, gust_margins.Gust(2500.0, 1.5, 3.0), speed, kp, ki)[..., 0]
    assert abs(heading[1]) < abs(heading[0]) < math.radians(0.1)  # the integral of the yaw rate is the heading
    assert 0.0 < path[1] < 0.8 * path[0]


def test_the_figure_of_the_gust_marks_the_design() -> None:
    figure = gust_margins.figure()
    check_layout(figure, shared_labels=True)
    assert gust_margins.FACTORS[gust_margins.DESIGN] == 1.0
    path, phase = figure.axes[2:], figure.axes[3]
    assert [axes.get_xlabel() for axes in path] == ["Gain margin (dB)", "Phase margin (deg)"]
    curve, point = phase.get_lines()[:2]
    assert (point.get_xdata()[0], point.get_ydata()[0]) in zip(curve.get_xdata(), curve.get_ydata(), strict=True)
    assert (np.diff(curve.get_ydata()) < 0.0).all()  # over the integral gain


def test_the_figure_of_the_keys_has_a_column_for_each() -> None:
    figure = map_choice.keys_figure("van", 120.0)
    check_layout(figure, shared_labels=True)
    titles = [axes.get_title(loc="left") for axes in figure.axes[: len(map_choice.KEYS)]]
    assert titles == [map_choice.KEY_TITLES[key] for key in map_choice.KEYS]


def test_a_passive_car_has_its_own_yaw_rate() -> None:
    (row,) = (line for line in map_choice.comparison("paper").splitlines() if line.startswith("| straight rear wheels"))
    assert row.count("100 %,") == len(map_choice.POINTS)


def test_the_table_of_random_cars(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(suite_tables, "CARS", tmp_path / "docs/cars.json")
    row = {"figure": "overshoot", "unit": "%", "asked": "at most 5 %", "stretch": False}
    measured = ((1.0, True), (6.0, False), (2.0, True))
    cars = [{"requirements": [{**row, "measured": value, "passed": passed}], "error": ""} for value, passed in measured]
    cars.append({"requirements": [], "error": "no suitable gains"})
    (tmp_path / "suite.json").write_text(json.dumps({"seed": 4, "passed": 2, "cars": cars}))
    suite_tables.write_cars(tmp_path / "suite.json")
    assert suite_tables.cars().startswith("Of 4 cars of seed 4, 2 meet all limits. 1 cannot be solved, tuned or built.\n")
    assert "| overshoot | at most 5 % | 1 | 1 % | 2 % | 6 % |" in suite_tables.cars()
