"""Simulation of the test suite: the paper's PI in all cells."""

import pytest

from hil_sim.suite.cells import CELL_SPEEDS_KM_H, conditions
from hil_sim.suite.subjects import Subject, around
from hil_sim.suite.tracking import run_suite
from tests import builds


def test_the_papers_pi_over_all_cells() -> None:
    """A prototype of the same loop had a mean of 55 %, a worst case of 174 % and 4 spins."""
    pi = Subject("pi", builds.CONFIG, around(builds.paper_map(), builds.CONFIG))
    chosen = [each for each in conditions(builds.CONFIG) if each.name in ("nominal", "lag-100", "friction-60")]
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
    assert [row.speed_km_h for row in suite.rise_times["pi"]] == list(CELL_SPEEDS_KM_H)
    times = [row.mean_s for row in suite.rise_times["pi"]]
    assert times == sorted(times, reverse=True)
    assert [each.cell.speed_km_h for each in suite.shown] == [42.5, 60.0, 100.0, 120.0]
