"""Controls and figures of the page compared with the project's functions and with a fresh build of the same settings."""

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from codegen.design.margins import family_margins, nominal_margins
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.laws import law_of
from codegen.explore.controls import STEP_SPEED, controls_of
from codegen.explore.explorer import Explorer, family_data, margin_data, opened
from codegen.map_file import map as npz
from codegen.map_file.bounds import Binding
from codegen.map_file.map import on_road
from codegen.optimum.solve import solve_acceleration_stack, solve_case
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.software import compile_build
from codegen.units import KM_H
from hil_sim.scenarios import SCENARIOS
from tests import builds
from tests.optimum.cars import PAPER, changed
from tests.report.figures import unpacked

TIGHT = {"limits.sideslip_max_deg": 0.5}


def test_the_map_equals_that_of_codegen_solve(pi: Explorer) -> None:
    moved = {"lambda": 150.0, "limits.sideslip_max_deg": 2.0}
    shown = pi.picture(moved)["map"]
    expected = solve_case(pi.configured(moved), pi.case)
    # Single precision of deg/s: 7 digits.
    np.testing.assert_allclose(unpacked(shown["yaw_rate"]), np.degrees(expected.yaw_rate).T, rtol=1e-6)
    np.testing.assert_allclose(unpacked(shown["rear_angle"]), np.degrees(expected.rear_angle).T, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(shown["speed_km_h"], expected.speed / KM_H, atol=1e-4)
    assert shown["feasible_percent"] == round(100.0 * expected.feasible.mean(), 1)


def test_binding_constraints_keep_name_and_colour(tracking: Explorer) -> None:
    first, later = (tracking.picture(moved)["map"] for moved in ({}, TIGHT))
    for key in ("binding_names", "binding_colours"):
        assert later[key][: len(first[key])] == first[key]
    for moved, shown in (({}, first), (TIGHT, later)):
        solved = solve_case(tracking.configured(moved), tracking.case)
        cells, names = unpacked(shown["binding"]).T, shown["binding_names"]
        np.testing.assert_array_equal(cells == 255, ~solved.feasible)
        alone = solved.feasible & (solved.active == Binding.SIDESLIP)
        assert alone.any() == bool(moved)
        if moved:
            np.testing.assert_array_equal(cells == names.index("sideslip"), alone)


PARTS = ("map", "cut", "step", "margins")


@pytest.mark.parametrize(
    ("key", "value", "parts"),
    [
        ("lambda", 100.0, {"map", "cut", "step"}),
        ("limits.sideslip_max_deg", 1.0, {"map", "cut"}),
        ("limits.lateral_acceleration_max_g", 0.3, {"map", "cut", "step"}),
        ("road.friction", 0.5, {"map", "cut", "step", "margins"}),
        ("controller.integral_gain", 0.4, {"step", "margins"}),
        ("step.speed_km_h", 70.0, {"cut", "step"}),
        ("step.road_percent", 60.0, {"step"}),
    ],
)
def test_each_setting_changes_only_its_parts(pi: Explorer, key: str, value: float, parts: set[str]) -> None:
    """The start values are shown next to the settings."""
    before, after = pi.picture({}), pi.picture({key: value})
    if not key.startswith("step."):
        assert after["step"]["runs"]["start"] == before["step"]["runs"]["now"]
        assert (after["cut"]["start"], after["margins"]["start"]) == (before["cut"]["now"], before["margins"]["now"])
    assert {part for part in PARTS if json.dumps(before[part]) != json.dumps(after[part])} == parts


def test_earlier_settings_leave_nothing_behind(pi: Explorer) -> None:
    """The first of two changes recomputes everything cached; the second reveals stale parts."""
    values = {"road.friction": (0.7, 0.5), "step.speed_km_h": (60.0, 80.0), "step.angle_deg": (60.0, 30.0)}
    values |= {"step.road_percent": (80.0, 60.0), "controller.integral_gain": (0.4, 0.2)}
    for key, (one, other) in values.items():
        before, after = pi.picture({key: one}), pi.picture({key: other})
        fresh = Explorer(pi.start, pi.case, "fresh").picture({key: other})
        assert [after[part] for part in PARTS[1:]] == [fresh[part] for part in PARTS[1:]], key
        assert before["step"] != after["step"]


def test_the_figures_of_the_step(pi: Explorer) -> None:
    shown = pi.picture({})["step"]["figures"]
    # The PI follows the cap of the map, (slip bound of the tyre / slip per m/s^2) / speed, to the end.
    cap = pi.calibration(pi.start).total.lateral_acceleration_cap / (42.5 * KM_H)
    # The integrator leaves an error of some 0.1 % after 3 s.
    assert np.radians(shown["now"]["yaw_rate_steady_deg_s"]) == pytest.approx(cap, rel=5e-3)
    assert shown["passive"]["rear_angle_peak_deg"] == 0.0
    assert shown["passive"]["sideslip_peak_deg"] > shown["now"]["sideslip_peak_deg"]


def test_a_step_that_spins_has_no_steady_figures(pi: Explorer) -> None:
    shown = pi.picture({"road.friction": 0.5, "step.speed_km_h": 70.0, "step.road_percent": 50.0})
    assert {"spins": True} in shown["step"]["figures"].values()
    json.dumps(shown, allow_nan=False)


def test_margins_are_those_of_the_design(tracking: Explorer) -> None:
    moved = {"proportional_percent": 130.0}
    shown, config = tracking.picture(moved)["margins"]["now"], tracking.configured(moved)
    gains = law_of(config).gains(config)
    speed = np.array(shown["speed_km_h"]) * KM_H
    expected = nominal_margins(config, speed, *gains(speed))
    # Speeds have two decimals of km/h, at least 1e-4 of a speed, and margins change by only a few percent for each percent.
    np.testing.assert_allclose(shown["gain_db"], expected.gain_margin_db, rtol=1e-3)
    np.testing.assert_allclose(shown["phase_deg"], expected.phase_margin_deg, rtol=1e-3)
    assert shown["worst"]["gain_db"] == pytest.approx(min(shown["gain_db"]), abs=0.01)
    assert (shown["asked_gain_db"], shown["asked_phase_deg"]) == (8.0, 45.0)


def test_the_margins_of_the_family_are_those_of_codegen_tune(tracking: Explorer) -> None:
    shown = tracking.family({}, lambda: False)
    gains = law_of(tracking.start).gains(tracking.start)
    speed = np.array(shown["speed_km_h"])[[0, -1]] * KM_H
    expected, _ = family_margins(tracking.start, speed, *gains(speed))
    np.testing.assert_allclose(np.array(shown["gain_db"])[[0, -1]], expected.gain_margin_db, rtol=1e-3)
    # The tuned gains meet the required margins up to the end of the map.
    assert min(shown["gain_db"]) >= 8.0
    assert min(shown["phase_deg"]) >= 45.0
    assert shown["cars"] == 243 + 1  # all combinations, and the configured car, whose relaxation length is none of theirs
    stale = iter((False, False, True))
    assert tracking.family({}, lambda: next(stale)) is None  # a newer request ends the work
    assert next(stale, None) is None


FRICTION = {"road.friction": 0.5, "limits.sideslip_max_deg": 1.5}
LIMITS = {"limits.rear_angle_max_deg": 2.0, "limits.lateral_acceleration_max_g": 0.5, "limits.yaw_gain_floor": 0.9}
TYRE = {"pi": {"limits.slip_departure_percent": 8.0}, "tracking": {"limits.grip_use_max": 0.9}}
"""Of both limits, only one acts, and only that one has a control."""
GAINS = {"pi": {"controller.integral_gain": 0.3}, "tracking": {"integral_percent": 40.0, "lead_percent": 150.0}}


@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_settings_run_like_a_fresh_build_bit_for_bit(kind: str, request: pytest.FixtureRequest) -> None:
    explorer: Explorer = request.getfixturevalue(kind)
    config = explorer.configured({"lambda": 200.0, **LIMITS, **TYRE[kind], **FRICTION, **GAINS[kind]})
    calibration = explorer.calibration(config)
    folder = build(solve_case(config, explorer.case), config, BuildOptions("fresh"), BuildInputs("map.npz", "0" * 64, "map"))
    fresh = ClosedLoop(compile_build(folder.files, folder.manifest))
    # The step stays within the map; the second scenario leaves it, on a road with less friction than the map's.
    for scenario in (SCENARIOS["step-steer"], SCENARIOS["low-friction"]):
        inputs = scenario.inputs(config)
        fresh.reset()
        expected = fresh.run(inputs)
        assert np.ptp(expected[:, 3]) > 0.1  # rad/s: the car turns
        np.testing.assert_array_equal(explorer.run(calibration, inputs), expected)


def test_threads_do_not_share_settings(pi: Explorer) -> None:
    inputs = SCENARIOS["step-steer"].inputs(pi.start)
    calibrations = [pi.calibration(pi.configured(moved)) for moved in ({}, FRICTION)]
    expected = [pi.run(calibration, inputs) for calibration in calibrations]
    assert not np.array_equal(*expected)
    with ThreadPoolExecutor(2) as pool:
        runs = list(pool.map(lambda k: pi.run(calibrations[k % 2], inputs), range(40)))
    assert all(np.array_equal(run, expected[k % 2]) for k, run in enumerate(runs))


def test_the_limit_of_the_tyre_that_does_not_act_has_no_control(pi: Explorer, tracking: Explorer) -> None:
    keys = {"limits.slip_departure_percent", "limits.grip_use_max"}
    for explorer, acting in ((pi, "limits.slip_departure_percent"), (tracking, "limits.grip_use_max")):
        assert keys & {control.key for control in explorer.controls} == {acting}
    (use,) = [control for control in tracking.controls if control.key == "limits.grip_use_max"]
    assert (use.value, use.bounds) == (0.98, (0.3, 0.995))
    floored = tracking.configured({"limits.yaw_gain_floor": 0.8, "limits.reference_characteristic_speed_km_h": 90.0})
    assert floored.limits.yaw_gain_floor == 0.8 and floored.limits.reference_characteristic_speed_km_h == 90.0


def test_each_setting_changes_only_its_key(pi: Explorer, tracking: Explorer) -> None:
    assert tracking.configured({control.key: control.value for control in tracking.controls}) is tracking.start
    data = pi.start.model_dump(mode="json")
    data["cases"]["4ws-2"]["sideslip_weight_per_s2"] = 100.0
    data["limits"]["rear_angle_max_deg"] = 2.0
    data["controller"]["integral_gain"] = 0.25
    found = pi.configured({"lambda": 100.0, "limits.rear_angle_max_deg": 2.0, "controller.integral_gain": 0.25})
    assert found.model_dump(mode="json") == data
    assert pi.configured({"road.friction": 0.5}) == on_road(pi.start, 0.5)  # the tyres are unchanged
    before = tracking.start.controller.tracking.schedule
    after = tracking.configured({"proportional_percent": 50.0}).controller.tracking.schedule
    assert before is not None and after is not None
    # Each product has six digits.
    assert after.proportional_gain_s == pytest.approx([0.5 * gain for gain in before.proportional_gain_s], rel=1e-5)
    assert after.integral_gain == before.integral_gain
    assert (before.gain_margin_db is None, after.gain_margin_db) == (False, None)  # the margins of other gains


def test_what_a_page_leaves_out_is_noted(tmp_path: Path) -> None:
    law = solve_acceleration_stack(changed(PAPER, grid={"speed_points": 6}), "zero-sideslip", (-4.0, 0.0))
    npz.save(law, tmp_path / "law.npz")
    moving, follows = opened(tmp_path / "law.npz").notes
    assert moving == "the maps for longitudinal accelerations are not used"
    assert follows == "the case follows a law for the rear angle, on which the sideslip weight has no effect"


@pytest.mark.parametrize(("top", "high", "family"), [(None, 120.0, 120.0), (180.0, 180.0, 120.0), (40.0, 40.0, 40.0)])
def test_the_sliders_and_curves_end_at_the_top_speed(top: float | None, high: float, family: float) -> None:
    config = builds.TRACKING_CONFIG.replace({"vehicle.top_speed_km_h": top})
    (speed,) = (each for each in controls_of(config, "4ws-2") if each.key == STEP_SPEED)
    assert speed.high == high and speed.value == min(42.5, high) and speed.bounds == (5.0, 400.0)
    alone, all_cars = margin_data(config), family_data(config, lambda: False)
    assert alone and all_cars
    assert (alone["speed_km_h"][-1], all_cars["speed_km_h"][-1]) == pytest.approx((high, family))
