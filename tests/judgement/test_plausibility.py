"""Warnings of `codegen check`: each input error from practice is found, and no plausible car is flagged."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from codegen.cli.check_commands import check
from codegen.configuration import Config, preset
from codegen.design.margins import Margins
from codegen.emit.from_files import prepare
from codegen.errors import CheckFailed, CodegenError
from codegen.judgement.build_warnings import family_warnings, margins_line, schedule_warnings
from codegen.judgement.car_warnings import Handling, car_warnings
from codegen.judgement.facts import Found, check_path
from codegen.judgement.map_warnings import MapFacts, axis_warnings, beyond_grip, map_warnings
from codegen.judgement.model import of_map
from codegen.map_file import map as npz
from codegen.optimum.solve import solve_case
from codegen.text import distinct
from hil_sim.suite.cars import TEST_SEED, random_cars
from tests.whole_car import car_toml

OLDER_LAGS = {"actuator_lag_s": [0.02, 0.05, 0.1], "actuator_lag_factor": None}
GENERATED = Path(__file__).resolve().parents[2] / "generated"
COARSE = {"grid": {"speed_points": 7, "front_angle_points": 8}}


def hatchback(**tables: Any) -> Config:
    """Return a front-heavy car of 1,450 kg with 60 kN/rad per tyre: 1.3 deg/g of understeer."""
    tyre = {"cornering_stiffness_n_per_rad": 60e3}
    vehicle = {"mass_kg": 1450.0, "yaw_inertia_kg_m2": 2300.0, "cg_height_m": 0.52, "track_m": 1.52}
    arms = {"cg_to_front_axle_m": 1.05, "cg_to_rear_axle_m": 1.55}
    own = {"vehicle": {**vehicle, **arms}, "tyre": {"front": tyre, "rear": tyre}}
    return preset("recommended").replace({**own, **COARSE}).replace(tables)


def check_plausible_car(number: int) -> None:
    """Check that a random car has no warning."""
    config = random_cars(TEST_SEED, number + 1)[number].replace(COARSE)
    reference_map = solve_case(config.with_tyre_model("magic-formula"), "4ws-2")
    assert (*car_warnings(config), *map_warnings(reference_map, config)) == ()


@pytest.mark.parametrize("number", range(10))
def test_a_plausible_car_has_no_warning(number: int) -> None:
    """tests/evidence/drives has more cars."""
    check_plausible_car(number)


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"limits": {"rear_angle_max_deg": 5.0}}, "limits.rear_angle_max_deg = 5 is above rear_actuator.angle_max_deg = 3.5"),
        ({"tyre": {"rear": {"cornering_stiffness_n_per_rad": 120e3}}}, "tyre.rear: 120000 N/rad .* Then halve it"),
        ({"tyre": {"front": {"cornering_stiffness_n_per_rad": 10e3}}}, "tyre.front: 10000 N/rad .* half of a tyre's"),
        (
            {"vehicle": {"yaw_inertia_kg_m2": 210.0}},
            r"vehicle.yaw_inertia_kg_m2 = 210 is 0\.089 times mass lf lr = 2360 kg m\^2; .* check its unit .* or take 2360",
        ),
        (
            {"tyre": {"front": {"cornering_stiffness_n_per_rad": 120e3}}},
            "tyre.front: the slip for each g .* Then halve it",
        ),
        (
            {"vehicle": {"cg_to_front_axle_m": 1.6, "cg_to_rear_axle_m": 1.0}},
            "tyre.front: the slip for each g .* are vehicle.cg_to_front_axle_m and cg_to_rear_axle_m exchanged",
        ),
        ({"vehicle": {"cg_height_m": 1.0}}, "rolls over before its tyres slide"),
        ({"rear_actuator": {"rate_max_deg_s": 20.0}}, "rear_rate_max_deg_s = 25 is above rear_actuator.rate_max_deg_s = 20"),
        (
            {"rear_actuator": {"lag_s": 0.2}, "tuning": OLDER_LAGS},
            r"rear_actuator.lag_s = 0.2 is outside the lags .*, 0.02 to 0.1 s \(tuning.actuator_lag_s\); replace that key by",
        ),
        (
            {"tuning": {"actuator_lag_factor": [2.0, 4.0]}},
            r"rear_actuator.lag_s = 0.05 is outside .* 0.1 to 0.2 s \(tuning.actuator_lag_factor\); include 1 there and run",
        ),
        (
            {"tyre": {"front": {"cornering_stiffness_n_per_rad": 140e3}}},
            "the car is unstable from 137 km/h without rear steering",
        ),
    ],
)
def test_a_mistake_in_the_configuration_is_found(tables: dict[str, Any], words: str) -> None:
    assert car_warnings(hatchback()) == ()
    assert any(re.search(words, text) for text in car_warnings(hatchback(**tables)))


def test_doubts_about_an_identification_are_warnings_until_they_are_accepted() -> None:
    doubts = {"doubts": ["front D is at the end of its range, 3", "another"]}
    first, _ = car_warnings(hatchback(identified=doubts))
    assert re.search(r"front D is at the end .* identified\.doubts_accepted = true", first)
    assert car_warnings(hatchback(identified={**doubts, "doubts_accepted": True})) == ()


SCHEDULE = {"speed_km_h": [15.0, 120.0], "proportional_gain_s": [0.0, 0.09], "integral_gain": [1.3, 0.5]}


@pytest.mark.parametrize("schedule", [None, SCHEDULE])
@pytest.mark.parametrize(("lead", "lag", "is_found"), [(0.05, 0.08, True), (0.08, 0.05, True), (0.05, 0.05, False)])
def test_a_fixed_lead_of_another_actuator_is_found(schedule: Any, lead: float, lag: float, is_found: bool) -> None:
    tracking = {"schedule": schedule, "lead_s": lead}
    found = car_warnings(hatchback(controller={"tracking": tracking}, rear_actuator={"lag_s": lag}))
    assert [f"controller.tracking.lead_s = {lead:g} is {lead / lag:.2g} times" in text for text in found] == [True] * is_found


def test_a_lead_that_is_tuned_or_the_default_has_no_warning() -> None:
    slow = {"lag_s": 0.08}
    for schedule in (None, SCHEDULE):
        assert car_warnings(hatchback(controller={"tracking": {"schedule": schedule}}, rear_actuator=slow)) == ()
    tuned = {"schedule": {**SCHEDULE, "lead_s": [0.0, 0.03], "response_gain_s": [0.1, 0.1]}, "lead_s": 0.05}
    assert car_warnings(hatchback(controller={"tracking": tuned}, rear_actuator=slow)) == ()


def test_handling_is_that_of_the_linear_car() -> None:
    """K = m/L (lr/Cf - lf/Cr), in deg/g; the characteristic speed is sqrt(L/K)."""
    coefficient = 1450.0 / 2.6 * (1.55 - 1.05) / 120e3
    handling = Handling.from_config(hatchback())
    assert handling.understeer_gradient_deg_per_g == pytest.approx(np.rad2deg(coefficient) * 9.81, rel=1e-12)
    assert handling.characteristic_speed_km_h == pytest.approx(3.6 * np.sqrt(2.6 / coefficient), rel=1e-12)
    assert str(handling) == "understeer gradient 1.31 deg/g, characteristic speed 120 km/h"


def test_a_map_beyond_the_actuator_or_the_tyres_is_found() -> None:
    """The warnings give the fraction of cells beyond the actuator, and the slip."""
    config = hatchback(limits={"rear_angle_max_deg": 5.0})
    found = list(map_warnings(solve_case(config, "4ws-2"), hatchback()))
    assert any(
        re.search(r"% of the map's feasible cells use rear angles up to 5 deg, beyond the 3\.5 deg", text) for text in found
    )
    narrow = hatchback(limits={"grip_use_max": None})
    linear = solve_case(narrow.with_tyre_model("linear"), "4ws-2")
    assert [text for text in map_warnings(linear, narrow) if "rear slip bound" in text]
    assert MapFacts.of_map(linear, narrow).reachable_percent == 100.0


def test_a_map_of_the_nonlinear_tyre_that_exceeds_its_slip_bounds_is_solved_again() -> None:
    config = hatchback(limits={"lateral_acceleration_max_g": 1.2}).with_tyre_model("magic-formula")
    solved = solve_case(config, "4ws-2")
    raised = replace(solved, yaw_rate=solved.yaw_rate * 1.02)
    (text,) = map_warnings(raised, config)
    assert "solve it again" in text and "magic-formula" not in text


def test_a_limiter_derived_from_the_car_has_another_remedy() -> None:
    config = hatchback(limiter={"opposite_phase_lateral_acceleration_m_s2": 1.0})
    (text,) = map_warnings(solve_case(config, "4ws-2"), config)
    assert "raise limiter.opposite_phase_lateral_acceleration_m_s2 (it is 1)" in text


def test_the_family_follows_a_slow_actuator_and_the_top_speed_ends_the_check() -> None:
    slow = {"rear_actuator": {"lag_s": 0.2}}
    assert car_warnings(hatchback(**slow)) == ()
    oversteering = {"tyre": {"front": {"cornering_stiffness_n_per_rad": 140e3}}}
    found = [
        "unstable from 137 km/h" in "\n".join(car_warnings(hatchback(**oversteering, vehicle={"top_speed_km_h": top})))
        for top in (140.0, 130.0)
    ]
    assert found == [True, False]


def test_a_neutral_car_has_no_critical_or_characteristic_speed() -> None:
    arm = {"cg_to_front_axle_m": 1.3, "cg_to_rear_axle_m": 1.301}
    assert str(Handling.from_config(hatchback(vehicle=arm))) == "understeer gradient 0.00 deg/g, neutral"


def test_a_value_close_to_a_limit_has_enough_digits() -> None:
    assert (distinct(1.9, 1.5), distinct(1.5004, 1.5), distinct(0.5996, 0.6)) == ("1.9", "1.5004", "0.5996")
    assert distinct(2360.0, 100.0) == "2400"


def test_a_gain_schedule_of_another_car_is_found() -> None:
    config = npz.load(GENERATED / "4ws2.npz").config
    assert config is not None and list(schedule_warnings(config)) == []
    family, text = schedule_warnings(config.replace({"rear_actuator": {"lag_s": 0.08}}))  # the family follows the actuator
    assert "tuned for another actuator than rear_actuator.lag_s = 0.08" in text
    assert family.startswith("over the family of cars the gains keep ")
    schedule = config.controller.tracking.schedule
    assert schedule is not None
    tripled = {
        "proportional_gain_s": [3.0 * gain for gain in schedule.proportional_gain_s],
        "integral_gain": [3.0 * gain for gain in schedule.integral_gain],
    }
    tracking = {"schedule": {**schedule.model_dump(mode="json"), **tripled}}
    (text,) = schedule_warnings(config.replace({"controller": {"tracking": tracking}}))
    assert re.match("over the family of cars the gains keep no margin .a car is unstable., less than the 8 dB and 45 deg", text)


@pytest.mark.parametrize(
    ("slow", "peak", "limit"), [(False, 1.95, "1.8"), (True, 2.3, "2.1"), (True, 1.95, ""), (False, 1.81, "")]
)
def test_a_peak_of_the_sensitivity_is_found_with_enough_margin(slow: bool, peak: float, limit: str) -> None:
    config = npz.load(GENERATED / "4ws2.npz").config
    assert config is not None
    margins = Margins(np.array([9.0]), np.array([50.0]), np.array([peak]), np.array([True]))
    found = list(family_warnings(config, margins, slow=slow))
    assert len(found) == bool(limit) and all(f"more than the {limit} of [tuning]" in text for text in found)


def test_wrong_units_and_a_transposed_table_are_named() -> None:
    """The paper's map: with km/h instead of m/s a cell of 0.8 g becomes 2.9 g."""
    own = npz.load(GENERATED / "4ws2-paper.npz")
    assert beyond_grip(own) == ""
    assert "is vx in km/h?" in beyond_grip(replace(own, speed=3.6 * own.speed))
    square = replace(own, front_angle=np.resize(own.front_angle, own.speed.size))
    rates = np.nan_to_num(own.yaw_rate[:, : own.speed.size])
    rates = np.pad(rates, ((0, 0), (0, own.speed.size - rates.shape[1])))
    turned = replace(square, yaw_rate=rates.T, feasible=np.ones(rates.shape, dtype=bool))
    assert "transpose yaw_rate: its rows are speeds" in beyond_grip(turned)


