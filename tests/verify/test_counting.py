"""Counts of single calls: instructions, cycles, stack, and the parts of a call. Evidence plants known instructions."""

import functools

import numpy as np

from codegen.emit.can_view import task_view
from codegen.verify.budgets.counting import CONDITIONS, EVENT, FOREIGN, MOTION, START, TASK, Calls, Counter
from codegen.verify.check import Subject
from tests.verify import builds, planted

PI = builds.made("pi", "uneven")


def counter_of(subject: Subject) -> Counter:
    return Counter(subject.sources(), "ars", task_view(builds.config_of("pi")))


@functools.cache
def counter() -> Counter:
    return counter_of(planted.subject_of(PI))


STEPS = np.array([[15.0, 0.07, 0.3, np.nan, 0.8, 0.0, restart] for restart in (1.0, 0.0, 0.0, 1.0)], dtype=np.float32)
PLACES = np.array([[15.0, 0.07, 0.9], [1.0, -0.3, 0.2], [np.nan, 0.0, np.nan]], dtype=np.float32)
DEMANDS = np.array([[15.0, 0.07, 0.02, 1.0], [15.0, 0.07, -0.04, 0.0]], dtype=np.float32)


def steps(target: Counter) -> Calls:
    calls = target.count("step", STEPS)
    return calls.where(calls.function == target.routine("controller_step").start)


def names(calls: Calls) -> list[str]:
    return [routine.name for address in calls.function if (routine := counter().program.at(int(address)))]


def test_each_call_is_counted_by_itself() -> None:
    target = counter()
    calls = target.count("step", STEPS)
    init, step = "ars_controller_init", "ars_controller_step"
    assert names(calls) == [init, step, step, step, init, step]  # a restart is a call of its own
    found = steps(target)
    assert (found.instructions[0], found.cycles[0]) == (found.instructions[3], found.cycles[3])
    assert (found.cycles > found.instructions).all()
    assert ((found.limiter > 0) & (found.limiter < found.instructions)).all()


def test_lookups_limiter_and_stack() -> None:
    target = counter()
    limiter = target.count("limiter", DEMANDS)
    own = limiter.where(limiter.function == target.routine("limiter_step").start)
    assert own.limiter.tolist() == own.instructions.tolist()
    for name in ("map_yaw_rate", "map_yaw_rate_on_road"):
        assert set(target.count(name.removeprefix("map_"), PLACES).function.tolist()) == {target.routine(name).start}
    # The watermark follows sixteen more words on the stack, of which the lowest is written.
    array = "    volatile uint32_t k = 0u;\n    volatile uint32_t planted[16];\n    planted[k] = 1u;\n"
    deep = counter_of(planted.started(PI, "ars_controller_step", array))
    for each in (target, deep):
        steps(each)
        assert 0 < each.stack["step"] <= each.program.depth("ars_controller_step").bytes
    assert deep.stack["step"] - target.stack["step"] in range(16 * 4, 18 * 4 + 1)


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
