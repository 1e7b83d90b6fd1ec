"""`codegen tune`: a map in, the same map with a controller out; one line where that cannot be."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from codegen import config as configuration
from codegen.config import Config, parse
from codegen.design.margins import gains_of, weakest
from codegen.refmap import map as npz
from codegen.refmap.solve import solve_case

from .conftest import Run, everything_in

Refused = Callable[..., str]

# Nine cars and four speeds up to the grid's last: a design in well under a second.
TUNING = """
[tuning]
actuator_lag_s = [0.05]
mass_percent = [0.0]
stiffness_percent = [-20.0, 15.0]
relaxation_length_m = [0.0, 0.6]
speed_km_h = [15.0, 42.5, 80.0, 120.0]
"""


def write_config(folder: Path, *changes: tuple[str, str], name: str = "ars.toml", tuning: str = TUNING) -> Path:
    text = configuration.preset_text() + tuning
    for old, new in (
        ("speed_points = 101", "speed_points = 11"),
        ("front_angle_points = 100", "front_angle_points = 10"),
        *changes,
    ):
        assert old in text
        text = text.replace(old, new, 1)
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def config_path(tmp_path: Path) -> Path:
    return write_config(tmp_path)


@pytest.fixture
def solved(tmp_path: Path, config_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A small solved map in the current folder, with the paper's PI."""
    monkeypatch.chdir(tmp_path)
    path = Path("map.npz")
    npz.save(solve_case(configuration.load(config_path), "4ws-2"), path)
    return path


NONLINEAR = '\n[cases.nonlinear]\nrear_steering = true\nsideslip_weight_per_s2 = 3000.0\ntyre_model = "magic-formula"\n'
FINER = (("speed_points = 11", "speed_points = 31"), ("front_angle_points = 10", "front_angle_points = 41"))


@pytest.mark.parametrize(("written", "raised"), [("", True), ("trim_max_percent = 15.0", False)])
def test_the_trim_is_what_a_map_of_the_nonlinear_tyre_needs(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: str, raised: bool
) -> None:
    monkeypatch.chdir(tmp_path)
    tuning = TUNING + NONLINEAR + (f"[controller.tracking]\n{written}\n" if written else "")
    npz.save(solve_case(configuration.load(write_config(tmp_path, *FINER, tuning=tuning)), "nonlinear"), Path("map.npz"))
    answer = run("tune", "--map", "map.npz", "-o", "map.npz")
    assert answer.code == 0, answer
    trim = stored(Path("map.npz")).controller.tracking.trim_max_percent
    if not raised:
        assert trim == 15.0 and "trim_max_percent" not in answer.out
        return
    assert trim > 1.0 and trim == int(trim)
    assert f"controller.tracking.trim_max_percent: {trim:g} instead of 1; " in answer.out
    again = json.loads(run("tune", "--map", "map.npz", "-o", "map.npz", "--json").out)
    assert "trim_max_percent" not in again  # it is enough now
    build = run("build", "--map", "map.npz", "-o", "x")
    assert build.code == 0 and "slip bounds" not in build.err


