"""The response to a gust: against a solution in continuous time, and over the integral gain."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from codegen.design.family import Member
from codegen.design.gust import DURATION_S, MOMENT_N_M, READ_AFTER_S, gust_response
from codegen.vehicle.single_track import SingleTrack

from .conftest import small_config

SPEED = 100.0 / 3.6


def test_without_feedback_the_car_moves_as_in_continuous_time() -> None:
    config = small_config()
    car, found = SingleTrack.from_config(config), gust_response(small_config(), Member(0.05), SPEED, 0.0, 0.0)

    def rates(time: float, state: list[float]) -> list[float]:
        beta, yaw_rate, heading, _ = state
        front = -car.front_stiffness * (beta + car.front_arm * yaw_rate / SPEED)
        rear = -car.rear_stiffness * (beta - car.rear_arm * yaw_rate / SPEED)
        moment = car.front_arm * front - car.rear_arm * rear + (MOMENT_N_M if time < DURATION_S else 0.0)
        return [
            (front + rear) / (car.mass * SPEED) - yaw_rate,
            moment / car.yaw_inertia,
            yaw_rate,
            SPEED * (heading + beta),
        ]

    end = DURATION_S + READ_AFTER_S
    exact = solve_ivp(rates, (0.0, end), np.zeros(4), max_step=0.002, rtol=1e-8)
    assert found.heading_deg == pytest.approx(math.degrees(exact.y[2, -1]), rel=1e-3)
    assert found.heading_max_deg == pytest.approx(math.degrees(np.abs(exact.y[2]).max()), rel=1e-3)
    assert found.path_m == pytest.approx(exact.y[3, -1], rel=1e-3)


def test_more_integral_gain_leaves_less() -> None:
    """The integral of the yaw rate is the heading, so it returns to zero."""
    some, more = (gust_response(small_config(), Member(0.05, relaxation_length=0.4), SPEED, 0.14, ki) for ki in (0.4, 0.8))
    assert abs(some.heading_deg) < 0.1 and abs(more.heading_deg) < 0.01
    assert more.heading_max_deg < 0.8 * some.heading_max_deg and more.path_m < 0.8 * some.path_m
