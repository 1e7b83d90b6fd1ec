"""`codegen sil --suite` and `codegen sil --baselines` at the command line."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from codegen import config as configuration
from codegen.cli.suite_command import instructions_of_step
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.write import write_folder
from codegen.refmap.solve import solve_case
from codegen.verify.budgets.measure import measure
from codegen.verify.check import Effort, Subject
from hil_sim.suite import candidate, whole
from hil_sim.suite.candidate import Candidate
from hil_sim.suite.tracking import SuiteResult
from hil_sim.suite.whole import Whole
from tests.report.made_suite import CELLS, SUBJECTS, cell_result, made, with_table

from .conftest import Run, everything_in

PICTURES = {f"{name}.png" for name in ("overview", "steps", "cells", "conditions", "margins", "friction", "price")}


@pytest.fixture(scope="module")
def good() -> SuiteResult:
    return made()


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., list[Candidate]]:
    """`suite(result)`: what the whole suite gives, without driving; returns where its candidates are kept."""
    monkeypatch.chdir(tmp_path)

    def give(result: SuiteResult, **more: Any) -> list[Candidate]:
        seen: list[Candidate] = []

        def run_whole(tested: Candidate, count: Any, stage: Any) -> Whole:
            assert callable(count)
            assert callable(stage)
            seen.append(tested)
            return Whole(**{"result": result, "edited": (), "notes": (), **more})

        monkeypatch.setattr(whole, "run_whole", run_whole)
        return seen

    return give


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's controller on a coarse map."""
    grid = {"speed_points": 21, "front_angle_min_deg": 0.5, "front_angle_points": 20}
    small = {**configuration.preset().model_dump(), "grid": grid}
    small["tuning"] = {"speed_km_h": [30.0, 60.0], "actuator_lag_s": [0.05], "mass_percent": [0.0]}
    small["tuning"] |= {"stiffness_percent": [0.0], "relaxation_length_m": [0.0]}
    config = configuration.parse(small, "test")
    target = tmp_path_factory.mktemp("builds") / "small"
    write_folder(
        build(solve_case(config, "4ws-2"), config, BuildOptions("small"), BuildInputs("small.npz", "0" * 64, "map")), target
    )
    return target


