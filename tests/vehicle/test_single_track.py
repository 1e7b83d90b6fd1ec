"""The closed forms of the steady turn compared with the CasADi model, solved numerically, and with published numbers."""

import math

import casadi as ca
import numpy as np
import pytest

from codegen.configuration import parse
from codegen.vehicle.dynamics import Model, single_track
from codegen.vehicle.single_track import SingleTrack
from tests.vehicle.reference_plant import Car, TyreData, tables

# At nine tenths of the critical speed the stabilising stiffness is the difference of two terms five times as large. With some
# twenty roundings of 1.1e-16 in each, the two methods agree to about 1e-14 (measured over these cars: 4e-15).
TOLERANCE = 1e-13


def state_space(model: Model, speed: float) -> tuple[np.ndarray, np.ndarray]:
    """Return A (2, 2) over [beta, r] and B (2, 2) over [delta_f, delta_r] of the CasADi model."""
    dfdx, dfdu = model.jacobian(ca.DM.zeros(2), ca.DM([speed, 0.0, 0.0, 0.9]))
    return np.array(dfdx), np.array(dfdu)[:, 1:3]


def slowest_pole(model: Model, speed: float) -> float:
    return float(np.linalg.eigvals(state_space(model, speed)[0]).real.max())


def test_closed_forms_solve_the_linear_model() -> None:
    """Cars range from a small one to a van; about half of them oversteer, and then have a critical speed."""
    rng = np.random.default_rng(20_240_517)
    oversteering = 0
    for _ in range(50):
        front_arm, rear_arm, mass, inertia = rng.uniform([0.9, 0.9, 700.0, 800.0], [2.2, 2.2, 3_500.0, 8_000.0])
        front, rear = (TyreData(slope) for slope in rng.uniform(30_000.0, 150_000.0, 2))
        described = Car(mass, inertia, to_front=front_arm, to_rear=rear_arm, front=front, rear=rear)
        config = parse(tables(described), "test")
        car, model = SingleTrack.from_config(config), single_track(config, "linear")
        speed = float(rng.uniform(3.0, min(70.0, 0.9 * car.critical_speed)))
        a, b = state_space(model, speed)
        for front_angle, rear_angle in ((0.05, 0.0), (0.0, 0.03), (0.04, -0.02)):
            yaw_rate = float(car.yaw_gain(speed)) * (front_angle - rear_angle)
            beta = rear_angle + float(car.sideslip_per_yaw_rate(speed)) * yaw_rate
            solved_beta, solved_yaw_rate = np.linalg.solve(a, -b @ np.array([front_angle, rear_angle]))
            assert yaw_rate == pytest.approx(solved_yaw_rate, rel=TOLERANCE)
            assert (yaw_rate > 0.0) == (front_angle > rear_angle)
            # beta passes through zero where its two terms cancel, so the tolerance scales with the terms.
            assert beta == pytest.approx(solved_beta, abs=TOLERANCE * (abs(rear_angle) + abs(beta - rear_angle) + 0.1))
            slip_front = solved_beta + car.front_arm * solved_yaw_rate / speed - front_angle
            slip_rear = solved_beta - car.rear_arm * solved_yaw_rate / speed - rear_angle
            acceleration = speed * solved_yaw_rate
            # Differences of angles of some 0.1 rad: absolute.
            assert slip_front == pytest.approx(-car.front_slip_per_lateral_acceleration * acceleration, abs=TOLERANCE)
            assert slip_rear == pytest.approx(-car.rear_slip_per_lateral_acceleration * acceleration, abs=TOLERANCE)
        critical = car.critical_speed
        oversteering += math.isfinite(critical)
        assert (critical < math.inf) == (car.understeer_coefficient < 0.0)
        if math.isinf(critical):
            assert slowest_pole(model, 150.0) < 0.0
        else:
            assert slowest_pole(model, 0.999 * critical) < 0.0 < slowest_pole(model, 1.001 * critical)
    assert 12 < oversteering < 38
