"""`codegen sil --suite` and `codegen sil --baselines` at the command line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from codegen import config as configuration
from hil_sim.suite import whole
from hil_sim.suite.candidate import Candidate
from hil_sim.suite.tracking import SuiteResult
from hil_sim.suite.whole import Whole
from tests.report.made_suite import CELLS, SUBJECTS, cell_result, made, with_table

from .conftest import Run, everything_in

SMALL_TUNING = {"speed_km_h": [30.0, 60.0], "actuator_lag_s": [0.05], "mass_percent": [0.0]}
SMALL_TUNING |= {"stiffness_percent": [0.0], "relaxation_length_m": [0.0]}


@pytest.fixture(scope="module")
def good() -> SuiteResult:
    return made()


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch, here: Path) -> Callable[..., list[Candidate]]:
    """`suite(result)`: the result of the whole suite, without driving; returns the list of its candidates."""

    def give(result: SuiteResult, **more: Any) -> list[Candidate]:
        seen: list[Candidate] = []
        found = Whole(**{"result": result, "edited": (), "notes": (), **more})
        monkeypatch.setattr(whole, "run_whole", lambda tested, count, stage: (seen.append(tested), found)[1])
        return seen

    return give


def test_suite_of_the_recommended_preset(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    seen = suite(good, notes=("a note",))
    answer = run("sil", "--suite", "tracking")
    assert answer.code == 0, answer
    first, *lines = answer.out.splitlines()
    assert first == "suite tracking: the recommended preset, case 4ws-2, solved, tuned and built in memory"
    assert "What is asked, and what tracking shows" in lines
    assert seen[0].config == configuration.preset("recommended")
    assert everything_in(Path()) == {}
    answer = run("sil", "--suite", "tracking", "--json", "--plot", "overview.png")
    data = json.loads(answer.out)
    assert (data["tested"], data["passed"], data["subjects"]) == ("tracking", True, list(SUBJECTS))
    assert (data["build"], data["notes"], data["pictures"], answer.err) == (None, ["a note"], ["overview.png"], "")


def test_a_missed_figure_is_a_failed_check(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    wide = tuple(cell_result("tracking", cell, "nominal", sideslip_max_deg=4.25) for cell in CELLS)
    suite(with_table(good, "tracking", "nominal", wide))
    answer = run("sil", "--suite", "tracking")
    assert answer.code == 1
    assert "NOT MET" in answer.out
    figure = "all cells, as configured: |sideslip| 4.25 deg (at most 3.2 deg)"
    assert answer.err == f"error: 1 figure is not as asked: {figure}; see the first table\n"
