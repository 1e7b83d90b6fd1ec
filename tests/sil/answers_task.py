"""Expected results of the second implementation of the task, computed once and compared with many builds of the same C.

The frames come from Python's own codec and protection, which share no code with the C.
"""

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from codegen.configuration.can import FRAME_BYTES, Can
from codegen.configuration.signals import Status
from codegen.emit.can_view import ANGLE_WAIT_S, WHEELS_WAIT_S
from codegen.emit.supervision import Cause, State, next_state, status_of
from hil_sim.codec import DIAGNOSTICS, Codec, Frame, RearSteerCommand, VehicleConditions, VehicleMotion
from hil_sim.e2e import E2eState, next_counter, protect
from tests.builds import SPEED, Built
from tests.oracle.task import SecondTask
from tests.sil.checks_edges import numbers_in
from tests.sil.checks_kinds import OPEN, model_of, parameters_of

STARTS, CYCLES = 20, 140
"""Starts of the task, and cycles after each."""
ACTUATOR_ANGLES = (
    0.02,
    math.nan,
    0.3,
    -0.3,
    math.inf,
    -0.05,
    *(side * code / 20000 for side in (1, -1) for code in (2000, 2001)),
)
"""Rear angle at the actuator after a start, rad. Some are impossible; the last four are codes at and past the limit in
PARAMETER_SETS."""
PARAMETER_SETS: tuple[Mapping[str, Any], ...] = (
    {},
    {
        "inputs": {"rear_angle_max": 2000 / 20000, "recovery_samples": 3, "missing_samples_max": 0},
        **{"actuator_samples_max": 3, "actuator_error_max": 0.02, "actuator_share": 0.5, "inhibit_samples_max": 1},
    },
)
EVENTS = (
    *("good",) * 12,
    *("motion lost", "conditions lost", "both lost", "corrupt", "repeated", "skipped", "jump", "no angle", "implausible") * 2,
    *("short", "foreign", "other message", "twice", "wrong and good", "reversed", "burst", "unavailable", "slow"),
)
"""Bus events; an event is drawn as often as it is listed."""


BITS = {name: bit for bit, (name, _) in DIAGNOSTICS.items()}


@dataclass(frozen=True)
class Cycle:
    """Frames of a cycle, whether the set is complete after each, and the task's frame and counters."""

    frames: Sequence[Frame]
    complete: Sequence[bool]
    answer: tuple[int, bytes]
    counters: Mapping[str, int]


@dataclass(frozen=True)
class Traffic:
    """Cycles of a task after each of its starts."""

    parameters: Any
    lives: Sequence[Sequence[Cycle]]


@dataclass
class _CountingTask(SecondTask):
    """Second task that counts the samples it lost."""

    lost: int = field(default=0, init=False)

    def _sample(self, motion: Any, conditions: Any, inhibit: bool) -> Any:
        self.lost += not (motion.is_usable and conditions.is_usable)
        return super()._sample(motion, conditions, inhibit)


