"""Checks of the generated cyclic task: frames in, one frame out; missing, wrong, late and too many frames.

The other side is Python's own codec and protection, which share no code with the C. Each check takes a build of any kind and
raises AssertionError if the build fails it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from codegen.can_sections import Can
from codegen.emit.can_view import DIAGNOSTICS
from codegen.sil.software import Measurement, Status
from codegen.sil.task import Task
from hil_sim.codec import Codec, RearSteerCommand, VehicleConditions, VehicleMotion
from hil_sim.e2e import E2eStatus, Receiver, next_counter, protect
from tests.builds import Built

BIT = {cause.name: 1 << cause.bit for cause in DIAGNOSTICS}
RUNNING = (Status.TRACKING, Status.LIMITED)
ANGLE_STEP = 5e-5
"""Resolution of an angle in a frame, rad."""
START_TOLERANCE = 0.01 + ANGLE_STEP
"""Largest distance of a first command from the achieved angle: one sample of the integral, one step of the frame; rad."""


def names(diagnostics: int) -> set[str]:
    """Return the names of the bits that are set."""
    return {name for name, mask in BIT.items() if diagnostics & mask}


@dataclass
class Car:
    """The other side of the bus: it sends frames to a task and reads the answers, as the bench does."""

    task: Task
    can: Can
    codec: Codec
    counters: dict[str, int] = field(default_factory=lambda: {"motion": 0, "conditions": 0})
    receiver: Receiver = field(init=False)
    check: E2eStatus = field(init=False)

    def __post_init__(self) -> None:
        self.receiver = Receiver(self.can.e2e)

    def _protected(self, name: str, data_id: int, signals: Any) -> bytes:
        data = protect(data_id, self.counters[name], self.codec.encode(signals))
        self.counters[name] = next_counter(self.counters[name])
        return data

    def motion(self, speed: float = 15.0, front_angle: float = 0.03, yaw_rate: float = 0.05) -> bytes:
        """Return the next VehicleMotion frame."""
        return self._protected("motion", self.can.vehicle_motion.e2e_data_id, VehicleMotion(speed, front_angle, yaw_rate))

    def conditions(self, rear_angle: float = 0.0, friction: float = math.nan, inhibit: bool = False) -> bytes:
        """Return the next VehicleConditions frame."""
        signals = VehicleConditions(rear_angle, friction, inhibit)
        return self._protected("conditions", self.can.vehicle_conditions.e2e_data_id, signals)

    def give(self, motion: bytes | None = None, conditions: bytes | None = None) -> None:
        """Deliver frames to the task, in this order."""
        if motion is not None:
            self.task.on_can_frame(self.can.vehicle_motion.id, motion)
        if conditions is not None:
            self.task.on_can_frame(self.can.vehicle_conditions.id, conditions)

    def answer(self) -> RearSteerCommand:
        """Run the task once and decode its frame."""
        identifier, data = self.task.run()
        assert identifier == self.can.rear_steer_command.id
        self.check = self.receiver.check(self.can.rear_steer_command.e2e_data_id, data)
        command = self.codec.decode(identifier, data)
        assert isinstance(command, RearSteerCommand)
        return command

    def cycle(self, rear_angle: float = 0.0) -> RearSteerCommand:
        """Run one cycle with good frames."""
        self.give(self.motion(), self.conditions(rear_angle))
        return self.answer()

    def without_angle(self, rear_angle: float = math.nan) -> RearSteerCommand:
        """Run one cycle whose rear angle is not measured or cannot be."""
        return self.cycle(rear_angle)

    def found(self, motion: bytes | None = None, conditions: bytes | None = None) -> set[str]:
        """Deliver frames, run the task and return its diagnostics."""
        self.give(motion, conditions)
        return names(self.answer().diagnostics)


def car_of(built: Built, **parameters: Any) -> Car:
    """Return a car for a new task, with some parameters changed."""
    software = built.software
    task = software.task(software.parameters(**parameters)) if parameters else software.task()
    return Car(task, software.config.can, Codec(software.config.can, software.precision))


def running(built: Built, cycles: int = 20) -> tuple[Car, RearSteerCommand]:
    """Return a car after good cycles, with the last command."""
    car = car_of(built)
    for _ in range(cycles):
        command = car.cycle()
    assert names(command.diagnostics) == set()
    assert command.status in RUNNING
    return car, command


def samples_of(built: Built) -> tuple[int, int]:
    """Return the samples of a gap that is held and those of a recovery."""
    parameters = built.software.parameters()
    return parameters.degraded_samples_max, parameters.recovery_samples


def check_task_protects_its_answers(built: Built) -> None:
    """Each answer carries the next counter and a correct CRC, whatever arrived."""
    for every in (1, 3):
        car, checks = car_of(built), []
        for index in range(40):
            if index % every == 0:
                car.give(car.motion(), car.conditions())
            car.answer()
            checks.append(car.check)
        assert checks == [E2eStatus.INITIAL] + [E2eStatus.OK] * 39


def check_task_is_its_controller(built: Built) -> None:
    """The command equals that of the bare controller for the decoded frames, code by code."""
    car, codec, controller = car_of(built), Codec(built.software.config.can), built.software.controller()
    for index in range(200):
        motion, conditions = car.motion(), car.conditions(rear_angle=-0.01)
        car.give(motion, conditions)
        command = car.answer()
        seen, also = codec.decode(car.can.vehicle_motion.id, motion), codec.decode(car.can.vehicle_conditions.id, conditions)
        assert isinstance(seen, VehicleMotion)
        assert isinstance(also, VehicleConditions)
        if index == 0:
            controller.init(also.rear_angle)
        wanted = controller.step(Measurement(seen.speed, seen.front_angle, seen.yaw_rate, also.rear_angle))
        sent = RearSteerCommand(wanted.rear_angle, wanted.yaw_rate_reference, wanted.status)
        assert codec.encode(sent) == codec.encode(command)


def check_task_before_the_first_sample(built: Built) -> None:
    """Before the first good sample no angle is sent; after it, control starts from the achieved angle."""
    held, _ = samples_of(built)
    for achieved in (-0.06, -0.02, 0.0, 0.035):
        car = car_of(built)
        for silent in range(1, 8):
            command = car.answer()
            assert math.isnan(command.rear_angle)
            assert math.isnan(command.yaw_rate_reference)
            assert command.status == (Status.DEGRADED if silent <= held else Status.FAIL_SAFE)
        # The fail-safe holds the achieved angle; before it, control starts there.
        assert abs(car.cycle(achieved).rear_angle - achieved) <= START_TOLERANCE


def check_task_start_without_angle(built: Built) -> None:
    """Without a measured angle control starts from zero after as many samples in a row as a recovery takes."""
    for needed in (1, 3, 12):
        car = car_of(built, recovery_samples=needed)
        for _ in range(2):
            assert all(math.isnan(car.without_angle().rear_angle) for _ in range(needed))
            assert math.isnan(car.without_angle(0.5).rear_angle), "an impossible angle restarts the count"
        assert all(math.isnan(car.without_angle().rear_angle) for _ in range(needed))
        assert abs(car.without_angle().rear_angle) <= START_TOLERANCE
    car = car_of(built)
    assert all(math.isnan(car.without_angle().rear_angle) for _ in range(2))
    assert abs(car.cycle(-0.03).rear_angle + 0.03) <= START_TOLERANCE, "a late angle is waited for"


def check_task_start_from_an_impossible_angle(built: Built) -> None:
    """Control never starts from an angle beyond its range, and starts from the first possible one."""
    for impossible in (0.3, -0.3, math.inf, -math.inf):
        car = car_of(built)
        assert all(math.isnan(car.without_angle(impossible).rear_angle) for _ in range(3 * samples_of(built)[1]))
        assert abs(car.cycle(0.02).rear_angle - 0.02) <= START_TOLERANCE
    largest = built.software.parameters().rear_angle_input_max
    for side in (1.0, -1.0):
        for angle, starts in ((math.floor(largest / 5e-5) * 5e-5, True), (math.ceil(largest / 5e-5) * 5e-5, False)):
            assert math.isnan(car_of(built).without_angle(side * angle).rear_angle) != starts
        for limit_code, code, starts in ((2000, 2000, True), (2000, 2001, False), (1999, 2000, False)):
            limit = float(built.real(limit_code) / built.real(20000.0))  # exactly a code of the frame
            car = car_of(built, rear_angle_input_max=limit)
            assert math.isnan(car.without_angle(side * code * ANGLE_STEP).rear_angle) != starts, (limit_code, code)


def check_task_inhibit(built: Built) -> None:
    """A steady error moves the command from sample to sample, but not while ESC or ABS acts."""
    car = car_of(built)

    def moved(inhibit: bool) -> float:
        commands = []
        for _ in range(5):
            car.give(car.motion(yaw_rate=0.0), car.conditions(inhibit=inhibit))
            commands.append(car.answer().rear_angle)
        return abs(commands[-1] - commands[0])

    assert moved(False) > 1e-3
    assert moved(True) == 0.0
    assert moved(False) > 1e-3


def check_task_gap(built: Built) -> None:
    """A short gap is held, one sample more is the fail-safe with TIMEOUT; each cause has its bit and every loss is counted."""
    held, _ = samples_of(built)
    missing = {"motion": {"MOTION_MISSING"}, "conditions": {"CONDITIONS_MISSING"}}
    for lost in ("motion", "conditions", "both"):
        car, before = running(built, 30)
        for sample in range(1, 9):
            motion, conditions = car.motion(), car.conditions()
            car.give(motion if lost == "conditions" else None, conditions if lost == "motion" else None)
            command = car.answer()
            is_held = sample <= held
            assert command.status == (Status.DEGRADED if is_held else Status.FAIL_SAFE)
            assert not is_held or command.rear_angle == before.rear_angle
            both = missing["motion"] | missing["conditions"] | {"TASK_EARLY"}
            assert names(command.diagnostics) == missing.get(lost, both) | (set() if is_held else {"TIMEOUT"})
        assert car.task.counters()["lost_samples"] == 8
        assert car.task.counters()["early_cycles"] == (8 if lost == "both" else 0)


def check_task_after_a_gap(built: Built) -> None:
    """After a short gap control goes on at once; after a long one the counter proves itself, then the recovery counts."""
    held, needed = samples_of(built)
    car, _ = running(built, 30)
    for _ in range(held):
        car.motion(), car.conditions()
        car.answer()
    command = car.cycle()
    assert command.status in RUNNING
    assert names(command.diagnostics) == {"MOTION_SOME_LOST", "CONDITIONS_SOME_LOST"}
    assert names(car.cycle().diagnostics) == set()
    for _ in range(6):
        car.motion(), car.conditions()
        car.answer()
    statuses = [Status(car.cycle().status) for _ in range(needed + 6)]
    recovered = next(index for index, status in enumerate(statuses) if status in RUNNING)
    # One frame, and one more (max_no_new_or_repeated_data, sync_counter_init), then the good samples are counted; the last of
    # them ends the fail-safe.
    assert recovered == 2 + needed - 1
    assert set(statuses[:recovered]) == {Status.FAIL_SAFE}


def check_task_waiting_ends_no_fail_safe(built: Built) -> None:
    """Good samples without an angle do not shorten the fail-safe of the silence before them."""
    car = car_of(built)
    for _ in range(samples_of(built)[0] + 3):
        command = car.answer()
    assert command.status == Status.FAIL_SAFE
    assert all(car.without_angle().status == Status.FAIL_SAFE for _ in range(5))


def check_task_timeout_lasts(built: Built) -> None:
    """The count of lost samples does not wrap after eleven minutes."""
    car, _ = running(built)
    for _ in range(samples_of(built)[0] + 2):
        car.answer()
    car.task.state.controller.bad_samples = 2**16 - 2
    assert all("TIMEOUT" in names(car.answer().diagnostics) for _ in range(6))


def check_task_wrong_frames(built: Built) -> None:
    """Each wrong frame sets the bit of its cause for one sample, which is held; the next sample is good again."""
    for message in ("MOTION", "CONDITIONS"):
        car, before = running(built)

        def given(wrong: bytes, good: bytes, car: Car = car, message: str = message) -> RearSteerCommand:
            car.give(*((wrong, good) if message == "MOTION" else (good, wrong)))
            return car.answer()

        def next_wrong(car: Car = car, message: str = message) -> bytes:
            return car.motion() if message == "MOTION" else car.conditions()

        def next_good(car: Car = car, message: str = message) -> bytes:
            return car.conditions() if message == "MOTION" else car.motion()

        for bit in (0, 9, 17, 40, 63):
            data = bytearray(next_wrong())
            data[bit // 8] ^= 1 << bit % 8
            command = given(bytes(data), next_good())
            assert names(command.diagnostics) == {f"{message}_WRONG_CRC"}, bit
            assert command.status == Status.DEGRADED
            assert abs(command.rear_angle - before.rear_angle) <= START_TOLERANCE
            assert car.cycle().status in RUNNING
            before = car.cycle()
        sent = next_wrong()
        assert given(sent, next_good()).status in RUNNING
        assert names(given(sent, next_good()).diagnostics) == {f"{message}_REPEATED"}
        next_wrong()
        assert names(given(next_good(), next_good()).diagnostics) >= {f"{message}_WRONG_CRC"}, "another message's frame"
        for length in (0, 1, 7):
            car, _ = running(built)
            parts = (car.motion(), car.conditions())
            cut = (parts[0][:length], parts[1]) if message == "MOTION" else (parts[0], parts[1][:length])
            assert car.found(*cut) == {"WRONG_LENGTH", f"{message}_MISSING"}
            assert car.found(car.motion(), car.conditions()) <= {f"{message}_SOME_LOST"}
        car, _ = running(built)
        for _ in range(6):  # made and never sent, while the task knows of no gap
            car.motion() if message == "MOTION" else car.conditions()
        command = car.cycle()
        assert names(command.diagnostics) == {f"{message}_WRONG_SEQUENCE"}
        assert command.status == Status.DEGRADED
        car, _ = running(built)
        old = car.motion() if message == "MOTION" else car.conditions()
        car.cycle()
        wrong = (old, car.conditions()) if message == "MOTION" else (car.motion(), old)
        assert car.found(*wrong) == {f"{message}_WRONG_SEQUENCE"}, "the counter goes back"


def check_task_wrong_values(built: Built) -> None:
    """A signal that is not available and one that cannot be are told apart, and only for samples that arrived."""
    car, _ = running(built)
    assert car.found(car.motion(yaw_rate=math.nan), car.conditions()) == {"UNAVAILABLE"}
    assert car.found(car.motion(yaw_rate=2.0), car.conditions()) == {"IMPLAUSIBLE"}
    car.motion()
    car.give(None, car.conditions())
    command = car.answer()
    assert names(command.diagnostics) == {"MOTION_MISSING"}
    assert command.status == Status.DEGRADED


def check_task_late_and_early(built: Built) -> None:
    """A task that sleeps through a cycle is late, one that runs twice is early; both are counted, the last sample counts."""
    car, before = running(built)
    command = car.answer()
    assert names(command.diagnostics) == {"MOTION_MISSING", "CONDITIONS_MISSING", "TASK_EARLY"}
    assert (command.status, command.rear_angle) == (Status.DEGRADED, before.rear_angle)
    assert car.check == E2eStatus.OK
    assert car.task.counters() == {"cycles": 21, "late_cycles": 0, "early_cycles": 1, "lost_samples": 1}
    for motions, conditions in ((2, 1), (1, 2), (2, 2), (254, 254), (255, 255), (256, 256), (300, 300), (512, 512)):
        car, _ = running(built)
        for _ in range(motions):
            car.give(car.motion())
        for _ in range(conditions):
            car.give(None, car.conditions())
        assert car.task.is_complete
        command = car.answer()
        assert names(command.diagnostics) == {"TASK_LATE"}, (motions, conditions)
        assert command.status in RUNNING
        assert car.task.counters() == {"cycles": 21, "late_cycles": 1, "early_cycles": 0, "lost_samples": 0}


def check_task_adds_causes_up(built: Built) -> None:
    """The causes of several frames of a cycle add up; one good frame is enough for the sample."""
    car, _ = running(built)
    good = car.motion()
    car.give(bytes((good[0] ^ 1,)) + good[1:])
    car.give(good)
    car.give(good)
    car.give(None, car.conditions())
    command = car.answer()
    assert names(command.diagnostics) == {"MOTION_WRONG_CRC", "MOTION_REPEATED", "TASK_LATE"}
    assert command.status in RUNNING
    assert names(car.cycle().diagnostics) == set()


def check_task_foreign_frames(built: Built) -> None:
    """Frames of other identifiers, of any length, change nothing."""
    car, _ = running(built)
    for identifier in (0x000, 0x100, 0x103, 0x201, 0x7FF):
        for length in range(9):
            car.task.on_can_frame(identifier, b"\xff" * length)
    assert not car.task.is_complete
    assert names(car.cycle().diagnostics) == set()


def check_task_complete_set(built: Built) -> None:
    """The conditions close a set that a motion opened, after any number of frames; leftovers of before open none."""
    car = car_of(built)
    car.give(None, car.conditions())
    assert not car.task.is_complete
    car.give(car.motion())
    assert not car.task.is_complete
    car.give(None, car.conditions()[:7])
    assert not car.task.is_complete
    car.give(None, car.conditions())
    assert car.task.is_complete
    car.answer()
    assert not car.task.is_complete
    for _ in range(256):
        car.give(car.motion())
    car.give(None, car.conditions())
    assert car.task.is_complete


def check_task_uses_the_speed_that_arrives(built: Built) -> None:
    """With the motion alone, the fail-safe ramps the angle to zero below the hold speed."""
    car = car_of(built)
    for _ in range(100):
        before = car.cycle(rear_angle=-0.02)
    for _ in range(100):
        car.give(car.motion(speed=5.0))
        command = car.answer()
    assert command.status == Status.FAIL_SAFE
    assert abs(command.rear_angle) < 0.5 * abs(before.rear_angle)


def check_task_uses_the_conditions(built: Built) -> None:
    """The friction of a frame lowers the reference; the measured angle bounds how far the demand runs ahead."""

    def reference(friction: float) -> float:
        car = car_of(built)
        for _ in range(3):
            car.give(car.motion(speed=30.0, front_angle=0.06, yaw_rate=0.1), car.conditions(friction=friction))
            command = car.answer()
        return command.yaw_rate_reference

    assert reference(0.3) < 0.5 * reference(math.nan)
    ahead = built.software.parameters().rear_angle_error_max
    car = car_of(built)
    for _ in range(300):
        car.give(car.motion(yaw_rate=-0.1), car.conditions(rear_angle=0.01))
        command = car.answer()
    assert abs(command.rear_angle - (0.01 - ahead)) < 1e-4
    assert command.status == Status.LIMITED


def check_task_instances(built: Built) -> None:
    """Two tasks, called in turn, answer as each does alone."""
    car = car_of(built)
    alone = [car.cycle() for _ in range(50)]
    one, other, together = car_of(built), car_of(built), []
    for _ in range(50):
        together.append(one.cycle())
        other.give(other.motion(yaw_rate=-0.3), None)
        other.answer()
    assert together == alone


OF_THE_PAPER_S_LAW = (check_task_inhibit, check_task_uses_the_conditions)
"""Checks that know how far the paper's gains move the command in a sample."""
