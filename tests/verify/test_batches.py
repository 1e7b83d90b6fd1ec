"""Batches of calls for the emulated cores, the rows that drive them, and drives of the controller from many starts."""

import functools
import math

import numpy as np

from codegen.emit.can_view import DIAGNOSTIC_CAUSES
from codegen.sil.closed_loop import ClosedLoop, LoopOptions
from codegen.sil.software import RECORD_COLUMNS, Status, compile_build
from codegen.verify import traffic
from codegen.verify.drives import DELAY_SAMPLES, Thresholds, drawn, measurements_of, recorded
from codegen.verify.emulated_batches import OnHost, Program, Rows, program_of, rows_of_cycles
from codegen.verify.emulated_streams import Source
from hil_sim.bench import run_through_can
from hil_sim.scenarios import SCENARIOS
from tests.verify import builds

TRACKING = builds.made("tracking", "uneven")


@functools.cache
def program() -> Program:
    return program_of(builds.compiled(), TRACKING.files)


@functools.cache
def host() -> OnHost:
    return OnHost(program())


def column(batch: str, rows: Rows, name: str) -> Rows:
    return rows[:, [output.name for output in program().batches[batch].outputs].index(name)]


def test_random_steps_reach_every_status_and_every_kind_of_number() -> None:
    """The tour at their start alone reaches every status, and recovers from both ways into the fail-safe."""
    batch = program().batches["controller"]
    rows = Source(Thresholds.of(TRACKING.manifest), np.uint32, np.random.default_rng(0)).steps(batch, 4_000)
    for place in range(1, 8):
        numbers = rows[:, place].view(np.float32)
        assert np.isinf(numbers).any()
        assert (np.isnan(numbers) & (rows[:, place] & 0x400000 == 0)).any()  # signalling NaN
        assert ((np.abs(numbers) < np.finfo(np.float32).tiny) & (numbers != 0.0)).any()
    assert set(rows[:, 8].tolist()) == {0, 1}
    tour = rows[: int(np.flatnonzero(rows[:, 0])[1])]
    status = column("controller", host().run(batch, tour), "command.status")
    assert set(status.tolist()) == set(Status)
    assert len(np.flatnonzero((status[1:] == Status.FAIL_SAFE) & (status[:-1] != Status.FAIL_SAFE))) == 2
    assert status[-1] in (Status.TRACKING, Status.LIMITED)


def test_disturbed_traffic_sets_every_diagnostic_and_reaches_every_status() -> None:
    software, batch = builds.compiled(), program().batches["task"]
    _, cycles = traffic.closed_loop(software)
    disturbed = traffic.disturbed(software.config, cycles, 2_000)
    assert max(map(len, disturbed)) <= traffic.FRAMES
    results = host().run(batch, rows_of_cycles(disturbed, batch, np.uint32, traffic.restarts_of(2_000)))
    causes = np.bitwise_or.reduce(column("task", results, "data[4..7]") >> 16)
    assert causes == 2 ** len(DIAGNOSTIC_CAUSES) - 1
    reached = set(column("task", results, "state.controller.status").tolist())
    assert reached >= set(Status) - {Status.STANDBY}, "standby is that of a car without a speed"
    assert set(column("task", results, "complete").tolist()) == {0, 1}


def test_the_recorded_scenario_reproduces_the_closed_loop() -> None:
    """Played back, its frames make the task repeat the bench's commands."""
    software, batch = builds.compiled(), program().batches["task"]
    name, cycles = traffic.closed_loop(software)
    results = host().run(batch, rows_of_cycles(cycles, batch, np.uint32))
    commands = run_through_can(software, SCENARIOS[name]).record[:, 7]
    codes = (column("task", results, "data[0..3]") >> 16).astype(np.int16)
    assert len(cycles) == len(commands)
    started = np.flatnonzero(codes != -32768)
    assert len(started) > 1_000
    np.testing.assert_array_equal(codes[started], np.rint(commands[started] * 20_000.0).astype(np.int16))
    assert np.abs(codes[started]).max() > 100


def test_a_recording_holds_the_controller_s_measurements() -> None:
    """Played back, it makes a controller repeat the loop's commands bit for bit, including estimate and inhibit."""
    folder = builds.made("tracking")
    # Ideal, because a recording holds true values.
    software = compile_build(folder.files, folder.manifest, builds.config_of("tracking").with_ideal_plant())
    drives = recorded(software)
    assert len(drives) == len(SCENARIOS)
    for scenario, drive in zip(SCENARIOS.values(), drives, strict=True):
        record = ClosedLoop(software, LoopOptions(delay_samples=DELAY_SAMPLES)).run(scenario.inputs(software.config))
        commands = [command.rear_angle for command in software.controller().run(measurements_of(drive))]
        assert commands == record[:, RECORD_COLUMNS.index("rear_angle_command_rad")].tolist()


def test_drawn_samples_cover_the_map() -> None:
    thresholds = Thresholds.of(TRACKING.manifest)
    inputs = thresholds.config.controller.inputs
    without_gaps = drawn(thresholds, 4_000)[0]
    speed, front_angle, _, rear_angle, friction, lateral_acceleration, inhibit = without_gaps.T
    speed_max = inputs.speed_max_km_h / 3.6
    assert np.histogram(speed, bins=10, range=(0.0, speed_max))[0].min() > 0
    assert speed.min() < 0.0 < np.abs(speed).max() <= speed_max
    assert np.abs(front_angle).max() <= np.float32(math.radians(inputs.front_angle_max_deg))
    assert all(0.1 < np.isnan(optional).mean() < 0.9 for optional in (rear_angle, friction, lateral_acceleration))
    assert set(inhibit.tolist()) == {0.0, 1.0}
    for values, corners in ((speed, thresholds.speed), (np.abs(front_angle), thresholds.front_angle)):
        inside = corners[corners < 0.99 * corners.max()].astype(np.float32)  # in the precision of the C
        assert np.isin(inside, values).mean() > 0.9


def test_drawn_drives_reach_every_cell_of_the_schedule() -> None:
    """`test_law` covers the statuses that they reach."""
    speeds = np.concatenate([drive[:, 0] for drive in drawn(Thresholds.of(TRACKING.manifest), 1_500)])
    breakpoints = np.array(builds.SCHEDULE["speed_km_h"], dtype=np.float32) / np.float32(3.6)
    cells = np.searchsorted(breakpoints, speeds[np.isfinite(speeds)])
    assert set(range(len(breakpoints))) <= set(cells.tolist())
