"""Paths and the driver who follows them."""

from dataclasses import replace

import numpy as np
import pytest

from codegen.sil.software import Software
from codegen.vehicle.single_track import SingleTrack
from hil_sim import manoeuvres
from hil_sim.bench import run, run_through_can
from hil_sim.metrics import column, evaluate
from hil_sim.scenario_files import find
from hil_sim.scenarios import PATH_SCENARIOS
from hil_sim.session import passive
from tests import builds

CONFIG = builds.CONFIG
HALF_WIDTH = 0.5 * (1.627 + 0.25)
LANES = ((0.0, 12.0, -1.157, 1.157), (25.5, 36.5, 2.157, 5.034), (49.0, 61.0, -1.843, 1.157))
"""Lanes for a car of 1.877 m, calculated to 0.5 mm: begin and end, right and left edge, in m."""


def test_the_car_on_its_path_stays_within_the_lanes_touches_their_ends_and_goes_round_cones() -> None:
    lateral, gaps = manoeuvres.double_lane_change(CONFIG, 20.0).lateral, []
    for begin, end, right, left in LANES:
        y = lateral(20.0 + np.linspace(begin, end, 200))
        room = np.minimum(left - HALF_WIDTH - y, y - HALF_WIDTH - right)
        assert room.min() > -1e-3
        gaps += [room[0], room[-1]]
    assert gaps[1:5] == pytest.approx([0.0] * 4, abs=1e-3)
    assert lateral(np.array([0.0, 1e3])) == pytest.approx([0.0, 0.5 * (2.3147 - 3.0)], abs=1e-4)
    for followed, room in ((manoeuvres.double_lane_change(CONFIG, 20.0), 0.0), (manoeuvres.slalom(CONFIG, 20.0), 0.3)):
        at, low, high = followed.cones.T
        y = followed.lateral(at)
        assert np.minimum(y - low, high - y).min() == pytest.approx(room, abs=1e-9)
    at_cones = manoeuvres.slalom(CONFIG, 50.0).lateral(50.0 + 36.0 * np.arange(8))
    assert at_cones == pytest.approx((HALF_WIDTH + 0.3) * np.array([0, -1, 1, -1, 1, -1, 1, 0]))


def test_the_driver_holds_the_angle_that_comes_closest_to_the_path() -> None:
    """The reference is the same linear car, integrated in small steps."""
    speed, start = 20.0, (3.0, 0.2, 0.01)
    car, followed = SingleTrack.from_config(CONFIG), manoeuvres.slalom(CONFIG, 10.0)
    hands = manoeuvres.PreviewDriver(CONFIG, followed, speed, manoeuvres.DELAY_S)  # one period of delay
    assert hands.steer(start, 0.005, 0.1) == 0.0
    found = hands.steer(start, 0.005, 0.1) / CONFIG.steering.ratio

    def missed(angle: float) -> float:
        y, heading, side, yaw_rate = start[1], start[2], speed * np.tan(0.005), 0.1
        total, step, count = 0.0, 1e-4, round(manoeuvres.PREVIEW_TIME_S / 1e-4)
        for number in range(1, count + 1):
            front = car.front_stiffness * (angle - (side + car.front_arm * yaw_rate) / speed)
            rear = -car.rear_stiffness * (side - car.rear_arm * yaw_rate) / speed
            y, heading = y + step * (speed * heading + side), heading + step * yaw_rate
            side += step * ((front + rear) / car.mass - speed * yaw_rate)
            yaw_rate += step * (car.front_arm * front - car.rear_arm * rear) / car.yaw_inertia
            if number % (count // manoeuvres.PREVIEW_POINTS) == 0:
                total += float(followed.lateral(np.array(start[0] + speed * number * step)) - y) ** 2
        return total

    # Steps of 0.1 ms shift the minimum of the parabola by less than 1 %.
    assert missed(found) < min(missed(0.99 * found), missed(1.01 * found))


@pytest.mark.parametrize("name", PATH_SCENARIOS)
def test_every_loop_has_the_same_driver_and_a_path_error(name: str, software: Software) -> None:
    scenario = find(name)
    alone, on_bus = run(software, scenario, controlled=False), passive(software.config, scenario)
    assert np.array_equal(alone[:, :-1], on_bus[:, :-1])
    short = replace(scenario, duration=3.0)
    one, two = (column(made, "front_angle_rad") for made in (run(software, short), run_through_can(software, short).record))
    assert one == pytest.approx(two, abs=2e-3)  # only the quantisation of the frames differs: 1e-4 rad of 0.1 rad

    straight = alone.copy()
    straight[:, 3:7] = 0.0
    figures = evaluate(scenario, software.config, {"driven": alone, "straight": straight}).runs
    assert figures["driven"]["path_error_rms_m"] < figures["driven"]["path_error_max_m"]
    # A car that drives straight on deviates by the path itself: the offset of the lanes, the distance around a cone.
    largest = {"double-lane-change": 0.5 * (2.3147 + 2.877) + 1.0, "slalom": HALF_WIDTH + 0.3}[name]
    assert figures["straight"]["path_error_max_m"] == pytest.approx(largest, abs=1e-3)
    over = {"double-lane-change": LANES[1][2] + HALF_WIDTH, "slalom": HALF_WIDTH}[name]
    assert figures["straight"]["cone_clearance_min_m"] == pytest.approx(-over, abs=1e-3)
