"""Magic Formula tyre: slope at zero, the end of its linear range, and the effect of load, friction and shifts."""

from __future__ import annotations

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
    """A tyre at 5.7 kN and friction 0.9, with the paper's factors except for `factors`."""
    if "stiffness_factor_b_per_rad" not in factors:
        factors.setdefault("cornering_stiffness_n_per_rad", STIFFNESS)
    return MagicFormulaTyre.from_config(Tyre(**factors), LOAD, FRICTION)


def formula(slip: float, b: float, c: float, d: float, e: float) -> float:
    """The Magic Formula as books print it."""
    x = b * slip
    return d * math.sin(c * math.atan(x - e * (x - math.atan(x))))


def test_numbers_of_the_paper(paper: Config) -> None:
    tyres = AxleTyres.from_config(paper)
    # Published to three decimals of a degree.
    assert round(math.degrees(tyres.front_slip_bound), 3) == 1.566
    assert round(math.degrees(tyres.rear_slip_bound), 3) == 1.570
    front, rear = static_wheel_loads(paper)
    assert 2.0 * (front + rear) == pytest.approx(2335.07 * 9.81, rel=1e-14)
    assert front * 1.574 == pytest.approx(rear * 1.566, rel=1e-14)


@pytest.mark.parametrize("percent", [0.5, 10.0, 50.0])
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
    assert max(departure(slip) for slip in np.linspace(0.0, bound, 2_001)[1:-1]) < percent / 100.0


def test_departure_percent_is_configurable() -> None:
    for percent in (2.0, 20.0):
        tyres = AxleTyres.from_config(parse({"limits": {"slip_departure_percent": percent}}, "test"))
        assert tyres.front.departure(tyres.front_slip_bound) == pytest.approx(percent / 100.0, abs=1e-12)
        assert tyres.rear.departure(tyres.rear_slip_bound) == pytest.approx(percent / 100.0, abs=1e-12)


@pytest.mark.parametrize("axle", ["front", "rear"])
def test_a_tyre_that_never_departs_is_refused(axle: str) -> None:
    # With B = 0.5/rad, 45 degrees of slip are still in the straight part of the curve.
    config = parse({"tyre": {axle: {"stiffness_factor_b_per_rad": 0.5}}}, "test")
    with pytest.raises(
        ConfigError, match=rf"^tyre\.{axle}: .*never departs 10 %.*45 deg.*limits\.slip_departure_percent"
    ) as caught:
        AxleTyres.from_config(config)
    assert caught.value.exit_code == 2


@pytest.mark.parametrize("factors", [{}, {"peak_factor_p1": 1.3, "peak_load_sensitivity_p2": -0.4}, {"shape_factor_c": 1.9}])
def test_force_is_the_formula_with_the_configured_slope(factors: dict[str, float]) -> None:
    this = tyre(**factors)
    c, d = factors.get("shape_factor_c", 1.3), FRICTION * LOAD * factors.get("peak_factor_p1", 1.0)
    slips = np.array([[-0.3, -0.027, -1e-4], [0.0, 1e-4, 0.3]])
    # rel: a dozen roundings, each of 1.1e-16.
    expected = [[formula(slip, STIFFNESS / (c * d), c, d, -0.5) for slip in row] for row in slips]
    np.testing.assert_allclose(this.force(slips), expected, rtol=2e-15)
    assert this.cornering_stiffness == pytest.approx(STIFFNESS, rel=1e-14)
    # The curve is odd, so it departs from its tangent by the cube of the slip: (B 1e-6)^2 = 3e-10.
    assert float(this.force(1e-6)) / 1e-6 == pytest.approx(STIFFNESS, rel=1e-9)


def test_b_in_place_of_a_stiffness() -> None:
    this = tyre(stiffness_factor_b_per_rad=12.0, shape_factor_c=1.5, peak_factor_p1=1.2)
    assert this.stiffness_factor == 12.0
    assert this.cornering_stiffness == pytest.approx(12.0 * 1.5 * FRICTION * 1.2 * LOAD, rel=1e-14)


def test_peak_depends_on_load_by_p1_and_p2() -> None:
    this = tyre(peak_factor_p1=1.1, peak_load_sensitivity_p2=-0.2)
    # dFz = 0.5: D = mu (1.1 - 0.1) 1.5 Fz0.
    assert this.peak(1.5 * LOAD, 0.8) == pytest.approx(0.8 * 1.0 * 1.5 * LOAD, rel=1e-14)
    assert this.peak(LOAD, 0.8) == pytest.approx(0.8 * 1.1 * LOAD, rel=1e-14)
    steep = tyre(peak_load_sensitivity_p2=-0.9)
    assert steep.peak(3.0 * LOAD, FRICTION) == 0.0  # 1 - 0.9 * 2 < 0: it never turns negative
    assert steep.force(0.1, 3.0 * LOAD) == 0.0


def test_friction_and_load_keep_b() -> None:
    """B fixed: the whole curve scales with D. The configured stiffness belongs to the nominal friction, which sets B."""
    slips = np.linspace(-0.5, 0.5, 101)
    for load, friction in ((LOAD, 0.3), (0.5 * LOAD, FRICTION), (1.7 * LOAD, 1.2)):
        scale = friction * load / (FRICTION * LOAD)
        assert tyre().force(slips, load, friction) == pytest.approx(tyre().force(slips) * scale, rel=1e-14)
    slippery = MagicFormulaTyre.from_config(Tyre(cornering_stiffness_n_per_rad=STIFFNESS), LOAD, 0.45)
    assert slippery.stiffness_factor == pytest.approx(2.0 * tyre().stiffness_factor, rel=1e-14)


def test_shifts_move_the_curve_but_not_the_bound() -> None:
    plain, shifted = tyre(), tyre(horizontal_shift_deg=0.4, vertical_shift_n=150.0)
    slips = np.linspace(-0.3, 0.3, 61)
    # atol: slip + shift - shift is off by 1e-16 rad, times 1e5 N/rad.
    np.testing.assert_allclose(shifted.force(slips + math.radians(0.4)), plain.force(slips) + 150.0, rtol=1e-13, atol=1e-10)
    assert shifted.slip_bound(0.1) == plain.slip_bound(0.1)
    assert shifted.cornering_stiffness == plain.cornering_stiffness
    # The vertical shift is a force by itself: it does not scale with friction.
    assert shifted.force(math.radians(0.4), friction=0.2) == 150.0


@pytest.mark.parametrize("factors", [{}, {"curvature_factor_e": 1.0, "shape_factor_c": 1.9}])
def test_peak_slip_is_where_the_force_is_largest(factors: dict[str, float]) -> None:
    this = tyre(**factors)
    # At the peak the sine is one; there the curve is flat, so 1e-12 of the force is 1e-6 of the slip.
    assert float(this.force(this.peak_slip)) == pytest.approx(this.peak(LOAD, FRICTION), rel=1e-12)
    assert tyre(shape_factor_c=1.0).peak_slip == math.inf
