"""`codegen report`: what it writes and tells, and what it refuses."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from .conftest import Run

GENERATED = Path(__file__).resolve().parents[2] / "generated"
MAP, BUILD = GENERATED / "4ws2.npz", GENERATED / "4ws2"
Refused = Callable[..., str]
ALONE = ("--no-simulation",)
"""So that nothing is compiled where it does not matter."""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_build_is_driven_and_its_faults_tried(run: Run, here: Path) -> None:
    answer = run("report", "--map", MAP, "--build", BUILD, "-o", "report.html", "--json")
    assert answer.code == 0, answer
    told = json.loads(answer.out)
    assert told["notes"] == []
    assert told["bytes"] == (here / "report.html").stat().st_size
    assert {"runs", "margins", "map-loss", "compare-difference-1"} <= set(told["charts"])
    text = (here / "report.html").read_text(encoding="utf-8")
    for run_name in ("pi", "tracking", "passive car"):
        assert f'<th scope="col" class="number">{run_name}</th>' in text
    assert "4 samples lost: one too many" in text


def test_a_map_alone_says_what_is_missing(run: Run, here: Path) -> None:
    answer = run("report", "--map", MAP, "-o", "report.html")
    assert answer.code == 0, answer
    text = (here / "report.html").read_text(encoding="utf-8")
    assert text.count("name a build with <code>--build</code>") == 2
    assert answer.out.startswith("report.html: 12 sections, ")


def test_runs_are_shown_under_their_names(run: Run, here: Path) -> None:
    assert run("sil", "--build", BUILD, "--csv", "mine.csv").code == 0
    files = ("--run", "one=mine.csv", "--run", "two=mine.csv", "--scenario", "step-steer")
    answer = run("report", "--map", MAP, "--build", BUILD, *files, *ALONE, "-o", "report.html")
    assert answer.code == 0, answer
    text = (here / "report.html").read_text(encoding="utf-8")
    assert '<th scope="col" class="number">one</th><th scope="col" class="number">two</th>' in text


def test_another_map_than_the_builds_is_told(run: Run, here: Path) -> None:
    answer = run("report", "--map", GENERATED / "4ws2-tracking.npz", "--build", BUILD, *ALONE, "-o", "report.html")
    assert answer.code == 0
    assert "was built from another map" in answer.err


def test_the_car_of_a_bare_map_is_that_of_its_build(run: Run, here: Path) -> None:
    import numpy as np

    np.savez("own.npz", vx=[10.0, 20.0], delta_f=[0.02, 0.04], yaw_rate=[[0.1, 0.2], [0.15, 0.25]])
    assert run("init", "car", "--preset", "paper").code == 0
    toml = Path("car/ars.toml")
    toml.write_text(toml.read_text(encoding="utf-8").replace("mass_kg = 2335.07", "mass_kg = 1450.0"), encoding="utf-8")
    assert run("build", "--map", "own.npz", "--config", toml, "-o", "b").code == 0
    answer = run("report", "--map", "own.npz", "--build", "b", *ALONE, "-o", "report.html")
    assert answer.code == 0, answer
    assert answer.err == "report: 10 %\nreport: 30 %\nreport: 100 %\n"
    assert "<td>1450 kg</td>" in Path("report.html").read_text(encoding="utf-8").replace('<td class="">', "<td>")


def test_another_car_than_the_maps_is_told(run: Run, here: Path) -> None:
    assert run("init", "car", "--preset", "paper").code == 0
    toml = Path("car/ars.toml")
    toml.write_text(toml.read_text(encoding="utf-8").replace("mass_kg = 2335.07", "mass_kg = 2300.0"), encoding="utf-8")
    assert run("build", "--map", MAP, "--config", toml, "-o", "b").code == 0
    answer = run("report", "--map", MAP, "--build", "b", *ALONE, "-o", "report.html")
    assert "describes another car than the map was solved for" in answer.err


def test_a_run_that_ends_before_the_step_is_refused(run: Run, refused: Refused, here: Path) -> None:
    assert run("sil", "--build", BUILD, "--csv", "mine.csv").code == 0
    rows = Path("mine.csv").read_text(encoding="ascii").splitlines()
    Path("short.csv").write_text("\n".join(rows[:701]) + "\n", encoding="ascii")
    files = ("--run", "short.csv", "--scenario", "step-steer")
    said = refused("report", "--map", MAP, *files, "-o", "r.html")
    assert "short.csv: it ends at 6.99 s" in said


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--map", "none.npz", "-o", "r.html"), "none.npz"),
        (("--map", MAP, "-o", "r.pdf"), "only .html is written"),
        (("--map", MAP, "-o", "no/r.html"), "its folder does not exist"),
        (("--map", MAP, "--build", "nowhere", "-o", "r.html"), "no generated folder"),
        (("--map", MAP, "--run", "none.csv", "-o", "r.html"), "there is no such file"),
        (("--map", MAP, "--compare", "none.npz", "-o", "r.html"), "none.npz"),
        (("--map", MAP, "--build", BUILD, "--scenario", "nosuch", "-o", "r.html"), "there is no scenario 'nosuch'"),
        (("--map", MAP, "-o", BUILD / "r.html"), "it lies inside a build"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(refused: Refused, options: tuple[object, ...], said: str) -> None:
    assert said in refused("report", *options)


def test_without_plotly_the_extra_is_named(refused: Refused, monkeypatch: pytest.MonkeyPatch) -> None:
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "plotly" else find(name, *more))
    monkeypatch.delitem(sys.modules, "plotly", raising=False)
    assert 'pip install "ars-codegen[report]"' in refused("report", "--map", MAP, "-o", "r.html")
