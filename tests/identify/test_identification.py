"""Identification of simulated cars whose true values are known, and of drives without excitation."""

import functools
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from codegen.configuration import Config, parse, preset_text
from codegen.errors import CodegenError
from codegen.identify import run
from codegen.identify.drive import Drive
from codegen.identify.estimate import Fit
from codegen.identify.identifiability import Direction, Identifiability, analyse, undetermined_curves
from codegen.identify.parameters import BY_NAME, CURVE_PARAMETERS, configured
from codegen.identify.reached import reached
from codegen.identify.result import grip_reached, identified_keys, identified_toml, understeer_gradient
from codegen.identify.run import Identification, IdentifiedQuantity, identify, judge
from codegen.identify.validation import validate, whiteness
from codegen.map_file.map import choose_config
from codegen.optimum.solve import solve_case
from codegen.units import DEGREE
from codegen.vehicle.single_track import SingleTrack
from tests.identify.drives import SENSOR, Course, Part, configured_car, drive, true_car, truth
from tests.whole_car import with_car

SEED = 3
DEVIATIONS_MAX = 3.5
"""Largest error in standard deviations: one of 2,000 normal values is beyond."""


@functools.cache
def driven(seed: int = SEED) -> tuple[Config, dict[str, float], tuple[Drive, ...]]:
    """Return a car, its true values, and three drives for its identification with a fourth to predict."""
    config, errors = true_car(seed)
    course = Course(config)
    parts = (*course.everything(), course.hold_out())
    signals = (*SENSOR, "delta_r_command", "steering_wheel_angle")
    drives = tuple(drive(config, part, k, errors, name=f"drive {k + 1}", signals=signals) for k, part in enumerate(parts))
    return config, truth(config, errors), drives


@functools.cache
def identified() -> Identification:
    config, _, drives = driven()
    return identify(configured_car(config), drives[:3])


def without(one: Drive, *names: str, **changed: np.ndarray) -> Drive:
    return Drive(one.name, one.time, {key: changed.get(key, value) for key, value in one.signals.items() if key not in names})


def test_a_car_is_found_from_the_preset() -> None:
    _, true, _ = driven()
    found = identified()
    value = found.values()
    for axle in ("front", "rear"):
        assert value[f"{axle}_stiffness"] == pytest.approx(true[f"{axle}_stiffness"], rel=0.03)
    assert value["yaw_inertia"] == pytest.approx(true["yaw_inertia"], rel=0.05)
    assert value["actuator_lag"] == pytest.approx(true["actuator_lag"], abs=0.005)
    for name, each in found.quantities.items():
        if each.is_identified:
            assert abs(each.value - true[name]) < DEVIATIONS_MAX * each.standard_deviation, name
    # Not measured; and the angle of the steering wheel has a resolution of 0.1 deg.
    assert [name for name, each in found.quantities.items() if not each.is_identified] == ["sideslip_offset", "sideslip_delay"]


def test_the_result_predicts_a_drive_that_was_held_out() -> None:
    config, _, drives = driven()
    found = validate(identified(), drives[3])
    noise = config.sensors.yaw_rate.noise
    resolution = config.sensors.yaw_rate.resolution
    least = np.hypot(noise, resolution / np.sqrt(12.0))
    assert found.identified.yaw_rate_error == pytest.approx(least, rel=0.1)  # 1,400 samples, and what the car adds
    assert found.identified.one_step_error == pytest.approx(least * np.sqrt(2.0), rel=0.1)
    assert found.configured.yaw_rate_error > 5.0 * found.identified.yaw_rate_error
    assert found.whiteness["yaw_rate"].first < 0.2


def test_the_file_has_the_values_and_their_uncertainty() -> None:
    config, true, _ = driven()
    found = identified()
    text = identified_toml(found, preset_text("recommended"), "ars.toml")
    assert "# centre of gravity above the road" in text
    written = parse(tomllib.loads(text), "ars.toml")
    assert written.vehicle.yaw_inertia_kg_m2 == pytest.approx(found.values()["yaw_inertia"], rel=1e-6)
    assert written.rear_actuator.rate_max_deg_s == pytest.approx(found.values()["actuator_rate"] / DEGREE, rel=1e-6)
    assert written.identified.keys == list(identified_keys(found))
    place = written.identified.keys.index("vehicle.yaw_inertia_kg_m2")
    assert written.identified.standard_deviations[place] < 0.01 * true["yaw_inertia"]
    np.linalg.cholesky(np.array(written.identified.correlations))
    gradient, deviation = understeer_gradient(found)
    assert abs(gradient - SingleTrack.from_config(config).understeer_coefficient) < DEVIATIONS_MAX * deviation


