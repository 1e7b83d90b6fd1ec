"""Delays of a sine, and paths and cones, against values by hand."""

import math

import numpy as np
import pytest

from codegen.metrics import Runs
from codegen.metrics.runs import cone_clearances, paths
from codegen.metrics.sine import SineResponse

TIME = np.arange(600, dtype=np.float64) * 0.01


def test_delays_are_those_of_the_fundamental_at_the_end() -> None:
    """A transient before the last three periods, and a harmonic, do not count."""

    def sine(delay: float, size: float = 1.0) -> np.ndarray:
        phase = 2.0 * math.pi * (TIME - delay)
        return size * np.sin(phase) + 0.1 * np.sin(2.0 * phase) + np.where(TIME < 2.5, 1.0, 0.0)

    wheel = np.stack([np.sin(2.0 * math.pi * TIME)] * 2, axis=1)
    yaw_rate, lateral = np.stack([sine(0.12), sine(-0.03)], axis=1), np.stack([sine(0.3, -2.0), sine(0.0)], axis=1)
    signals = {"front_angle_rad": wheel, "yaw_rate_rad_s": yaw_rate, "lateral_acceleration_m_s2": lateral}
    found = SineResponse(Runs(TIME, signals, 0.0), 1.0)
    assert found.yaw_rate_delay_s == pytest.approx([0.12, -0.03])
    assert found.lateral_acceleration_delay_s == pytest.approx([0.3 - 0.5, 0.0])  # the other sign is half a period


def test_a_circle_and_the_cones_beside_it() -> None:
    radius, rate = 40.0, 0.25
    count = TIME.size
    signals = {
        "speed_m_s": np.full((count, 2), radius * rate),
        "yaw_rate_rad_s": np.stack([np.full(count, rate), np.zeros(count)], axis=1),
        "sideslip_rad": np.zeros((count, 2)),
    }
    heading, forward, left = paths(Runs(TIME, signals, 0.0))
    turned = rate * TIME
    # The trapezoidal rule cuts corners: (0.25 * 0.01)^2 / 12 of the radius.
    assert heading[:, 0] == pytest.approx(turned)
    assert forward[:, 0] == pytest.approx(radius * np.sin(turned), abs=1e-4)
    assert left[:, 0] == pytest.approx(radius * (1.0 - np.cos(turned)), abs=1e-4)
    at = 20.0
    y = radius - math.sqrt(radius**2 - at**2)
    cones = np.array([[at, y - 0.5, y + 0.3], [at, -math.inf, y + 1.0], [1e3, 5.0, 6.0]])
    assert cone_clearances(cones, forward, left) == pytest.approx([0.3, -(y - 0.5)], abs=1e-3)  # the last is not passed
    assert np.isnan(cone_clearances(cones[2:], forward, left)).all()
