"""`codegen solve --friction` and what `codegen show` tells of a stack."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from codegen import config as configuration
from codegen.refmap import map as npz
from codegen.refmap.solve import solve_case

from .conftest import Run

Refused = Callable[..., str]


@pytest.fixture
def config_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An ars.toml with a grid of 6 by 5 cells and a case that is passively safe, in the current folder."""
    text = configuration.preset_text().replace("speed_points = 101", "speed_points = 6")
    text = text.replace("front_angle_points = 100", "front_angle_points = 5")
    text = text.replace("[grid]", "[cases.safe]\npassive_safe = true\n\n[grid]", 1)
    monkeypatch.chdir(tmp_path)
    path = Path("ars.toml")
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("method", ["exact", "ipopt"])
@pytest.mark.parametrize("case", ["fws", "4ws-1", "4ws-2", "safe"])
def test_stack_of_any_case_by_both_methods(run: Run, config_path: Path, case: str, method: str) -> None:
    options = ("--config", config_path, "--case", case, "--method", method)
    answer = run("solve", *options, "--friction", "0.5,0.9", "-o", "stack.npz")
    assert answer.code == 0, answer
    assert answer.out.startswith(f"stack.npz: case {case}, 6 speeds x 5 front angles")
    assert answer.out.rstrip().endswith("; a stack with friction 0.5")
    assert (f"solving {case} for 2 frictions: 100 %" in answer.err.splitlines()) == (method == "ipopt")
    assert run("solve", *options, "-o", "alone.npz").code == 0
    stacked, alone = npz.load(Path("stack.npz")), npz.load(Path("alone.npz"))
    np.testing.assert_array_equal(stacked.yaw_rate, alone.yaw_rate)
    assert [layer.friction for layer in stacked.layers] == [0.5]
    assert stacked.layers[0].map.config is not None
    expected = solve_case(stacked.layers[0].map.config, case, "ipopt" if method == "ipopt" else "exact")
    np.testing.assert_array_equal(stacked.layers[0].map.yaw_rate, expected.yaw_rate)


def test_show_prints_the_stack(run: Run, config_path: Path) -> None:
    solved = run("solve", "--config", config_path, "--case", "4ws-2", "--friction", "0.9, 0.3,0.6", "-o", "stack.npz", "--json")
    assert solved.code == 0, solved
    shown = run("show", "stack.npz")
    reference_map = npz.load(Path("stack.npz"))
    rows = shown.out.split("\nfriction")[1].splitlines()[2:]
    cells = [int(layer.map.feasible.sum()) for layer in reference_map.layers] + [int(reference_map.feasible.sum())]
    names = ["0.3", "0.6", "0.9 (the map itself)"]
    assert [row.split("  ")[0] for row in rows] == names
    assert [int(row.removeprefix(name).split()[0]) for row, name in zip(rows, names, strict=True)] == cells
    told = [json.loads(solved.out), json.loads(run("show", "stack.npz", "--json").out)]
    for data in told:
        assert data["friction"] == 0.9
        assert [(layer["friction"], layer["feasible_cells"]) for layer in data["stack"]] == [(0.3, cells[0]), (0.6, cells[1])]


def test_show_of_a_map_without_a_stack_has_none(run: Run, config_path: Path) -> None:
    assert run("solve", "--config", config_path, "--case", "4ws-2", "-o", "alone.npz").code == 0
    shown = run("show", "alone.npz")
    assert "stack" not in shown.out
    assert "friction" not in shown.out
    assert json.loads(run("show", "alone.npz", "--json").out)["stack"] == []


def test_plot_of_a_stack_is_that_of_its_map(run: Run, config_path: Path) -> None:
    for name, options in (("stack", ("--friction", "0.5,0.9")), ("alone", ())):
        Path(name).mkdir()
        run("solve", "--config", config_path, "--case", "4ws-2", *options, "-o", f"{name}/4ws2.npz")
        run("show", f"{name}/4ws2.npz", "--plot", f"{name}.png")
    assert Path("stack.png").read_bytes() == Path("alone.png").read_bytes()


@pytest.mark.parametrize(
    ("text", "fault", "remedy"),
    [
        ("", "no friction, where two or more make a stack", "leave --friction out"),
        (" ", "no friction, where two or more make a stack", "leave --friction out"),
        (",", "a number is missing", "such as 0.5,0.9"),
        ("0.3,,0.9", "a number is missing", "such as 0.5,0.9"),
        ("0.3,0.9,", "a number is missing", "such as 0.5,0.9"),
        ("wet,0.9", "'wet' is no number", "such as 0.5,0.9"),
        ("0.3;0.9", "'0.3;0.9' is no number", "such as 0.5,0.9"),
        ("0.3\n\x1b[31m,0.9\x1b", "is no number", "such as 0.5,0.9"),
        ("0.9", "1 friction, where two or more make a stack", "such as 0.5,0.9"),
        ("0.3", "1 friction, where two or more make a stack", "such as 0.5,0.9"),
        ("-0.3,0.9", "-0.3 is outside 0.05 to 1.5", "peak friction"),
        ("30,90", "30 is outside 0.05 to 1.5", "peak friction"),
        ("nan,0.9", "nan is outside", "peak friction"),
        ("0.3,1e400", "inf is outside", "peak friction"),
        ("0.3,0.5,0.3,0.9", "0.3 is there twice", "0.01 or more between two"),
        ("0.895,0.9", "too close together", "0.01 or more between two"),
        ("0.3,0.5", "the largest friction, 0.5, is not the one that the map itself is for", "set road.friction to 0.5"),
        ("0.3,0.9,1.2", "the largest friction, 1.2, is not", "or let the list end with 0.9"),
    ],
)
def test_bad_lists(refused: Refused, config_path: Path, text: str, fault: str, remedy: str) -> None:
    line = refused("solve", "--config", config_path, "--case", "4ws-2", f"--friction={text}", "-o", "map.npz")
    assert "--friction: " in line
    assert fault in line
    assert remedy in line
    assert "\x1b" not in line


def test_friction_without_a_list(refused: Refused, config_path: Path) -> None:
    assert "--friction" in refused("solve", "--config", config_path, "--case", "4ws-2", "-o", "map.npz", "--friction")


def test_layer_without_a_feasible_cell_names_its_friction(refused: Refused, config_path: Path) -> None:
    text = config_path.read_text().replace("front_angle_min_deg = 0.1", "front_angle_min_deg = 6.0")
    config_path.write_text(text.replace("speed_min_km_h = 20.0", "speed_min_km_h = 40.0"))
    line = refused("solve", "--config", config_path, "--case", "4ws-2", "--friction", "0.1,0.9", "-o", "map.npz")
    assert "ars.toml: friction 0.1: [cases.4ws-2]: no operating point of the grid is feasible" in line
    assert "or leave this friction out" in line


def test_half_a_stack_in_a_file(refused: Refused, run: Run, config_path: Path) -> None:
    run("solve", "--config", config_path, "--case", "4ws-2", "--friction", "0.5,0.9", "-o", "stack.npz")
    with np.load("stack.npz") as file:
        arrays = {key: file[key] for key in file.files if key != "friction_delta_r"}
    np.savez("half.npz", **arrays)
    for command in (("show",), ("build", "--map")):
        assert "half.npz: friction_delta_r: this key is missing" in refused(*command, "half.npz")