def test_axes_are_checked_where_the_acceleration_is_plausible() -> None:
    own = npz.load(GENERATED / "4ws2-paper.npz")
    assert own.config is not None
    slow = replace(own, speed=own.speed[:60], yaw_rate=own.yaw_rate[:60, :60].T, feasible=own.feasible[:60, :60].T)
    turned = replace(slow, front_angle=own.front_angle[:60])
    assert beyond_grip(turned) == ""
    (text,) = axis_warnings(turned, own.config)
    assert "transpose yaw_rate: its rows are speeds" in text
    (text,) = axis_warnings(replace(own, front_angle=16.0 * own.front_angle), own.config)
    assert "not of the steering wheel" in text
    assert not list(axis_warnings(own, own.config))


def test_a_square_map_that_is_transposed_is_named_by_its_bend() -> None:
    """In the wrong order its yaw rate falls only a little with the angle, but rises by 43 % where the angle doubles."""
    own = npz.load(GENERATED / "4ws2-paper.npz")
    assert own.config is not None
    speed, angle = np.arange(20.0, 111.0, 10.0) / 3.6, np.radians(np.arange(0.5, 5.1, 0.5))
    rates = speed[:, np.newaxis] * angle / (3.0 + 0.004 * speed[:, np.newaxis] ** 2)
    cells = {"feasible": np.ones(rates.shape, dtype=bool), "rear_angle": None, "active": None, "sideslip": None}
    square = replace(own, speed=speed, front_angle=angle, yaw_rate=rates, **cells)
    assert not list(axis_warnings(square, own.config))
    (text,) = axis_warnings(replace(square, yaw_rate=rates.T), own.config)
    assert "not in proportion" in text and "transpose yaw_rate" in text


