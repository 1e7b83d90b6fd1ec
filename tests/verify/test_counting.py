"""Calls counted one by one: instructions, cycles, stack, and the parts of a call."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from codegen.emit.can_view import task_view
from codegen.emit.folder import Folder
from codegen.verify.budgets.counting import CONDITIONS, EVENT, FOREIGN, MOTION, START, TASK, Calls, Counter, Rows
from codegen.verify.budgets.cycles import REFILL
from tests.verify import builds

NOPS = 40


def counter_of(folder: Folder, files: dict[str, bytes] | None = None) -> Counter:
    sources = {path: content for path, content in (files or folder.files).items() if path.startswith(("include/", "src/"))}
    return Counter(sources, "ars", task_view(builds.config_of("pi")))


@functools.cache
def counter() -> Counter:
    return counter_of(builds.made("pi"))


def at_the_start_of(function: str, planted: str) -> Counter:
    """A build with a statement before all others of a public function."""
    folder = builds.made("pi")
    for path, content in folder.files.items():
        text = content.decode() if path.startswith("src/") else ""
        head = text.find(f" {function}(")
        if head >= 0 and text[: text.index("{", head)].count(";") == text[:head].count(";"):
            place = text.index("{", head) + 1
            return counter_of(folder, {**folder.files, path: f"{text[:place]}\n{planted}{text[place:]}".encode()})
    raise LookupError(function)


def nops(count: int) -> str:
    return f'    __asm__ volatile ("{"nop; " * count}");\n'


STEPS = np.array([[15.0, 0.07, 0.3, np.nan, 0.8, 0.0, restart] for restart in (1.0, 0.0, 0.0, 1.0)], dtype=np.float32)
PLACES = np.array([[15.0, 0.07, 0.9], [1.0, -0.3, 0.2], [np.nan, 0.0, np.nan]], dtype=np.float32)
DEMANDS = np.array([[15.0, 0.07, 0.02, 1.0], [15.0, 0.07, -0.04, 0.0]], dtype=np.float32)


def steps(target: Counter, rows: Rows = STEPS) -> Calls:
    calls = target.count("step", rows)
    return calls.where(calls.function == target.routine("controller_step").start)


def test_each_call_is_counted_by_itself() -> None:
    target = counter()
    calls = target.count("step", STEPS)
    # Two restarts, each one call of its own.
    names = [target.program.at(int(address)) for address in calls.function]
    assert [name.name.removeprefix("ars_controller_") for name in names if name] == [
        "init",
        "step",
        "step",
        "step",
        "init",
        "step",
    ]
    found = steps(target)
    assert found.instructions[0] == found.instructions[3]
    assert found.cycles[0] == found.cycles[3]
    assert (found.cycles > found.instructions).all()
    assert (found.limiter > 0).all()
    assert (found.limiter < found.instructions).all()


def test_instructions_more_are_counted_to_the_last_one() -> None:
    """A nop is one instruction and one cycle; only in the limiter's share where it is the limiter's."""
    before, after = steps(counter()), steps(at_the_start_of("ars_limiter_step", nops(NOPS)))
    assert (after.instructions - before.instructions).tolist() == [NOPS] * 4
    assert (after.limiter - before.limiter).tolist() == [NOPS] * 4
    assert (after.cycles - before.cycles).tolist() == [NOPS] * 4
    planted = steps(at_the_start_of("ars_controller_step", nops(NOPS)))
    assert (planted.instructions - before.instructions).tolist() == [NOPS] * 4
    assert planted.limiter.tolist() == before.limiter.tolist()


def test_instructions_more_in_one_state_are_counted_in_its_steps_alone() -> None:
    """Six samples are lost: as many are held as the configuration says, the others are in the fail-safe."""
    good, lost = [15.0, 0.07, 0.3, np.nan, 0.8, 0.0, 0.0], [np.nan, 0.07, 0.3, np.nan, 0.8, 0.0, 0.0]
    rows = np.array([[*good[:6], 1.0], good, good, *[lost] * 6], dtype=np.float32)
    place = "    self->yaw_rate_error = 0.0f;\n}\n\n/* The estimate"
    folder = builds.made("pi")
    planted = counter_of(folder, builds.with_text(folder, "src/ars_controller.c", place, nops(NOPS) + place))
    more = steps(planted, rows).instructions - steps(counter(), rows).instructions
    held = 3 + builds.config_of("pi").controller.fail_safe.degraded_samples_max
    assert held < 9
    assert more.tolist() == [0] * held + [NOPS] * (9 - held)


def test_a_jump_costs_the_refill_of_the_pipeline() -> None:
    before = steps(counter())
    after = steps(at_the_start_of("ars_controller_step", '    __asm__ volatile ("b 1f; 1:");\n'))
    assert (after.instructions - before.instructions).tolist() == [1] * 4
    # It jumps to the next instruction, which the trace cannot tell from no jump.
    assert set((after.cycles - before.cycles).tolist()) <= {1, 1 + REFILL}
    over = steps(at_the_start_of("ars_controller_step", '    __asm__ volatile ("b 1f; nop; 1:");\n'))
    assert (over.cycles - before.cycles).tolist() == [1 + REFILL] * 4


def test_lookups_and_limiter() -> None:
    target = counter()
    on_road, plain = target.count("yaw_rate_on_road", PLACES), target.count("yaw_rate", PLACES)
    assert set(on_road.function.tolist()) == {target.routine("map_yaw_rate_on_road").start}
    assert set(plain.function.tolist()) == {target.routine("map_yaw_rate").start}
    limiter = target.count("limiter", DEMANDS)
    own = limiter.where(limiter.function == target.routine("limiter_step").start)
    assert own.limiter.tolist() == own.instructions.tolist()
    assert target.lookups == ("map_yaw_rate", "map_yaw_rate_on_road")


def test_many_rows_are_counted_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = counter().count("step", STEPS)
    monkeypatch.setattr("codegen.verify.budgets.counting.ROWS_MAX", 3)
    assert counter().count("step", STEPS).instructions.tolist() == whole.instructions.tolist()


def events(*kinds: int) -> np.ndarray[tuple[int], np.dtype[np.void]]:
    found = np.zeros(len(kinds), dtype=EVENT)
    found["kind"], found["length"] = kinds, 8
    return found


def test_the_task_by_its_events() -> None:
    target = counter()
    calls = target.count("task", events(START, MOTION, CONDITIONS, FOREIGN, TASK))
    names = [target.program.at(int(address)) for address in calls.function]
    assert [name.name for name in names if name] == ["ars_task_init", *["ars_task_on_can_frame"] * 3, "ars_task_10ms"]
    assert calls.instructions[3] < calls.instructions[1]  # a foreign frame is left alone
    assert calls.packing.tolist()[:4] == [0, 0, 0, 0]
    assert 0 < calls.packing[4] < calls.instructions[4]
    planted = at_the_start_of("ars_can_pack_rear_steer_command", nops(NOPS))
    more = planted.count("task", events(START, TASK))
    assert more.packing[-1] - target.count("task", events(START, TASK)).packing[-1] == NOPS


def test_what_is_not_counted_leaves_its_state() -> None:
    """A frame that came before is known: of the two kinds of the next cycle, it makes the one that was not silent."""
    target = counter()
    target.run("task", events(START, MOTION))
    late = target.count("task", events(TASK)).instructions[0]
    target.run("task", events(START))
    assert target.count("task", events(TASK)).instructions[0] != late


def test_frames_are_packed_and_protected_by_the_build() -> None:
    rows = np.column_stack([STEPS, [[3, 7]] * 4]).astype(np.float32)
    found = counter().packed(rows)
    assert found["motion"].shape == (4, 8)
    assert set((found["motion"][:, 1] & 0x0F).tolist()) == {3}
    assert set((found["conditions"][:, 1] & 0x0F).tolist()) == {7}
    assert int.from_bytes(found["motion"][0, 2:4].tobytes(), "little", signed=True) == round(15.0 / 0.005)


def test_the_stack_that_a_call_takes() -> None:
    """Sixteen words more on the stack, the lowest of them written to: the watermark goes down with them."""
    target = counter()
    steps(target)
    array = "    volatile uint32_t k = 0u;\n    volatile uint32_t planted[16];\n    planted[k] = 1u;\n"
    deep = at_the_start_of("ars_controller_step", array)
    steps(deep)
    assert deep.stack["step"] - target.stack["step"] in range(16 * 4, 18 * 4 + 1)
    for each in (deep, target):
        assert 0 < each.stack["step"] <= each.program.depth("ars_controller_step").bytes


def test_blocks_that_ran() -> None:
    target = counter_of(builds.made("pi"))
    target.count("limiter", DEMANDS)
    start = {routine.name: routine.start for routine in target.program.routines}
    entered = {address for address, _ in target.entered}
    assert {start["ars_limiter_step"], start["ars_limiter_init"]} <= entered
    assert start["ars_controller_step"] not in entered
    frame = [routine for routine in target.program.routines if routine.unit == "budget.c"]
    assert not any(routine.start <= address < routine.end for routine in frame for address in entered)


def test_sizes_of_the_structs() -> None:
    """All members of the limiter's state are words, but for the flag at the end, which fills one."""
    assert counter().structs["limiter"] == 16
    assert counter().structs["controller"] < counter().structs["task"]
    assert set(counter().structs) == {"controller", "limiter", "task", "parameters"}
