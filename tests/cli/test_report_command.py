"""`codegen report`: the page that it writes, and its notes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np

from codegen import config as configuration

from .conftest import BUILD, MAP, TRACKING, Refused, Run, edit

ALONE = ("--no-simulation",)
"""Leave out the runs, so that nothing is compiled."""


def test_a_build_is_driven_and_its_faults_tried(run: Run, here: Path) -> None:
    answer = run("report", "--map", MAP, "--build", BUILD, "-o", "report.html", "--json")
    assert answer.code == 0, answer
    data = json.loads(answer.out)
    assert data["notes"] == []
    assert data["bytes"] == Path("report.html").stat().st_size
    assert {"runs", "margins", "map-loss", "compare-difference-1"} <= set(data["charts"])
    text = Path("report.html").read_text(encoding="utf-8")
    for run_name in ("pi", "tracking", "passive car"):
        assert f'<th scope="col" class="number">{run_name}</th>' in text
    assert "4 samples lost: one too many" in text


def test_a_map_with_a_run_or_alone(run: Run, refused: Refused, here: Path) -> None:
    answer = run("report", "--map", MAP, "-o", "report.html")
    assert answer.code == 0, answer
    assert answer.out.startswith("report.html: 12 sections, ")
    assert Path("report.html").read_text(encoding="utf-8").count("name a build with <code>--build</code>") == 2
    assert run("sil", "--build", BUILD, "--csv", "mine.csv").code == 0
    files = ("--run", "one=mine.csv", "--run", "two=mine.csv", "--scenario", "step-steer")
    assert run("report", "--map", MAP, "--build", BUILD, *files, *ALONE, "-o", "report.html").code == 0
    names = '<th scope="col" class="number">one</th><th scope="col" class="number">two</th>'
    assert names in Path("report.html").read_text(encoding="utf-8")
    rows = Path("mine.csv").read_text(encoding="ascii").splitlines()
    Path("short.csv").write_text("\n".join(rows[:701]) + "\n", encoding="ascii")
    line = refused("report", "--map", MAP, "--run", "short.csv", "--scenario", "step-steer", "-o", "r.html")
    assert "short.csv: it ends at 6.99 s" in line


def test_cars_and_maps_that_differ(run: Run, here: Path) -> None:
    answer = run("report", "--map", TRACKING.with_suffix(".npz"), "--build", BUILD, *ALONE, "-o", "report.html")
    assert answer.code == 0
    assert "was built from another map" in answer.err
    np.savez("own.npz", vx=[10.0, 20.0], delta_f=[0.02, 0.04], yaw_rate=[[0.1, 0.2], [0.15, 0.25]])
    Path("ars.toml").write_text(configuration.preset_text(), encoding="utf-8")
    edit(Path("ars.toml"), ("mass_kg = 2335.07", "mass_kg = 1450.0"))
    # The car of a bare map is that of its build.
    assert run("build", "--map", "own.npz", "--config", "ars.toml", "-o", "b").code == 0
    answer = run("report", "--map", "own.npz", "--build", "b", *ALONE, "-o", "report.html")
    assert (answer.code, answer.err) == (0, "report: 10 %\nreport: 30 %\nreport: 100 %\n")
    assert "<td>1450 kg</td>" in Path("report.html").read_text(encoding="utf-8").replace('<td class="">', "<td>")
    shutil.copy(MAP, "own.npz")
    assert run("build", "--map", "own.npz", "--config", "ars.toml", "-o", "b").code == 0
    answer = run("report", "--map", "own.npz", "--build", "b", *ALONE, "-o", "report.html")
    assert "describes another car than the map was solved for" in answer.err