def test_committed_files_and_a_modified_build(tmp_path: Path) -> None:
    found = check_path(GENERATED / "4ws2.npz")
    stored = of_map(npz.load(GENERATED / "4ws2.npz"), npz.load(GENERATED / "4ws2.npz").config)
    assert (found.kind, found.warnings) == ("map", stored.warnings)
    assert found.facts["judgement"] == stored.to_dict()
    folder = tmp_path / "build"
    (folder / "src").mkdir(parents=True)
    manifest = json.loads((GENERATED / "4ws2/manifest.json").read_text(encoding="utf-8"))
    manifest["files"] = {"src/ars_map.c": manifest["files"]["src/ars_map.c"]}
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    (folder / "src/ars_map.c").write_text("int x;\n", encoding="utf-8")
    found = check_path(folder)
    assert any("changed since the build: src/ars_map.c" in text for text in found.warnings)
    assert f"not verified yet; next: `codegen verify {folder}`" in found.notes
    for damaged in ("{}", "not JSON", '{"build": {"manifest_sha256": "0"}, "counts": {"failed": 0}}'):
        (folder / "verify.json").write_text(damaged, encoding="utf-8")
        assert any("verify.json" in text for text in check_path(folder).warnings)


def test_a_command_that_a_note_proposes_has_names_of_files_quoted(tmp_path: Path) -> None:
    """A user may paste it into a shell."""
    shutil.copytree(GENERATED / "4ws2", tmp_path / "build")
    path = tmp_path / "build" / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    manifest["inputs"]["map"]["file"] = manifest["inputs"]["configuration"]["source"] = "$(touch x).npz"
    path.write_text(json.dumps(manifest), encoding="utf-8")
    assert any("`codegen check '$(touch x).npz' --config '$(touch x).npz'`" in text for text in check_path(path.parent).notes)


