"""The generated task at its edges: very many frames in a cycle, wrong lengths of either message, counters of many cycles."""

from __future__ import annotations

import math

import pytest

from codegen.sil.software import Status
from hil_sim.e2e import E2eStatus
from tests.builds import Built
from tests.sil.test_task import DEGRADED_MAX, Car, car_of, names


@pytest.fixture
def car(paper: Built) -> Car:
    return car_of(paper)


def running(car: Car, cycles: int = 20) -> None:
    """Until all is well."""
    for _ in range(cycles):
        command = car.cycle()
    assert names(command.diagnostics) == set()


@pytest.mark.parametrize("frames", [2, 254, 255, 256, 257, 300, 512])
def test_any_number_of_frames_in_a_cycle_is_too_many(car: Car, frames: int) -> None:
    """Their count does not begin anew: that would be a cycle without a frame."""
    running(car)
    for _ in range(frames):
        car.give(car.motion(), car.conditions())
    assert car.task.is_complete
    assert names(car.answer().diagnostics) == {"TASK_LATE"}
    assert car.task.counters()["late_cycles"] == 1


def test_a_set_is_complete_after_any_number_of_frames(car: Car) -> None:
    running(car)
    for _ in range(256):
        car.give(car.motion())
    car.give(None, car.conditions())
    assert car.task.is_complete


@pytest.mark.parametrize("length", [0, 1, 7])
@pytest.mark.parametrize("message", ["motion", "conditions"])
def test_a_wrong_length_of_either_message(car: Car, message: str, length: int) -> None:
    running(car)
    motion, conditions = car.motion(), car.conditions()
    if message == "motion":
        car.give(motion[:length], conditions)
    else:
        car.give(motion, conditions[:length])
        assert not car.task.is_complete
    command = car.answer()
    assert names(command.diagnostics) == {"WRONG_LENGTH", f"{message.upper()}_MISSING"}
    assert command.status == Status.DEGRADED


def test_a_frame_of_another_node_may_have_any_length(car: Car) -> None:
    running(car)
    for length in range(9):
        car.task.on_can_frame(0x103, bytes(length))
        car.task.on_can_frame(0x201, bytes(length))
    assert names(car.cycle().diagnostics) == set()


def test_the_counters_count_each_cycle(car: Car) -> None:
    for _ in range(5):
        car.cycle()
    for _ in range(3):
        car.answer()
    for _ in range(2):
        car.give(car.motion(), car.conditions())
        car.give(car.motion())
        car.answer()
    assert car.task.counters() == {"cycles": 10, "late_cycles": 2, "early_cycles": 3, "lost_samples": 3}


@pytest.mark.parametrize("lost", ["motion", "conditions"])
def test_one_message_alone_is_no_early_task(car: Car, lost: str) -> None:
    running(car)
    motion, conditions = car.motion(), car.conditions()
    car.give(None if lost == "motion" else motion, None if lost == "conditions" else conditions)
    assert names(car.answer().diagnostics) == {f"{lost.upper()}_MISSING"}
    assert car.task.counters()["early_cycles"] == 0


def test_each_cause_of_the_conditions_has_a_bit_of_its_own(car: Car) -> None:
    running(car)
    car.give(car.motion(), bytes((car.conditions()[0] ^ 1,)) + bytes(7))
    assert names(car.answer().diagnostics) == {"CONDITIONS_WRONG_CRC"}
    running(car)
    old = car.conditions()
    car.give(car.motion(), old)
    car.answer()
    car.give(car.motion(), old)
    assert names(car.answer().diagnostics) == {"CONDITIONS_REPEATED"}
    car.conditions()
    running(car)
    for _ in range(6):
        car.conditions()  # made and never sent
    car.give(car.motion(), car.conditions())
    assert names(car.answer().diagnostics) == {"CONDITIONS_WRONG_SEQUENCE"}


def test_causes_of_several_frames_of_a_cycle_add_up(car: Car) -> None:
    running(car)
    good = car.motion()
    broken = bytes((good[0] ^ 1,)) + good[1:]
    car.give(broken)
    car.give(good)
    car.give(good)
    car.give(None, car.conditions())
    command = car.answer()
    assert names(command.diagnostics) == {"MOTION_WRONG_CRC", "MOTION_REPEATED", "TASK_LATE"}
    assert command.status in (Status.TRACKING, Status.LIMITED), "one of them was good"
    assert names(car.cycle().diagnostics) == set()


def test_samples_of_either_message_lost_are_counted(car: Car) -> None:
    running(car, 5)
    for motion, conditions in ((True, False), (False, True), (False, False)):
        first, second = car.motion(), car.conditions()
        car.give(first if motion else None, second if conditions else None)
        car.answer()
    assert car.task.counters()["lost_samples"] == 3


