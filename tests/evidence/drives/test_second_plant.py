"""Long drives on the third-party multi-body car: linear theory, step size, and closed loop."""

import functools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen import configuration
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.map_file import map as npz
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_acceleration_stack, solve_case
from codegen.sil.plant import PlantInput, PlantSample
from codegen.sil.software import RECORD_COLUMNS
from codegen.units import KM_H
from codegen.vehicle.single_track import SingleTrack
from hil_sim.metrics import column, spin_time
from hil_sim.scenarios import SCENARIOS, Scenario
from hil_sim.second_plant import MultiBodyPlant, car_of, cells, published, run
from hil_sim.settings import Settings
from tests import builds
from tests.optimum.cars import changed

COMMITTED = Path(__file__).parents[3] / "generated" / "4ws2.npz"


@functools.cache
def config() -> Config:
    return car_of(published(), configuration.preset())


@functools.cache
def reference_map() -> ReferenceMap:
    return solve_case(config(), "4ws-2")


def steady(speed: float, front_angle: float, rear_angle: float = 0.0, time: float = 2.0) -> PlantSample:
    """Return the state after a step of both angles (rad), once the yaw motion has settled."""
    plant = MultiBodyPlant(config(), speed)
    acting = PlantInput(speed, front_angle * config().steering.ratio, rear_angle, config().road.friction)
    plant.advance([acting] * round(time / config().plant.sampling_time_s))
    return plant.sample(acting)


@pytest.mark.parametrize(("speed_km_h", "tolerance"), [(40.0, 0.02), (70.0, 0.05)])
def test_rear_steer_gain_is_that_of_the_linear_car(speed_km_h: float, tolerance: float) -> None:
    """The slope is taken around a slight turn: at zero, the tyre data have a step over camber.

    The tolerance covers effects that the linear car lacks: roll, camber and lateral compliance. It grows with speed because the
    car is close to neutral. The front wheels' gain deviates equally, so the ratio of both is much more accurate.
    """
    speed, angle, change = speed_km_h * KM_H, math.radians(1.0), math.radians(0.2)
    base = steady(speed, angle).yaw_rate
    by_rear = (steady(speed, angle, change).yaw_rate - base) / change
    by_front = (steady(speed, angle + change).yaw_rate - base) / change
    assert by_rear == pytest.approx(-float(SingleTrack.from_config(config()).yaw_gain(speed)), rel=tolerance)
    assert by_rear == pytest.approx(-by_front, rel=0.005)


def test_the_controller_closes_the_loop() -> None:
    cell = cells(reference_map())[1]
    record = run(builds.make(reference_map(), config()).software, config(), cell.scenario)
    passive = run(None, config(), cell.scenario)
    assert spin_time(record) is None
    end = slice(-50, None)
    yaw_rate, reference = column(record, "yaw_rate_rad_s")[end], column(record, "yaw_rate_reference_rad_s")[end]
    np.testing.assert_allclose(yaw_rate, reference, rtol=0.002)
    assert column(passive, "yaw_rate_rad_s")[-1] < 0.8 * reference[-1]
    assert not column(passive, "rear_angle_command_rad").any()
    # The car's engine keeps the speed to 0.05 m/s at 11 m/s.
    for one in (record, passive):
        np.testing.assert_allclose(column(one, "speed_m_s"), cell.speed_km_h * KM_H, atol=0.05)


def braking(front_angle_deg: float) -> Scenario:
    """Return a turn at 110 km/h in which the car brakes with 3 m/s^2 from 2 s on and turns from 2.5 s on."""

    def drive(car: Config, settings: Settings, time: FloatArray) -> dict[str, FloatArray]:
        wheel = math.radians(front_angle_deg) * car.steering.ratio * np.clip(2.0 * (time - 2.5), 0.0, 1.0)
        return {"speed": 110.0 * KM_H - 3.0 * np.clip(time - 2.0, 0.0, None), "steering_wheel_command": wheel}

    return replace(SCENARIOS["step-steer"], duration=6.5, drive=drive)


@pytest.mark.long
def test_maps_for_braking_keep_the_rear_slip_of_a_car_that_brakes() -> None:
    """The speed is not imposed: the car's own tyres brake. Without the stack its rear axle slips half as much again."""
    tuned = npz.load(COMMITTED).config
    assert tuned is not None
    car = changed(car_of(published(), tuned), grid={"speed_points": 41, "front_angle_points": 40})
    stacked = solve_acceleration_stack(car, "4ws-2", (-3.0, -1.5, 0.0, 1.0))
    builds_of = {"stack": stacked, "constant speed": replace(stacked, layers=())}
    software = {name: builds.make(each, car).software for name, each in builds_of.items()}
    for front_angle_deg in (2.0, 3.0):
        slips, errors = {}, {}
        for name, built in software.items():
            record = run(built, car, braking(front_angle_deg))[350:]
            assert record[-1, RECORD_COLUMNS.index("speed_m_s")] == pytest.approx(110.0 * KM_H - 13.5, abs=0.5)
            slips[name] = np.degrees(np.abs(column(record, "slip_rear_rad")).max())
            error = column(record, "yaw_rate_reference_rad_s") - column(record, "yaw_rate_rad_s")
            errors[name] = np.degrees(np.abs(error).max())
        assert slips["stack"] < 1.6 and slips["constant speed"] > 1.5 * slips["stack"], slips
        assert errors["stack"] < 0.5 and errors["constant speed"] > 1.5 * errors["stack"], errors
