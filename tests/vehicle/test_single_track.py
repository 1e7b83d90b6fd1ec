"""The closed forms of the steady turn against the CasADi model, solved numerically, and against published numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from codegen.config import Config, parse
from codegen.vehicle.dynamics import Model, single_track
from codegen.vehicle.single_track import SingleTrack

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Sample:
    """A random car, its linear model, and one speed (m/s) below nine tenths of its critical speed."""

    car: SingleTrack
    model: Model
    speed: float

    def state_space(self, speed: float | None = None) -> tuple[FloatArray, FloatArray]:
        """A (2, 2) over [beta, r] and B (2, 2) over [delta_f, delta_r] of the CasADi model."""
        dfdx, dfdu = self.model.jacobian(ca.DM.zeros(2), ca.DM([speed or self.speed, 0.0, 0.0, 0.9]))
        return np.array(dfdx), np.array(dfdu)[:, 1:3]

    def steady_state(self, front: float, rear: float) -> FloatArray:
        """[beta, r] of the steady turn, by solving the linear system."""
        a, b = self.state_space()
        return np.linalg.solve(a, -b @ np.array([front, rear]))


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    """Cars between a small one and a van; about half of them oversteer."""
    rng = np.random.default_rng(20_240_517)
    found = []
    for _ in range(50):
        front_arm, rear_arm = rng.uniform(0.9, 2.2, 2)
        tables = {
            "vehicle": {
                "mass_kg": float(rng.uniform(700.0, 3_500.0)),
                "yaw_inertia_kg_m2": float(rng.uniform(800.0, 8_000.0)),
                "cg_to_front_axle_m": float(front_arm),
                "cg_to_rear_axle_m": float(rear_arm),
            },
            "tyre": {
                axle: {"cornering_stiffness_n_per_rad": float(rng.uniform(30_000.0, 150_000.0))} for axle in ("front", "rear")
            },
        }
        config = parse(tables, "test")
        car = SingleTrack.from_config(config)
        speed = float(rng.uniform(3.0, min(70.0, 0.9 * car.critical_speed)))
        found.append(Sample(car, single_track(config, "linear"), speed))
    assert 12 < sum(sample.car.understeer_coefficient < 0.0 for sample in found) < 38
    return found


# At nine tenths of the critical speed the stiffness that keeps the car straight is the difference of two terms five times as
# large; with some twenty roundings of 1.1e-16 in each the two ways agree to about 1e-14 (measured over these cars: 4e-15).
TOLERANCE = 1e-13


def test_closed_forms_solve_the_linear_model(samples: list[Sample]) -> None:
    for sample in samples:
        car, speed = sample.car, sample.speed
        for front, rear in ((0.05, 0.0), (0.0, 0.03), (0.04, -0.02)):
            yaw_rate = float(car.yaw_gain(speed)) * (front - rear)
            beta = rear + float(car.sideslip_per_yaw_rate(speed)) * yaw_rate
            solved_beta, solved_yaw_rate = sample.steady_state(front, rear)
            assert yaw_rate == pytest.approx(solved_yaw_rate, rel=TOLERANCE)
            assert (yaw_rate > 0.0) == (front > rear)
            # beta passes through zero where its two terms cancel: the scale is that of the terms.
            assert beta == pytest.approx(solved_beta, abs=TOLERANCE * (abs(rear) + abs(beta - rear) + 0.1))
            slip_front = solved_beta + car.front_arm * solved_yaw_rate / speed - front
            slip_rear = solved_beta - car.rear_arm * solved_yaw_rate / speed - rear
            acceleration = speed * solved_yaw_rate
            # Differences of angles of some 0.1 rad: absolute.
            assert slip_front == pytest.approx(-car.front_slip_per_lateral_acceleration * acceleration, abs=TOLERANCE)
            assert slip_rear == pytest.approx(-car.rear_slip_per_lateral_acceleration * acceleration, abs=TOLERANCE)


def test_critical_speed_is_where_stability_ends(samples: list[Sample]) -> None:
    def slowest_pole(sample: Sample, speed: float) -> float:
        return float(np.linalg.eigvals(sample.state_space(speed)[0]).real.max())

    for sample in samples:
        critical = sample.car.critical_speed
        if math.isinf(critical):
            assert slowest_pole(sample, 150.0) < 0.0
        else:
            assert slowest_pole(sample, 0.999 * critical) < 0.0 < slowest_pole(sample, 1.001 * critical)


def test_neutral_car_has_no_critical_speed() -> None:
    car = SingleTrack(mass=1_000.0, yaw_inertia=1_500.0, front_arm=1.2, rear_arm=1.2, front_stiffness=1e5, rear_stiffness=1e5)
    assert car.understeer_coefficient == 0.0
    assert car.critical_speed == math.inf
    assert car.yaw_gain(np.array([[12.0], [24.0]])) == pytest.approx(np.array([[5.0], [10.0]]), rel=1e-15)  # vx/L


def test_published_numbers(paper: Config) -> None:
    """The paper's front-steered car at 4 degrees, published as 15.35 deg/s and 1.101 deg at "43.9 km/h".

    The exact steady state has this yaw rate at 43.35 km/h, to its last printed digit, and this sideslip within 1 %.
    """
    car = SingleTrack.from_config(paper)
    assert (car.front_stiffness, car.rear_stiffness) == pytest.approx((2.0 * 119_540.0, 2.0 * 119_830.0), rel=1e-14)
    for speed_km_h, expected in ((43.9, (15.544, 1.070)), (43.35, (15.349, 1.093))):
        yaw_rate = 4.0 * float(car.yaw_gain(speed_km_h / 3.6))
        sideslip = yaw_rate * float(car.sideslip_per_yaw_rate(speed_km_h / 3.6))
        assert (round(yaw_rate, 3), round(abs(sideslip), 3)) == expected
    # Its slip bounds stop it at 0.572 g; they are rounded to 5e-4 deg of 1.57: 3e-4 of the result.
    accelerations = (
        math.radians(1.566) / car.front_slip_per_lateral_acceleration,
        math.radians(1.570) / car.rear_slip_per_lateral_acceleration,
    )
    assert accelerations == pytest.approx((0.572 * 9.81, 0.572 * 9.81), rel=1e-3)
