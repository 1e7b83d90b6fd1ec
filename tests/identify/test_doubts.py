"""Doubts: what an identification shows against itself is found, written, and reset by the next one; deviations grow."""

import dataclasses
import math
import tomllib

import numpy as np
import pytest

from codegen.configuration import parse, preset, preset_text
from codegen.identify import identifiability as holding
from codegen.identify.identifiability import analyse, undetermined_curves
from codegen.identify.outcome import ERROR_FACTOR, doubts, model_error, with_model_error
from codegen.identify.parameters import BY_NAME, CURVE_PARAMETERS
from codegen.identify.reached import Reached, axle_forces, held_means, reached, slip_limit, tyres_of
from codegen.identify.result import identified_toml
from codegen.identify.run import Identification, identify
from codegen.identify.validation import FreeRun, Validation, Whiteness, model_errors
from codegen.importing.toml_edit import whole
from codegen.map_file.map import grip_notes
from codegen.units import DEGREE
from codegen.vehicle.tyre import AxleTyres
from tests.identify.drives import SENSOR, Course, configured_car, drive
from tests.identify.foreign import BRUSH, START, leaning_plant
from tests.identify.test_identification import identified

WHITE, COLOURED = Whiteness(0.0, 10.0, 20, 0.5), Whiteness(0.5, 900.0, 20, 0.0)
NOISE = 0.1 * DEGREE
REACHED = Reached((10.0, 20.0), 8.0, (20.0 * DEGREE, 20.0 * DEGREE), (1.0, 1.0), (1.0, 1.0))
"""Both axles far beyond their peaks."""


def changed(name: str, value: float) -> Identification:
    """Return the identified car with another value of one quantity."""
    found = identified()
    one = dataclasses.replace(found.quantities[name], value=value)
    return dataclasses.replace(found, quantities={**found.quantities, name: one})


def predicted(error: float, *, white: bool = False, size: float = 5.0 * DEGREE) -> Validation:
    """Return a drive whose yaw rate (rms `size`, rad/s) is predicted with noise and with a slow error (rms, rad/s)."""
    time = np.arange(2000) * 0.01
    noise = NOISE * np.random.default_rng(0).standard_normal(time.size)
    measured = np.full((time.size, 3), math.nan)
    measured[:, 0] = math.sqrt(2.0) * size * np.sin(time) + noise
    simulated = measured - noise[:, None] - math.sqrt(2.0) * error * np.sin(0.7 * time)[:, None]
    free_run = math.hypot(error, NOISE)
    run = FreeRun(time, measured, simulated, free_run, math.sqrt(2.0) * NOISE, size, 2.0 * free_run, math.nan)
    return Validation("two", run, run, {"yaw_rate": WHITE if white else COLOURED})


def test_a_car_that_is_known_has_no_doubts() -> None:
    assert doubts(identified(), REACHED, [predicted(0.0, white=True)]) == []


@pytest.mark.parametrize("name", ["front_load_sensitivity", "rear_curvature", "yaw_rate_delay", "rear_stiffness"])
@pytest.mark.parametrize("end", ["low", "high"])
def test_a_value_at_the_end_of_its_range_is_in_doubt(name: str, end: str) -> None:
    parameter = BY_NAME[name]
    value = getattr(parameter, end)
    found = doubts(changed(name, value), REACHED, [])
    assert any(text.startswith(f"{parameter.title} is at the end of its range, {value:.4g}") for text in found)
    inside = value + (0.01 if end == "low" else -0.01) * parameter.spread * (value if parameter.is_relative else 1.0)
    assert not any("end of its range" in text for text in doubts(changed(name, inside), REACHED, []))


def test_a_friction_above_the_one_reached_is_in_doubt() -> None:
    friction = identified().config.road.friction
    assert doubts(changed("front_peak", 1.14 / friction), REACHED, []) == []
    (found,) = doubts(changed("front_peak", 1.79 / friction), REACHED, [])
    assert found == f"front D is {1.79 / friction:.3g}, where the drives reached a friction of 1.00"