@pytest.mark.parametrize("name", ["4ws2", "4ws2-paper"])
def test_a_map_and_the_build_of_it_have_the_same_facts_and_warnings(name: str) -> None:
    of_map, of_build = check_path(GENERATED / f"{name}.npz"), check_path(GENERATED / name)
    assert (of_map.lines, of_map.facts, of_map.warnings) == (of_build.lines, of_build.facts, of_build.warnings)
    assert any(text.startswith("margins of the configured car: ") for text in of_map.lines)


def test_margins_of_an_unstable_loop_name_the_speeds() -> None:
    assert (
        "margins of the configured car: little from 107 km/h, unstable from 259 km/h"
        in check_path(GENERATED / "4ws2-paper").lines
    )
    assert margins_line(None) == "no feedback, so no margins"


def bare_map(folder: Path, scale: float = 1.0, speed_scale: float = 1.0) -> Path:
    """Save only speeds, front angles and yaw rates of the recommended map, without gaps."""
    own = npz.load(GENERATED / "4ws2.npz")
    last = np.nanmax(own.yaw_rate, axis=1, keepdims=True)
    yaw_rate = scale * np.where(own.feasible, own.yaw_rate, last)
    path = folder / "bare.npz"
    np.savez(path, vx=speed_scale * own.speed, delta_f=own.front_angle, yaw_rate=yaw_rate)
    return path


