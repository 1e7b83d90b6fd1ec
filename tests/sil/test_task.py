"""The generated cyclic task: frames in, one frame out, and what it makes of frames that are missing, wrong, late or too many.

The other side here is Python's own codec and protection, which share no code with the C.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from codegen.can_sections import Can
from codegen.emit.can_view import DIAGNOSTICS, task_name
from codegen.sil.software import Status
from codegen.sil.task import Task
from hil_sim.codec import Codec, RearSteerCommand, VehicleConditions, VehicleMotion
from hil_sim.e2e import E2eStatus, Receiver, next_counter, protect
from tests import builds
from tests.builds import Built

BIT = {cause.name: 1 << cause.bit for cause in DIAGNOSTICS}
DEGRADED_MAX, RECOVERY = 3, 10
"""Of the paper's configuration: controller.fail_safe."""


def names(diagnostics: int) -> set[str]:
    """The bits that are set, by name."""
    return {name for name, mask in BIT.items() if diagnostics & mask}


@dataclass
class Car:
    """Sends frames to a task and reads its answers, as the bench does."""

    task: Task
    can: Can
    codec: Codec
    counters: dict[str, int] = field(default_factory=lambda: {"motion": 0, "conditions": 0})
    receiver: Receiver = field(init=False)
    check: E2eStatus = field(init=False)

    def __post_init__(self) -> None:
        self.receiver = Receiver(self.can.e2e)

    def motion(self, speed: float = 15.0, front_angle: float = 0.03, yaw_rate: float = 0.05) -> bytes:
        """The next frame of that message."""
        data = protect(
            self.can.vehicle_motion.e2e_data_id,
            self.counters["motion"],
            self.codec.encode(VehicleMotion(speed, front_angle, yaw_rate)),
        )
        self.counters["motion"] = next_counter(self.counters["motion"])
        return data

    def conditions(self, rear_angle: float = 0.0, friction: float = math.nan, inhibit: bool = False) -> bytes:
        """The next frame of that message."""
        data = protect(
            self.can.vehicle_conditions.e2e_data_id,
            self.counters["conditions"],
            self.codec.encode(VehicleConditions(rear_angle, friction, inhibit)),
        )
        self.counters["conditions"] = next_counter(self.counters["conditions"])
        return data

    def give(self, motion: bytes | None = None, conditions: bytes | None = None) -> None:
        """Frames on the bus, in this order."""
        if motion is not None:
            self.task.on_can_frame(self.can.vehicle_motion.id, motion)
        if conditions is not None:
            self.task.on_can_frame(self.can.vehicle_conditions.id, conditions)

    def answer(self) -> RearSteerCommand:
        """One run of the task."""
        identifier, data = self.task.run()
        assert identifier == self.can.rear_steer_command.id
        self.check = self.receiver.check(self.can.rear_steer_command.e2e_data_id, data)
        command = self.codec.decode(identifier, data)
        assert isinstance(command, RearSteerCommand)
        return command

    def cycle(self, rear_angle: float = 0.0) -> RearSteerCommand:
        """A cycle in which all is well."""
        self.give(self.motion(), self.conditions(rear_angle))
        return self.answer()


def car_of(built: Built) -> Car:
    software = built.software
    return Car(software.task(), software.config.can, Codec(software.config.can, software.precision))


@pytest.fixture
def car(paper: Built) -> Car:
    return car_of(paper)


def test_each_answer_is_protected_and_counts_on(car: Car) -> None:
    checks = [(car.cycle(), car.check)[1] for _ in range(40)]
    assert checks == [E2eStatus.INITIAL] + [E2eStatus.OK] * 39


def test_answers_are_those_of_the_controller_within_the_frames_steps(paper: Built) -> None:
    """The bare controller is given what the frames carry, and its command is compared code by code."""
    car, codec = car_of(paper), Codec(paper.software.config.can)
    controller = paper.software.controller()
    from codegen.sil.software import Measurement

    for _ in range(200):
        motion, conditions = car.motion(), car.conditions(rear_angle=-0.01)
        car.give(motion, conditions)
        command = car.answer()
        seen = codec.decode(car.can.vehicle_motion.id, motion)
        also = codec.decode(car.can.vehicle_conditions.id, conditions)
        assert isinstance(seen, VehicleMotion)
        assert isinstance(also, VehicleConditions)
        if car.task.counters()["cycles"] == 1:
            controller.init(also.rear_angle)
        wanted = controller.step(Measurement(seen.speed, seen.front_angle, seen.yaw_rate, also.rear_angle))
        sent = RearSteerCommand(wanted.rear_angle, wanted.yaw_rate_reference, wanted.status)
        assert codec.encode(sent) == codec.encode(command)


