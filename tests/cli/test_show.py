"""`codegen show`: one map, a stack, and two maps compared."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen import configuration
from codegen.library.quantities import MEMORY_KIND, YAW_RATE_KIND
from codegen.map_file import map as npz
from codegen.optimum.solve import solve_case
from tests import shared
from tests.whole_car import car_toml

from .conftest import Run

GRID = "[grid]\nspeed_points = 21\nfront_angle_min_deg = 0.5\nfront_angle_points = 20\n"
CASE = "[cases.4ws-2]\nrear_steering = true\nsideslip_weight_per_s2 = 3000.0\n"


@pytest.fixture
def maps(here: Path) -> dict[str, Path]:
    """Return linear.npz, and nonlinear.npz with the same tables but marked as solved with the other tyre."""
    text = car_toml(f'{GRID}[controller]\nkind = "pi"\n{CASE}\n[cases.fws]\nrear_steering = false\n')
    (here / "linear.toml").write_text(text)
    linear = shared.once("show", lambda: solve_case(configuration.load(here / "linear.toml"), "4ws-2"))
    config = linear.config.with_tyre_model("magic-formula")
    other = replace(linear, config=config, meta=npz.make_meta(config, "4ws-2", "exact"))
    npz.save(linear, Path("linear.npz"))
    npz.save(other, Path("nonlinear.npz"))
    return {name: Path(f"{name}.npz") for name in ("linear", "nonlinear")}


def test_maps_are_compared_in_the_width_of_a_terminal(run: Run, maps: dict[str, Path]) -> None:
    assert run("show", maps["nonlinear"]).out.splitlines()[1] == "tyre of the optimisation: magic-formula"
    assert run("build", "--map", maps["nonlinear"], "-o", "build").code == 0
    assert "| tyre of the optimisation | magic-formula |\n" in Path("build/README.md").read_text(encoding="utf-8")
    answer = run("show", maps["linear"], "--against", maps["nonlinear"], "--plot", "difference.png")
    assert (answer.code, answer.err) == (0, "")
    lines = answer.out.splitlines()
    assert (lines[:2], lines[-1]) == (["first:  linear.npz", "second: nonlinear.npz"], "plot: difference.png")
    assert max(len(line) for line in lines) <= 80
    rows = {line[:34].strip(): line[34:].split() for line in lines}
    assert rows["tyre of the optimisation"] == ["linear", "magic-formula"]
    for start in ("yaw rate, first less second  ", "60 km/h, 2.00 deg  "):
        assert any(line.startswith(start) for line in lines)
    assert Path("difference.png").read_bytes().startswith(b"\x89PNG")
    assert run("show", maps["linear"], "--plot", "map.svg").code == 0
    assert Path("map.svg").read_bytes().startswith(b"<?xml")
    Path("heavy.toml").write_text(car_toml(f"[vehicle]\nmass_kg = 2000.0\n{GRID}"), encoding="utf-8")
    assert run("solve", "--config", "heavy.toml", "--case", "4ws-2", "-o", "heavy.npz").code == 0
    assert "different cars" in run("show", maps["linear"], "--against", "heavy.npz").err
    data = json.loads(run("show", maps["linear"], "--against", "heavy.npz", "--json").out)
    assert (data["map"], data["against"], data["plot"]) == ("linear.npz", "heavy.npz", None)
    assert data["first"]["front_slip"]["largest_percent"] > 110.0


def test_a_stack(run: Run, here: Path) -> None:
    Path("ars.toml").write_text(car_toml(f"[grid]\nspeed_points = 6\nfront_angle_points = 5\n{CASE}"), encoding="utf-8")
    answer = run("solve", "--config", "ars.toml", "--case", "4ws-2", "--friction", "0.9, 0.5", "-o", "stack.npz")
    assert answer.code == 0, answer
    assert answer.out.startswith("stack.npz: case 4ws-2, 6 speeds x 5 front angles")
    assert answer.out.splitlines()[0].endswith("; a stack with friction 0.5")
    stacked = npz.load(Path("stack.npz"))
    (layer,) = stacked.layers
    for one in (stacked, layer.map):
        np.testing.assert_array_equal(one.yaw_rate, solve_case(one.config, "4ws-2").yaw_rate)
    rows = run("show", "stack.npz", "--plot", "stack.png").out.split("\nfriction")[1].splitlines()[2:4]
    assert [row.split("  ")[0] for row in rows] == ["0.5", "0.9 (the map itself)"]
    data = json.loads(run("show", "stack.npz", "--json").out)
    found = [(one["friction"], one["feasible_cells"]) for one in data["stack"]]
    assert (data["friction"], found) == (0.9, [(0.5, layer.map.feasible.sum())])


def test_quantities_are_read_with_their_unit() -> None:
    for written, value in {"0.05deg/s": math.radians(0.05), " 1e-3 rad/s": 1e-3}.items():
        assert YAW_RATE_KIND.read(written).value == pytest.approx(value, rel=1e-15)
    sizes = {"4KiB": 4096, "4096B": 4096, "4kB": 4000, "2MB": 2000000, "1MiB": 1048576, "0.5 KiB": 512}
    assert {written: MEMORY_KIND.read(written).value for written in sizes} == sizes