def test_a_peak_and_a_slip_bound_beyond_the_drives_are_in_doubt() -> None:
    tyre = tyres_of(identified().config, identified().values())[1]
    less = dataclasses.replace(REACHED, slip=(20.0 * DEGREE, 4.0 * DEGREE), share=(1.0, 0.9))
    (found,) = doubts(identified(), less, [])
    peak = tyre.peak_slip / DEGREE
    assert found == f"the peak of the rear tyres, at {peak:.1f} deg, lies beyond the 4.0 deg of slip that were driven"
    little = dataclasses.replace(less, slip=(20.0 * DEGREE, 0.5 * DEGREE))
    assert any(text.startswith("the slip bound of the rear axle, ") for text in doubts(identified(), little, []))


def test_the_linear_range_of_a_map_ends_where_the_drives_did() -> None:
    """A car with brush tyres, roll and relaxation, driven within the linear range: its curves stay as configured. The doubt
    names the bound that they would have; the written file ends the map where the drives ended."""
    base = preset("recommended").with_ideal_plant()
    given = drive(base, (START, Course(base).turns(60.0, 2.0)), 1, signals=SENSOR, plant=leaning_plant(base, BRUSH))
    config = configured_car(base).replace({"limits": {"grip_use_max": None}})
    found = identify(config, [given])
    driven, tyres = reached(found.vehicle, config), tyres_of(config, found.values())
    named = doubts(found, driven, [])
    written = parse(tomllib.loads(identified_toml(found, whole(config, "a test"), "test")), "test")
    ends = AxleTyres.from_config(written).slip_limits
    assert not any(found.quantities[name].is_identified for curve in CURVE_PARAMETERS for name in curve)
    for axle, tyre in enumerate(tyres):
        bound, slip = tyre.slip_bound(config.limits.slip_departure_percent / 100.0), driven.slip[axle]
        assert bound > 1.5 * slip
        assert named[axle].endswith(
            f" axle, {bound / DEGREE:.1f} deg, lies beyond the {slip / DEGREE:.1f} deg of slip that were driven, "
            "where its map ends"
        )
        assert slip_limit(tyre, driven.share[axle], config) == pytest.approx(slip)
        assert ends[axle] == pytest.approx(slip, rel=0.01)  # the share of the grip has three digits
    assert len(named) == 2
    assert [note.endswith("maps end there at the latest") for note in grip_notes(written)] == [True, True, False]


def test_a_curve_that_goes_far_beyond_the_drives_is_not_determined(monkeypatch: pytest.MonkeyPatch) -> None:
    """However small the deviation of D is, C and load sensitivity are held, as where D is not determined."""
    fitted, config = identified().vehicle, identified().config
    prior = fitted.problem.prior
    judged = analyse(prior.parameters, fitted.free, fitted.covariance, fitted.information)
    assert undetermined_curves(fitted, judged, config) == []
    held = ["front_load_sensitivity", "front_shape"]
    monkeypatch.setattr(holding, "reached", lambda *_: REACHED)
    at_end = np.where(np.array(prior.names) == held[0], BY_NAME[held[0]].low, fitted.values)
    assert undetermined_curves(dataclasses.replace(fitted, values=at_end), judged, config) == held
    changes: list[dict[str, tuple[float, float]]] = [{"friction": (0.8, 1.0)}, {"slip": (3.5 * DEGREE, 20.0 * DEGREE)}]
    for less in changes:
        monkeypatch.setattr(holding, "reached", lambda *_, less=less: dataclasses.replace(REACHED, **less))
        assert undetermined_curves(fitted, judged, config) == held


def test_a_prediction_with_an_error_of_the_model_is_in_doubt() -> None:
    (found,) = doubts(identified(), REACHED, [predicted(0.9 * NOISE)])
    assert found == "two: the errors of yaw rate are no white noise: they are errors of the model"
    first, second = doubts(identified(), REACHED, [predicted(2.0 * NOISE)])
    assert first.startswith("two: the free run has 1.6 times the error of one step")
    assert "no white noise" in second
    (found,) = doubts(identified(), REACHED, [predicted(10.0 * NOISE)])
    assert found.endswith("check signs and units of all signals")


def test_a_kind_of_doubt_about_many_drives_is_one_line_with_the_worst() -> None:
    """A file has room for a hundred doubts."""
    many = [dataclasses.replace(predicted(size * NOISE), name=f"drive {size:g}") for size in (2.0, 3.0, 2.5)]
    first, second = doubts(identified(), REACHED, many)
    assert first.startswith("drive 3: the free run has 2.2 times the error of one step")
    assert first.endswith("(and 2 more drives)") and second.endswith("(and 2 more drives)")


