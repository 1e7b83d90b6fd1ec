"""The cars of `benchmarks.foreign_cars` against text-book figures, and the count of intervals."""

import dataclasses

import numpy as np
import pytest

from benchmarks.foreign_cars import GRAVITY, OUTPUTS, Cars, brush, random_cars, simulate, tmeasy
from benchmarks.identify_foreign import SLIPS, Found, first_slip, rows_of, static_force

STEP, SPEED, ANGLE = 1e-3, 15.0, 0.004
ACTUATOR = (0.05, 0.5, 0.09)


def cars(tyre: str = "brush") -> Cars:
    return random_cars(np.random.default_rng(3), {"brush": brush, "TMeasy": tmeasy}[tyre], 4)


@pytest.mark.parametrize("tyre", ["brush", "TMeasy"])
def test_a_tyre_has_its_stiffness_and_its_largest_force(tyre: str) -> None:
    one = cars(tyre)
    load = one.static_loads
    small = -one.forces(np.full((4, 4), 1e-5), load)[:, [0, 2]] / 1e-5
    np.testing.assert_allclose(small, np.stack([one.front_stiffness, one.rear_stiffness], axis=1), rtol=1e-3)
    largest = np.max([-one.forces(np.full((4, 4), slip), load) for slip in np.linspace(0.0, 0.6, 600)], axis=0)
    peak = np.stack([one.front_friction, one.rear_friction], axis=1) * load[:, [0, 2]]
    np.testing.assert_allclose(largest[:, [0, 2]], peak, rtol=1e-3)  # between two slips of the grid
    np.testing.assert_array_equal(one.forces(np.full((4, 4), 0.1), load), -one.forces(np.full((4, 4), -0.1), load))


def test_a_steady_turn_is_that_of_the_single_track_car() -> None:
    """r = v delta / (L + K v^2) (R. Rajamani, Vehicle Dynamics and Control, section 3.3); and what the accelerometer tilts."""
    one = dataclasses.replace(cars(), stiffness_gain=np.ones(4))  # so that load transfer takes no stiffness
    rows = np.tile([SPEED, ANGLE, 0.0], (2500, 4, 1))
    found = dict(zip(OUTPUTS, simulate(one, rows, STEP, [ACTUATOR] * 4)[-1].T, strict=True))
    front, rear = (
        one.mass * arm / (2.0 * one.wheelbase * stiffness)
        for arm, stiffness in ((one.rear_arm, one.front_stiffness), (one.front_arm, one.rear_stiffness))
    )
    expected = SPEED * ANGLE / (one.wheelbase + (front - rear) * SPEED**2)
    np.testing.assert_allclose(found["yaw_rate"], expected, rtol=0.03)  # a brush loses that much at 0.3 deg of slip
    acceleration = SPEED * found["yaw_rate"]
    body = one.sprung_share * one.mass * one.roll_arm
    roll = body * acceleration / (one.roll_stiffness - body * GRAVITY)
    np.testing.assert_allclose(found["lateral_acceleration"], acceleration + GRAVITY * np.sin(roll), rtol=1e-3)
    np.testing.assert_allclose(found["front_force"] + found["rear_force"], one.mass * acceleration, rtol=1e-3)
    np.testing.assert_allclose(found["front_force"] * one.front_arm, found["rear_force"] * one.rear_arm, rtol=1e-3)


def test_the_slip_at_a_force_is_that_of_steady_turns() -> None:
    one = cars("TMeasy")
    rows = np.tile([SPEED, 0.03, 0.0], (2500, 4, 1))
    found = dict(zip(OUTPUTS, simulate(one, rows, STEP, [ACTUATOR] * 4)[-1].T, strict=True))
    slip = 0.03 - np.arctan((SPEED * np.tan(found["sideslip"]) + one.front_arm * found["yaw_rate"]) / SPEED)
    curve = static_force(one, 0)
    expected = [first_slip(SLIPS, curve[:, k], found["front_force"][k]) for k in range(4)]
    np.testing.assert_allclose(slip, expected, rtol=0.02)  # the inner wheel turns at another speed


@pytest.mark.parametrize(("error", "is_met"), [(1.9, True), (2.0, False)])
def test_intervals_are_counted(error: float, is_met: bool) -> None:
    figures = {(axle, name): (100.0 + error, 1.0, 100.0) for axle in ("front", "rear") for name in ("stiffness", "force")}
    figures |= {("front", "slip"): (1.0, 1.0, np.nan), ("rear", "slip"): (1.0, 1.0, 1.0)}
    rows = {row.cells[:2]: row for row in rows_of([Found("brush", figures, 1)])}
    assert rows["all", "cornering stiffness"].met == is_met
    assert rows["all", "cornering stiffness"].cells[2] == ("2 of 2" if is_met else "0 of 2")
    assert rows["all", "slip at grip_use_max"].cells[2] == "1 of 1"
    assert rows["brush", "cornering stiffness"].met