@dataclass
class _OtherNodes:
    """Other nodes of the bus. In each spell, one message is disturbed."""

    can: Can
    codec: Codec
    rng: np.random.Generator
    life: int
    counters: dict[int, int] = field(default_factory=lambda: {0: 0, 1: 0})

    def _frame(self, place: int, contents: bytes) -> Frame:
        message = (self.can.vehicle_motion, self.can.vehicle_conditions)[place]
        data = protect(message.e2e_data_id, self.counters[place], contents)
        self.counters[place] = next_counter(self.counters[place])
        return Frame(message.id, data)

    def cycles(self) -> Iterator[list[Frame]]:
        """Yield the frames of each cycle: silence or undisturbed traffic first, then spells of every kind of disturbance."""
        calm, spell, place = 7 * (self.life % 3), 0, 0
        for cycle in range(CYCLES):
            if spell == 0:
                event, spell = str(self.rng.choice(EVENTS)), int(self.rng.choice([1, 1, 2, 4, 8]))
                place = int(self.rng.integers(2))
            spell -= 1
            if cycle < calm:
                event, spell = "both lost" if self.life % 4 == 3 and cycle < 5 else "good", 0
            yield self._of(event, place, self._angle(cycle))

    def _angle(self, cycle: int) -> float:
        """Return the rear angle that the bus reports, rad. Where it is missing at first, an impossible value restarts the
        count."""
        if cycle >= 14:
            return 0.04 * math.cos(0.05 * cycle)
        reported = ACTUATOR_ANGLES[self.life % len(ACTUATOR_ANGLES)]
        return 0.3 if math.isnan(reported) and cycle == 5 else reported

    def _of(self, event: str, place: int, angle: float) -> list[Frame]:
        rng = self.rng
        speed = 2.0 if event == "slow" else 12.0 + self.life % 20
        yaw_rate = {"unavailable": math.nan, "implausible": 2.0}.get(event, float(rng.normal(0.05, 0.02)))
        reported, friction = math.nan if event == "no angle" else angle, float(rng.choice([math.nan, 0.3]))
        signals = (VehicleMotion(speed, 0.03, yaw_rate), VehicleConditions(reported, friction, inhibit=rng.random() < 0.2))
        contents = [self.codec.encode(each) for each in signals]
        for _ in range({"skipped": 6, "jump": 2}.get(event, 0)):  # made and never sent
            self._frame(place, contents[place])
        frames = [self._frame(each, contents[each]) for each in (0, 1)]
        one, other = frames[place], frames[1 - place]
        if event == "corrupt":
            number = int.from_bytes(one.data, "little") ^ 1 << int(rng.integers(64))
            frames[place] = Frame(one.id, number.to_bytes(FRAME_BYTES, "little"))
        elif event == "repeated":
            frames.append(one)
        elif event == "short":
            frames[place] = Frame(one.id, one.data[: int(rng.integers(FRAME_BYTES))])
        elif event == "foreign":
            frames.insert(int(rng.integers(3)), Frame(int(rng.choice([0, 0x100, 0x103, 0x7FF])), bytes(int(rng.integers(9)))))
        elif event == "other message":
            frames[place] = Frame(one.id, other.data)
        elif event == "wrong and good":
            wrong = Frame(one.id, one.data[:3] + bytes((one.data[3] ^ 0x10,)) + one.data[4:])
            frames.insert(place + int(rng.integers(2)), wrong)
        elif event in ("twice", "burst"):
            count = 1 if event == "twice" else int(rng.choice([253, 254, 255, 256, 511]))
            frames[place + 1 : place + 1] = [self._frame(place, contents[place]) for _ in range(count)]
        lost = {"motion lost": [1], "conditions lost": [0], "both lost": [], "reversed": [1, 0]}
        return [frames[each] for each in lost[event]] if event in lost else frames


def _cycles_after_start(built: Built, parameters: Any, rng: np.random.Generator, life: int) -> list[Cycle]:
    """Return the second task's results, the late and early cycles, and when a set is complete by the rule in its header."""
    software = built.software
    can = software.config.can
    codec, first, second = Codec(can, software.precision), can.vehicle_motion.id, can.vehicle_conditions.id
    task = _CountingTask(can, parameters, codec, lambda angle: model_of(built, parameters, angle))
    found, late, early = [], 0, 0
    for number, frames in enumerate(_OtherNodes(can, codec, rng, life).cycles(), 1):
        count, complete, states = {first: 0, second: 0}, False, []
        for frame in frames:
            if frame.id in count:
                count[frame.id] += 1
                complete = count[first] > 0 if frame.id == second else complete
            states.append(complete)
        late, early = late + (max(count.values()) > 1), early + (max(count.values()) == 0)
        with np.errstate(all="ignore"):
            answer = task.run(tuple(frames))
        counters = {"cycles": number, "late_cycles": late, "early_cycles": early, "lost_samples": task.lost}
        found.append(Cycle(frames, states, answer, counters))
    return found


