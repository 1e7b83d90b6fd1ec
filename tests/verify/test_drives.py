"""What the controller is driven with: recordings that repeat themselves, and samples from everywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest

from codegen.config import Config
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Measurement, Status
from codegen.verify.drives import COLUMNS, DELAY_SAMPLES, Ground, drawn, drive_of, measurements_of, recorded
from hil_sim.scenarios import SCENARIOS
from tests.verify import builds


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground.of(builds.made().manifest)


def test_a_recording_holds_what_the_controller_measured() -> None:
    """Given to a controller again, it makes it command what it did in the loop, to the bit: estimate and inhibit included."""
    software = builds.compiled("tracking")
    drives = recorded(software)
    assert len(drives) == len(SCENARIOS)
    for scenario, drive in zip(SCENARIOS.values(), drives, strict=True):
        record = ClosedLoop(software, LoopOptions(delay_samples=DELAY_SAMPLES)).run(scenario.inputs(software.config))
        commands = software.controller().run(measurements_of(drive))
        assert [command.rear_angle for command in commands] == record[
            :, RECORD_COLUMNS.index("rear_angle_command_rad")
        ].tolist()


def test_measurements_go_into_an_array_and_back() -> None:
    measurements = [Measurement(15.0, -0.5, 0.25, 0.0625, 0.5, True), Measurement(1e300, 0.0, 0.0)]
    drive = drive_of(measurements)
    assert drive.dtype == np.float32
    assert drive.shape == (2, len(COLUMNS))
    back = measurements_of(drive)
    assert back[0] == measurements[0]
    assert back[1].speed == math.inf
    assert math.isnan(back[1].friction)


def test_the_same_seed_gives_the_same_drives(ground: Ground) -> None:
    again, other = drawn(ground, 200), drawn(ground, 200, seed=1)
    assert all(left.tobytes() == right.tobytes() for left, right in zip(drawn(ground, 200), again, strict=True))
    assert all(left.tobytes() != right.tobytes() for left, right in zip(again, other, strict=True))


def test_drawn_samples_go_everywhere(ground: Ground) -> None:
    config: Config = ground.config
    without_gaps = drawn(ground, 4_000)[0]
    speed, front_angle, yaw_rate, rear_angle, friction, inhibit = without_gaps.T
    speed_max = config.controller.inputs.speed_max_km_h / 3.6
    counts, _ = np.histogram(speed, bins=10, range=(0.0, speed_max))
    assert counts.min() > 0
    assert speed.min() < 0.0
    assert np.abs(speed).max() <= speed_max
    assert np.abs(front_angle).max() <= np.float32(math.radians(config.controller.inputs.front_angle_max_deg))
    assert {-1.0, 0.0, 1.0} <= set(np.sign(front_angle).tolist())
    assert np.isfinite(yaw_rate).all()
    for optional in (rear_angle, friction):
        assert 0.1 < np.isnan(optional).mean() < 0.9
    assert set(inhibit.tolist()) == {0.0, 1.0}
    # Every breakpoint itself, in the precision of the C.
    for values, corners in ((speed, ground.speed), (np.abs(front_angle), ground.front_angle)):
        inside = corners[corners < 0.99 * corners.max()].astype(np.float32)
        assert np.isin(inside, values).mean() > 0.9


def test_every_status_is_reached_by_the_drawn_drives_alone(ground: Ground) -> None:
    software = builds.compiled("tracking")
    reached = {
        command.status for drive in drawn(ground, 1_500) for command in software.controller().run(measurements_of(drive))
    }
    assert reached == set(Status)


def test_the_drawn_drives_go_to_every_cell_of_the_schedule(ground: Ground) -> None:
    speeds = np.concatenate([drive[:, 0] for drive in drawn(ground, 1_000)])
    breakpoints = np.array(builds.SCHEDULE["speed_km_h"], dtype=np.float32) / np.float32(3.6)
    cells = np.searchsorted(breakpoints, speeds[np.isfinite(speeds)])
    assert set(range(len(breakpoints))) <= set(cells.tolist())
