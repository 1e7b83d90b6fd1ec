"""The tyre of the optimisation: named wherever a map is told of, and the same in all that a report draws beside the map."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from codegen.config import Config
from codegen.refmap import map as npz
from codegen.report.html.blocks import Chart, Gallery, Text
from codegen.report.html.compare import comparison
from codegen.report.html.curves import front_angle_chart
from codegen.report.html.gather import Request, gather, read
from codegen.report.html.maps import cuts
from codegen.report.html.report import sections
from tests.cli.conftest import Run

SMALL = '[grid]\nspeed_points = 11\nfront_angle_min_deg = 0.5\nfront_angle_points = 10\n[controller]\nkind = "pi"\n'
CASE = "\n[cases.4ws-2]\nrear_steering = true\nsideslip_weight_per_s2 = 3000.0\n"
NONLINEAR = 'tyre_model = "magic-formula"\n'
LINE = "tyre of the optimisation: "


@pytest.fixture
def maps(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Path]:
    """linear.npz and nonlinear.npz of a small grid, in the current folder; in the latter's file another case is linear."""
    monkeypatch.chdir(tmp_path)
    for name, tyre in (("linear", ""), ("nonlinear", NONLINEAR)):
        Path(f"{name}.toml").write_text(f"{SMALL}{CASE}{tyre}\n[cases.fws]\nrear_steering = false\n", encoding="utf-8")
        assert run("solve", "--config", f"{name}.toml", "--case", "4ws-2", "-o", f"{name}.npz").code == 0
    return {name: Path(f"{name}.npz") for name in ("linear", "nonlinear")}


@pytest.mark.parametrize(("name", "tyre"), [("linear", "linear"), ("nonlinear", "magic-formula")])
def test_show_names_it(run: Run, maps: dict[str, Path], name: str, tyre: str) -> None:
    assert run("show", maps[name]).out.splitlines()[1] == f"{LINE}{tyre}"
    assert json.loads(run("show", maps[name], "--json").out)["tyre_model"] == tyre


def test_a_bare_map_does_not_tell(run: Run, maps: dict[str, Path]) -> None:
    np.savez("bare.npz", vx=[5.0, 10.0], delta_f=[0.02, 0.04], yaw_rate=[[0.1, 0.2], [0.1, 0.3]])
    assert LINE not in run("show", "bare.npz").out
    assert json.loads(run("show", "bare.npz", "--json").out)["tyre_model"] is None


def test_a_readme_names_it_where_it_is_not_linear(run: Run, maps: dict[str, Path]) -> None:
    for name, path in maps.items():
        assert run("build", "--map", path, "-o", name).code == 0
    row = "| tyre of the optimisation | magic-formula |\n"
    readmes = {name: Path(name, "README.md").read_text(encoding="utf-8") for name in maps}
    assert (row in readmes["nonlinear"], "tyre of the opt" in readmes["linear"]) == (True, False)


def summary_of(path: Path) -> list[str]:
    return [block.text for block in blocks_of(path)["summary"] if isinstance(block, Text)]


def blocks_of(path: Path) -> dict[str, list[object]]:
    material = gather(read(Request(path)), lambda done, total: None)
    return {section.name: list(section.blocks) for section in sections(material)}


def test_the_report_compares_with_the_same_tyre_and_says_so(maps: dict[str, Path]) -> None:
    found = blocks_of(maps["nonlinear"])
    assert f"{LINE.capitalize()}magic-formula." in summary_of(maps["nonlinear"])
    told, charts = found["compared"][:2]
    assert isinstance(told, Text)
    assert isinstance(charts, Gallery)
    assert told.text.endswith("; tyre of the optimisation of both: magic-formula.")
    assert "FWS (magic-formula)" in charts.charts[1].caption
    (cut,) = (block for block in found["optimum"] if isinstance(block, Chart) and block.name == "front-angle-cut")
    names = {line["name"] for line in cut.figure["data"]}
    assert {"FWS (magic-formula)", "4WS-2 (magic-formula)"} <= names
    assert all(name.endswith(" (magic-formula)") for name in names)


def test_the_report_of_a_linear_map_says_no_more_than_that(maps: dict[str, Path]) -> None:
    found = blocks_of(maps["linear"])
    assert f"{LINE.capitalize()}linear." in summary_of(maps["linear"])
    assert not any("magic-formula" in repr(block) for name in ("compared", "optimum") for block in found[name])


def test_maps_of_different_tyres_are_named_apart(maps: dict[str, Path]) -> None:
    found = gather(read(Request(maps["nonlinear"], compare=(maps["linear"],))), lambda done, total: None)
    told = next(section for section in sections(found) if section.name == "compared").blocks[0]
    assert isinstance(told, Text)
    assert told.text.endswith("; tyre of the optimisation: magic-formula of nonlinear, linear of linear.")
    captions = [chart.caption for chart in comparison(found.map, found.others[0]).charts]
    assert captions[:2] == ["Yaw rate: nonlinear (magic-formula).", "Yaw rate: linear."]
    assert [one["name"] for one in cuts([found.map, *found.others]).data["maps"]] == ["nonlinear (magic-formula)", "linear"]


def test_a_case_that_differs_by_its_tyre_alone_is_drawn_once(maps: dict[str, Path]) -> None:
    config = npz.load(maps["linear"]).config
    assert isinstance(config, Config)
    twin = config.cases["4ws-2"].model_copy(update={"tyre_model": "magic-formula"})
    both = config.model_copy(update={"cases": {"fws": config.cases["fws"], "4ws-2": config.cases["4ws-2"], "twin": twin}})

    def drawn(tyre: str | None, own: str) -> list[str]:
        chart = front_angle_chart(both.with_tyre_model(tyre), 4.0, paper=False, own=own)
        return [line["name"] for line in chart.figure["data"] if line["yaxis"] == "y"]

    assert drawn(None, "4ws-2") == ["FWS", "4WS-2", "TWIN (magic-formula)"]
    assert drawn("linear", "4ws-2") == ["FWS", "4WS-2"]
    assert drawn("magic-formula", "twin") == ["FWS (magic-formula)", "TWIN (magic-formula)"]
