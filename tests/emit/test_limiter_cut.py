"""The limiter's bound derived from the car, and the part of a map that it cuts off."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen import configuration
from codegen.configuration import Config
from codegen.emit.limiter_view import LimiterCut, cut_text, opposite_phase_max, opposite_phase_speeds_km_h
from codegen.judgement.car_warnings import car_warnings
from codegen.optimum.solve import solve_case
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack

FIXED = [50.0, 62.0, 80.0, 110.0, 160.0, 400.0]
"""km/h: breakpoints of a table that is independent of the car."""


def car(rear_deg: float, **limiter: object) -> Config:
    """Return a short car with this much rear steering, in the map and at the actuator."""
    return configuration.preset("recommended").replace(
        {
            "vehicle": {"mass_kg": 1520.0, "cg_to_front_axle_m": 1.3, "cg_to_rear_axle_m": 1.3},
            "limits": {"rear_angle_max_deg": rear_deg},
            "rear_actuator": {"angle_max_deg": rear_deg},
            "limiter": limiter,
        }
    )


@pytest.mark.parametrize("rear_deg", [0.5, 3.5, 5.0, 12.0])
def test_the_bound_from_the_car_allows_the_whole_angle_at_low_speed(rear_deg: float) -> None:
    config = car(rear_deg)
    speeds, bounds = np.array(opposite_phase_speeds_km_h(config)) * KM_H, np.array(opposite_phase_max(config))
    single, wanted = SingleTrack.from_config(config), config.limiter.opposite_phase_lateral_acceleration_m_s2

    def exact(speed: np.ndarray) -> np.ndarray:
        return wanted * (single.wheelbase / speed**2 + single.understeer_coefficient)

    assert bounds[0] == config.rear_actuator.angle_max
    assert exact(speeds[:1])[0] == pytest.approx(bounds[0], rel=0.02)  # rounded down to 0.1 km/h, at 15 km/h or more
    assert speeds[-1] == config.controller.inputs.speed_max_km_h * KM_H
    np.testing.assert_allclose(bounds[1:], exact(speeds[1:]), rtol=1e-12)
    # The error of a chord is f'' h^2/8: with five cells even in 1/vx at most 6/8/25 = 3 % of the bound. Rounding the first
    # speed by 0.1 km/h moves the bound there by at most 1 % (2 x 0.1 km/h of 20 km/h).
    between = np.geomspace(speeds[0], speeds[-1], 2000)
    error = (np.interp(between, speeds, bounds) - np.minimum(exact(between), bounds[0])) / bounds[0]
    assert error.min() > -0.01 and error.max() < 0.03


def test_an_oversteering_car_keeps_an_angle_for_its_feedback_and_is_warned_of() -> None:
    config = car(3.5).replace({"tyre": {"rear": {"cornering_stiffness_n_per_rad": 60e3}}})
    speed = np.array(opposite_phase_speeds_km_h(config)) * KM_H
    critical = SingleTrack.from_config(config).critical_speed
    assert critical < speed[-1]
    np.testing.assert_allclose(opposite_phase_max(config)[1:], 4.0 * 2.6 / speed[1:] ** 2, rtol=1e-12)
    assert f"unstable from {critical / KM_H:.0f} km/h" in "\n".join(car_warnings(config))
    assert "unstable from" not in "\n".join(
        car_warnings(config.replace({"controller": {"inputs": {"speed_max_km_h": 0.99 * critical / KM_H}}}))
    )


def test_share_of_the_map_that_the_limiter_cuts() -> None:
    """A table that starts at 50 km/h holds its first bound below and cuts the map there; the bound from the car cuts
    nothing."""
    fixed = car(5.0, opposite_phase_speed_km_h=FIXED)
    made = solve_case(fixed.replace({"grid": {"speed_points": 21, "front_angle_points": 20}}), "4ws-2")
    found = LimiterCut.of_map(made, fixed)
    bound, gain = opposite_phase_max(fixed)[0], SingleTrack.from_config(fixed).yaw_gain(made.speed)
    below = made.speed <= 50.0 * KM_H
    outside = np.where(made.feasible, -made.rear_angle - bound, 0.0)[below]
    assert found.of == made.feasible.sum()
    assert found.cells >= (outside > 1e-6).sum() > 20
    assert found.largest == pytest.approx((outside * gain[below, np.newaxis]).max(), rel=1e-12)
    assert f"{found.cells} of {found.of} feasible cells" in cut_text(found.to_dict())
    # A bare table is assumed to steer like the linear car, for which this map is solved.
    assert LimiterCut.of_map(replace(made, rear_angle=None), fixed).cells == found.cells
    nothing = LimiterCut.of_map(made, car(5.0))
    assert (nothing.cells, nothing.largest, cut_text(nothing.to_dict())) == (0, 0.0, "nothing")
    assert math.isnan(nothing.speed)