def test_only_the_cause_is_reported_for_a_bare_map(tmp_path: Path) -> None:
    """Its rear angles are unknown, so there is no warning about the limiter; wrong units suppress their consequences."""
    (margins,) = check_path(bare_map(tmp_path)).warnings
    assert margins.startswith('the feedback of kind "pi" has little margin from 107 km/h')
    assert "; lower its gains, or use" in margins  # the map reaches 120 km/h, so the largest speed cannot be lowered
    (units,) = check_path(bare_map(tmp_path, speed_scale=3.6)).warnings
    assert "is vx in km/h?" in units


def test_reasons_to_reject_a_build_are_warnings_of_its_map(tmp_path: Path) -> None:
    path = bare_map(tmp_path, scale=0.0)
    with pytest.raises(CodegenError) as refused:
        prepare(path)
    (text,) = check_path(path).warnings
    assert f"{path}: {text}" == str(refused.value)


def configured(folder: Path, text: str) -> Path:
    path = folder / "ars.toml"
    path.write_text(car_toml(text), encoding="utf-8")
    return path


GRID = "[grid]\nspeed_points = 7\nfront_angle_points = 8\n"


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("[controller.inputs]\nspeed_max_km_h = 100.0\n", "controller.inputs.speed_max_km_h: 100 km/h is below"),
        ("[controller]\nslow_speed_km_h = 40.0\n", "controller.slow_speed_km_h: 40 km/h is more than a quarter"),
    ],
)
def test_input_limits_inside_the_map_are_found_in_configuration_and_map(tmp_path: Path, text: str, place: str) -> None:
    path = configured(tmp_path, GRID + text)
    for found in (check_path(path), check_path(GENERATED / "4ws2.npz", path)):
        (warning,) = found.warnings
        assert place in warning


def test_a_limit_above_that_of_the_actuator_is_reported_once(tmp_path: Path) -> None:
    (text,) = check_path(configured(tmp_path, f"{GRID}[limits]\nrear_angle_max_deg = 5.0\n")).warnings
    assert "limits.rear_angle_max_deg = 5 is above rear_actuator.angle_max_deg = 3.5" in text


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("[plant]\nrear_relaxation_factor = 0.7\n", ["plant.rear_relaxation_factor = 0.7 has no effect"]),
        ("[plant]\nrear_relaxation_factor = 0.7\nrelaxation_length_m = 0.4\n", []),
        ("[plant]\ncommand_delay_samples = 2\n", []),
        ("[plant]\ncommand_delay_samples = 2\n[tuning]\ndelay_samples = 1\n", ["tuning.delay_samples = 1 has no effect"]),
        ("[plant]\ncommand_delay_samples = 2\n[tuning]\ndelay_samples = 2\n", []),
    ],
)
def test_keys_of_the_plant_without_effect_are_found(tmp_path: Path, text: str, found: list[str]) -> None:
    warnings = check_path(configured(tmp_path, GRID + text)).warnings
    assert [text.partition(":")[0] for text in warnings] == found


def test_lags_that_do_not_follow_the_car_are_one_note(tmp_path: Path) -> None:
    older = check_path(configured(tmp_path, f"{GRID}[tuning]\nactuator_lag_s = [0.02, 0.05, 0.1]\n"))
    (note,) = [text for text in older.notes if "actuator_lag_factor" in text]
    assert note.startswith("tuning.actuator_lag_s = 0.02 to 0.1 s does not follow rear_actuator.lag_s")
    assert not [text for text in check_path(configured(tmp_path, GRID)).notes if "actuator_lag" in text]
    of_map, of_build = (check_path(GENERATED / name).notes for name in ("4ws2-paper.npz", "4ws2-paper"))
    assert note in of_map and note in of_build


def test_another_configuration_requires_a_map(tmp_path: Path) -> None:
    with pytest.raises(CodegenError, match="only a map is checked with another configuration"):
        check_path(GENERATED / "4ws2", configured(tmp_path, GRID))


def test_several_warnings_are_counted_in_the_plural(monkeypatch: pytest.MonkeyPatch) -> None:
    found = Found("map", (), {}, (), ("one", "two"))
    monkeypatch.setattr("codegen.judgement.facts.check_path", lambda *_, **__: found)
    with pytest.raises(CheckFailed, match="2 warnings; resolve them"):
        check.main([str(GENERATED / "4ws2.npz")], standalone_mode=False)
