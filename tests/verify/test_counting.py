"""Counts of single calls: instructions, cycles, and the parts of a call. `test_budgets` plants loops in each function."""

import functools

import numpy as np

from codegen.emit.can_view import task_view
from codegen.verify.budgets.counting import CONDITIONS, EVENT, FOREIGN, MOTION, START, TASK, Calls, Counter
from tests.verify import builds, planted

PI = builds.made("pi", "uneven")


@functools.cache
def counter() -> Counter:
    return Counter(planted.subject_of(PI).sources(), "ars", task_view(builds.config_of("pi")))


STEPS = np.array([[15.0, 0.07, 0.3, np.nan, 0.8, 0.0, restart] for restart in (1.0, 0.0, 0.0, 1.0)], dtype=np.float32)


def names(calls: Calls) -> list[str]:
    return [routine.name for address in calls.function if (routine := counter().program.at(int(address)))]


def test_each_call_is_counted_by_itself() -> None:
    target = counter()
    calls = target.count("step", STEPS)
    init, step = "ars_controller_init", "ars_controller_step"
    assert names(calls) == [init, step, step, step, init, step]  # a restart is a call of its own
    found = calls.where(calls.function == target.routine("controller_step").start)
    assert (found.instructions[0], found.cycles[0]) == (found.instructions[3], found.cycles[3])
    assert (found.cycles > found.instructions).all()
    assert ((found.limiter > 0) & (found.limiter < found.instructions)).all()


def events(*kinds: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    found = np.zeros(len(kinds), dtype=EVENT)
    found["kind"], found["length"] = kinds, 8
    return found


def test_the_task_is_counted_by_its_events() -> None:
    target = counter()
    calls = target.count("task", events(START, MOTION, CONDITIONS, FOREIGN, TASK))
    assert names(calls) == ["ars_task_init", *["ars_task_on_can_frame"] * 3, "ars_task_10ms"]
    assert calls.instructions[3] < calls.instructions[1]  # a foreign frame is ignored
    assert calls.packing.tolist()[:4] == [0, 0, 0, 0]
    assert 0 < calls.packing[4] < calls.instructions[4]
    # Calls that are run without being counted leave their state: one with a frame received, one without.
    target.run("task", events(START, MOTION))
    received = target.count("task", events(TASK)).instructions[0]
    target.run("task", events(START))
    assert target.count("task", events(TASK)).instructions[0] != received
