"""Drives of the controller: recordings that repeat themselves, and samples from everywhere."""

import math

import numpy as np
import pytest

from codegen.config import parse
from codegen.refmap.solve import solve_case
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Status
from codegen.verify import suites
from codegen.verify.drives import DELAY_SAMPLES, Ground, drawn, measurements_of, recorded
from codegen.verify.map_reference import lookup_of
from hil_sim.scenarios import SCENARIOS
from tests.verify import builds, planted


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.of(builds.made("tracking", "uneven").manifest)


def test_a_recording_holds_what_the_controller_measured() -> None:
    """Played back, it makes a controller repeat the commands of the loop bit for bit, estimate and inhibit included."""
    software = builds.compiled()
    drives = recorded(software)
    assert len(drives) == len(SCENARIOS)
    for scenario, drive in zip(SCENARIOS.values(), drives, strict=True):
        record = ClosedLoop(software, LoopOptions(delay_samples=DELAY_SAMPLES)).run(scenario.inputs(software.config))
        commands = [command.rear_angle for command in software.controller().run(measurements_of(drive))]
        assert commands == record[:, RECORD_COLUMNS.index("rear_angle_command_rad")].tolist()


def test_drawn_samples_go_everywhere(ground: Ground) -> None:
    inputs = ground.config.controller.inputs
    without_gaps, *others = drawn(ground, 4_000)
    speed, front_angle, yaw_rate, rear_angle, friction, inhibit = without_gaps.T
    speed_max = inputs.speed_max_km_h / 3.6
    assert np.histogram(speed, bins=10, range=(0.0, speed_max))[0].min() > 0
    assert speed.min() < 0.0 < np.abs(speed).max() <= speed_max
    assert np.abs(front_angle).max() <= np.float32(math.radians(inputs.front_angle_max_deg))
    assert {-1.0, 0.0, 1.0} <= set(np.sign(front_angle).tolist())
    assert np.isfinite(yaw_rate).all()
    assert all(0.1 < np.isnan(optional).mean() < 0.9 for optional in (rear_angle, friction))
    assert set(inhibit.tolist()) == {0.0, 1.0}
    for values, corners in ((speed, ground.speed), (np.abs(front_angle), ground.front_angle)):
        inside = corners[corners < 0.99 * corners.max()].astype(np.float32)  # in the precision of the C
        assert np.isin(inside, values).mean() > 0.9
    again, other = drawn(ground, 4_000), drawn(ground, 4_000, seed=1)
    assert all(left.tobytes() == right.tobytes() for left, right in zip((without_gaps, *others), again, strict=True))
    assert all(left.tobytes() != right.tobytes() for left, right in zip(again, other, strict=True))


def test_drawn_drives_reach_every_status_and_every_cell_of_the_schedule(ground: Ground) -> None:
    software, drives = builds.compiled(), drawn(ground, 1_500)
    reached = {command.status for drive in drives for command in software.controller().run(measurements_of(drive))}
    assert reached == set(Status)
    speeds = np.concatenate([drive[:, 0] for drive in drives])
    breakpoints = np.array(builds.SCHEDULE["speed_km_h"], dtype=np.float32) / np.float32(3.6)
    cells = np.searchsorted(breakpoints, speeds[np.isfinite(speeds)])
    assert set(range(len(breakpoints))) <= set(cells.tolist())


def test_places_of_lookups_go_everywhere(ground: Ground) -> None:
    speed, angle = suites.places(ground, 4_000, "single").T
    assert {-1.0, 1.0} <= set(np.sign(angle).tolist())
    assert np.isnan(speed).any()
    assert (speed > ground.speed.max()).any()
    assert all((speed == np.float32(value)).any() for value in ground.speed)


def test_faults_are_defined_for_the_settings_of_the_presets_only() -> None:
    data = builds.config_of("tracking").model_dump(mode="json")
    assert suites.are_faults_defined_for(parse(data, "test"))
    data["controller"]["fail_safe"]["degraded_samples_max"] = 6
    assert not suites.are_faults_defined_for(parse(data, "test"))


def test_the_caps_of_a_stack_are_read_from_the_c() -> None:
    lookup = lookup_of(planted.subject_of(builds.made("tracking", "uneven", layers=True)))
    assert lookup.tables.shape == lookup.rear_tables.shape == (4, 9, 10)
    assert lookup.caps.tolist() == sorted(lookup.caps.tolist())
    assert lookup.lateral_acceleration_cap_per_friction == pytest.approx(lookup.caps[0] / 0.3, rel=1e-6)  # single precision


def test_the_car_of_another_map_is_read_from_the_c() -> None:
    """Beyond the cap of the map the C steers the car of the map, not the one of the manifest."""
    config = builds.config_of("tracking", "uneven")
    heavier = config.model_copy(update={"vehicle": config.vehicle.model_copy(update={"mass_kg": 2400.0})})
    other = builds.build_of(solve_case(config, builds.CASE), heavier, "ars.toml")
    found, own = (lookup_of(planted.subject_of(folder)) for folder in (other, builds.made("tracking", "uneven")))
    speed, front_angle = np.full(3, 30.0, dtype=np.float32), np.array([0.02, 0.1, 0.5], dtype=np.float32)
    for mine, theirs in zip(found.reference(speed, front_angle, 0.3), own.reference(speed, front_angle, 0.3), strict=True):
        np.testing.assert_array_equal(mine, theirs)