def test_a_grid_too_coarse_for_any_trim_is_told(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = write_config(tmp_path, tuning=TUNING + NONLINEAR)
    npz.save(solve_case(configuration.load(path), "nonlinear"), Path("map.npz"))
    for changed in ("20 instead of 1", "20"):  # the second time it stays
        answer = run("tune", "--map", "map.npz", "-o", "map.npz")
        assert answer.code == 0, answer
        assert f"controller.tracking.trim_max_percent: {changed}, the largest, and not enough: " in answer.out
        assert "a finer [grid]" in answer.out.splitlines()[-1]
    assert stored(Path("map.npz")).controller.tracking.trim_max_percent == 20.0
    told = run("build", "--map", "map.npz", "-o", "x").err
    assert "no trim takes back so much, and a finer [grid]" in told and "keeps them" not in told


@pytest.fixture
def bare(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's own table: no configuration in it."""
    monkeypatch.chdir(tmp_path)
    speed, angle = np.array([5.0, 15.0, 30.0]), np.array([0.02, 0.05, 0.1])
    np.savez("bare.npz", vx=speed, delta_f=angle, yaw_rate=np.minimum(np.outer(speed / 3.2, angle), 5.0 / speed[:, np.newaxis]))
    return Path("bare.npz")


def stored(path: Path) -> Config:
    config = npz.load(path).config
    assert config is not None
    return config


def test_the_map_comes_back_with_gains_and_nothing_else_changed(run: Run, solved: Path) -> None:
    before = npz.load(solved)
    answer = run("tune", "--map", solved, "-o", "tuned.npz")
    assert answer.code == 0, answer
    after = npz.load(Path("tuned.npz"))
    for key in ("speed", "front_angle", "yaw_rate", "feasible", "sideslip", "rear_angle", "active"):
        np.testing.assert_array_equal(getattr(before, key), getattr(after, key))
    assert before.config is not None
    assert after.config is not None
    assert after.case == "4ws-2"
    assert {key: value for key, value in after.meta.items() if key != "configuration"} == {
        key: value for key, value in before.meta.items() if key != "configuration"
    }
    controller = after.config.controller
    assert controller.kind == "tracking"
    schedule = controller.tracking.schedule
    assert schedule is not None
    assert weakest(after.config, gains_of(schedule)).enough
    # Taken out again, the controller is what it was.
    untuned = controller.tracking.model_copy(update={"schedule": None})
    was = controller.model_copy(update={"kind": "pi", "tracking": untuned})
    assert after.config.model_copy(update={"controller": was}) == before.config


def test_the_table_shows_what_is_stored(run: Run, solved: Path) -> None:
    answer = run("tune", "--map", solved, "-o", "tuned.npz")
    schedule = stored(Path("tuned.npz")).controller.tracking.schedule
    assert schedule is not None
    lines = answer.out.splitlines()
    assert lines[0] == (
        "tuned.npz: 9 cars, delay of 1 samples; asked for: at least 8 dB, 45 deg, and a peak sensitivity of at most 1.8"
    )
    rows = [line.split() for line in lines[4:-1]]
    assert len(rows) == len(schedule.speed_km_h)
    for k, row in enumerate(rows):
        assert float(row[0]) == schedule.speed_km_h[k]
        assert float(row[1]) == schedule.proportional_gain_s[k]
        assert float(row[2]) == schedule.integral_gain[k]
        assert float(row[3]) == schedule.gain_margin_db[k]
        assert float(row[4]) == schedule.phase_margin_deg[k]
        assert float(row[5]) == schedule.sensitivity[k]
        assert " ".join(row[7:]).startswith("lag 50 ms")
    assert lines[-1].startswith("the configured car: at least ")


def test_the_output_may_be_the_map_itself_and_a_second_run_changes_nothing(run: Run, solved: Path) -> None:
    assert run("tune", "--map", solved, "-o", solved).code == 0
    first = solved.read_bytes()
    assert stored(solved).controller.kind == "tracking"
    assert run("tune", "--map", solved, "-o", solved).code == 0
    assert solved.read_bytes() == first


def test_the_result_as_json(run: Run, solved: Path) -> None:
    answer = run("tune", "--map", solved, "-o", "tuned.npz", "--json")
    result = json.loads(answer.out)
    assert result["map"] == "tuned.npz"
    assert result["configuration"] == "map"
    assert result["demands"] == {"gain_margin_db": 8.0, "phase_margin_deg": 45.0, "sensitivity_max": 1.8}
    assert result["family"] == 9
    assert result["configured_car"]["enough"] is True
    schedule = stored(Path("tuned.npz")).controller.tracking.schedule
    assert schedule is not None
    assert [row["integral_gain"] for row in result["breakpoints"]] == schedule.integral_gain
    assert {row["cars"] for row in result["breakpoints"][:4]} == {9}
    assert result["breakpoints"][0]["limiting"].keys() == {
        "actuator_lag",
        "mass_factor",
        "front_stiffness_factor",
        "rear_stiffness_factor",
        "relaxation_length",
    }


def test_a_given_configuration_counts_and_is_stored(run: Run, solved: Path, tmp_path: Path) -> None:
    other = write_config(
        tmp_path, ("[controller.inputs]\nspeed_max_km_h = 400.0", "[controller.inputs]\nspeed_max_km_h = 150.0")
    )
    answer = run("tune", "--map", solved, "--config", other, "-o", "tuned.npz", "--json")
    assert answer.code == 0, answer
    assert json.loads(answer.out)["configuration"] == "ars.toml"
    config = stored(Path("tuned.npz"))
    assert config.controller.inputs.speed_max_km_h == 150.0
    assert config.controller.tracking.schedule is not None
    assert config.controller.tracking.schedule.speed_km_h[-1] == 150.0


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        ("mass_kg = 2335.07", "mass_kg = 2000.0", "[vehicle]"),
        ("sideslip_max_deg = 3.0", "sideslip_max_deg = 2.0", "[limits]"),
        ("speed_max_km_h = 120.0", "speed_max_km_h = 130.0", "[grid]"),
        ("[cases.4ws-2]\nrear_steering = true\nsideslip_weight_per_s2 = 3000.0",
         "[cases.4ws-2]\nrear_steering = true\nsideslip_weight_per_s2 = 2000.0", "[cases.4ws-2]"),
    ],
)  # fmt: skip
def test_a_configuration_that_the_map_was_not_solved_with_is_refused(
    refused: Refused, solved: Path, tmp_path: Path, old: str, new: str, named: str
) -> None:
    other = write_config(tmp_path, (old, new), name="other.toml")
    line = refused("tune", "--map", solved, "--config", other, "-o", "tuned.npz")
    assert f"other.toml: {named} differ" in line
    assert "solve the map again" in line


