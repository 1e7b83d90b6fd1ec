"""Magic Formula tyre: its force compared with the textbook formula, its peak, and the end of its linear range."""

import math
from typing import Any

import numpy as np
import pytest

from codegen.configuration import Tyre
from codegen.errors import ConfigError
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre
from tests.builds import CONFIG
from tests.whole_car import car

LOAD = 5_700.0
FRICTION = 0.9
STIFFNESS = 119_540.0


def tyre(**factors: Any) -> MagicFormulaTyre:
    """Return a tyre at 5.7 kN and friction 0.9 with the paper's factors except for `factors`."""
    if "stiffness_factor_b_per_rad" not in factors:
        factors.setdefault("cornering_stiffness_n_per_rad", STIFFNESS)
    return MagicFormulaTyre.from_config(Tyre(**factors), LOAD, FRICTION)


def formula(slip: float, b: float, c: float, d: float, e: float) -> float:
    """Return the textbook Magic Formula."""
    x = b * slip
    return d * math.sin(c * math.atan(x - e * (x - math.atan(x))))


def test_numbers_of_the_paper() -> None:
    tyres = AxleTyres.from_config(CONFIG)
    # Published with three decimals of a degree.
    assert (round(math.degrees(tyres.front_slip_bound), 3), round(math.degrees(tyres.rear_slip_bound), 3)) == (1.566, 1.570)


@pytest.mark.parametrize("percent", [0.5, 10.0, 50.0])
@pytest.mark.parametrize(
    "factors",
    [
        {},
        {"curvature_factor_e": -20.0},  # departs upward first
        {"curvature_factor_e": -4.0},  # rises a little before it falls
        {"curvature_factor_e": 1.0, "horizontal_shift_deg": 0.4, "vertical_shift_n": 150.0},  # the shifts have no effect
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

    # The root is accurate to 1e-15 rad, and the departure, a quotient near one, changes by less than 100 per rad.
    assert departure(bound) == pytest.approx(percent / 100.0, abs=1e-12)
    assert max(departure(slip) for slip in np.linspace(0.0, bound, 2_001)[1:-1]) < percent / 100.0


def test_a_tyre_that_never_departs_is_refused() -> None:
    # With B = 0.5/rad, 45 degrees of slip are still in the linear range.
    config = car({"tyre": {"rear": {"stiffness_factor_b_per_rad": 0.5}}})
    with pytest.raises(ConfigError, match=r"^tyre\.rear: .*never departs 10 %.*45 deg.*limits\.slip_departure_percent"):
        AxleTyres.from_config(config)


@pytest.mark.parametrize(
    "factors",
    [
        {},
        {"peak_factor_p1": 1.3, "peak_load_sensitivity_p2": -0.4},
        {"peak_load_sensitivity_p2": -0.9},
        {"shape_factor_c": 1.9, "curvature_factor_e": 1.0, "horizontal_shift_deg": 0.4, "vertical_shift_n": 150.0},
        {"stiffness_factor_b_per_rad": 12.0, "shape_factor_c": 1.5, "peak_factor_p1": 1.2},
    ],
)
def test_force_is_the_formula(factors: dict[str, float]) -> None:
    """A configured stiffness sets B at nominal load and friction; B stays constant under others, and the curve scales with
    D."""
    this = tyre(**factors)
    data = Tyre(**{"stiffness_factor_b_per_rad": 1.0, **factors})
    c, e, p1, p2 = data.shape_factor_c, data.curvature_factor_e, data.peak_factor_p1, data.peak_load_sensitivity_p2
    nominal = FRICTION * LOAD * p1
    b = factors.get("stiffness_factor_b_per_rad", STIFFNESS / (c * nominal))
    assert this.cornering_stiffness == pytest.approx(b * c * nominal, rel=1e-14)
    shift, force = math.radians(data.horizontal_shift_deg), data.vertical_shift_n
    slips = np.array([[-0.3, -0.027, -1e-4], [0.0, 1e-4, 0.3]])
    for load, friction in ((LOAD, FRICTION), (LOAD, 0.3), (0.5 * LOAD, FRICTION), (1.5 * LOAD, 0.8), (3.0 * LOAD, FRICTION)):
        d = friction * max(p1 + p2 * (load / LOAD - 1.0), 0.0) * load  # never negative, at -0.9 and three times the load
        assert this.peak(load, friction) == pytest.approx(d, rel=1e-14)
        expected = [[formula(slip - shift, b, c, d, e) + force for slip in row] for row in slips]
        # A dozen roundings of 1.1e-16 each, relative to the two terms near the zero of a shifted curve.
        np.testing.assert_allclose(this.force(slips, load, friction), expected, rtol=2e-15, atol=1e-12 if force else 0.0)
    assert np.array_equal(this.force(slips), this.force(slips, LOAD, FRICTION))
    # The curve is flat at its peak, so 1e-12 of the force corresponds to 1e-6 of the slip.
    assert float(this.force(this.peak_slip + shift)) == pytest.approx(this.peak(LOAD, FRICTION) + force, rel=1e-12)
    assert tyre(shape_factor_c=1.0).peak_slip == math.inf
