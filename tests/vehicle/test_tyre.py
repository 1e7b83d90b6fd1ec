"""Magic Formula tyre: slope at zero, the end of its linear range, and what load, friction and shifts change."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from codegen.config import Config, Tyre, parse
from codegen.errors import ConfigError
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre, static_wheel_loads

LOAD = 5_700.0
FRICTION = 0.9
STIFFNESS = 119_540.0


def tyre(**factors: Any) -> MagicFormulaTyre:
    """A tyre with the paper's factors but for `factors`, at 5.7 kN and friction 0.9."""
    if "stiffness_factor_b_per_rad" not in factors:
        factors.setdefault("cornering_stiffness_n_per_rad", STIFFNESS)
    return MagicFormulaTyre.from_config(Tyre(**factors), LOAD, FRICTION)


def formula(slip: float, b: float, c: float, d: float, e: float) -> float:
    """The Magic Formula as books print it."""
    x = b * slip
    return d * math.sin(c * math.atan(x - e * (x - math.atan(x))))


def slope(this: MagicFormulaTyre, slip: float, load: float | None = None, friction: float | None = None) -> float:
    """dF/dalpha by central difference.

    A step of 1e-5 rad leaves a relative truncation error of (B h)^2 = 3e-8 at most and a rounding error of 1e-16/(B h) = 1e-12.
    """
    step = 1e-5
    low, high = this.force([slip - step, slip + step], load, friction)
    return float((high - low) / (2.0 * step))


SLOPE_TOLERANCE = 1e-7


# --- the paper's numbers -------------------------------------------------------------------------------------------


def test_slip_bounds_of_the_paper(paper: Config) -> None:
    tyres = AxleTyres.from_config(paper)
    # Published to three decimals of a degree.
    assert round(math.degrees(tyres.front_slip_bound), 3) == 1.566
    assert round(math.degrees(tyres.rear_slip_bound), 3) == 1.570


def test_cornering_stiffness_of_the_paper(paper: Config) -> None:
    tyres = AxleTyres.from_config(paper)
    assert tyres.front.cornering_stiffness == pytest.approx(119_540.0, rel=1e-14)  # a product and a quotient apart
    assert tyres.rear.cornering_stiffness == pytest.approx(119_830.0, rel=1e-14)


def test_static_wheel_loads_balance_weight_and_pitch(paper: Config) -> None:
    front, rear = static_wheel_loads(paper)
    weight = 2335.07 * 9.81
    assert 2.0 * (front + rear) == pytest.approx(weight, rel=1e-14)
    assert front * 1.574 == pytest.approx(rear * 1.566, rel=1e-14)


# --- the linear range ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("percent", [0.5, 1.0, 5.0, 10.0, 20.0, 50.0])
@pytest.mark.parametrize(
    "factors",
    [
        {},
        {"curvature_factor_e": -20.0},  # departs upward first
        {"curvature_factor_e": -4.0},  # rises a little before it falls
        {"curvature_factor_e": 1.0},
        {"shape_factor_c": 0.7},
        {"shape_factor_c": 2.4, "stiffness_factor_b_per_rad": 40.0},
        {"peak_factor_p1": 1.4, "peak_load_sensitivity_p2": -0.3},
    ],
    ids=lambda factors: "-".join(factors) or "paper",
)
def test_slip_bound_is_the_first_departure(factors: dict[str, float], percent: float) -> None:
    this = tyre(**factors)
    bound = this.slip_bound(percent / 100.0)
    b, c, e = this.stiffness_factor, this.shape_factor, this.curvature_factor

    def departure(slip: float) -> float:
        return abs(formula(slip, b, c, 1.0, e) / (b * c * slip) - 1.0)

    # The root is found to 1e-15 rad, the departure changes by less than 100 for each rad, and it is a quotient near one.
    assert departure(bound) == pytest.approx(percent / 100.0, abs=1e-12)
    assert max(departure(slip) for slip in np.linspace(0.0, bound, 20_001)[1:-1]) < percent / 100.0


