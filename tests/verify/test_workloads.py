"""Rows for each counted function, cycles of the task with all bus events, and the search for the longest call."""

import functools

import numpy as np
import pytest

from codegen.emit.can_view import task_view
from codegen.sil.software import Status
from codegen.verify.budgets.counting import CONDITIONS, MOTION, TASK, Counter, Rows
from codegen.verify.budgets.workloads import Fault, events_of, flooded, histories, long_histories, long_task_histories
from codegen.verify.budgets.worst import Figures, Search
from codegen.verify.drives import Thresholds, measurements_of
from hil_sim.e2e import E2eStatus, Receiver
from tests.verify import builds, planted

MOTION_ID = 0x101
PI = builds.made("pi", "uneven")
THRESHOLDS = Thresholds.of(PI.manifest)


@functools.cache
def counter() -> Counter:
    return Counter(planted.subject_of(PI).sources(), "ars", task_view(builds.config_of("pi")))


def cycles(*faults: Fault) -> Rows:
    rows = [[15.0, 0.07, 0.3, 0.01, 0.8, 4.5, 0.0, float(index == 0), float(fault), 0.0] for index, fault in enumerate(faults)]
    return np.array(rows, dtype=np.float32)


def statuses(rows: Rows) -> list[list[E2eStatus]]:
    """Return an independent receiver's status of the motion frames, cycle by cycle."""
    found, receiver = events_of(rows, counter()), Receiver(THRESHOLDS.config.can.e2e)
    seen: list[list[E2eStatus]] = [[] for _ in rows]
    for event, row in zip(found.events, found.row, strict=True):
        if event["kind"] == MOTION and event["length"] == 8:
            seen[row].append(receiver.check(MOTION_ID, event["data"].tobytes()))
        if event["kind"] == TASK and not seen[row]:
            seen[row].append(receiver.no_new_data())
    return seen


@pytest.mark.parametrize(
    ("fault", "status"),
    [
        (Fault.NONE, E2eStatus.OK),
        (Fault.MISSING, E2eStatus.NO_NEW_DATA),
        (Fault.WRONG_CRC, E2eStatus.WRONG_CRC),
        (Fault.SAME_COUNTER, E2eStatus.REPEATED),
        (Fault.ONE_LOST, E2eStatus.OK_SOME_LOST),
        (Fault.JUMP, E2eStatus.WRONG_SEQUENCE),
        (Fault.COUNTER_15, E2eStatus.WRONG_CRC),
        (Fault.FOREIGN, E2eStatus.OK),
    ],
)
def test_a_receiver_recognises_each_fault(fault: Fault, status: E2eStatus) -> None:
    rows = cycles(Fault.NONE, Fault.NONE, fault, Fault.NONE)
    assert (statuses(rows)[0], statuses(rows)[2]) == ([E2eStatus.INITIAL], [status])
    assert events_of(rows, counter()).regular.tolist() == [True, True, fault is not Fault.FOREIGN, True]


def test_calls_that_are_not_counted_leave_their_state() -> None:
    """The task's last run takes another path with frames than without, even if they came before the count."""
    instructions = []
    for fault in (Fault.NONE, Fault.MISSING):
        events = events_of(cycles(Fault.NONE, fault), counter()).events
        assert events[-1]["kind"] == TASK
        counter().run("task", events[:-1])
        instructions.append(counter().count("task", events[-1:]).instructions[0])
    assert instructions[0] != instructions[1]


def test_long_histories_reach_their_limits() -> None:
    fail_safe = THRESHOLDS.config.controller.fail_safe
    ways = long_histories(THRESHOLDS)
    assert any(len(way.before) == 1 + fail_safe.degraded_samples_max + 2 + fail_safe.recovery_samples - 1 for way in ways)
    of_task = long_task_histories(THRESHOLDS)
    seen = statuses(np.concatenate([of_task[-1].before, of_task[-1].then]))  # a silence, then frames
    after = len(of_task[-1].then)
    assert seen[:-after].count([E2eStatus.NO_NEW_DATA]) > THRESHOLDS.config.can.e2e.max_no_new_or_repeated_data
    assert [E2eStatus.SYNC] in seen[-after:]
    kinds = flooded()["kind"].tolist()  # more frames than the counter of a cycle holds
    assert kinds.count(MOTION) == kinds.count(CONDITIONS) > 2**8


def test_each_history_leads_to_another_state() -> None:
    good = np.array([[15.0, 0.02, 0.1, np.nan, np.nan, np.nan, 0.0, 0.0]], dtype=np.float32)
    runs = [
        builds.compiled("pi").controller().run(measurements_of(np.concatenate([history, good])[:, :7]))
        for history in histories(THRESHOLDS)
    ]
    expected = [Status.STANDBY, Status.TRACKING, *3 * [Status.DEGRADED], Status.FAIL_SAFE]
    assert [commands[-2].status for commands in runs] == expected
    assert runs[-1][-1].status in (Status.TRACKING, Status.LIMITED)  # one good sample ends that fail-safe


def rare_combination(rows: Rows) -> Figures:
    """Return instruction counts that are high where each of four inputs is near its own value. No drawn row has all four."""
    goal = np.array([0.3, -0.7, 0.1, 0.9])
    return {"instructions": 100 + 10 * (np.abs(rows - goal) < 0.05).sum(axis=1)}


def test_the_search_combines_separate_findings() -> None:
    search = Search(rare_combination, "instructions")
    search.run([np.random.default_rng(seed).uniform(-1.0, 1.0, (2_000, 4)).astype(np.float32) for seed in range(2)])
    assert search.spread("instructions", 1).largest < 140
    search.improve(12, np.random.default_rng(1))
    assert search.largest("instructions")[1]["instructions"] == search.spread("instructions", 1).largest == 140
    assert np.allclose(search.worst_input(), [0.3, -0.7, 0.1, 0.9], atol=0.05)