def test_before_the_first_good_sample_no_angle_is_sent(car: Car) -> None:
    for silent in range(1, 8):
        command = car.answer()
        assert math.isnan(command.rear_angle)
        assert math.isnan(command.yaw_rate_reference)
        assert command.status == (Status.DEGRADED if silent <= DEGRADED_MAX else Status.FAIL_SAFE)


@pytest.mark.parametrize("achieved", [-0.06, -0.02, 0.0, 0.035])
def test_control_starts_from_the_angle_that_the_actuator_holds(car: Car, achieved: float) -> None:
    for _ in range(5):
        car.answer()
    car.give(car.motion(), car.conditions(rear_angle=achieved))
    # One sample of the integral and one step of the frames beside the angle of before.
    assert car.answer().rear_angle == pytest.approx(achieved, abs=0.01 * 1.0 + 5e-5)


def test_a_car_that_does_not_measure_the_rear_angle_starts_from_zero_after_a_while(car: Car) -> None:
    for _ in range(RECOVERY):
        car.give(car.motion(), car.conditions(rear_angle=math.nan))
        assert math.isnan(car.answer().rear_angle)
    car.give(car.motion(), car.conditions(rear_angle=math.nan))
    assert car.answer().rear_angle == pytest.approx(0.0, abs=0.01)


def test_a_rear_angle_that_is_late_is_waited_for(car: Car) -> None:
    for _ in range(2):
        car.give(car.motion(), car.conditions(rear_angle=math.nan))
        assert math.isnan(car.answer().rear_angle)
    car.give(car.motion(), car.conditions(rear_angle=-0.03))
    assert car.answer().rear_angle == pytest.approx(-0.03, abs=0.01 + 5e-5)


@pytest.mark.parametrize("impossible", [0.3, -0.3, math.inf, -math.inf])
def test_control_does_not_start_from_a_rear_angle_that_cannot_be(car: Car, impossible: float) -> None:
    """However long it lasts; with the first one that can be, control starts there."""
    for _ in range(3 * RECOVERY):
        car.give(car.motion(), car.conditions(rear_angle=impossible))
        assert math.isnan(car.answer().rear_angle)
    car.give(car.motion(), car.conditions(rear_angle=0.02))
    assert car.answer().rear_angle == pytest.approx(0.02, abs=0.01 + 5e-5)


def test_the_inhibit_bit_holds_the_integrator(car: Car) -> None:
    """A steady error moves the command sample by sample, and not while ESC or ABS acts."""

    def moved(inhibit: bool) -> float:
        commands = []
        for _ in range(5):
            car.give(car.motion(yaw_rate=0.0), car.conditions(rear_angle=0.0, inhibit=inhibit))
            commands.append(car.answer().rear_angle)
        return abs(commands[-1] - commands[0])

    assert moved(inhibit=False) > 1e-3
    assert moved(inhibit=True) == 0.0
    assert moved(inhibit=False) > 1e-3


@pytest.mark.parametrize("lost", ["motion", "conditions", "both"])
def test_three_lost_samples_are_held_and_the_fourth_is_fail_safe(car: Car, lost: str) -> None:
    for _ in range(30):
        before = car.cycle()
    assert before.status in (Status.TRACKING, Status.LIMITED)
    for sample in range(1, 9):
        motion, conditions = car.motion(), car.conditions()
        car.give(motion if lost == "conditions" else None, conditions if lost == "motion" else None)
        command = car.answer()
        if sample <= DEGRADED_MAX:
            assert command.status == Status.DEGRADED
            assert command.rear_angle == before.rear_angle
            assert "TIMEOUT" not in names(command.diagnostics)
        else:
            assert command.status == Status.FAIL_SAFE
            assert "TIMEOUT" in names(command.diagnostics)
        missing = {"motion": {"MOTION_MISSING"}, "conditions": {"CONDITIONS_MISSING"}}
        early = {"TASK_EARLY"} if lost == "both" else set()
        expected = missing.get(lost, {"MOTION_MISSING", "CONDITIONS_MISSING"}) | early
        assert names(command.diagnostics) - {"TIMEOUT"} == expected
    assert car.task.counters()["lost_samples"] == 8


