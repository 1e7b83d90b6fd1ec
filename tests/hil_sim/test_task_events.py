"""Events of the task: late calls, an intermittent bus and a stuck actuator, each alone, and none of them in a healthy car."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from codegen.config import Kind
from codegen.sil.software import RECORD_COLUMNS, Software, Status
from hil_sim import manoeuvres
from hil_sim.bench import run_in_process
from hil_sim.clocks import Clocks
from hil_sim.diagnostics import DIAGNOSTICS
from hil_sim.faults import Fault
from hil_sim.frames import Frame
from hil_sim.plant_node import PlantNode
from hil_sim.runs import run_through_can
from hil_sim.scenarios import SCENARIOS, Scenario, find
from hil_sim.suite.plants import changed
from tests import builds

BIT = {name: 1 << bit for bit, (name, _) in DIAGNOSTICS.items()}
LATE, INTERMITTENT, STUCK = BIT["TASK_LATE"], BIT["INTERMITTENT"], BIT["ACTUATOR_STUCK"]
PERIOD = 0.01


def step_steer(duration: float, *faults: Fault) -> Scenario:
    return replace(find("step-steer"), duration=duration, steer_time=0.5, drive=manoeuvres.step(0.5), faults=faults)


def events(
    software: Software,
    scenario: Scenario,
    calls: Callable[[int], bool] = lambda _: True,
    comes: Callable[[int], bool] = lambda _: True,
    stuck_from: int | None = None,
) -> list[int]:
    """Diagnostics of each call of the task.

    Args:
        calls: whether the task is called in a cycle.
        comes: whether the frames of a cycle come.
        stuck_from: cycle from which the rear wheels stay where they are.
    """
    node, task, found = PlantNode(software.config, scenario), software.task(), []
    for cycle in range(node.cycles):
        for frame in node.outgoing(cycle):
            if comes(cycle):
                task.on_can_frame(frame.id, frame.data)
        if calls(cycle):
            answer = Frame(*task.run())
            if stuck_from is None or cycle < stuck_from:
                node.receive(answer)
            found.append(int.from_bytes(answer.data[6:8], "little"))
        node.finish(cycle)
    return found


def first(diagnostics: Sequence[int], mask: int) -> int | None:
    return next((index for index, bits in enumerate(diagnostics) if bits & mask), None)


# A driver with a queue gives both frames, one with a mailbox the last.
@pytest.mark.parametrize("queued", [True, False])
def test_a_task_that_is_called_every_20_ms_is_late(software: Software, queued: bool) -> None:
    """One step more is left behind with each call, and the fourth exceeds three. A first frame alone leaves none behind."""
    found = events(software, step_steer(1.0), lambda cycle: cycle % 2 == 1, lambda cycle: queued or cycle % 2 == 1)
    assert first(found, LATE) == (3 if queued else 4)
    assert all(bits & LATE for bits in found[4:])


def test_a_task_that_is_20_percent_slow_is_late(software: Software) -> None:
    """A step in five calls less one in 64: more than three after 20 calls, and once more at most."""
    found = events(software, step_steer(2.0), lambda cycle: cycle % 6 != 5)
    late = first(found, LATE)
    assert late is not None and late <= 25
    assert all(bits & LATE for bits in found[30:])


def test_one_late_call_is_none(software: Software) -> None:
    found = events(software, step_steer(1.0), lambda cycle: cycle % 30 != 29)
    assert first(found, LATE) is None


# Each return adds 10 and each other call takes 1: after `returns` of them there are more than 40.
@pytest.mark.parametrize(("period", "lost", "returns"), [(2, 1, 5), (4, 3, 6), (4, 1, 6), (9, 1, 17)])
def test_an_intermittent_bus(software: Software, period: int, lost: int, returns: int) -> None:
    begin = 30
    shown = begin + lost + (returns - 1) * period
    found = events(software, step_steer(2.5), comes=lambda cycle: cycle < begin or (cycle - begin) % period >= lost)
    assert first(found, INTERMITTENT) == shown
    assert all(bits & INTERMITTENT for bits in found[shown + 4 * period :])
    assert first(found, LATE) is None


def test_silence_and_a_lasting_fault_are_not_intermittent(software: Software) -> None:
    for fault in (Fault("bus-down", 0.2, 0.5), Fault("corrupt", 0.2, 0.5), Fault("drop", 0.2, 0.01)):
        assert not np.bitwise_or.reduce(run_through_can(software, step_steer(1.5, fault)).diagnostics) & INTERMITTENT


def test_intermittent_loss_ends_in_the_fail_safe(software: Software) -> None:
    """Three of four samples lost for ever, above the speed from which the rear angle is held."""
    faults = tuple(Fault("drop", start, 0.03) for start in np.arange(1.0, 3.0, 0.04))
    result = run_through_can(software, step_steer(3.0, *faults))
    status = result.record[:, RECORD_COLUMNS.index("status")]
    assert (status[110:] == Status.FAIL_SAFE).all()


@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_a_stuck_actuator(kind: Kind) -> None:
    """The rear wheels stay straight ahead. The step asks for more than is tolerated within 0.1 s, and the kind "tracking" goes
    back to the other side for 0.2 s; then the time runs."""
    software = builds.of_kind(kind).software
    found = events(software, step_steer(3.0), stuck_from=30)
    since = first(found, STUCK)
    assert since is not None
    assert 0 < since - 50 - software.parameters().actuator_samples_max < 45


@pytest.mark.parametrize("lag", [0.02, 0.1])
def test_a_healthy_car_shows_none(lag: float) -> None:
    """With an actuator twice as slow or fast as configured, in every scenario and with two clocks."""
    software = builds.of_kind("tracking").software
    config = changed(software.config, {"rear_actuator": {"lag_s": lag}})
    for name, scenario in SCENARIOS.items():
        if scenario.faults:
            continue
        node = PlantNode(config, replace(scenario, clocks=Clocks(100.0, 0.7)))
        seen = int(np.bitwise_or.reduce(run_in_process(node, software).diagnostics))
        assert not seen & (LATE | INTERMITTENT | STUCK), name
