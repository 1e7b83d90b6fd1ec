"""`codegen tune`: adds a controller to a map."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from codegen import configuration
from codegen.configuration import Config
from codegen.design.lead import Response
from codegen.design.margins import gains_of, weakest
from codegen.ecu_map.model_excess import Excess
from codegen.judgement.build_warnings import excess_warning
from codegen.judgement.model import of_map
from codegen.library.tuning import _target_note, _trim_facts, _trim_text
from codegen.map_file import map as npz
from codegen.optimum.solve import solve_case

from .conftest import Answer, Run, edit, everything_in

# Nine cars and four speeds up to the end of the grid: designed in well under a second.
TUNING = """
[tuning]
actuator_lag_factor = [1.0]
mass_percent = [0.0]
stiffness_percent = [-20.0, 15.0]
relaxation_length_m = [0.0, 0.6]
speed_km_h = [15.0, 42.5, 80.0, 120.0]
"""
IDENTIFIED = """
[identified]
keys = ["rear_actuator.lag_s"]
standard_deviations = [0.001]
correlations = [[1.0]]
"""
NONLINEAR = '\n[cases.nonlinear]\nrear_steering = true\nsideslip_weight_per_s2 = 3000.0\ntyre_model = "magic-formula"\n'


def write_config(*changes: tuple[str, str], grid: tuple[int, int] = (11, 10), more: str = "") -> Path:
    """Write the paper's ars.toml with a small family of cars and a small grid to the current folder."""
    path = Path("ars.toml")
    text = configuration.preset_text().replace("[tuning]\nactuator_lag_s = [0.02, 0.05, 0.1]\n", TUNING)
    path.write_text(text + more, encoding="utf-8")
    points = (("speed_points = 101", f"speed_points = {grid[0]}"), ("angle_points = 100", f"angle_points = {grid[1]}"))
    return edit(path, *points, *changes)


def solve(config: Path, case: str = "4ws-2") -> Path:
    npz.save(solve_case(configuration.load(config), case), Path("map.npz"))
    return Path("map.npz")


@pytest.fixture
def solved(here: Path) -> Path:
    """Solve a small map in the current folder, with the paper's PI and a measured lag."""
    return solve(write_config(more=IDENTIFIED))


def stored(path: Path) -> Config:
    config = npz.load(path).config
    assert config is not None
    return config


def test_only_the_gains_of_the_map_change(run: Run, solved: Path) -> None:
    before = npz.load(solved)
    answer = run("tune", "--map", solved, "-o", "tuned.npz")
    assert answer.code == 0, answer
    after = npz.load(Path("tuned.npz"))
    for key in ("speed", "front_angle", "yaw_rate", "feasible", "sideslip", "rear_angle", "active"):
        np.testing.assert_array_equal(getattr(before, key), getattr(after, key))
    assert after.case == "4ws-2"
    added = {"configuration": "", "judgement": ""}
    assert after.meta | added == before.meta | added
    controller = after.config.controller
    assert controller.kind == "tracking"
    assert controller.tracking.schedule.lead_s and max(controller.tracking.schedule.response_gain_s) > 0.0
    # Two ends and the car, two stiffnesses of each axle, two relaxation lengths; and the configured stiffness.
    assert answer.out.startswith("tuned.npz: 25 cars, ")
    assert "\nfamily: rear_actuator.lag_s from [identified] (99 % of the cars); mass, stiffness, relaxation from" in answer.out
    assert "\n42.5 " in answer.out.partition("response gain s")[2]
    assert "\nThe design ends at 120 km/h. At higher speeds the C holds the last gains.\n" in answer.out
    assert "Up to the last speed of the grid" not in answer.out and controller.tracking.schedule.speed_km_h[-1] == 120.0
    assert weakest(after.config, gains_of(controller.tracking.schedule)).enough
    assert f"\ncontroller.fail_safe.rate_deg_s: {controller.fail_safe.rate_deg_s:g}" in answer.out
    assert_judged(run, after, answer)
    # Without the added keys, the controller is unchanged.
    before_tracking = before.config.controller.tracking
    was = {
        "kind": "pi",
        "fail_safe": before.config.controller.fail_safe,
        "tracking": controller.tracking.model_copy(
            update={"schedule": None, **{name: getattr(before_tracking, name) for name in ("lead_max_deg", "response_ahead_s")}}
        ),
    }
    assert after.config.model_copy(update={"controller": controller.model_copy(update=was)}) == before.config


