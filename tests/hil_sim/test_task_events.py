"""Events of the task in closed loop: none without a cause, and the outcome of a bus that loses most samples.

`tests/sil` compares the time of each event with a second implementation.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from codegen.sil.software import Software, Status
from hil_sim import manoeuvres
from hil_sim.bench import run_in_process, run_through_can
from hil_sim.codec import DIAGNOSTICS, Codec, frame_of
from hil_sim.faults import Fault
from hil_sim.metrics import column
from hil_sim.plant_node import PlantNode
from hil_sim.scenario_files import find
from hil_sim.scenarios import FREE_RUNNING, SCENARIOS, Scenario
from hil_sim.settings import Settings
from tests import builds

CONDITIONS = builds.CONFIG.can.vehicle_conditions.name
BIT = {name: 1 << bit for bit, (name, _) in DIAGNOSTICS.items()}
LATE, INTERMITTENT, STUCK = BIT["TASK_LATE"], BIT["INTERMITTENT"], BIT["ACTUATOR_STUCK"]


def step_steer(duration: float, *faults: Fault) -> Scenario:
    return replace(find("step-steer"), duration=duration, steer_time=0.5, drive=manoeuvres.step(0.5), faults=faults)


def test_silence_and_a_lasting_fault_are_not_intermittent(software: Software) -> None:
    for fault in (Fault("bus-down", 0.2, 0.5), Fault("corrupt", 0.2, 0.5), Fault("drop", 0.2, 0.01)):
        assert not np.bitwise_or.reduce(run_through_can(software, step_steer(1.5, fault)).diagnostics) & INTERMITTENT


def test_three_of_four_samples_lost_end_in_the_fail_safe(software: Software) -> None:
    faults = (Fault("drop", start, 0.03) for start in np.arange(1.0, 3.0, 0.04))
    assert (column(run_through_can(software, step_steer(3.0, *faults)).record, "status")[110:] == Status.FAIL_SAFE).all()


def lost_in_ten(cycles: tuple[int, ...], message: str | None) -> Scenario:
    """Return a step steer in which the frames of these cycles of every ten are lost from 1 s on; None: of both messages."""
    starts = (start + 0.01 * cycle for start in np.arange(1.0, 4.0, 0.1) for cycle in cycles)
    return step_steer(4.0, *(Fault("drop", start, 0.01, message=message) for start in starts))


@pytest.mark.parametrize("message", [None, builds.CONFIG.can.vehicle_motion.name, CONDITIONS])
@pytest.mark.parametrize("cycles", [(0, 3, 6), (0, 1, 2)], ids=["spread", "in a row"])
def test_three_of_ten_frames_lost_are_degraded(software: Software, cycles: tuple[int, ...], message: str | None) -> None:
    """Once the bus counts as intermittent, after a second at most, each sample is DEGRADED; none is FAIL_SAFE."""
    status = column(run_through_can(software, lost_in_ten(cycles, message)).record, "status")
    assert (status[110:] < Status.FAIL_SAFE).all() and (status[210:] == Status.DEGRADED).all()


def test_frames_lost_at_random_end_the_fail_safe_of_a_long_loss(software: Software) -> None:
    """With three of ten lost at random, four in a row lead to the fail-safe, and it ends without ten good ones in a row."""
    rng = np.random.default_rng(1)
    starts = (start + 0.01 * cycle for start in np.arange(1.0, 8.0, 0.1) for cycle in rng.choice(10, 3, replace=False))
    status = column(
        run_through_can(software, step_steer(8.0, *(Fault("drop", each, 0.01) for each in starts))).record, "status"
    )
    assert 0 < (status[110:] == Status.FAIL_SAFE).sum() < 70  # of 690; 4 to 40 for each loss of four


def check_healthy_car(lag: float, scenarios: Iterable[str]) -> None:
    """Check that a car with an actuator of this lag (s) shows no event, with two clocks."""
    software = builds.of_kind("tracking").software
    config = software.config.replace({"rear_actuator": {"lag_s": lag}})
    for name, scenario in ((name, SCENARIOS[name]) for name in scenarios):
        if not scenario.faults:
            node = PlantNode(config, replace(scenario, clocks=FREE_RUNNING))
            seen = int(np.bitwise_or.reduce(run_in_process(node, software).diagnostics))
            assert not seen & (LATE | INTERMITTENT | STUCK), name


def held_turn(*faults: Fault, duration: float = 4.0) -> Scenario:
    """Return a slow turn with a large rear angle."""
    drive = manoeuvres.step(0.5, front_angle_deg=8.0)
    return replace(step_steer(duration, *faults), drive=drive, settings=Settings(speed_km_h=30.0))


@pytest.mark.parametrize("measures", [True, False])
def test_after_a_silence_the_command_starts_from_the_actuator(software: Software, measures: bool) -> None:
    """The actuator holds its angle while the bus is down. Without a new measurement the last measured angle counts."""
    missing = () if measures else (Fault("not-a-number", 1.5, 2.5, message=CONDITIONS, signal="rear_angle"),)
    result = run_through_can(software, held_turn(Fault("bus-down", 1.5, 1.5), *missing))
    sent, rear = column(result.record, "rear_angle_command_rad"), column(result.record, "rear_angle_rad")
    assert abs(rear[299]) > np.radians(1.0)  # else the test shows nothing
    assert (column(result.record, "status")[300:308] == Status.FAIL_SAFE).all()
    controller, code = software.config.controller, software.config.can.rear_steer_command.real("rear_angle").factor
    step = np.radians(controller.fail_safe.rate_deg_s) * controller.sampling_time_s + code  # two rounded commands
    first = 300 + int(np.argmax(sent[300:] != sent[299]))
    assert abs(sent[first] - rear[first - 1 if measures else 149]) <= step + code  # and a rounded measurement
    assert first < 312 and np.abs(np.diff(sent[first:320])).max() <= step


@pytest.mark.parametrize(
    "impaired",
    [
        held_turn(Fault("drop", 1.0, 2.0, message=CONDITIONS)),
        held_turn(Fault("stuck-value", 0.4, 3.5, message=CONDITIONS, signal="rear_angle")),
    ],
    ids=["conditions lost", "actuator stuck"],
)
def test_an_impaired_loop_is_degraded(software: Software, impaired: Scenario) -> None:
    """From the tenth cycle after the loss, and after the time of the stuck actuator, until the end of the fault."""
    status = column(run_through_can(software, impaired).record, "status")
    assert (status[200:290] == Status.DEGRADED).all()
    assert (status[:40][status[:40] != Status.STANDBY] != Status.DEGRADED)[5:].all()


def test_a_late_task_is_degraded(software: Software) -> None:
    """The task runs in every second cycle. Its state, which measurement systems read, has the status of each frame."""
    node, task, seen = PlantNode(software.config, held_turn(duration=1.0)), software.task(), []
    for cycle in range(node.cycles):
        for frame in node.outgoing(cycle):
            task.on_can_frame(frame.id, frame.data)
        if cycle % 2:
            answer = frame_of(node.can, *task.run())
            seen.append(Codec(node.can, software.precision).decode(answer.id, answer.data).status)
            node.receive(answer)
            assert seen[-1] == task.state.supervision.status
    assert set(seen[-20:]) == {Status.DEGRADED}


LAGS = (0.02, 0.1)
"""s: the actuator is twice as fast or as slow as configured."""


@pytest.mark.parametrize("half", [0, 1])
def test_a_healthy_car_shows_none(half: int) -> None:
    """Every scenario has one of the lags. tests/evidence/drives has both."""
    check_healthy_car(LAGS[half], list(SCENARIOS)[half::2])