@pytest.mark.parametrize("limit", [1.0, -1.0])
def test_control_starts_from_the_largest_angle_that_can_be(paper: Built, limit: float) -> None:
    """The code just inside the range starts control, the one just beyond does not."""
    largest = paper.software.parameters().rear_angle_input_max
    inside, beyond = (math.floor(largest / 5e-5) * 5e-5, math.ceil(largest / 5e-5) * 5e-5)
    for angle, starts in ((inside, True), (beyond, False)):
        car = car_of(paper)
        car.give(car.motion(), car.conditions(rear_angle=limit * angle))
        assert math.isnan(car.answer().rear_angle) != starts


def test_an_angle_that_is_exactly_at_its_limit_can_be(paper: Built) -> None:
    """Limits that are codes of the frame."""
    for side in (1.0, -1.0):
        for limit_code, code, starts in ((2000, 2000, True), (2000, 2001, False), (1999, 2000, False)):
            limit = float(paper.real(limit_code) / paper.real(20000.0))
            car = Car(
                paper.software.task(paper.software.parameters(rear_angle_input_max=limit)),
                paper.software.config.can,
                car_of(paper).codec,
            )
            car.give(car.motion(), car.conditions(rear_angle=side * code * 5e-5))
            assert math.isnan(car.answer().rear_angle) != starts, (limit_code, code)


def test_a_start_without_an_angle_takes_as_many_samples_as_a_recovery(paper: Built) -> None:
    """In a row: one that cannot be begins the count anew."""
    for needed in (1, 3, 12):
        car = Car(
            paper.software.task(paper.software.parameters(recovery_samples=needed)),
            paper.software.config.can,
            car_of(paper).codec,
        )
        for _ in range(2):
            for _ in range(needed):
                car.give(car.motion(), car.conditions(rear_angle=math.nan))
                assert math.isnan(car.answer().rear_angle)
            car.give(car.motion(), car.conditions(rear_angle=0.5))
            assert math.isnan(car.answer().rear_angle)
        for _ in range(needed):
            car.give(car.motion(), car.conditions(rear_angle=math.nan))
            assert math.isnan(car.answer().rear_angle)
        car.give(car.motion(), car.conditions(rear_angle=math.nan))
        assert not math.isnan(car.answer().rear_angle)


def test_what_the_controller_says_is_told_of_whole_samples_only(car: Car) -> None:
    """A sample that is lost is missing, not unavailable; and is implausible only where it came."""
    running(car)
    car.give(car.motion(yaw_rate=2.0), car.conditions())
    assert names(car.answer().diagnostics) == {"IMPLAUSIBLE"}
    car.give(None, car.conditions())
    car.motion()
    assert names(car.answer().diagnostics) == {"MOTION_MISSING"}


def test_every_answer_s_check_is_in_sequence_whatever_came(car: Car) -> None:
    checks = []
    for index in range(40):
        if index % 3:
            car.give(car.motion(), car.conditions())
        car.answer()
        checks.append(car.check)
    assert checks == [E2eStatus.INITIAL] + [E2eStatus.OK] * 39


def test_the_friction_of_a_frame_reaches_the_map(paper: Built) -> None:
    """On a slippery road the reference in the answer is smaller."""

    def reference(friction: float) -> float:
        car = car_of(paper)
        for _ in range(3):
            car.give(car.motion(speed=30.0, front_angle=0.06, yaw_rate=0.1), car.conditions(friction=friction))
            command = car.answer()
        return command.yaw_rate_reference

    assert reference(0.3) < 0.5 * reference(math.nan)


def test_the_measured_angle_of_a_frame_reaches_the_law(paper: Built) -> None:
    """The demand runs ahead of it by so much and no more."""
    ahead = paper.software.parameters().rear_angle_error_max
    car = car_of(paper)
    for _ in range(300):
        car.give(car.motion(yaw_rate=-0.1), car.conditions(rear_angle=0.01))
        command = car.answer()
    assert abs(command.rear_angle - (0.01 - ahead)) < 1e-4
    assert command.status == Status.LIMITED


def test_waiting_for_an_angle_ends_no_fail_safe(car: Car) -> None:
    """Good samples without an angle count as any others: the fail-safe of a silence before them lasts as long as ever."""
    for _ in range(DEGRADED_MAX + 3):
        command = car.answer()
    assert command.status == Status.FAIL_SAFE
    for _ in range(5):
        car.give(car.motion(), car.conditions(rear_angle=math.nan))
        assert car.answer().status == Status.FAIL_SAFE


def test_a_timeout_is_told_for_as_long_as_it_lasts(car: Car) -> None:
    """The count of lost samples does not begin anew after eleven minutes."""
    running(car)
    for _ in range(DEGRADED_MAX + 2):
        car.answer()
    car.task.state.controller.bad_samples = 2**16 - 2
    for _ in range(6):
        assert "TIMEOUT" in names(car.answer().diagnostics)
