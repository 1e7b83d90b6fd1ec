"""What may be moved: bounds from the configuration's own models, and the configuration that comes of it."""

from __future__ import annotations

import math

import pytest

from codegen.config import parse
from codegen.errors import ConfigError
from codegen.explore.controls import ExploreError, apply, checked, controls_of, start_values
from codegen.explore.explorer import Explorer
from codegen.refmap.road import on_road


def configured(explorer: Explorer, **moved: float) -> object:
    return explorer.configured({key.replace("__", "."): value for key, value in moved.items()})


def test_the_bounds_of_what_may_be_typed_are_those_of_the_models(pi: Explorer, tracking: Explorer) -> None:
    bounds = {control.key: control.bounds for control in (*pi.controls, *tracking.controls)}
    assert bounds["lambda"] == (0.0, 1e7)
    assert bounds["limits.sideslip_max_deg"] == (0.2, 20.0)
    assert bounds["road.friction"] == (0.05, 1.5)
    assert bounds["controller.integral_gain"] == (0.0, 100.0)
    assert bounds["controller.tracking.lead_s"] == (0.0, 0.2)


def test_every_slider_lies_within_its_bounds_and_reaches_where_it_starts(pi: Explorer, tracking: Explorer) -> None:
    for control in (*pi.controls, *tracking.controls):
        assert control.bounds[0] <= control.low <= control.value <= control.high <= control.bounds[1], control.key
        assert control.low < control.high
        assert not control.logarithmic or control.low > 0.0


@pytest.mark.parametrize(("value", "low", "high"), [(4.0, 4.0, 1e5), (2e6, 10.0, 2e6), (0.0, 10.0, 1e5)])
def test_a_slider_of_ratios_reaches_a_start_beyond_its_usual_ends(pi: Explorer, value: float, low: float, high: float) -> None:
    data = pi.start.model_dump(mode="json")
    data["cases"][pi.case]["sideslip_weight_per_s2"] = value
    found = {control.key: control for control in controls_of(parse(data, "test"), pi.case)}["lambda"]
    # Zero is no ratio: the page has a stop of its own for it.
    assert (found.value, found.low, found.high) == (value, low, high)


@pytest.mark.parametrize(("value", "low", "high"), [(0.3, 0.3, 8.0), (15.0, 0.5, 15.0)])
def test_a_slider_of_values_reaches_a_start_beyond_its_usual_ends(pi: Explorer, value: float, low: float, high: float) -> None:
    data = pi.start.model_dump(mode="json")
    data["limits"]["sideslip_max_deg"] = value
    found = {control.key: control for control in controls_of(parse(data, "test"), pi.case)}["limits.sideslip_max_deg"]
    assert (found.value, found.low, found.high) == (value, low, high)


def test_nothing_moved_is_the_configuration_of_the_start_itself(tracking: Explorer) -> None:
    assert tracking.configured({}) is tracking.start
    assert tracking.configured(start_values(tracking.controls)) is tracking.start


def test_a_step_changes_no_configuration(pi: Explorer) -> None:
    assert pi.configured({"step.speed_km_h": 80.0, "step.angle_deg": 20.0, "step.road_percent": 60.0}) is pi.start


def test_each_setting_reaches_its_key_and_no_other(pi: Explorer) -> None:
    data = pi.start.model_dump(mode="json")
    data["cases"]["4ws-2"]["sideslip_weight_per_s2"] = 100.0
    data["limits"]["rear_angle_max_deg"] = 2.0
    data["controller"]["integral_gain"] = 0.25
    found = pi.configured({"lambda": 100.0, "limits.rear_angle_max_deg": 2.0, "controller.integral_gain": 0.25})
    assert found.model_dump(mode="json") == data


def test_friction_leaves_the_tyres_as_they_are(pi: Explorer) -> None:
    assert pi.configured({"road.friction": 0.5}) == on_road(pi.start, 0.5)


def test_the_schedule_is_scaled_as_a_whole_and_loses_the_margins_of_other_gains(tracking: Explorer) -> None:
    before = tracking.start.controller.tracking.schedule
    after = tracking.configured({"proportional_percent": 50.0}).controller.tracking.schedule
    assert before is not None
    assert after is not None
    # Six digits are kept of each product.
    assert after.proportional_gain_s == pytest.approx([0.5 * gain for gain in before.proportional_gain_s], rel=1e-5)
    assert after.integral_gain == before.integral_gain
    assert (before.gain_margin_db is None, after.gain_margin_db) == (False, None)


@pytest.mark.parametrize("value", [math.nan, math.inf, 10**400, -(10**400), "3", None, True, [3.0], 21.0, -1.0])
def test_what_is_no_number_within_the_bounds_is_refused_with_the_setting_s_name(pi: Explorer, value: object) -> None:
    with pytest.raises(ExploreError, match=r"^Sideslip limit: .*0\.2 to 20 deg"):
        checked(pi.controls, {"limits.sideslip_max_deg": value})


def test_unknown_settings_are_refused(pi: Explorer, tracking: Explorer) -> None:
    with pytest.raises(ExploreError, match="lead_s"):
        checked(pi.controls, {"controller.tracking.lead_s": 0.01})
    with pytest.raises(ExploreError, match="table"):
        checked(tracking.controls, [1, 2])


def test_rules_between_keys_are_the_models_own(tracking: Explorer) -> None:
    values = start_values(tracking.controls) | {"integral_percent": 1000.0, "proportional_percent": 1000.0}
    apply(tracking.start, tracking.case, tracking.controls, values)
    data = tracking.start.model_dump(mode="json")
    data["controller"]["inputs"]["friction_max"] = 1.0
    tight = type(tracking.start).model_validate(data)
    with pytest.raises(ConfigError, match=r"friction_max must not be below road\.friction"):
        apply(tight, tracking.case, tracking.controls, start_values(tracking.controls) | {"road.friction": 1.2})
