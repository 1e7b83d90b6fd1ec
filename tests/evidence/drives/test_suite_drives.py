"""The test set, driven: the paper's PI in all cells, and the whole suite for the recommended controller."""

from collections.abc import Mapping
from typing import Any

import pytest

from codegen import config as configuration
from hil_sim.suite import third_party, tracking, whole
from hil_sim.suite.candidate import Candidate
from hil_sim.suite.cells import SPEEDS_KM_H
from hil_sim.suite.conditions import CONDITIONS, NOMINAL
from hil_sim.suite.plants import changed
from hil_sim.suite.subjects import Subject, around
from hil_sim.suite.tracking import run_suite
from hil_sim.suite.whole import run_whole
from tests import builds
from tests.cli.test_suite_command import SMALL_TUNING

ONE_CAR = {
    "tuning": SMALL_TUNING,
    "grid": {"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20},
}
"""A family of one car and a coarse grid: gains and maps take little time."""


def test_the_papers_pi_over_all_cells() -> None:
    """A prototype of the same loop gave a mean of 55 %, a worst of 174 % and 4 spins."""
    pi = Subject("pi", builds.CONFIG, around(builds.paper_map(), builds.CONFIG))
    chosen = [each for each in CONDITIONS if each.name in ("nominal", "lag-100", "friction-60")]
    suite = run_suite(pi, [], builds.CONFIG.case("4ws-2"), chosen=chosen)
    found = suite.summary("pi", "nominal")
    assert found.cells == 24
    assert found.overshoot_mean_percent == pytest.approx(50.5, abs=1.0)
    worst = found.overshoot_percent
    assert worst is not None and worst.value == pytest.approx(139.7, abs=3.0)
    assert (worst.cell.speed_km_h, worst.cell.share) == (120.0, 1.0)
    assert len(suite.summary("pi", "friction-60").spins) >= 8  # a dry map on a wet road
    slow = suite.summary("pi", "lag-100").overshoot_mean_percent
    assert slow is not None and slow > found.overshoot_mean_percent
    assert [row.speed_km_h for row in suite.rise_times["pi"]] == list(SPEEDS_KM_H)
    times = [row.mean_s for row in suite.rise_times["pi"]]
    assert times == sorted(times, reverse=True)
    assert [each.cell.speed_km_h for each in suite.shown] == [42.5, 60.0, 100.0, 120.0]


def test_the_whole_suite_of_a_candidate(monkeypatch: pytest.MonkeyPatch) -> None:
    """One condition, four cells, and no plant of a third party; tuned and built as always."""
    points = tracking.cells
    monkeypatch.setattr(tracking, "conditions", lambda config: (NOMINAL,))
    monkeypatch.setattr(tracking, "cells", lambda config, case: points(config, case)[:4])
    monkeypatch.setattr(third_party, "available", lambda: False)
    best = changed(configuration.preset("recommended"), ONE_CAR)
    found = run_whole(Candidate("x", best, "4ws-2", (0.9,)), count_files)
    assert found.result.subjects == ("tracking", "pi", "feedforward", "proportional", "passive")
    assert found.result.requirements[-1].measured == found.result.instructions > 10
    assert found.notes == (whole.THIRD_PARTY_MISSING,)
    c1 = found.result.c1
    assert c1["tracking"]["lag-50"].overshoot_percent < 0.2 * c1["pi"]["lag-50"].overshoot_percent


def count_files(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> int:
    """Stand in for the count of instructions: runs in a process of its own."""
    assert manifest["options"]["kind"] == "tracking"
    return len(files)
