"""The lane change of the judgement: drivers of a batch, and the search for the largest entry speed."""

import math
from dataclasses import replace

import numpy as np
import pytest

from codegen.judgement.bench import Bench
from codegen.judgement.drives import drive_dwells
from codegen.judgement.lane_change import (
    DRIVERS,
    LANE_CHANGE_COLUMNS,
    LaneChange,
    lane_change_figures,
    largest_entry_speed,
    sideslips_if_passed,
)
from codegen.judgement.lane_change import _Drives as Drives
from codegen.metrics import Runs
from codegen.sil.batch import BatchSoftware, compile_batch
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from hil_sim.manoeuvres import Hands, RoadPath
from tests import builds, shared


@pytest.fixture(scope="module")
def software() -> BatchSoftware:
    folder = builds.of_kind("feedforward").folder
    with shared.locked("compile feedforward batch"):
        return compile_batch(folder.files, folder.manifest)


@pytest.mark.parametrize(("controlled", "speed"), [(True, 45.0), (False, 45.0), (True, 60.0)])
def test_a_driver_of_a_batch_is_the_driver_of_a_single_run(software: BatchSoftware, controlled: bool, speed: float) -> None:
    """The batch integrates the position once a sample; on this track that is less than a centimetre."""
    built, hands = builds.of_kind("feedforward"), DRIVERS[9:12]
    config = built.software.config.replace({"plant.command_delay_samples": 3 if speed == 60.0 else 0})
    found = Drives(Bench(software, config), hands).sideslips(speed)[0 if controlled else 1]
    for sideslip, each in zip(found, hands, strict=True):
        scenario = LaneChange.at(speed, each)
        loop, driver = ClosedLoop(built.software, LoopOptions(controlled, config.driven_delay_samples)), scenario.driver(config)
        assert driver is not None
        record = loop.run_stepped(scenario.inputs(config), driver.steer)
        one = sideslips_if_passed(Runs.of_record(record, 2.0), scenario, config)
        assert sideslip == pytest.approx(one[0], rel=2e-3, nan_ok=True)


def test_the_sine_with_dwell_is_that_of_the_driven_car_whatever_the_batch_was_compiled_with(software: BatchSoftware) -> None:
    """A batch is compiled once for all cars with the same parts: its own car must not set the angle for 0.3 g."""
    other = software.config.replace({"vehicle.mass_kg": 1.2 * software.config.vehicle.mass_kg})
    folder = builds.of_kind("feedforward").folder
    steps = [compile_batch(folder.files, folder.manifest, other.replace({"plant.sampling_time_s": s})) for s in (0.001, 0.002)]
    found, own, coarse = (drive_dwells(Bench(batch, other)).displacement_m for batch in (software, *steps))
    assert found == pytest.approx(own, rel=1e-12)
    assert found == pytest.approx(coarse, rel=1e-3)  # RK4 with half as many steps
    assert found != pytest.approx(drive_dwells(Bench(software, software.config)).displacement_m, rel=1e-3)


def test_a_driver_passes_the_lane_change_only_when_slow_enough(software: BatchSoftware) -> None:
    drives = Drives(Bench(software, software.config), DRIVERS)
    slow, fast = drives.sideslips(40.0), drives.sideslips(70.0)
    assert np.isfinite(slow).any(axis=1).all() and 0.1 < np.nanmin(slow) < 3.0
    assert np.isnan(fast).all()  # nobody spins, but all hit cones


def test_what_follows_the_end_of_the_scenario_does_not_count() -> None:
    """A car of 0.1 m that drives straight, on a track without an offset, spins before or after the end."""
    config, scenario = builds.CONFIG, LaneChange.at(50.0, DRIVERS[0])
    wide = replace(scenario, path=lambda _config, start: RoadPath(np.zeros_like, start, 61.0, np.array([[start, -1.0, 1.0]])))
    time = np.arange(1200, dtype=np.float64) * 0.01
    straight = {name: np.zeros((time.size, 1)) for name in LANE_CHANGE_COLUMNS} | {
        "speed_m_s": np.full((time.size, 1), 50.0 / 3.6)
    }
    found = []
    for begin in (scenario.duration - 0.1, scenario.duration + 0.1):
        spins = np.where(time < begin, 0.01, 1.0)[:, np.newaxis]
        signals = straight | {"sideslip_rad": spins, "slip_rear_rad": spins, "yaw_rate_rad_s": np.zeros_like(spins)}
        found.append(sideslips_if_passed(Runs(time, signals, 2.0), wide, config)[0])
    assert found == pytest.approx([math.nan, math.degrees(0.01)], nan_ok=True)


def test_the_search_ends_after_two_misses() -> None:
    asked: list[float] = []

    def passes(speed: float) -> bool:
        asked.append(speed)
        return speed <= 60.0 and speed != 40.0

    assert largest_entry_speed(passes) == 60.0
    assert asked[-1] == 62.0
    assert largest_entry_speed(lambda _: False) == 0.0
    assert largest_entry_speed(lambda _: True) == 100.0


def test_drivers_who_never_pass_leave_no_sideslip(software: BatchSoftware) -> None:
    found = lane_change_figures(Bench(software, software.config), (Hands(0.3, 0.05, 0.05),))
    assert (found.speed_km_h, found.passive_speed_km_h, found.drivers) == (0.0, 0.0, 1)
    assert math.isnan(found.sideslip_deg)