def test_the_instructions_are_those_of_the_check_of_budgets(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Counted in a process of its own: the function must be one that can be sent there."""
    monkeypatch.setattr("codegen.verify.budgets.measure.SAMPLES", 60)
    monkeypatch.setattr("codegen.verify.budgets.measure.ROUNDS", 1)
    subject = Subject.read(folder)
    found = pickle.loads(pickle.dumps(instructions_of_step))(subject.files, subject.manifest)
    expected = measure(subject, Effort()).counts["controller_step"].with_limiter
    assert expected is not None
    assert found == expected.largest > 200


def test_suite_of_the_recommended_preset(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    seen = suite(good)
    answer = run("sil", "--suite", "tracking")
    assert answer.code == 0, answer
    first, *lines = answer.out.splitlines()
    assert first == "suite tracking: the recommended preset, case 4ws-2, solved, tuned and built in memory"
    assert "What is asked, and what tracking shows" in lines
    assert "What was tuned on what" in lines
    assert max(map(len, lines)) <= 120
    assert seen[0].config == configuration.preset("recommended")
    assert everything_in(Path()) == {}


def test_suite_of_a_build(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult, folder: Path) -> None:
    seen = suite(good, edited=("src/ars_map.c",), notes=("the multi-body car is missing",))
    answer = run("sil", "--suite", "tracking", "--build", folder)
    assert answer.code == 0, answer
    assert answer.out.startswith(f"suite tracking: {folder}\n")
    assert seen[0].folder == folder
    assert answer.err.splitlines() == [
        "note: src/ars_map.c was changed after the build; it was tested as it is",
        "note: the multi-body car is missing",
    ]


def test_suite_as_json(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    suite(good, notes=("a note",))
    answer = run("sil", "--suite", "tracking", "--json", "--plot", "overview.png")
    data = json.loads(answer.out)
    assert data["tested"] == "tracking"
    assert data["passed"] is True
    assert data["subjects"] == list(SUBJECTS)
    assert (data["build"], data["notes"], data["pictures"]) == (None, ["a note"], ["overview.png"])
    assert answer.err == ""


def test_all_pictures_go_into_a_folder(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    suite(good)
    answer = run("sil", "--suite", "tracking", "-o", "pictures", "--plot", "one.png")
    assert answer.code == 0, answer
    assert {path.name for path in Path("pictures").iterdir()} == PICTURES
    assert Path("one.png").read_bytes() == Path("pictures/overview.png").read_bytes()
    assert answer.out.count("plot: ") == len(PICTURES) + 1


def test_a_missed_figure_is_a_failed_check(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    wide = tuple(cell_result("tracking", cell, "nominal", sideslip_max_deg=4.25) for cell in CELLS)
    suite(with_table(good, "tracking", "nominal", wide))
    answer = run("sil", "--suite", "tracking", "--plot", "overview.png")
    assert answer.code == 1
    assert "NOT MET" in answer.out
    assert answer.out.endswith("plot: overview.png\n")
    figure = "all cells, as configured: |sideslip| 4.25 deg (at most 3.2 deg)"
    assert answer.err == f"error: 1 figure is not as asked: {figure}; see the first table\n"


def test_many_missed_figures_still_are_one_line(run: Run, suite: Callable[..., list[Candidate]], good: SuiteResult) -> None:
    suite(replace(good, tested="passive").with_outside(whole.Outside()))
    answer = run("sil", "--suite", "tracking", "--json")
    assert answer.code == 1
    assert json.loads(answer.out)["passed"] is False
    (line,) = answer.err.splitlines()
    assert " more; see the first table" in line
    assert "…" not in line


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--suite", "trakking"), "did you mean 'tracking'"),
        (("--suite", "tracking", "--scenario", "step-steer"), "--scenario: it is about one scenario"),
        (("--suite", "tracking", "--csv", "run.csv"), "--csv"),
        (("--suite", "tracking", "--map", "x.npz"), "--map"),
        (("--suite", "tracking", "--can"), "--can"),
        (("--suite", "tracking", "--sensors"), "--sensors"),
        (("--suite", "tracking", "--seed", "1"), "--seed"),
        (("--suite", "tracking", "--baselines"), "--baselines"),
        (("--suite", "tracking", "--plot", "overview.pdf"), "overview.png"),
        (("--suite", "tracking", "--build", "nowhere"), "nowhere"),
        (("-o", "pictures", "--build", "nowhere"), "--plot"),
        ((), "codegen build"),
    ],
)
def test_what_cannot_be_is_one_line(refused: Callable[..., str], arguments: tuple[str, ...], words: str) -> None:
    assert words in refused("sil", *arguments)


def test_baselines_stand_beside_a_scenario(run: Run, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    answer = run("sil", "--build", folder, "--baselines", "--plot", "run.png", "--csv", "run.csv")
    assert answer.code == 0, answer
    assert answer.out.splitlines()[1].split() == ["controlled", "tracking", "feedforward", "proportional", "passive"]
    alone = run("sil", "--build", folder, "--csv", "alone.csv")
    assert Path("run.csv").read_bytes() == Path("alone.csv").read_bytes()
    metrics = json.loads(run("sil", "--build", folder, "--baselines", "--json").out)["metrics"]
    assert metrics["controlled"] == json.loads(run("sil", "--build", folder, "--json").out)["metrics"]["controlled"]
    assert metrics["tracking"]["overshoot_percent"] < 2.0 < metrics["controlled"]["overshoot_percent"]
    assert Path("run.png").read_bytes().startswith(b"\x89PNG")
    assert "controlled" in alone.out


def test_baselines_go_through_frames_as_well(run: Run, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The quantisation of the frames is in their figures too."""
    monkeypatch.chdir(tmp_path)
    command = ("sil", "--build", folder, "--baselines", "--json")
    direct, framed = (json.loads(run(*command, *more).out)["metrics"]["feedforward"] for more in ((), ("--can",)))
    assert framed != direct
    assert framed["yaw_rate_steady_deg_s"] == pytest.approx(direct["yaw_rate_steady_deg_s"], rel=1e-2)


def test_a_baseline_that_cannot_be_tuned_is_noted(run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from codegen.errors import ConfigError

    def refuse(*given: Any) -> Any:
        raise ConfigError("no gains meet the demands", where="[tuning]")

    monkeypatch.setattr(candidate, "tuned", refuse)
    answer = run("sil", "--build", folder, "--baselines")
    assert answer.code == 0, answer
    assert "note: tracking is not shown beside: [tuning]: no gains meet the demands" in answer.err