def test_the_text_of_a_direction_of_one_quantity_depends_on_what_is_known_about_it() -> None:
    assert Direction(1.0, 0.0, {"front C": 1.0}).text == "front C: not in these drives"
    assert Direction(0.5, 2.0, {"front C": 0.95}).text == "front C: hardly in these drives"


def test_a_covariance_is_symmetric() -> None:
    """Correlations are written with seven digits; a file whose matrix is not symmetric is rejected."""
    found = identified()
    assert (found.vehicle.covariance == found.vehicle.covariance.T).all()
    assert (found.correlation == found.correlation.T).all()


def test_the_file_has_the_grip_that_the_drives_reached() -> None:
    """The side force of the drives decides, over the load and the identified peak; load transfer is worth 2 %. The front axle
    reached its peak, and a key of an earlier identification that says otherwise is taken out."""
    found = identified()
    before = "\n[identified]\nfront_grip_reached = 0.5 # of another drive\nrear_grip_reached = 0.5\n"
    data = with_car({})
    inline = ", ".join(f"{key} = {value}" for key, value in data.pop("vehicle").items())
    rewritten = f"schema_version = 1\nvehicle = {{ {inline} }}\n{tomlkit.dumps(data)}"
    for text in (preset_text("recommended") + before, rewritten + before):
        written = parse(tomllib.loads(identified_toml(found, text, "ars.toml")), "ars.toml").identified
        assert written.front_grip_reached == 1.0 and written.rear_grip_reached < 0.99
        force = reached(found.vehicle, found.config).friction[1]
        peak = found.config.road.friction * found.values()["rear_peak"]
        assert written.rear_grip_reached == pytest.approx(force / peak, rel=0.02)
        assert written.keys == list(identified_keys(found))
    (shares,) = [grip_reached(identify(found.config, [driven()[2][1]]))]
    assert max(shares.values()) < 0.9  # without the drive to the limit


def test_the_grip_reached_is_a_note_of_every_command(tmp_path: Path) -> None:
    file = tmp_path / "ars.toml"
    text = identified_toml(identified(), preset_text("recommended"), "ars.toml")
    file.write_text(text, encoding="utf-8")
    share = round(100.0 * parse(tomllib.loads(text), "ars.toml").identified.rear_grip_reached)
    note = f"rear axle: the drives reached {share} % of its grip; grip_use_max refers to that"
    config = choose_config(None, file).config.replace({"grid": {"speed_points": 3, "front_angle_points": 3}})
    for reference_map, path in ((None, file), (solve_case(config, "4ws-2"), None), (solve_case(config, "4ws-2"), file)):
        assert choose_config(reference_map, path).notes == (note,)


@pytest.mark.parametrize(("vehicle", "between"), [("vehicle = {{ {} }}", ", "), ("[vehicle]\n{}", "\n")])
def test_a_stiffness_factor_becomes_a_stiffness(vehicle: str, between: str) -> None:
    """A file with an inline table is written anew."""
    data = with_car({"tyre": {"rear": {"stiffness_factor_b_per_rad": 12.0}}})
    own = vehicle.format(between.join(f"{key} = {value}" for key, value in data.pop("vehicle").items()))
    text = f"schema_version = 1\n{own}\n{tomlkit.dumps(data)}"
    found = identified()
    written = parse(tomllib.loads(identified_toml(found, text, "ars.toml")), "ars.toml")
    assert written.tyre.rear.stiffness_factor_b_per_rad is None
    assert written.tyre.rear.cornering_stiffness_n_per_rad == pytest.approx(found.values()["rear_stiffness"], rel=1e-6)


def test_outliers_do_not_matter() -> None:
    config, true, drives = driven()
    rng = np.random.default_rng(0)
    yaw_rate = drives[1].signals["yaw_rate"].copy()
    yaw_rate[rng.random(yaw_rate.size) < 0.03] *= 3.0  # least squares would see 6 % more yaw rate
    yaw_rate[500:600] = np.nan
    found = identify(configured_car(config), [without(drives[1], yaw_rate=yaw_rate)]).values()
    assert found["yaw_inertia"] == pytest.approx(true["yaw_inertia"], rel=0.02)
    assert found["front_stiffness"] == pytest.approx(true["front_stiffness"], rel=0.02)


