"""Events of the task: late calls, an intermittent bus and a stuck actuator, each alone, and none of them in a healthy car."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from codegen.config import Kind
from codegen.sil.software import Software, Status
from hil_sim import manoeuvres
from hil_sim.bench import run_in_process
from hil_sim.clocks import FREE_RUNNING
from hil_sim.diagnostics import DIAGNOSTICS
from hil_sim.faults import Fault
from hil_sim.frames import Frame
from hil_sim.metrics import column
from hil_sim.plant_node import PlantNode
from hil_sim.runs import run_through_can
from hil_sim.scenarios import SCENARIOS, Scenario, find
from hil_sim.suite.plants import changed
from tests import builds

BIT = {name: 1 << bit for bit, (name, _) in DIAGNOSTICS.items()}
LATE, INTERMITTENT, STUCK = BIT["TASK_LATE"], BIT["INTERMITTENT"], BIT["ACTUATOR_STUCK"]
Cycles = Callable[[int], bool]


def always(_: int) -> bool:
    return True


def step_steer(duration: float, *faults: Fault) -> Scenario:
    return replace(find("step-steer"), duration=duration, steer_time=0.5, drive=manoeuvres.step(0.5), faults=faults)


def events(
    software: Software, duration: float, calls: Cycles = always, comes: Cycles = always, moves: Cycles = always
) -> list[int]:
    """Diagnostics of each call: the cycles with a call, those whose frames come, and those in which the actuator moves."""
    node, task, found = PlantNode(software.config, step_steer(duration)), software.task(), []
    for cycle in range(node.cycles):
        for frame in node.outgoing(cycle):
            if comes(cycle):
                task.on_can_frame(frame.id, frame.data)
        if calls(cycle):
            answer = Frame(*task.run())
            if moves(cycle):
                node.receive(answer)
            found.append(int.from_bytes(answer.data[6:8], "little"))
        node.finish(cycle)
    return found


def first(diagnostics: list[int], mask: int) -> int:
    return next((index for index, bits in enumerate(diagnostics) if bits & mask), -1)


# A driver with a queue gives both frames, one with a mailbox the last.
@pytest.mark.parametrize("queued", [True, False])
def test_a_task_that_is_called_every_20_ms_is_late(software: Software, queued: bool) -> None:
    """One step more is left behind with each call, and the fourth exceeds three. A first frame alone leaves none behind."""
    found = events(software, 1.0, lambda cycle: cycle % 2 == 1, lambda cycle: queued or cycle % 2 == 1)
    assert first(found, LATE) == (3 if queued else 4)
    assert all(bits & LATE for bits in found[4:])


# Each return adds 10 and each other call takes 1: after `returns` of them there are more than 40.
@pytest.mark.parametrize(("period", "lost", "returns"), [(2, 1, 5), (4, 3, 6), (9, 1, 17)])
def test_an_intermittent_bus(software: Software, period: int, lost: int, returns: int) -> None:
    found = events(software, 2.5, comes=lambda cycle: cycle < 30 or (cycle - 30) % period >= lost)
    shown = 30 + lost + (returns - 1) * period
    assert first(found, INTERMITTENT) == shown and first(found, LATE) == -1
    assert all(bits & INTERMITTENT for bits in found[shown + 4 * period :])


def test_silence_and_a_lasting_fault_are_not_intermittent(software: Software) -> None:
    for fault in (Fault("bus-down", 0.2, 0.5), Fault("corrupt", 0.2, 0.5), Fault("drop", 0.2, 0.01)):
        assert not np.bitwise_or.reduce(run_through_can(software, step_steer(1.5, fault)).diagnostics) & INTERMITTENT


def test_three_of_four_samples_lost_end_in_the_fail_safe(software: Software) -> None:
    faults = (Fault("drop", start, 0.03) for start in np.arange(1.0, 3.0, 0.04))
    assert (column(run_through_can(software, step_steer(3.0, *faults)).record, "status")[110:] == Status.FAIL_SAFE).all()


@pytest.mark.parametrize("kind", ["pi", "tracking"])
def test_a_stuck_actuator(kind: Kind) -> None:
    """The step asks for more than is tolerated within 0.1 s, "tracking" then less for up to a second; and the time runs."""
    software = builds.of_kind(kind).software
    found = events(software, 3.0, moves=lambda cycle: cycle < 30)
    assert 50 < first(found, STUCK) - software.parameters().actuator_samples_max < (95 if kind == "pi" else 195)


@pytest.mark.parametrize("lag", [0.02, 0.1])
def test_a_healthy_car_shows_none(lag: float) -> None:
    """With an actuator twice as slow or fast as configured, in every scenario and with two clocks."""
    software = builds.of_kind("tracking").software
    config = changed(software.config, {"rear_actuator": {"lag_s": lag}})
    for name, scenario in SCENARIOS.items():
        if not scenario.faults:
            node = PlantNode(config, replace(scenario, clocks=FREE_RUNNING))
            seen = int(np.bitwise_or.reduce(run_in_process(node, software).diagnostics))
            assert not seen & (LATE | INTERMITTENT | STUCK), name