def test_doubts_are_written_and_an_acceptance_of_earlier_ones_is_removed() -> None:
    text = preset_text("recommended") + '\n[identified]\ndoubts = ["old"]\ndoubts_accepted = true # by me\n'
    for found in ((), ("one", 'a "second" one')):
        written = parse(tomllib.loads(identified_toml(identified(), text, "ars.toml", found)), "ars.toml").identified
        assert tuple(written.doubts) == found
        assert written.is_doubtful == bool(found)


def test_the_error_of_the_model_is_what_the_free_run_has_beyond_the_noise() -> None:
    size = 5.0 * DEGREE
    error, *others = model_errors([predicted(3.0 * NOISE, size=size)])
    assert error == pytest.approx(3.0 * NOISE / size, rel=0.03)  # the noise of 2,000 samples, and the sines' mean squares
    assert np.isnan(others).all()
    assert model_errors([predicted(3.0 * NOISE, white=True)])[0] == 0.0
    assert np.isnan(model_errors([predicted(3.0 * NOISE, size=2.0 * NOISE)])[0])
    assert model_error([predicted(3.0 * NOISE)]) == (ERROR_FACTOR * error, error)


def test_a_drive_with_the_other_sign_has_finite_deviations_and_a_doubt() -> None:
    """The error is twice the yaw rate. A slip bound of the linear range has none without a departure."""
    wrong = predicted(10.0 * DEGREE)
    assert model_error([wrong]) == (0.9, 0.9)
    assert any("check signs and units" in text for text in doubts(identified(), REACHED, [wrong]))
    found = identified()
    linear = found.config.replace({"limits": {"grip_use_max": None}})
    for config in (found.config, linear):
        grown = with_model_error(found, 0.9).vehicle.covariance
        for each in axle_forces(found.vehicle, grown, config, 0.9):
            assert all(math.isfinite(value) and value > 0.0 for value in dataclasses.astuple(each))


def test_deviations_grow_by_the_error_of_the_model() -> None:
    """An error of 3 % is one of about 3 % in the force, and so in each stiffness; without sideslip, in their level more."""
    found = identified()
    grown = with_model_error(found, 0.03)
    assert with_model_error(found, 0.0) is found
    for axle in ("front", "rear"):
        before, after = (each.quantities[f"{axle}_stiffness"] for each in (found, grown))
        assert after.value == before.value
        assert before.standard_deviation < 0.003 * before.value
        assert after.standard_deviation > 0.03 * before.value
    place = found.names.index("front_stiffness"), found.names.index("rear_stiffness")
    assert found.names == grown.names and (grown.correlation == grown.correlation.T).all()
    assert grown.correlation[place] > found.correlation[place]  # both levels move together
    assert np.linalg.eigvalsh(grown.correlation).min() > 0.0
    forces = [axle_forces(found.vehicle, each.vehicle.covariance, found.config, error)
              for each, error in ((found, 0.0), (grown, 0.03))]  # fmt: skip
    for before, after in zip(*forces, strict=True):
        assert after.force == before.force and after.slip_limit == before.slip_limit
        assert after.force_deviation == pytest.approx(math.hypot(before.force_deviation, 0.03 * before.force))
        assert after.slip_limit_deviation > 2.0 * before.slip_limit_deviation


def test_a_map_ends_where_the_drives_did() -> None:
    found = identified()
    limits, tyre = reached(found.vehicle, found.config), tyres_of(found.config, found.values())[1]
    assert limits.share[1] < 0.99
    use = found.config.limits.grip_use_max
    assert use is not None
    end = slip_limit(tyre, limits.share[1], found.config)
    assert end < limits.slip[1]
    assert tyre.use_at_slip(end) == pytest.approx(use * limits.share[1], rel=1e-9)


def test_means_that_are_held() -> None:
    assert held_means(np.array([0.0, 1.0, 2.0, 3.0]), 2).tolist() == [0.5, 1.5, 2.5]
    assert held_means(np.array([1.0, 3.0]), 5).tolist() == [2.0]