def test_the_steering_wheel_and_measured_sideslip_are_used() -> None:
    config, errors = true_car(SEED)
    course = Course(config)
    signals = ("vx", "yaw_rate", "lateral_acceleration", "steering_wheel_angle", "delta_r", "sideslip")
    parts = (course.turns(20.0, 2.0), course.turns(70.0), course.front_sweep(70.0))
    found = identify(configured_car(config), [drive(config, parts, 0, errors, signals=signals)])
    true = truth(config, errors)
    for name in ("steering_ratio", "front_stiffness", "rear_stiffness", "sideslip_delay"):
        each = found.quantities[name]
        assert each.is_identified, name
        assert abs(each.value - true[name]) < DEVIATIONS_MAX * each.standard_deviation, name
    assert found.quantities["actuator_lag"].note == "rear angle and its command were not measured together"


def test_without_excitation_nothing_is_invented() -> None:
    config, errors = true_car(SEED)
    known = configured_car(config)
    straight = drive(config, (Course(config).straight(20.0),), 0, errors, signals=(*SENSOR, "delta_r_command"))
    found = identify(known, [straight])
    assert identified_keys(found) == {}
    before = configured(known)
    for name, each in found.quantities.items():
        if each.parameter.key:
            assert each.value == before[name]
            assert each.parameter.manoeuvre in each.note or "not measured" in each.note
    named = {direction.text for direction in found.directions}
    for axle in ("front", "rear"):
        assert f"{axle} D: not in these drives" in named
    assert any("yaw inertia" in text and text.endswith("only together") for text in named)


def doubtful(name: str, share: float) -> tuple[Fit, Identifiability]:
    """Return the fit of the identified car, and what it determines if one quantity has this deviation over its spread."""
    fitted = identified().vehicle
    place = fitted.problem.prior.names.index(name)
    covariance = fitted.covariance.copy()
    covariance[place, place] = share**2
    return fitted, analyse(fitted.problem.prior.parameters, fitted.free, covariance, fitted.information)


def judged(name: str, share: float) -> dict[str, IdentifiedQuantity]:
    """Return the quantities of `doubtful`."""
    fitted, result = doubtful(name, share)
    found: dict[str, IdentifiedQuantity] = {}
    judge(fitted, result, configured(identified().config), fitted.problem.samples, found)
    return found


@pytest.mark.parametrize(
    ("lost", "departure_percent", "before", "held"),
    [
        ("peak", 10.0, (), ("load_sensitivity", "shape")),
        ("peak", 10.0, ("load_sensitivity", "shape"), ("curvature",)),
        ("peak", 10.0, ("load_sensitivity", "shape", "curvature"), ()),
        ("peak", 95.0, (), ("load_sensitivity", "shape")),
        ("peak", 95.0, ("load_sensitivity", "shape", "curvature"), ("peak",)),
        ("peak", 10.0, ("load_sensitivity", "shape", "curvature", "peak"), ()),
        ("shape", 95.0, (), ()),
    ],
)
def test_a_curve_that_is_not_determined_keeps_what_shows_at_its_peak_or_all(
    lost: str, departure_percent: float, before: tuple[str, ...], held: tuple[str, ...]
) -> None:
    fitted, result = doubtful(f"front_{lost}", 0.7)
    free = np.array([name not in {f"front_{each}" for each in before} for name in fitted.problem.prior.names])
    limits = identified().config.limits.model_copy(update={"slip_departure_percent": departure_percent})
    config = identified().config.model_copy(update={"limits": limits})
    found = undetermined_curves(replace(fitted, free=fitted.free & free), result, config)
    assert found == [f"front_{each}" for each in held]


def test_what_is_free_of_a_curve_is_taken_with_it() -> None:
    found = judged("front_shape", 0.7)
    assert all(found[name].is_identified for name in CURVE_PARAMETERS[0])
    assert found["front_shape"].note.startswith("not determined alone")


@pytest.mark.parametrize(("share", "is_taken"), [(0.29, True), (0.5, True), (0.7, False)])
def test_stiffnesses_and_inertia_are_taken_together(share: float, is_taken: bool) -> None:
    each = judged("rear_stiffness", share)["rear_stiffness"]
    assert each.is_identified == is_taken
    assert each.note.startswith("weakly determined") == (share == 0.5)


