"""Random cars: the draw, and batches of cells."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen.sil.batch import NOISES, sensor_errors
from codegen.vehicle.single_track import SingleTrack
from hil_sim.suite.cars import CARS_ANGLE_SHARES, CARS_SPEEDS_KM_H, DEVELOPMENT_SEED, MASS_KG, TEST_SEED, examine, random_cars
from hil_sim.suite.cells import NOMINAL, SENSORS, cells, conditions
from hil_sim.suite.requirements import Limits
from hil_sim.suite.runs import drive, judge, map_yaw_rate, run_table
from hil_sim.suite.subjects import of_config, passive_of
from tests import builds


def test_a_car_follows_from_seed_and_number_and_is_plausible() -> None:
    found = random_cars(DEVELOPMENT_SEED, 40)
    assert random_cars(DEVELOPMENT_SEED, 3) == found[:3] and random_cars(TEST_SEED, 1)[0] not in found
    assert len({config.vehicle.mass_kg for config in found}) == 40
    for config in found:
        assert MASS_KG[0] <= config.vehicle.mass_kg <= MASS_KG[1]
        assert SingleTrack.from_config(config).critical_speed * 3.6 > 1.2 * config.grid.speed_max_km_h
        # It slides before it rolls over: half the track over the height of the centre of gravity exceeds the tyres' peak.
        assert 0.5 * config.vehicle.track_m / config.vehicle.cg_height_m > 1.1 * config.road.friction


def test_cells_in_a_batch_equal_single_runs() -> None:
    """Tolerance 1e-6: only the batch's rounding differs, see `codegen.sil.batch.DIFFERENCE_MAX`."""
    subject = of_config("tracking", builds.paper_map(), builds.TRACKING_CONFIG)
    points = cells(subject.config, subject.config.case("4ws-2"), CARS_SPEEDS_KM_H[::3], CARS_ANGLE_SHARES[:2])
    under = [each for each in conditions(subject.config) if each.name in ("relaxation-300", "friction-60")]
    names = ("overshoot_percent", "settling_time_s", "sideslip_max_deg", "map_error_percent", "slip_percent")
    for driven in (subject, passive_of(subject)):
        tables = run_table(driven, under, points)
        assert list(tables) == [condition.name for condition in under]
        for condition in under:
            record, asked = (of(driven, condition, points[-1]) for of in (drive, map_yaw_rate))
            alone = judge(record, points[-1], condition.name, asked, car=condition.plant(driven.config))
            found = tables[condition.name][-1]
            assert (found.cell, found.condition) == (points[-1], condition.name)
            assert [getattr(found, name) for name in names] == pytest.approx([getattr(alone, name) for name in names], abs=1e-6)


def test_errors_of_the_sensors_reach_the_controller() -> None:
    """The errors are those of the data sheet, and a bias of the yaw rate moves the steady yaw rate by about as much.

    The bias is the largest that the controller takes for one; a larger one is a disturbance to it.
    """
    bias = builds.TRACKING_CONFIG.controller.inputs.yaw_rate_offset_max_deg_s
    noisy = {"speed": {"noise_km_h": 0.36, "resolution_km_h": 0.0}, "rear_angle": {"noise_deg": 0.0, "resolution_deg": 0.2}}
    noisy |= {"yaw_rate": {"noise_deg_s": 0.0, "resolution_deg_s": 0.0, "bias_deg_s": bias}}
    config = builds.TRACKING_CONFIG.replace({"sensors": noisy})
    errors = dict(zip(NOISES, sensor_errors(config.sensors, 500, 200, 1).transpose(1, 0, 2), strict=True))
    assert np.std(errors["speed"]) == pytest.approx(0.1, rel=0.01)  # 1 / sqrt(2 * 100,000) of it: 0.2 %
    assert np.ptp(errors["rear_angle"]) == pytest.approx(math.radians(0.2), rel=0.001)
    assert (errors["yaw_rate"] == math.radians(bias)).all()
    other = config.replace({"sensors.speed.noise_km_h": 0.0}).sensors
    assert np.array_equal(sensor_errors(other, 500, 200, 1)[:, 1:], sensor_errors(config.sensors, 500, 200, 1)[:, 1:])
    subject = of_config("tracking", builds.paper_map(), config)
    tables = run_table(subject, [NOMINAL, SENSORS], cells(config, config.case("4ws-2"), (60.0,), (0.5,)))
    (ideal,), (biased,) = tables[NOMINAL.name], tables[SENSORS.name]
    assert ideal.yaw_rate_steady_deg_s is not None and biased.yaw_rate_steady_deg_s is not None
    assert -1.25 * bias < biased.yaw_rate_steady_deg_s - ideal.yaw_rate_steady_deg_s < -0.1 * bias


def test_a_car_that_cannot_be_tuned_is_reported() -> None:
    config = random_cars(DEVELOPMENT_SEED, 1)[0]
    result = examine(7, config.replace({"tuning": {"sensitivity_max": 1.05}, "grid": {"speed_points": 5}}), Limits())
    assert not result.passed and "no gains" in result.error and result.title.startswith("car 7: ")
    assert not replace(result, error="").requirements
