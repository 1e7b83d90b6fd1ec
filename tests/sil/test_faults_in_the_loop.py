"""Faults with the car in the loop: what the reactions are for."""

from __future__ import annotations

import math

import pytest

from codegen.sil.closed_loop import INPUT_COLUMNS
from codegen.sil.software import Measurement, Status
from tests.builds import Built

SPEED = 100.0 / 3.6
WHEEL = INPUT_COLUMNS.index("steering_wheel_command")


def drive(built: Built, front_angle: float, fault_yaw_rate: float | None) -> tuple[float, list[Status]]:
    """Largest |sideslip| (rad) from 4 s on, and the statuses, of a drive at 100 km/h in which the yaw-rate sensor fails at 4 s.

    The sensor then sticks at `fault_yaw_rate` (rad/s), or is lost (NaN).
    """
    software = built.software
    lib, ffi = software.compiled.lib, software.ffi
    controller = software.controller()
    plant, output = ffi.new("plant_state_t *"), ffi.new("plant_output_t *")
    wheel = front_angle * software.config.steering.ratio
    largest, statuses = 0.0, []
    for sample in range(1000):
        source = ffi.new("plant_input_t *", (SPEED, wheel, 0.0, 0.9, 0.0))
        lib.plant_output(plant, source, output)
        yaw_rate = plant.yaw_rate
        if sample >= 400:
            yaw_rate = math.nan if fault_yaw_rate is None else fault_yaw_rate
            largest = max(largest, abs(output.sideslip_angle))
        command = controller.step(Measurement(SPEED, output.front_angle, yaw_rate, plant.rear_angle))
        statuses.append(command.status)
        source.rear_angle_command = command.rear_angle
        for _ in range(10):
            lib.plant_step(plant, source, 0.001)
    return largest, statuses[400:]


@pytest.mark.parametrize("yaw_rate", [math.radians(100.0), -math.radians(100.0)])
def test_a_mad_yaw_rate_sensor_does_not_steer_the_car(paper: Built, yaw_rate: float) -> None:
    """Straight ahead the car stays straight: not one sample of a yaw rate that cannot be is controlled upon."""
    largest, statuses = drive(paper, 0.0, yaw_rate)
    assert largest == 0.0
    held = round(paper.software.config.controller.inputs.implausible_time_s / 0.01)
    assert statuses == [Status.DEGRADED] * held + [Status.FAIL_SAFE] * (len(statuses) - held)


@pytest.mark.parametrize("yaw_rate", [None, math.radians(100.0)])
def test_losing_the_sensor_in_a_corner_keeps_the_car_as_it_is(paper: Built, yaw_rate: float | None) -> None:
    """3 deg at 100 km/h, steered with the rear wheels: held, the sideslip stays what it was, 0.54 deg."""
    largest, statuses = drive(paper, math.radians(3.0), yaw_rate)
    assert statuses[-1] is Status.FAIL_SAFE
    assert math.degrees(largest) < 0.6