def _on_bus(built: Built, parameters: Any = None) -> tuple[Any, Callable[..., RearSteerCommand]]:
    """Return a task, and a function that runs a cycle of it: motion, conditions, places of lost messages -> its command."""
    codec, task = Codec(built.software.config.can, built.software.precision), built.software.task(parameters)
    car = _OtherNodes(built.software.config.can, codec, np.random.default_rng(0), 0)

    def cycle(motion: VehicleMotion, conditions: VehicleConditions, *lacks: int) -> RearSteerCommand:
        for place, contents in enumerate((motion, conditions)):
            frame = car._frame(place, codec.encode(contents))
            if place not in lacks:
                task.on_can_frame(frame.id, frame.data)
        answer = codec.decode(*task.run())
        assert isinstance(answer, RearSteerCommand)
        return answer

    return task, cycle


def check_backlog(built: Built) -> None:
    """Check the backlog: it grows by a second frame per call up to five, and falls by one in each 64th call and in a call
    without a frame."""
    can = built.software.config.can
    task, car = built.software.task(), _OtherNodes(can, Codec(can, built.software.precision), np.random.default_rng(0), 0)

    def after(frames: int) -> tuple[int, int]:
        """Return the backlog after a call with this many frames of the first message, and whether the task is late."""
        for _ in range(frames):
            frame = car._frame(0, bytes(FRAME_BYTES))
            task.on_can_frame(frame.id, frame.data)
        _, data = task.run()
        return task.state.backlog, int.from_bytes(data[6:8], "little") >> BITS["TASK_LATE"] & 1

    filled = [after(count) for count in (1, 2, 2, 2, 2, 2, 2, 9)]
    assert filled == [(0, 0), (1, 0), (2, 0), (3, 0), (4, 1), (5, 1), (5, 1), (5, 1)]
    found = [after(1) for _ in range(len(filled), 5 * 64 + 10)]
    left = [max(5 - call // 64, 0) for call in range(len(filled) + 1, 5 * 64 + 11)]
    assert found == [(backlog, int(backlog > 3)) for backlog in left]
    assert [after(count)[0] for count in (3, 0, 1, 0, 0)] == [2, 1, 1, 0, 0]


def check_actuator_is_followed(built: Built) -> None:
    """Check the limits of angle and time for both signs, to one code and one sample, and memory with an impossible angle."""
    real, limit = built.real, 400
    changes = {"actuator_share": 0.5, "actuator_error_max": (limit + 0.5) / 20000, "actuator_samples_max": 3}
    parameters = parameters_of(built, changes)
    (task, cycle), stuck = _on_bus(built, parameters), 0

    def samples(count: int, code: int = 0) -> int:
        """Return how many samples of a straight drive, with a command of zero, count as deviating."""
        nonlocal stuck
        for _ in range(count):
            task.state.controller.rear_angle = task.state.controller.limiter.rear_angle = 0.0
            answer = cycle(VehicleMotion(SPEED, 0.0, 0.0), VehicleConditions(code / 20000))
            stuck = answer.diagnostics >> BITS["ACTUATOR_STUCK"] & 1
        return int(task.state.actuator_samples)

    samples(5)
    for side in (1, -1):
        assert samples(6, side * limit) == 0
        assert (samples(3, side * (limit + 1)), stuck) == (3, 0)
        assert (samples(1, side * (limit + 1)), stuck) == (4, 1)
        assert (samples(9, side * (limit + 1)), stuck) == (3, 1)
        assert (samples(2), stuck) == (1, 1)
        assert (samples(1, side * (limit + 1)), stuck) == (3, 1), "it must follow without a break"
        assert (samples(2), stuck) == (1, 1)
        assert (samples(1), stuck) == (0, 0)
    largest = float(real(parameters.inputs.rear_angle_max))
    expected = {math.nan: 0.0, math.inf: 0.0, -math.inf: 0.0, 2.1 * largest: 0.0, -2.1 * largest: 0.0}
    for held, becomes in {**expected, 2.0 * largest: largest, -2.0 * largest: -largest}.items():
        task.state.expected_angle = held
        samples(1)
        assert task.state.expected_angle == becomes, held


def check_stuck_wheels_come_free(built: Built) -> None:
    """Check that agreement with a command that is kept near stuck wheels does not clear the cause; moving wheels do, and
    wheels near zero."""
    drive = _Wheels(built)
    state, most = drive.state, drive.parameters.actuator_samples_max
    for side, moved, follows in ((1.0, TOLERANCE + CODE_RAD, True), (-1.0, TOLERANCE - CODE_RAD, False), (1.0, -HELD, True)):
        drive.until(drive.is_enabled)
        drive.until(lambda side=side: state.is_stuck, wheels=side * HELD)  # type: ignore[misc]
        for angle, is_free in ((side * HELD, False), (side * (HELD + moved), follows)):
            for _ in range(most + 1):
                drive.put(angle)
                drive.run(angle)
            assert state.is_stuck != is_free
        drive.until(lambda: not state.is_stuck)


def check_damaged_state(built: Built) -> None:
    """Check that damage of any number of the controller moves no wheel faster than control or the fail-safe does, with and
    without a measured angle."""
    drive = _Wheels(built)
    drive.until(drive.is_enabled)
    drive.put(HELD)
    start = drive.run(HELD)
    software, state = built.software, drive.state
    before = bytes(software.ffi.buffer(state))
    fastest = max(drive.parameters.limiter.rear_rate_max, drive.parameters.fail_safe_rate) * drive.period + CODE_RAD
    numbers = [*numbers_in(software.ffi, software.ffi.addressof(state.controller))]
    assert ("rear_angle",) in numbers
    for path, number, lacks in itertools.product(numbers, (math.nan, math.inf, 3e38), ((), (1,))):
        software.ffi.memmove(state, before, len(before))
        (*structs, name) = path
        setattr(functools.reduce(getattr, structs, state.controller), name, number)
        angle = start
        for _ in range(5):
            last, angle = angle, drive.run(HELD, *lacks)
            assert abs(angle - last) <= fastest, (path, number, lacks)


def check_inhibit_for_good(built: Built) -> None:
    """Check that the rear wheels return to zero after the last tolerated sample with Inhibit, and that control comes back."""
    commanded, tolerated = 0.02, 5
    parameters = parameters_of(built, {"inhibit_samples_max": tolerated})
    step = parameters.fail_safe_rate * built.software.config.controller.sampling_time_s
    (task, cycle), angles = _on_bus(built, parameters), [0.0]

    def status(inhibit: bool) -> Status:
        held = 0.0 if math.isnan(angles[-1]) else angles[-1]
        answer = cycle(VehicleMotion(30.0, 0.0, 0.0), VehicleConditions(held, inhibit=inhibit))
        angles.append(answer.rear_angle)
        return Status(answer.status)

    followed = (Status.TRACKING, Status.LIMITED)
    while status(False) not in followed:
        pass  # the car's messages become valid
    assert all(status(inhibit) in followed for inhibit in (False, *(True,) * tolerated, False, *(True,) * tolerated))
    task.state.controller.rear_angle = commanded
    assert {status(True) for _ in range(int(commanded / step) + 2)} == {Status.STANDBY}
    expected = [max(commanded - sample * step, 0.0) for sample in range(1, int(commanded / step) + 3)]
    # A code of the angle is 1/20000 rad. Each angle is rounded to the nearest, and so is the measured one from which the return
    # starts; the sums in single precision are far closer.
    assert max(abs(found - each) for found, each in zip(angles[-len(expected) :], expected, strict=True)) <= 1.01 / 20000
    assert status(False) in followed


CODE_RAD = 1.0 / 20000
"""A code of the rear angle on the bus."""
HELD = 600 * CODE_RAD
TOLERANCE, SHARE = 80 * CODE_RAD, 0.2
"""Rear angle at which control ends, tolerated difference and actuator share of the checks below."""


class _Wheels:
    """A task at SPEED whose rear wheels are where a check puts them, with the change of a return to zero in a sample, rad."""

    def __init__(self, built: Built, **changes: Any) -> None:
        actuator = {"actuator_error_max": TOLERANCE, "actuator_share": SHARE, "actuator_samples_max": 20}
        self.parameters = parameters_of(built, {**actuator, **changes})
        self.period = built.software.config.controller.sampling_time_s
        self.step = self.parameters.fail_safe_rate * self.period
        task, self._cycle = _on_bus(built, self.parameters)
        self.state = task.state

    def run(self, wheels: float, *lacks: int, front_angle: float = 0.0) -> float:
        """Return the command of a sample with the wheels at an angle, both in rad. `lacks`: places of lost messages."""
        return self._cycle(VehicleMotion(SPEED, front_angle, 0.0), VehicleConditions(wheels), *lacks).rear_angle

    def until(self, reached: Callable[[], bool], *lacks: int, wheels: float | None = None) -> float:
        """Run samples until a condition holds, with the wheels at an angle in rad or where the last command was."""
        angle = 0.0
        for _ in range(1000):
            if reached():
                return angle
            angle = self.run((0.0 if math.isnan(angle) else angle) if wheels is None else wheels, *lacks)
        raise AssertionError("not reached")

    def put(self, angle: float) -> None:
        """Put command and expected angle to an angle in rad."""
        state = self.state
        state.controller.rear_angle = state.controller.limiter.rear_angle = state.expected_angle = angle

    def release(self, angle: float) -> None:
        """End control with command and wheels held at an angle in rad."""

        def is_released() -> bool:
            self.put(angle)
            return not self.state.controller.enabled

        self.until(self.is_enabled)
        self.until(is_released, 0, wheels=angle)

    def is_enabled(self) -> bool:
        """Return whether the controller runs."""
        return bool(self.state.controller.enabled)

    def is_straight(self) -> bool:
        """Return whether the command is zero."""
        return bool(self.state.controller.rear_angle == 0.0)


def check_command_stays_near_wheels(built: Built) -> None:
    """Check a command that does not reach the wheels: a return to zero waits for them and goes on with them; under control it
    goes no farther out; conditions that return tell where to start."""
    drive = _Wheels(built)
    state, run, until, step = drive.state, drive.run, drive.until, drive.step
    largest_step = drive.parameters.limiter.rear_rate_max * drive.period

    def near(angle: float, other: float) -> bool:
        # Beside the tolerance: the remaining angle of a ramp at this share, three times; a sample of delay; two roundings.
        return abs(angle - other) <= TOLERANCE + 3.0 * (1.0 - SHARE) / SHARE * step + 2.0 * step + CODE_RAD

    drive.release(HELD)
    waits = [run(HELD, 0) for _ in range(int(HELD / step))]
    assert waits[0] < HELD and near(waits[-1], HELD) and waits[-1] == waits[-2] != HELD
    angle = run(HELD - 30 * CODE_RAD, 0)
    assert abs(angle - (HELD - 30 * CODE_RAD)) <= CODE_RAD, "it goes on from wheels that move"
    until(drive.is_straight, 0)
    for side in (1.0, -1.0):
        drive.release(side * HELD)
        angle = run(side * HELD, 0)
        for _ in range(5):
            angle = run(angle, 0)
        waits = [run(side * 1.4 * HELD, 0) for _ in range(int(HELD / step))]
        assert waits[-1] == waits[-2] == angle
        assert abs(run(side * 1.2 * HELD, 0) - side * HELD) <= step + CODE_RAD, "but no farther out than control ended"
        until(drive.is_straight, 0)
    drive.release(HELD)
    waits = [run(HELD, 0) for _ in range(round(WHEELS_WAIT_S / drive.period))]
    assert waits[-1] == waits[len(waits) // 2], "it waits all the time"
    assert until(drive.is_straight, 0, wheels=HELD) == 0.0, "and then goes on alone"
    assert state.waited_samples == len(waits)
    until(drive.is_enabled)
    stuck = [run(HELD) for _ in range(200)]
    assert state.is_stuck and all(abs(each) <= CODE_RAD for each in stuck[-50:])
    for side in (1.0, -1.0):  # neither the law nor a jump takes it farther out
        state.controller.rear_angle = state.controller.limiter.rear_angle = side * HELD
        assert 0.0 <= side * run(side * 3.0 * HELD) <= HELD + CODE_RAD
    until(lambda: not state.is_stuck)
    until(lambda: state.conditions_input.supervision.state != E2eState.VALID, 1, wheels=0.0)
    angle = until(lambda: state.conditions_input.supervision.state == E2eState.VALID, wheels=HELD)
    assert abs(angle - HELD) <= largest_step + CODE_RAD
    until(drive.is_enabled)
    run(HELD)
    for _ in range(300):
        run(HELD, 0, 1)
    assert math.isnan(run(math.nan))
    angle = until(lambda: state.supervision.has_command, wheels=math.nan)
    assert abs(angle - HELD) <= largest_step + CODE_RAD, "after a silence, from the last measured angle"


def check_start_of_the_return(built: Built) -> None:
    """Check that a return to zero starts from the farther out of command and measured angle; while wheels deviate as control
    ends, the command does not go out to them."""
    drive = _Wheels(built)
    for side in (1.0, -1.0):
        for ahead in (40, -40):
            drive.release(side * HELD)
            angle = side * drive.run(side * HELD + side * ahead * CODE_RAD, 0)
            assert abs(angle - (HELD + max(ahead, 0) * CODE_RAD - drive.step)) <= CODE_RAD, (side, ahead)
            drive.until(drive.is_straight, 0)
        drive.until(drive.is_enabled)
        wheels, angle = 0.9 * HELD, 0.0
        while drive.is_enabled():
            drive.put(side * 0.25 * HELD)
            drive.state.start_angle = side * HELD
            angle, wheels = side * drive.run(side * wheels, 0), wheels - 30 * CODE_RAD
        assert 0.0 < angle <= 0.25 * HELD + CODE_RAD
        drive.until(drive.is_straight, 0, wheels=0.0)


def check_wheels_that_follow_again(built: Built) -> None:
    """Check that the difference that is taken off when control ends is dropped when the angle is right again: the return does
    not wait then."""
    drive = _Wheels(built)
    for side in (1.0, -1.0):
        drive.release(side * HELD)
        drive.run(-side * HELD, 0)
        assert side * drive.state.angle_offset < -HELD
        before = float(drive.state.controller.rear_angle)
        for _ in range(5):
            drive.run(float(drive.state.expected_angle), 0)
            assert drive.state.angle_offset == 0.0
        moved = side * (before - float(drive.state.controller.rear_angle))
        assert abs(moved - 5.0 * drive.step) <= 5.0 * built.eps * HELD
        drive.until(drive.is_straight, 0)


def check_command_goes_out_to_wheels(built: Built) -> None:
    """Check that under control a command goes out to wheels that do not follow it, and no farther; it stays at zero if they are
    on the other side."""
    tolerance = 10 * CODE_RAD
    drive = _Wheels(built, inputs=OPEN, actuator_error_max=tolerance)
    for side in (1.0, -1.0):
        angle, front_angle = 0.0, side * 0.05
        drive.until(drive.is_enabled)
        for _ in range(50):
            angle = drive.run(angle, front_angle=front_angle)
        demand = angle
        assert abs(demand) > 4.0 * tolerance
        for wheels in (0.5 * demand, -0.5 * demand):
            drive.put(0.0)
            found = [0.0]
            for _ in range(30):
                found.append(math.copysign(1.0, demand) * drive.run(wheels, front_angle=front_angle))
                if drive.state.deviates or drive.state.is_stuck:
                    farthest = max(found[-2], math.copysign(wheels, wheels * demand), 0.0)
                    assert found[-1] <= farthest + CODE_RAD
            if wheels * demand > 0.0:
                assert max(found) >= abs(wheels) - tolerance
            else:
                assert max(found) <= CODE_RAD
        drive.until(lambda: not drive.state.is_stuck, wheels=0.0)


def check_replaced_in_standby(built: Built) -> None:
    """Check that a first signal that is not available is reported as replaced, and measured ones are not."""
    available, names = (SPEED, 0.0, 0.0), ("SPEED_REPLACED", "FRONT_ANGLE_REPLACED", "YAW_RATE_REPLACED")
    for lacks in range(len(names)):
        _, cycle = _on_bus(built)
        motion = VehicleMotion(*(math.nan if place == lacks else value for place, value in enumerate(available)))
        found = set()
        for _ in range(5):  # before the fail-safe
            answer = cycle(motion, VehicleConditions(0.0))
            found |= {name for name in names if answer.diagnostics >> BITS[name] & 1}
        assert found == {names[lacks]}


def check_rear_angle_never_measured(built: Built) -> None:
    """Check that a car that does not measure its rear angle gets commands from zero, after the wait for it."""
    _, cycle = _on_bus(built)
    angles = [cycle(VehicleMotion(SPEED, 0.0, 0.0), VehicleConditions(math.nan)).rear_angle for _ in range(30)]
    waited = sum(map(math.isnan, angles))
    assert waited > round(ANGLE_WAIT_S / built.software.config.controller.sampling_time_s)
    assert angles[waited:] == [0.0] * (len(angles) - waited)


def check_rear_angle_lost_in_a_broken_bus(built: Built) -> None:
    """Check that the angle is waited for once, and no longer than ANGLE_WAIT_S, while single frames come between silences."""
    (task, cycle), straight = _on_bus(built), VehicleMotion(SPEED, 0.0, 0.0)
    waited_max = round(ANGLE_WAIT_S / built.software.config.controller.sampling_time_s)

    def without_command(angle: float) -> list[bool]:
        """Return for each call whether it has no command. A set comes after five silent calls, ten times."""
        return [
            math.isnan(cycle(straight, VehicleConditions(angle), *lacks).rear_angle)
            for _ in range(10)
            for lacks in [(0, 1)] * 5 + [()]
        ]

    for _ in range(2):  # an angle that is measured again is waited for again
        while not task.state.supervision.has_command or not task.state.controller.enabled:
            cycle(straight, VehicleConditions(0.0))
        unknown = without_command(math.nan)
        first = unknown.index(True)
        assert (first, sum(unknown), all(unknown[first : first + waited_max])) == (5, waited_max, True)


def answers_of_task(built: Built, lives: int = STARTS) -> list[Traffic]:
    """Return the results for each parameter set. Together they must show every cause of a diagnosis."""
    codec, known = Codec(built.software.config.can, built.software.precision), []
    for seed, changes in enumerate(PARAMETER_SETS):
        parameters, rng = parameters_of(built, changes), np.random.default_rng(seed)
        known.append(Traffic(parameters, [_cycles_after_start(built, parameters, rng, life) for life in range(lives)]))
    diagnostics = 0
    for traffic in known:
        for cycle in (cycle for life in traffic.lives for cycle in life):
            command = codec.decode(*cycle.answer)
            assert isinstance(command, RearSteerCommand)
            diagnostics |= command.diagnostics
    assert all(diagnostics >> bit & 1 for bit in DIAGNOSTICS), "every cause occurs"
    return known


def check_task(built: Built, known: list[Traffic]) -> None:
    """Check every frame, every count and when a set is complete. Tasks with all parameter sets run interleaved and share
    nothing."""
    for lives in zip(*(traffic.lives for traffic in known), strict=True):
        tasks = [built.software.task(traffic.parameters) for traffic in known]
        for cycles in zip(*lives, strict=True):
            for task, cycle in zip(tasks, cycles, strict=True):
                for frame, complete in zip(cycle.frames, cycle.complete, strict=True):
                    task.on_can_frame(frame.id, frame.data)
                    assert task.is_complete == complete
                assert task.run() == cycle.answer
                assert task.counters() == cycle.counters
                assert not task.is_complete


def check_zeroed_task(built: Built) -> None:
    """Check that memory of any content starts with the default parameters, and that a lost inhibit holds the law."""
    software, function = built.software, built.software.function
    task, filled, received, started = (software.new("task") for _ in range(4))
    for each in (filled, received):
        memory = software.ffi.buffer(each)
        memory[:] = b"\xa5" * len(memory)
    data, other = software.ffi.new("uint8_t[8]"), software.ffi.new("uint8_t[8]")
    parameters = software.parameters()
    function("task_init")(started, parameters)
    assert not function("task_is_complete")(received)
    function("task_on_can_frame")(received, 0, bytes(8), 8)
    function("task_10ms")(task, data)
    for each in (filled, received, started):
        function("task_10ms")(each, other)
        assert bytes(data) == bytes(other)
    assert task.parameters != software.ffi.NULL
    assert {(each.cycles, each.early_cycles) for each in (task, filled, received, started)} == {(1, 1)}
    for inhibit, window, inhibits in ((True, 0xFFFF, True), (False, 0xFFFF, False), (False, 0, True)):  # valid so far, and not
        task.supervision.has_command, task.has_measured = True, True
        task.conditions.inhibit, supervision = inhibit, task.conditions_input.supervision
        supervision.state, supervision.window = 2, window
        function("task_10ms")(task, data)
        assert task.controller.sample.inhibit == inhibits
    assert task.cycles == 4


def check_silence(built: Built) -> None:
    """Check that the first new data after a silence of any length stop the commands; damaged and repeated frames do not."""
    software, function = built.software, built.software.function
    car = _OtherNodes(software.config.can, Codec(software.config.can), np.random.default_rng(0), 0)
    for calls, stops in ((0, False), (3, False), (4, True), (300, True)):  # longer than the count of silent calls can tell
        task, data, parameters = software.new("task"), software.ffi.new("uint8_t[8]"), software.parameters()
        function("task_init")(task, parameters)
        task.supervision.state, task.supervision.has_command, task.has_measured = State.RUN, True, True
        first, second = (car._frame(0, bytes(FRAME_BYTES)) for _ in range(2))
        function("task_on_can_frame")(task, first.id, first.data, len(first.data))
        function("task_10ms")(task, data)
        old = ((first.data, 7), (first.data[:7] + b"\x5a", 8), (first.data, 8))
        for call in range(calls):
            function("task_on_can_frame")(task, first.id, *old[call % 3])
            function("task_10ms")(task, data)
        assert (task.supervision.state, task.silent_calls) == (State.LOST, min(calls, 255))
        function("task_on_can_frame")(task, second.id, second.data, len(second.data))
        function("task_10ms")(task, data)
        assert (task.supervision.state == State.RESYNCHRONISE, task.silent_calls, task.early_cycles) == (stops, 0, 0)


def check_supervision(built: Built) -> None:
    """Check each transition of the table with each status of the controller, and what state and cause mean for the task."""
    software, function = built.software, built.software.function
    supervision = software.new("supervision")
    function("supervision_init")(supervision)
    assert (supervision.state, supervision.cause, supervision.status) == (State.START, Cause.ANGLE_UNKNOWN, Status.FAIL_SAFE)
    for state, cause, status in itertools.product(State, Cause, Status):
        supervision.state, following = state, next_state(state, cause)
        sent = function("supervision_step")(supervision, cause, status)
        expected = status_of(following, status is Status.LIMITED)
        assert (supervision.state, supervision.cause, sent, supervision.status) == (following, cause, expected, expected)
        has_command = following not in (State.START, State.RESYNCHRONISE)
        assert supervision.has_command == has_command