def assert_judged(run: Run, tuned: npz.ReferenceMap, answer: Answer) -> None:
    """Check that the judgement is stored and printed, and that `check --drive` makes the same one."""
    found = of_map(tuned, stored(Path("tuned.npz"))).judgement
    assert found is not None and found.sentence in answer.out
    assert all(f"warning: {text}" in answer.err for text in found.warnings)
    before = everything_in(Path())
    shown, fresh = json.loads(run("show", "tuned.npz", "--json").out), run("check", "tuned.npz", "--drive", "--json")
    assert fresh.code == (1 if found.warnings else 0)
    assert json.loads(fresh.out)["judgement"] == shown["judgement"] == {"state": "current", **found.to_dict()}
    assert everything_in(Path()) == before
    built = run("build", "--map", "tuned.npz")
    assert all(f"warning: {text}" in built.err for text in found.warnings)
    assert run("build", "--map", "tuned.npz", "--check").code == 0
    assert json.loads(run("check", "generated/tuned", "--json").out)["judgement"] == shown["judgement"]


def test_a_missed_target_of_the_step_response_is_a_warning() -> None:
    met = Response(100.0, 0.05, 0.1, 1.3, 0.9, 0.3, 2.0)
    assert _target_note((met,)) == ""
    text = _target_note((met, Response(60.0, 0.05, 0.1, 4.8, 0.9, 0.3, 2.0)))
    assert text == (
        "the step responses miss their target of at most 3 % overshoot and 2 s settling time (60 km/h: 4.8 % and 0.90 s); "
        "up to 5 % and 2.5 s are acceptable"
    )
    barely = _target_note((Response(60.0, 0.05, 0.1, 3.0004, 2.003, 0.3, 2.0),))
    assert "(60 km/h: 3.0004 % and 2.003 s)" in barely and "exceeded" not in barely
    far = _target_note((Response(30.0, 0.05, 0.1, 5.04, 0.9, 0.3, 2.0), Response(60.0, 0.05, 0.1, 400.0, 0.9, 0.3, 2.0)))
    assert "30 km/h: 5.0 % and 0.90 s" in far and "60 km/h: 400.0 %" in far and far.endswith("exceeded at 30, 60 km/h")
    late = "(60 km/h: 0.8 % and 2.07 s)"
    assert late in _target_note((Response(60.0, 0.05, 0.1, 0.8, 2.07, 0.3, 2.0),))


def test_unmet_requirements_leave_the_map_unchanged(run: Run, solved: Path, here: Path) -> None:
    wide = write_config(("[-20.0, 15.0]", "[-50.0, 50.0]"))
    before = everything_in(here)
    answer = run("tune", "--map", solved, "--config", wide, "-o", solved)
    assert (answer.code, answer.out) == (2, "")
    *progress, line = answer.err.splitlines()
    assert all(data.startswith("tuning: ") for data in progress)
    assert line.startswith(f"error: {wide}: [tuning]: no gains meet the demands at 120 km/h")
    assert "narrow the family" in line
    assert everything_in(here) == before


def test_the_place_of_the_excess_has_its_longitudinal_acceleration() -> None:
    excess = Excess(0.0623, 32.5, 0.07, 0.9, -4.0)
    tuned: Any = SimpleNamespace(excess=excess, config=configuration.preset(), trim_is_enough=True)
    assert _trim_facts(tuned, 1.0) == {}
    text = _trim_text(_trim_facts(tuned, 0.5))
    assert "6.3 % more than this map allows (117 km/h, 4.0 deg, friction 0.9, longitudinal acceleration -4 m/s^2)" in text
    manifest = {
        "reference_model_excess": {
            "percent": 6.3,
            "at_km_h": 117.0,
            "at_front_angle_deg": 4.0,
            "at_friction": 0.9,
            "at_longitudinal_acceleration_m_s2": -4.0,
            "trim_max_percent": 1.0,
            "enough": False,
        }
    }
    assert "(117 km/h, 4.0 deg, friction 0.9, longitudinal acceleration -4 m/s^2)" in excess_warning(manifest)