def test_an_upward_departure_ends_the_linear_range_too() -> None:
    this = tyre(curvature_factor_e=-20.0)
    bound = this.slip_bound(0.1)
    assert this.force(bound) == pytest.approx(1.1 * STIFFNESS * bound, rel=1e-12)
    # It departs downward as well, much later: that root is not the bound.
    assert this.force(0.5) < 0.9 * STIFFNESS * 0.5


def test_a_small_rise_does_not_end_the_linear_range() -> None:
    this = tyre(curvature_factor_e=-4.0)
    slips = np.linspace(0.0, 0.2, 2_000)[1:]
    ratio = this.force(slips) / (STIFFNESS * slips)
    assert 1.005 < ratio.max() < 1.1  # above its tangent, by less than 10 %
    bound = this.slip_bound(0.1)
    assert this.force(bound) == pytest.approx(0.9 * STIFFNESS * bound, rel=1e-12)


def test_slip_bound_scales_with_one_over_b() -> None:
    # B and alpha enter as their product only.
    products = [tyre(stiffness_factor_b_per_rad=b).slip_bound(0.1) * b for b in (2.0, 17.9, 90.0)]
    assert products == pytest.approx([products[0]] * 3, rel=1e-13)


def test_departure_percent_is_configurable(paper: Config) -> None:
    bounds = []
    for percent in (2.0, 5.0, 10.0, 20.0):
        config = parse({"limits": {"slip_departure_percent": percent}}, "test")
        tyres = AxleTyres.from_config(config)
        assert tyres.front.departure(tyres.front_slip_bound) == pytest.approx(percent / 100.0, abs=1e-12)
        assert tyres.rear.departure(tyres.rear_slip_bound) == pytest.approx(percent / 100.0, abs=1e-12)
        bounds.append(tyres.front_slip_bound)
    assert bounds == sorted(bounds)
    assert bounds[2] == AxleTyres.from_config(paper).front_slip_bound


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_a_tyre_that_never_departs_is_refused(axle: str) -> None:
    # With B = 0.5/rad, 45 degrees of slip are still in the straight part of the curve.
    config = parse({"tyre": {axle: {"stiffness_factor_b_per_rad": 0.5}}}, "test")
    with pytest.raises(ConfigError) as caught:
        AxleTyres.from_config(config)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith("tyre")
    assert "never departs" in message
    assert "45 deg" in message
    assert "limits.slip_departure_percent" in caught.value.remedy
    assert caught.value.exit_code == 2


# --- the curve -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("slip", [-0.3, -0.027, -1e-4, 0.0, 1e-4, 0.027, 0.3])
def test_force_is_the_formula(slip: float) -> None:
    this = tyre()
    b = STIFFNESS / (1.3 * FRICTION * LOAD)
    # rel: a dozen roundings, each of 1.1e-16.
    assert this.force(slip) == pytest.approx(formula(slip, b, 1.3, FRICTION * LOAD, -0.5), rel=2e-15)


@pytest.mark.parametrize("factors", [{}, {"peak_factor_p1": 1.3}, {"peak_load_sensitivity_p2": -0.4}, {"shape_factor_c": 1.9}])
def test_configured_stiffness_is_the_slope_at_zero(factors: dict[str, float]) -> None:
    this = tyre(**factors)
    assert this.cornering_stiffness == pytest.approx(STIFFNESS, rel=1e-14)
    assert slope(this, 0.0) == pytest.approx(STIFFNESS, rel=SLOPE_TOLERANCE)


def test_b_in_place_of_a_stiffness() -> None:
    this = tyre(stiffness_factor_b_per_rad=12.0, shape_factor_c=1.5, peak_factor_p1=1.2)
    assert this.stiffness_factor == 12.0
    assert this.cornering_stiffness == pytest.approx(12.0 * 1.5 * FRICTION * 1.2 * LOAD, rel=1e-14)
    assert slope(this, 0.0) == pytest.approx(this.cornering_stiffness, rel=SLOPE_TOLERANCE)