def test_a_fail_safe_ends_after_the_configured_number_of_good_samples(car: Car) -> None:
    for _ in range(30):
        car.cycle()
    for _ in range(6):
        car.motion(), car.conditions()
        car.answer()
    statuses = [Status(car.cycle().status) for _ in range(RECOVERY + 6)]
    recovered = next(index for index, status in enumerate(statuses) if status <= Status.LIMITED)
    # After so long a silence the counter must prove itself first: one frame, and one more (max_no_new_or_repeated_data,
    # sync_counter_init), then the good samples are counted, the last of them ends the fail-safe.
    assert recovered == 2 + RECOVERY - 1
    assert set(statuses[:recovered]) == {Status.FAIL_SAFE}


def test_a_short_gap_is_told_and_goes_on_at_once(car: Car) -> None:
    for _ in range(30):
        car.cycle()
    for _ in range(DEGRADED_MAX):
        car.motion(), car.conditions()
        car.answer()
    command = car.cycle()
    assert command.status in (Status.TRACKING, Status.LIMITED)
    assert names(command.diagnostics) == {"MOTION_SOME_LOST", "CONDITIONS_SOME_LOST"}
    assert names(car.cycle().diagnostics) == set()


class TestEveryCauseHasItsBit:
    """One fault in an otherwise good run: what it does to that sample, what it leaves, and that the next is good again."""

    @staticmethod
    def running(car: Car) -> RearSteerCommand:
        for _ in range(20):
            command = car.cycle()
        assert names(command.diagnostics) == set()
        return command

    @pytest.mark.parametrize("bit", [0, 9, 17, 40, 63])
    def test_a_flipped_bit(self, car: Car, bit: int) -> None:
        before = self.running(car)
        data = bytearray(car.motion())
        data[bit // 8] ^= 1 << bit % 8
        car.give(bytes(data), car.conditions())
        command = car.answer()
        assert names(command.diagnostics) == {"MOTION_WRONG_CRC"}
        assert (command.status, command.rear_angle) == (Status.DEGRADED, before.rear_angle)
        assert car.cycle().status in (Status.TRACKING, Status.LIMITED)

    def test_a_repeated_frame(self, car: Car) -> None:
        self.running(car)
        motion, conditions = car.motion(), car.conditions()
        car.give(motion, conditions)
        car.answer()
        car.give(motion, car.conditions())
        command = car.answer()
        assert names(command.diagnostics) == {"MOTION_REPEATED"}
        assert command.status == Status.DEGRADED

    def test_a_frame_of_another_message_under_this_identifier(self, car: Car) -> None:
        self.running(car)
        wrong = car.conditions()
        car.motion()
        car.give(wrong, car.conditions())
        assert "MOTION_WRONG_CRC" in names(car.answer().diagnostics)

    def test_a_counter_that_jumps(self, car: Car) -> None:
        self.running(car)
        for _ in range(6):
            car.motion()  # made and never sent, while the task does not know of a gap
        car.give(car.motion(), car.conditions())
        command = car.answer()
        assert names(command.diagnostics) == {"MOTION_WRONG_SEQUENCE"}
        assert command.status == Status.DEGRADED

    def test_a_counter_that_goes_back(self, car: Car) -> None:
        self.running(car)
        old = car.motion()
        car.give(car.motion(), car.conditions())
        car.answer()
        car.give(old, car.conditions())
        assert names(car.answer().diagnostics) == {"MOTION_WRONG_SEQUENCE"}

    @pytest.mark.parametrize("length", [0, 1, 7])
    def test_a_wrong_length(self, car: Car, length: int) -> None:
        self.running(car)
        car.give(car.motion()[:length], car.conditions())
        assert names(car.answer().diagnostics) == {"WRONG_LENGTH", "MOTION_MISSING"}
        assert "WRONG_LENGTH" not in names(car.cycle().diagnostics)

    def test_a_signal_that_is_not_available(self, car: Car) -> None:
        self.running(car)
        car.give(car.motion(yaw_rate=math.nan), car.conditions())
        command = car.answer()
        assert names(command.diagnostics) == {"UNAVAILABLE"}
        assert command.status == Status.DEGRADED

    def test_a_yaw_rate_that_cannot_be(self, car: Car) -> None:
        self.running(car)
        car.give(car.motion(yaw_rate=2.0), car.conditions())
        command = car.answer()
        assert names(command.diagnostics) == {"IMPLAUSIBLE"}
        assert command.status == Status.DEGRADED

    def test_a_task_that_comes_late(self, car: Car) -> None:
        """It sleeps through a cycle, and finds two frames of each message."""
        self.running(car)
        car.give(car.motion(), car.conditions())
        car.give(car.motion(), car.conditions())
        command = car.answer()
        assert names(command.diagnostics) == {"TASK_LATE"}
        assert command.status in (Status.TRACKING, Status.LIMITED)  # the last sample is good
        assert car.task.counters() == {"cycles": 21, "late_cycles": 1, "early_cycles": 0, "lost_samples": 0}

    def test_a_task_that_comes_twice(self, car: Car) -> None:
        before = self.running(car)
        command = car.answer()
        assert names(command.diagnostics) == {"MOTION_MISSING", "CONDITIONS_MISSING", "TASK_EARLY"}
        assert (command.status, command.rear_angle) == (Status.DEGRADED, before.rear_angle)
        assert car.check == E2eStatus.OK  # the car sees one command too many in a cycle, in sequence
        assert car.task.counters() == {"cycles": 21, "late_cycles": 0, "early_cycles": 1, "lost_samples": 1}

    def test_all_bits_are_seen_above(self) -> None:
        assert {cause.bit for cause in DIAGNOSTICS} == set(range(16))


def test_foreign_frames_are_nothing(car: Car) -> None:
    for _ in range(5):
        car.cycle()
    for identifier in (0x000, 0x100, 0x103, 0x201, 0x7FF):
        car.task.on_can_frame(identifier, b"\xff" * 8)
    assert not car.task.is_complete
    assert names(car.cycle().diagnostics) == set()


def test_a_set_is_complete_with_both_messages(car: Car) -> None:
    """The conditions close it: one that was left over from before opens none."""
    assert not car.task.is_complete
    car.give(None, car.conditions())
    assert not car.task.is_complete
    car.give(car.motion())
    assert not car.task.is_complete
    car.give(None, car.conditions())
    assert car.task.is_complete
    car.answer()
    assert not car.task.is_complete


def test_with_the_speed_still_known_the_fail_safe_goes_by_it(car: Car) -> None:
    """The conditions stay away, the motion comes: below the hold speed the rear angle is ramped to zero, not held."""
    for _ in range(100):
        before = car.cycle(rear_angle=-0.02)
    for _ in range(100):
        car.give(car.motion(speed=5.0))
        command = car.answer()
    assert command.status == Status.FAIL_SAFE
    assert abs(command.rear_angle) < 0.5 * abs(before.rear_angle)


def test_two_tasks_are_independent(paper: Built) -> None:
    alone = [car.cycle() for car in [car_of(paper)] for _ in range(50)]
    one, other = car_of(paper), car_of(paper)
    together = []
    for _ in range(50):
        together.append(one.cycle())
        other.give(other.motion(yaw_rate=-0.3), None)
        other.answer()
    assert together == alone


@pytest.mark.parametrize(
    ("sampling_time", "name"), [(0.01, "task_10ms"), (0.001, "task_1ms"), (0.0025, "task_2500us"), (0.1, "task_100ms")]
)
def test_the_name_follows_the_period(sampling_time: float, name: str) -> None:
    assert task_name(sampling_time) == name


def test_another_period_builds_and_runs() -> None:
    config = builds.CONFIG.model_copy(
        update={
            "controller": builds.CONFIG.controller.model_copy(update={"sampling_time_s": 0.005}),
            "can": Can(),
        }
    )
    built = builds.make(builds.paper_map(), config)
    assert "ars_task_5ms" in built.folder.files["include/ars_task.h"].decode("ascii")
    car = car_of(built)
    assert [car.cycle().status for _ in range(3)] == [Status.TRACKING] * 3


def test_one_message_twice_is_a_late_task(car: Car) -> None:
    for motions, conditions in ((2, 1), (1, 2)):
        car.cycle()
        for _ in range(motions):
            car.give(car.motion())
        for _ in range(conditions):
            car.give(None, car.conditions())
        assert "TASK_LATE" in names(car.answer().diagnostics)


def three_lost(car: Car) -> None:
    test_three_lost_samples_are_held_and_the_fourth_is_fail_safe(car, "motion")


def starts_from_achieved(car: Car) -> None:
    test_control_starts_from_the_angle_that_the_actuator_holds(car, -0.06)


def starts_from_impossible(car: Car) -> None:
    test_control_does_not_start_from_a_rear_angle_that_cannot_be(car, 0.3)


def late(car: Car) -> None:
    TestEveryCauseHasItsBit().test_a_task_that_comes_late(car)


def twice(car: Car) -> None:
    TestEveryCauseHasItsBit().test_a_task_that_comes_twice(car)


def repeated(car: Car) -> None:
    TestEveryCauseHasItsBit().test_a_repeated_frame(car)


def wrong_length(car: Car) -> None:
    TestEveryCauseHasItsBit().test_a_wrong_length(car, 7)


@pytest.mark.parametrize(
    ("old", "new", "seen_by"),
    [
        ("self->good = self->good || usable;", "self->good = true;", repeated),
        ("    self->frames = 0u;\n    self->good = false;\n    return", "    self->frames = 0u;\n    return", three_lost),
        ("conditions_shift = 5u", "conditions_shift = 4u", test_a_short_gap_is_told_and_goes_on_at_once),
        ("self->started ? command.rear_angle : ars_can_not_available()", "command.rear_angle",
         test_before_the_first_good_sample_no_angle_is_sent),
        ("ars_controller_init(&self->controller, rear_angle);", "", starts_from_achieved),
        ("(rear_angle <= largest)", "(rear_angle <= 100.0f)", starts_from_impossible),
        ("(rear_angle < -largest)) {", "(rear_angle < -largest) || true) {",
         test_a_car_that_does_not_measure_the_rear_angle_starts_from_zero_after_a_while),
        ("measurement.inhibit = self->conditions.inhibit;", "measurement.inhibit = false;",
         test_the_inhibit_bit_holds_the_integrator),
        ("self->wrong_length = false;\n    }", "}", wrong_length),
        ("(self->conditions_input.frames > 1u)", "false", test_one_message_twice_is_a_late_task),
        ("self->conditions_close = self->motion_input.frames > 0u;", "self->conditions_close = true;",
         test_a_set_is_complete_with_both_messages),
        ("(self->motion_input.frames > 1u)", "(self->motion_input.frames > 2u)", test_one_message_twice_is_a_late_task),
        ("causes = (uint32_t)ARS_DIAGNOSTICS_TASK_LATE;", "", late),
        ("self->late_cycles++;", "", late),
        ("self->early_cycles++;", "", twice),
        ("self->lost_samples++;", "", twice),
        ("(void)ars_e2e_no_new_data(&self->receiver);", "", test_a_short_gap_is_told_and_goes_on_at_once),
        (".speed = motion_good ? self->motion.speed : not_available", ".speed = not_available",
         test_with_the_speed_still_known_the_fail_safe_goes_by_it),
        ("(length != (uint8_t)ARS_CAN_LENGTH)", "(length > (uint8_t)ARS_CAN_LENGTH)", wrong_length),
        ("controller->bad_samples > self->parameters->degraded_samples_max", "controller->bad_samples > 0u", three_lost),
        ("(uint16_t)ARS_CAN_DATA_ID_REAR_STEER_COMMAND", "(uint16_t)ARS_CAN_DATA_ID_VEHICLE_MOTION",
         test_each_answer_is_protected_and_counts_on),
    ],
)  # fmt: skip
def test_a_planted_fault_fails_a_named_test(old: str, new: str, seen_by: Callable[[Car], None]) -> None:
    """One place of the task's C changed."""
    car = car_of(builds.altered("src/ars_task.c", old, new))
    with pytest.raises(AssertionError):
        seen_by(car)
