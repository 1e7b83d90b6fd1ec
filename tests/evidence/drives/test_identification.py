"""Identification of simulated cars, where `make test` has no time for it: a rolling car, and the covariance of held values."""

import math

import numpy as np
import pytest

from codegen.identify.parameters import configured
from codegen.identify.reached import reached
from codegen.identify.run import identify
from codegen.identify.validation import validate
from hil_sim.third_plant import rolling
from tests.identify.drives import SENSOR, Course, configured_car, drive, true_car
from tests.identify.foreign import leaning_plant
from tests.identify.test_held import gentle
from tests.identify.test_identification import SEED


@pytest.mark.long
def test_a_car_with_roll_that_the_model_does_not_contain_is_predicted_and_its_slip_angles_are_right() -> None:
    config = configured_car(true_car(SEED)[0])
    course = Course(config)
    fitted = (course.turns(40.0, duration=15.0), course.turns(80.0, duration=15.0), course.front_sweep(60.0))
    drives = [
        drive(config, parts, k, plant=leaning_plant(config), signals=(*SENSOR, "delta_r_command", "sideslip"))
        for k, parts in enumerate((fitted, course.hold_out()))
    ]
    found = identify(config, drives[:1])
    prediction = validate(found, drives[1])
    assert prediction.identified.yaw_rate_error < 0.5 * prediction.configured.yaw_rate_error
    assert not prediction.whiteness["yaw_rate"].is_white
    assert reached(found.vehicle, config).lateral_acceleration == pytest.approx(4.0, abs=1.5)
    # The accelerometer rolls with the body: 4 deg/g. The slopes of the tyres are those of the third plant.
    assert found.values()["lateral_acceleration_factor"] == pytest.approx(
        1.0 + math.radians(rolling(config).plant.roll_deg_per_g), rel=0.01
    )
    for axle in ("front", "rear"):
        true = configured(rolling(config))[f"{axle}_stiffness"]
        assert found.values()[f"{axle}_stiffness"] == pytest.approx(true, rel=0.03), axle


@pytest.mark.long
def test_the_covariance_says_how_another_held_value_moves_the_others() -> None:
    change = 0.04
    _, _, found = gentle()
    _, _, other = gentle(1.3 + change)
    names = list(found.names)
    held = [names.index(name) for name in names if not found.quantities[name].is_identified]
    assert held == [names.index(name) for name in names if not other.quantities[name].is_identified]
    deviations = np.array([found.quantities[name].standard_deviation for name in names])
    covariance = found.correlation * np.outer(deviations, deviations)
    moves = covariance[:, held] @ np.linalg.inv(covariance[np.ix_(held, held)])
    moved = moves[:, held.index(names.index("front_shape"))] * change
    for name in ("front_peak", "front_curvature"):
        actual = other.values()[name] - found.values()[name]
        assert abs(actual) > 0.02 * found.quantities[name].standard_deviation, name
        # A fifth: the curve is not linear in C, and noise and steps of the fit are found anew.
        assert moved[names.index(name)] == pytest.approx(actual, rel=0.2), name
