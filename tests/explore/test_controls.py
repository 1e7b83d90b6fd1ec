"""The controls: bounds from the models of the configuration, and the configuration that results from the settings."""

import math

import pytest

from codegen.config import parse
from codegen.errors import ConfigError
from codegen.explore.controls import ExploreError, apply, checked, controls_of, start_values
from codegen.explore.explorer import Explorer
from codegen.refmap.road import on_road


def test_bounds_are_those_of_the_models_and_sliders_lie_within(pi: Explorer, tracking: Explorer) -> None:
    controls = {control.key: control for control in (*pi.controls, *tracking.controls)}
    for key, bounds in {
        "lambda": (0.0, 1e7),
        "limits.sideslip_max_deg": (0.2, 20.0),
        "road.friction": (0.05, 1.5),
        "controller.integral_gain": (0.0, 100.0),
        "controller.tracking.lead_s": (0.0, 0.2),
    }.items():
        assert controls[key].bounds == bounds
    for control in controls.values():
        assert control.bounds[0] <= control.low <= control.value <= control.high <= control.bounds[1], control.key
        assert control.low < control.high
        assert not control.logarithmic or control.low > 0.0


@pytest.mark.parametrize(
    ("value", "low", "high"),
    [(4.0, 4.0, 1e5), (2e6, 10.0, 2e6), (0.0, 10.0, 1e5)],  # zero is no ratio: the page has a stop of its own for it
)
def test_a_slider_reaches_a_start_beyond_its_usual_ends(pi: Explorer, value: float, low: float, high: float) -> None:
    data = pi.start.model_dump(mode="json")
    data["cases"][pi.case]["sideslip_weight_per_s2"] = value
    found = {control.key: control for control in controls_of(parse(data, "test"), pi.case)}["lambda"]
    assert (found.value, found.low, found.high) == (value, low, high)


def test_each_setting_reaches_its_key_alone(pi: Explorer, tracking: Explorer) -> None:
    assert tracking.configured({}) is tracking.start
    assert tracking.configured(start_values(tracking.controls)) is tracking.start
    assert pi.configured({"step.speed_km_h": 80.0, "step.angle_deg": 20.0, "step.road_percent": 60.0}) is pi.start
    data = pi.start.model_dump(mode="json")
    data["cases"]["4ws-2"]["sideslip_weight_per_s2"] = 100.0
    data["limits"]["rear_angle_max_deg"] = 2.0
    data["controller"]["integral_gain"] = 0.25
    found = pi.configured({"lambda": 100.0, "limits.rear_angle_max_deg": 2.0, "controller.integral_gain": 0.25})
    assert found.model_dump(mode="json") == data
    assert pi.configured({"road.friction": 0.5}) == on_road(pi.start, 0.5)  # the tyres stay as they are
    before = tracking.start.controller.tracking.schedule
    after = tracking.configured({"proportional_percent": 50.0}).controller.tracking.schedule
    assert before is not None and after is not None
    # Six digits are kept of each product.
    assert after.proportional_gain_s == pytest.approx([0.5 * gain for gain in before.proportional_gain_s], rel=1e-5)
    assert after.integral_gain == before.integral_gain
    assert (before.gain_margin_db is None, after.gain_margin_db) == (False, None)  # the margins of other gains


def test_messages_for_bad_values_and_unknown_settings(pi: Explorer, tracking: Explorer) -> None:
    for value in (math.nan, math.inf, 10**400, -(10**400), "3", None, True, [3.0], 21.0, -1.0):
        with pytest.raises(ExploreError, match=r"^Sideslip limit: .*0\.2 to 20 deg"):
            checked(pi.controls, {"limits.sideslip_max_deg": value})
    with pytest.raises(ExploreError, match="lead_s"):
        checked(pi.controls, {"controller.tracking.lead_s": 0.01})
    with pytest.raises(ExploreError, match="table"):
        checked(tracking.controls, [1, 2])


def test_rules_between_keys_are_those_of_the_models(tracking: Explorer) -> None:
    data = tracking.start.model_dump(mode="json")
    data["controller"]["inputs"]["friction_max"] = 1.0
    with pytest.raises(ConfigError, match=r"friction_max must not be below road\.friction"):
        apply(parse(data, "test"), tracking.case, tracking.controls, start_values(tracking.controls) | {"road.friction": 1.2})
