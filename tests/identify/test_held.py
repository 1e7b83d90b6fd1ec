"""Tyre curves of which the drives determine a part only: what is held as configured, and what that adds to the uncertainty."""

import functools
import tomllib

import numpy as np
import pytest

from codegen.arrays import BoolArray
from codegen.configuration import Config, parse
from codegen.identify.parameters import CURVE_PARAMETERS
from codegen.identify.reached import reached
from codegen.identify.result import identified_toml
from codegen.identify.run import Identification, identify
from codegen.importing.toml_edit import whole
from codegen.vehicle.population import BAND, draw
from codegen.vehicle.tyre import AxleTyres
from tests.identify.drives import SENSOR, Course, configured_car, drive, true_car

SEED = 104
AXLES = ("front", "rear")
POINTS = 8


@functools.cache
def gentle(shape: float = 1.3) -> tuple[Config, Config, Identification]:
    """Return the true and the known car, and what drives up to 4 m/s^2 say with a configured front C."""
    config, errors = true_car(SEED)
    course = Course(config)
    known = configured_car(config).model_dump(mode="json", exclude_none=True)
    known["tyre"]["front"]["shape_factor_c"] = shape
    car = parse(known, "known car")
    drives = [
        drive(config, parts, 10 * SEED + k, errors, name=f"drive {k}", signals=(*SENSOR, "delta_r_command"))
        for k, parts in enumerate(course.everything()[:2])  # without the limit of grip
    ]
    return config, car, identify(car, drives)


def test_what_is_held_keeps_its_value_and_spreads_as_was_assumed() -> None:
    _, _, found = gentle()
    one, peak = found.quantities["front_shape"], found.quantities["front_peak"]
    assert not one.is_identified
    assert one.value == one.configured
    assert 0.5 * one.parameter.spread < one.standard_deviation < one.parameter.spread
    assert one.note.startswith("as configured, with an assumed deviation; drive: slowly increasing steer")
    assert peak.is_identified
    assert peak.note == "with front C, front load sensitivity as configured; the deviation includes errors of these values"


def test_a_curve_that_was_not_driven_beyond_its_slip_bound_spreads_as_was_assumed() -> None:
    true, errors = true_car(SEED)
    course, known = Course(true), configured_car(true)
    parts = (course.turns(60.0, 2.0), course.front_sweep(60.0, 1.5), course.rear_sweep(60.0))
    found = identify(known, [drive(true, parts, 0, errors, signals=(*SENSOR, "delta_r_command"))])
    for name in CURVE_PARAMETERS[0]:
        one = found.quantities[name]
        spread = one.parameter.spread * (abs(one.value) if one.parameter.is_relative else 1.0)
        assert not one.is_identified, name
        assert one.value == one.configured, name
        assert 0.5 * spread < one.standard_deviation <= spread, name
    assert in_band(true, known, found, "front").all()


def in_band(true: Config, known: Config, found: Identification, axle: str) -> BoolArray:
    """Return whether the true side force is in the band of drawn cars, at POINTS slips up to the one that was reached."""
    written = parse(tomllib.loads(identified_toml(found, whole(known, "a test"), "test")), "test")
    identified = written.replace({"identified": {"interval_floor_percent": 0.0}})
    slips = np.linspace(0.0, reached(found.vehicle, known).slip[AXLES.index(axle)], POINTS + 1)[1:]
    forces = [getattr(AxleTyres.from_config(car), axle).force(slips) for car in (true, *draw(identified, 400, 1))]
    low, high = np.quantile(forces[1:], BAND, axis=0)
    result: BoolArray = (low <= forces[0]) & (forces[0] <= high)
    # The force is known far better than D, from which it follows in proportion at large slip angles.
    half, deviation = POINTS // 2, found.quantities[f"{axle}_peak"].standard_deviation
    assert ((high - low)[:half] < deviation * forces[0][:half]).all(), axle
    return result


@pytest.mark.parametrize("axle", AXLES)
def test_the_true_force_is_within_the_band_up_to_the_slip_that_was_reached(axle: str) -> None:
    assert in_band(*gentle(), axle).all()