def test_peak_depends_on_load_by_p1_and_p2() -> None:
    this = tyre(peak_factor_p1=1.1, peak_load_sensitivity_p2=-0.2)
    # dFz = 0.5: D = mu (1.1 - 0.1) 1.5 Fz0.
    assert this.peak(1.5 * LOAD, 0.8) == pytest.approx(0.8 * 1.0 * 1.5 * LOAD, rel=1e-14)
    assert this.peak(LOAD, 0.8) == pytest.approx(0.8 * 1.1 * LOAD, rel=1e-14)
    slips = np.linspace(0.0, 1.5, 4_001)
    # The formula reaches D where its sine is one; 4001 points come within 1e-5 of the flat top.
    assert this.force(slips, 1.5 * LOAD, 0.8).max() == pytest.approx(0.8 * 1.5 * LOAD, rel=1e-5)


def test_peak_never_turns_negative() -> None:
    this = tyre(peak_load_sensitivity_p2=-0.9)
    assert this.peak(3.0 * LOAD, FRICTION) == 0.0  # 1 - 0.9 * 2 < 0
    assert this.peak(0.0, FRICTION) == 0.0
    assert this.force(0.1, 3.0 * LOAD) == 0.0


@pytest.mark.parametrize(("load", "friction"), [(LOAD, 0.3), (0.5 * LOAD, FRICTION), (1.7 * LOAD, 1.2)])
def test_friction_and_load_keep_b(load: float, friction: float) -> None:
    """B fixed: the whole curve scales with D, its peak stays at the same slip, and the slope falls with the friction."""
    this = tyre()
    slips = np.linspace(-0.5, 0.5, 101)
    scale = friction * load / (FRICTION * LOAD)
    assert this.force(slips, load, friction) == pytest.approx(this.force(slips) * scale, rel=1e-14)
    assert slope(this, 0.0, load, friction) == pytest.approx(STIFFNESS * scale, rel=SLOPE_TOLERANCE)


def test_nominal_friction_sets_b() -> None:
    """The configured stiffness belongs to the map's friction: on a more slippery nominal road, B is larger."""
    slippery = MagicFormulaTyre.from_config(Tyre(cornering_stiffness_n_per_rad=STIFFNESS), LOAD, 0.45)
    assert slippery.stiffness_factor == pytest.approx(2.0 * tyre().stiffness_factor, rel=1e-14)
    assert slippery.slip_bound(0.1) == pytest.approx(0.5 * tyre().slip_bound(0.1), rel=1e-12)


def test_shifts_move_the_curve_but_not_the_bound() -> None:
    plain = tyre()
    shifted = tyre(horizontal_shift_deg=0.4, vertical_shift_n=150.0)
    slips = np.linspace(-0.3, 0.3, 61)
    # atol: slip + shift - shift is off by 1e-16 rad, times 1e5 N/rad.
    np.testing.assert_allclose(shifted.force(slips + math.radians(0.4)), plain.force(slips) + 150.0, rtol=1e-13, atol=1e-10)
    assert shifted.force(math.radians(0.4)) == 150.0
    assert shifted.slip_bound(0.1) == plain.slip_bound(0.1)
    assert shifted.cornering_stiffness == plain.cornering_stiffness
    # The vertical shift is a force by itself: it does not scale with friction.
    assert shifted.force(math.radians(0.4), friction=0.2) == 150.0


def test_force_keeps_the_shape_of_its_argument_and_is_odd() -> None:
    this = tyre()
    slips = np.linspace(0.0, 0.4, 12).reshape(3, 4)
    assert this.force(slips).shape == (3, 4)
    assert np.array_equal(this.force(-slips), -this.force(slips))
    assert np.all(np.diff(this.force(np.linspace(0.0, 0.1, 50))) > 0.0)  # rising with slip: magnitude-signed


def test_a_tyre_cannot_be_changed() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        tyre().static_load = 1.0  # type: ignore[misc]
