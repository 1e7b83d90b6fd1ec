"""The suite "references": its subjects, and a reference in the generated C."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from codegen.configuration import REFERENCE_CASES
from codegen.optimum.solve import solve_case
from codegen.optimum.turns import turns_of
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from hil_sim.suite import references
from hil_sim.suite.cells import NOMINAL, Cell, cells
from hil_sim.suite.references import compared_cases, run_references
from hil_sim.suite.runs import run_table
from hil_sim.suite.subjects import Candidate, Subject, of_config
from tests import builds
from tests.optimum.cars import changed
from tests.report import made_suite

CONFIG = changed(builds.CONFIG, grid={"speed_points": 11, "front_angle_min_deg": 0.5, "front_angle_points": 10})


def test_the_subjects_are_the_cases_with_rear_steering(monkeypatch: pytest.MonkeyPatch) -> None:
    """The envelope of the paper's car never binds, so that it is not driven twice."""
    seen: list[Subject] = []
    points = cells(CONFIG, CONFIG.case("4ws-1"))

    def run_suite(tested: Subject, others: Sequence[Subject], case: object, **_: Any) -> Any:
        seen.extend((tested, *others))
        assert case == CONFIG.case("4ws-1")
        return made_suite.made(cells=points)

    monkeypatch.setattr(references, "run_suite", run_suite)
    found = run_references(Candidate("test", CONFIG, "4ws-1", (0.9,)))
    assert compared_cases(CONFIG, "4ws-1") == ("4ws-1", "4ws-2", *REFERENCE_CASES)
    assert [subject.name for subject in seen] == ["4ws-1", "4ws-2", "zero-sideslip", "variable-wheelbase"]
    assert found.same_as == {"envelope": "4ws-2"} and list(found.maps) == [subject.name for subject in seen]
    assert all(subject.config == CONFIG for subject in seen)  # the paper's PI has nothing to tune
    for name, one in found.maps.items():
        assert one.case == name and found.feasible_percent[name] == 100.0 * one.feasible.mean()
    # The cells are those of the tested case, so it has a turn in all of them; at their largest angle a law has none.
    assert found.inside["4ws-1"].all() and found.inside["zero-sideslip"].sum() < 20
    law = turns_of(CONFIG, CONFIG.case("zero-sideslip"))
    for name, turns in (("zero-sideslip", law), ("passive", law.without_rear_steering())):
        edge = turns.edge(np.array([cell.speed_km_h * KM_H for cell in points])).front_angle
        assert found.inside[name].tolist() == [math.radians(c.front_angle_deg) < e for c, e in zip(points, edge, strict=True)]
    assert found.to_dict()["same_as"] == {"envelope": "4ws-2"}


def test_all_maps_get_the_controller_of_the_map_under_test(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Subject] = []
    tuned_for: list[str | None] = []
    config = changed(
        builds.FEEDFORWARD_CONFIG.with_tyre_model("linear"), grid=CONFIG.grid.model_dump(), controller={"kind": "tracking"}
    )
    made = changed(config, controller={"tracking": {"trim_max_percent": 3.0}})

    def run_suite(tested: Subject, others: Sequence[Subject], case: object, **_: Any) -> Any:
        seen.extend((tested, *others))
        return made_suite.made(cells=cells(config, config.case("4ws-2")))

    monkeypatch.setattr(references, "run_suite", run_suite)
    monkeypatch.setattr(references, "tuned", lambda solved, *_: (tuned_for.append(solved.case), made)[1])
    run_references(Candidate("test", config, "4ws-2", (0.9,)))
    assert tuned_for == ["4ws-2"] and len(seen) == 4 and all(subject.config == made for subject in seen)


def test_a_reference_in_c() -> None:
    """Inside the map it is the law, and beyond grip the car holds the largest lateral acceleration instead of leaving it."""
    config = builds.FEEDFORWARD_CONFIG.with_tyre_model("linear")
    law = solve_case(config, "zero-sideslip")
    subject = of_config("zero-sideslip", law, config)
    software = subject.around(config)
    assert software.selftest()
    car = SingleTrack.from_config(config)
    speed, angle = law.speed[50], law.front_angle[15]
    assert law.feasible[50, 15]
    # beta = delta_r + b r = 0 and r = G (delta_f - delta_r)
    gain, per_yaw_rate = float(car.yaw_gain(speed)), float(car.sideslip_per_yaw_rate(speed))
    assert software.map_yaw_rate(speed, angle) == pytest.approx(gain * angle / (1.0 - gain * per_yaw_rate), rel=1e-5)
    beyond = Cell(60.0, 5.0, 1.0)
    edge = turns_of(config, config.case("zero-sideslip")).edge(np.array([60.0 * KM_H])).front_angle[0]
    assert math.radians(beyond.front_angle_deg) > 1.2 * edge
    (driven,) = run_table(subject, (NOMINAL,), (beyond,))["nominal"]
    assert not driven.spun and driven.settled
    # The linear map requires more slip than the bound of the plant, by up to 17 %; without steering in phase it is twice that.
    assert driven.slip_percent is not None and driven.slip_percent < 125.0
