"""Inputs of the counted functions: the directed drives reach the states in which a call takes long, as frames too."""

import functools

import numpy as np
import pytest

from codegen.emit.can_view import task_view
from codegen.sil.software import Command, Status
from codegen.verify.drives import Thresholds, drawn, measurements_of
from codegen.verify.resource_usage import Counter
from codegen.verify.workloads import DRIVE_COLUMNS, START, TASK, cycles_of, events_of, histories, steps_of
from hil_sim.e2e import E2eStatus, Receiver
from tests.verify import builds, planted

PI = builds.made("pi", "uneven")
CONFIG = builds.config_of("pi", "uneven")
HISTORIES = tuple(histories(CONFIG))


@functools.cache
def counter() -> Counter:
    return Counter(planted.subject_of(PI).sources(), "ars", task_view(CONFIG))


@functools.cache
def driven(index: int) -> list[Command]:
    """Return the commands of the controller in a directed drive."""
    return builds.compiled("pi").controller().run(measurements_of(HISTORIES[index][:, : len(DRIVE_COLUMNS)]))


def test_directed_drives_reach_their_states() -> None:
    ends = [Status.FAIL_SAFE, Status.DEGRADED, Status.TRACKING, Status.FAIL_SAFE, Status.TRACKING]
    assert [driven(index)[-1].status for index in range(len(ends))] == ends
    recovering = [command.status for command in driven(2)]
    assert recovering.count(Status.FAIL_SAFE) >= CONFIG.controller.fail_safe.recovery_samples - 1
    assert driven(6)[0].status is Status.STANDBY


def test_directed_drives_have_longer_steps_than_drawn_ones() -> None:
    """Offsets that are learned from contradicting signals take 4 % longer than any of 2,500 drawn samples."""
    start = counter().routine("controller_step").start

    def longest(rows: np.ndarray) -> int:
        calls = counter().count("step", rows)
        return int((calls["instructions"] - calls["limiter"])[calls["function"] == start].max())

    drives = drawn(Thresholds.of(PI.manifest), 500)
    wild = max(longest(np.column_stack([drive, np.arange(500) == 0]).astype(np.float32)) for drive in drives)
    assert max(map(longest, HISTORIES)) > 1.04 * wild


def test_steps_start_with_the_usual_ones() -> None:
    thresholds = Thresholds.of(PI.manifest)
    first = drawn(thresholds, 5)[0]
    rows, usual = steps_of((first, first[:3]), thresholds, 20)
    assert usual == 8
    assert np.array_equal(rows[:5, :-1], first, equal_nan=True)
    assert np.flatnonzero(rows[:8, -1]).tolist() == [0, 5]
    assert steps_of((), thresholds, 20)[1] == 20


def test_frames_are_valid_and_one_is_lost_after_a_lost_sample() -> None:
    rows = HISTORIES[-2]  # a lost sample between good ones
    cycles, receivers = cycles_of(CONFIG, rows), {}
    for message in (CONFIG.can.vehicle_motion, CONFIG.can.vehicle_conditions):
        receivers[message.id] = Receiver(CONFIG.can.e2e)
    seen = [[receivers[frame.id].check(frame_data_id(frame.id), frame.data) for frame in frames] for frames in cycles]
    lost = 1 + int(np.flatnonzero(np.isnan(rows[:, 0]))[0])
    assert {*seen[0]} == {E2eStatus.INITIAL}
    assert {*seen[lost]} == {E2eStatus.OK_SOME_LOST}
    assert {status for found in (*seen[1:lost], *seen[lost + 1 :]) for status in found} == {E2eStatus.OK}


def frame_data_id(identifier: int) -> int:
    messages = (CONFIG.can.vehicle_motion, CONFIG.can.vehicle_conditions)
    return next(message.e2e_data_id for message in messages if message.id == identifier)


def test_events_and_their_cycles() -> None:
    cycles = cycles_of(CONFIG, HISTORIES[0][:3])
    events, place = events_of([*cycles, ()], [0, 3], 8)
    assert place.tolist() == [0] * 4 + [1] * 3 + [2] * 3 + [3] * 2
    assert np.flatnonzero(events["kind"] == START).tolist() == [0, 10]
    assert np.flatnonzero(events["kind"] == TASK).tolist() == [3, 6, 9, 11]
    assert events["id"][1:3].tolist() == [frame.id for frame in cycles[0]]
    assert events[1].tobytes()[-8:] == cycles[0][0].data


@pytest.mark.parametrize("part", ["limiter", "packing"])
def test_parts_of_a_call_are_counted(part: str) -> None:
    events, _ = events_of(cycles_of(CONFIG, HISTORIES[-1]), [0], 8)
    calls = counter().count("task", events)
    inside = calls[part][events["kind"] == TASK]
    started = np.flatnonzero(inside)[0] if part == "limiter" else 0  # no step before the rear angle is known
    assert (inside[started:] > 0).all() and started < 5 and (inside < calls["instructions"][events["kind"] == TASK]).all()
    assert not calls[part][events["kind"] != TASK].any()