def test_a_configuration_without_the_maps_case_is_refused(refused: Refused, solved: Path, tmp_path: Path) -> None:
    other = write_config(tmp_path, ("[cases.4ws-2]", "[cases.mine]"), name="other.toml")
    line = refused("tune", "--map", solved, "--config", other, "-o", "tuned.npz")
    assert "there is no case '4ws-2'" in line


def test_a_bare_map_needs_a_configuration(refused: Refused, bare: Path) -> None:
    line = refused("tune", "--map", bare, "-o", "tuned.npz")
    assert "bare.npz: it brings no configuration" in line
    assert "--config ars.toml" in line


def test_a_bare_map_takes_the_given_configuration(run: Run, bare: Path, tmp_path: Path) -> None:
    before = npz.load(bare)
    answer = run("tune", "--map", bare, "--config", write_config(tmp_path), "-o", "tuned.npz")
    assert answer.code == 0, answer
    after = npz.load(Path("tuned.npz"))
    np.testing.assert_array_equal(before.yaw_rate, after.yaw_rate)
    assert after.case is None
    assert after.config is not None
    assert after.config.controller.kind == "tracking"


def test_demands_that_cannot_be_met_leave_the_map_alone(run: Run, solved: Path, tmp_path: Path) -> None:
    wide = write_config(tmp_path, name="wide.toml", tuning=TUNING.replace("[-20.0, 15.0]", "[-50.0, 50.0]"))
    before = everything_in(tmp_path)
    answer = run("tune", "--map", solved, "--config", wide, "-o", solved)
    assert (answer.code, answer.out) == (2, "")
    *progress, line = answer.err.splitlines()
    assert all(told.startswith("tuning: ") for told in progress)
    assert line.startswith(f"error: {wide}: [tuning]: no gains meet the demands at 120 km/h")
    assert "narrow the family" in line
    assert everything_in(tmp_path) == before


@pytest.mark.parametrize("output", ["tuned.txt", "nowhere/tuned.npz", "ars.toml"])
def test_an_output_that_would_destroy_something_is_refused(
    refused: Refused, solved: Path, config_path: Path, output: str
) -> None:
    refused("tune", "--map", solved, "--config", config_path, "-o", output)


def test_the_stored_configuration_survives_the_round_trip(run: Run, solved: Path) -> None:
    run("tune", "--map", solved, "-o", "tuned.npz")
    config = stored(Path("tuned.npz"))
    assert parse(config.model_dump(mode="json"), "again") == config
    assert npz.to_bytes(npz.load(Path("tuned.npz"))) == Path("tuned.npz").read_bytes()