def test_what_is_missing_is_named() -> None:
    config, _, drives = driven()
    known, one = configured_car(config), drives[0]
    for given, message in (
        ([], "there is no drive"),
        ([without(one, "yaw_rate")], "no drive has yaw_rate"),
        ([without(one, "delta_f", "steering_wheel_angle")], "no drive has delta_f or steering_wheel_angle"),
        ([without(one, vx=np.zeros(one.time.size))], "no drive has 1 s with speed above 3 m/s"),
        ([one, Drive("slow", one.time[::2], {})], "slow: has a sample every 20 ms"),
        ([Drive("short", one.time[:1], {})], "short: has fewer than two samples"),
    ):
        with pytest.raises(CodegenError, match=message):
            identify(known, given)
    found = identify(known, [drives[3], without(drives[2], "delta_r", "delta_r_command")])
    assert "drive 3 is not used for the car" in " ".join(found.notes)
    found = identify(known, [without(drives[2], "delta_r", "delta_r_command")])
    assert "the rear wheels count as straight" in " ".join(found.notes)
    assert "no drive of `logs=` has sideslip" in " ".join(found.notes)


@pytest.mark.parametrize("degrees", [0.5, 2.0])
def test_a_rate_limit_that_was_not_reached_is_not_determined(degrees: float) -> None:
    """The command moves by 20 deg/s, less than the actuator can."""
    config, errors = true_car(SEED)
    time = np.arange(8000) * 1e-3
    wave = np.abs((20.0 / degrees * time) % 4.0 - 2.0) - 1.0
    part = Part(8.0, 15.0, 0.0, degrees * DEGREE * wave)
    found = identify(configured_car(config), [drive(config, (part,), 0, errors, signals=(*SENSOR, "delta_r_command"))])
    assert config.rear_actuator.rate_max_deg_s > 25.0
    assert found.quantities["actuator_lag"].is_identified
    assert not found.quantities["actuator_rate"].is_identified
    assert found.quantities["actuator_rate"].note.endswith("steps of the rear angle command over the whole angle")
    assert "actuator rate: not in these drives" in {direction.text for direction in found.directions}


def test_tyres_without_relaxation_length() -> None:
    data = true_car(SEED)[0].model_dump(mode="json")
    data["plant"]["relaxation_length_m"] = 0.0
    config = parse(data, "car")
    course = Course(config)
    guess = configured_car(config).model_dump(mode="json")
    guess["plant"]["relaxation_length_m"] = 0.3
    drives = [drive(config, (course.front_sweep(70.0),), 0)]
    each = identify(parse(guess, "guess"), drives).quantities["relaxation_length"]
    assert each.is_identified
    assert each.value == 0.0
    assert each.note == "below 0.05 m, which counts as none"


def test_whiteness() -> None:
    rng = np.random.default_rng(0)
    white = rng.standard_normal(5000)
    coloured = white.copy()
    for k in range(1, coloured.size):
        coloured[k] += 0.3 * coloured[k - 1]
    white[100:200] = np.nan
    assert whiteness(white, 0.01).is_white
    found = whiteness(coloured, 0.01)
    assert not found.is_white
    assert found.first == pytest.approx(0.3, abs=0.05)  # three standard deviations of 1/sqrt(n)
    assert BY_NAME.keys() >= set(identified().names)


def test_derivatives_beyond_all_numbers_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A yaw rate with the other sign, without a lateral acceleration that contradicts it, gave them for one car."""

    def singular(*_: object) -> None:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(run, "fit", singular)
    config, _, drives = driven()
    with pytest.raises(CodegenError, match="diverges; check units and signs of the signals"):
        identify(configured_car(config), [without(drives[0], "delta_r", "delta_r_command")])


def test_a_wrong_wheelbase_is_noted() -> None:
    config, _, drives = driven()
    known = configured_car(config)
    vehicle = known.vehicle.model_copy(update={"cg_to_front_axle_m": 1.2 * known.vehicle.cg_to_front_axle_m})
    notes = identify(known.model_copy(update={"vehicle": vehicle}), drives[:1]).notes
    assert any(note.endswith("check the configured wheelbase and mass, and the measured speed") for note in notes)
