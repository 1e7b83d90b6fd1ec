"""The generated reference model: bit for bit, as physics, and what it never does."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.config import Config
from tests import builds
from tests.sil import checks_reference_model, units
from tests.sil.units import Units


def odd_car() -> Config:
    """Another car: tyres with shifts, a falling curve in front and one that never falls behind, slow sampling."""
    data = builds.TRACKING_CONFIG.model_dump()
    data["tyre"]["front"] |= {
        "shape_factor_c": 1.9,
        "curvature_factor_e": 0.3,
        "horizontal_shift_deg": 0.2,
        "vertical_shift_n": 90.0,
    }
    data["tyre"]["rear"] |= {"shape_factor_c": 0.9, "curvature_factor_e": -3.0, "peak_factor_p1": 1.2}
    data["vehicle"] |= {"mass_kg": 1100.0, "yaw_inertia_kg_m2": 1300.0, "cg_to_front_axle_m": 1.0, "cg_to_rear_axle_m": 1.4}
    data["tyre"]["front"]["cornering_stiffness_n_per_rad"] = 45_000.0
    data["tyre"]["rear"]["cornering_stiffness_n_per_rad"] = 55_000.0
    return Config.model_validate(data)


CARS = {"paper": builds.TRACKING_CONFIG, "odd": odd_car()}


@pytest.fixture(scope="module", params=[(car, precision) for car in CARS for precision in builds.PRECISIONS], ids=str)
def model(request: pytest.FixtureRequest) -> Units:
    """Two cars, in both precisions."""
    car, precision = request.param
    if car == "paper":
        return units.tracking(precision)
    return units.make(builds.paper_map(), CARS[car], precision, ("reference_model",))


def test_every_step_has_the_bits_of_the_independent_model(model: Units) -> None:
    checks_reference_model.check_model_same_bits(model)
    checks_reference_model.check_model_same_bits_over_time(model)


def test_nothing_leads_out_of_bounds(model: Units) -> None:
    checks_reference_model.check_model_finite(model)


def test_a_step_is_that_of_the_single_track_car(model: Units) -> None:
    checks_reference_model.check_model_physics(model)


def test_it_settles_in_the_steady_turn_of_that_car() -> None:
    for precision in builds.PRECISIONS:
        checks_reference_model.check_model_settles(units.tracking(precision))


def test_it_is_stable_at_any_speed() -> None:
    for precision in builds.PRECISIONS:
        checks_reference_model.check_model_stable_when_slow(units.tracking(precision))


def test_its_rear_wheels_follow_as_the_actuator_s() -> None:
    for precision in builds.PRECISIONS:
        checks_reference_model.check_model_actuator(units.tracking(precision))


def test_the_curves_keep_their_stated_error(model: Units) -> None:
    checks_reference_model.check_curves(model)


@given(
    st.tuples(*[st.floats(width=32)] * 3),
    st.lists(st.tuples(*[st.floats(width=32)] * 4), min_size=1, max_size=20),
)
def test_no_sequence_of_inputs_leads_out_of_bounds(start: tuple[float, ...], inputs: list[tuple[float, ...]]) -> None:
    car = units.tracking()
    begun = car.model_start(np.array([start], dtype=np.float32))[0]
    states = car.model(begun, np.array(inputs, dtype=np.float32))
    assert np.isfinite(states).all()
    assert (np.abs(states) <= checks_reference_model.limits(car)[0]).all()
