"""Cyclic task around the second controller, written from its header: frames in, one frame out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

from codegen.configuration.can import Can
from codegen.configuration.e2e_profiles import DataId
from codegen.emit.supervision import CAUSES, STATES, Cause, State, next_state, status_of
from codegen.sil.software import Command, Measurement, Status
from hil_sim.codec import DIAGNOSTICS, Codec, Frame, RearSteerCommand, VehicleConditions, VehicleMotion
from hil_sim.e2e import E2eState, E2eStatus, Receiver, Supervision, next_counter, protect
from tests.oracle.controller import SecondController
from tests.oracle.inputs import Quality

ANGLE_WAIT_S, WHEELS_WAIT_S = 0.1, 5.0
"""Times for which the command waits for the rear angle, and for wheels that do not follow, from the header of the task."""
_BITS = {name: 1 << bit for bit, (name, _) in DIAGNOSTICS.items()}
_ADVANCE = {E2eStatus.OK: 1, E2eStatus.INITIAL: 1, E2eStatus.OK_SOME_LOST: 2}
"""Steps of the sender's counter by a good frame, as counted by the task; other statuses are not good."""

INPUTS = ("speed", "front_angle", "yaw_rate")
BACKLOG_MAX, FORGIVEN_EVERY = 3, 64
"""Steps that the calls may lag behind the sender, and the calls after which one is forgiven."""
DISTURBANCE_WEIGHT, DISTURBANCE_MAX = 15, 60
"""Weight of a recovery after a disturbance, and the sum (minus one for each other call) above which the bus is
intermittent."""


@dataclass
class _Input:
    """State of one message: its frames in this cycle, and the last usable contents."""

    name: str
    data_id: DataId
    receiver: Receiver
    supervision: Supervision
    frames: int = 0
    advance: int = 0
    is_heard: bool = False
    causes: set[str] = field(default_factory=set)
    is_disturbed: bool = False
    is_usable: bool = False
    contents: Any = None

    def receive(self, data: bytes) -> bool:
        """Return whether the frame is good. A frame of wrong length is damaged and does not advance the counter."""
        self.frames += 1
        if len(data) != self.receiver.frame_bytes:
            self.causes.add("WRONG_CRC")
            return False
        status = self.receiver.check(self.data_id, data)
        self.advance += _ADVANCE.get(status, 0)
        if status not in _ADVANCE:
            self.causes.add("WRONG_CRC" if status is E2eStatus.WRONG_CRC else "WRONG_COUNTER")
        self.is_disturbed |= status is E2eStatus.OK_SOME_LOST
        self.is_heard |= status not in (E2eStatus.WRONG_CRC, E2eStatus.REPEATED)
        return status in _ADVANCE

    def has_returned(self) -> bool:
        """Return whether a good frame came after a fault, or with one in the same cycle."""
        return self.advance > 0 and (self.is_disturbed or bool(self.causes))

    @property
    def is_valid(self) -> bool:
        """Whether the message is valid over its last cycles."""
        return self.supervision.state is E2eState.VALID

    def close(self) -> int:
        """End the cycle and return its diagnostics."""
        is_good = self.advance > 0
        self.is_disturbed = not is_good and (self.is_disturbed or bool(self.causes))
        is_valid = self.supervision.step(is_good, "WRONG_CRC" in self.causes) is E2eState.VALID
        self.is_usable = is_good and is_valid
        if not self.frames:
            self.receiver.no_new_data()
            self.causes.add("MISSING")
        if is_good and not is_valid:
            self.causes.add("WRONG_COUNTER")
        causes = sum(_BITS[f"{self.name}_{cause}"] for cause in self.causes)
        self.frames, self.advance, self.is_heard, self.causes = 0, 0, False, set()
        return causes


@dataclass
class SecondTask:
    """Task after initialisation.

    Attributes:
        parameters: anything with the fields of the C parameter struct.
        codec: of the build's numbers.
        make: a controller of the build's kind that starts from a rear angle in rad.
        is_complete: whether both messages were received since the last cycle, the conditions after the motion.
    """

    can: Can
    parameters: Any
    codec: Codec
    make: Callable[[float], SecondController]
    is_complete: bool = field(default=False, init=False)
    _state: State = State.START
    _samples_without_angle: int = 0
    _silence: int = 0
    _measured: float | None = None
    _counter: int = 0
    _cycles: int = 0
    _backlog: int = 0
    _disturbance: int = 0
    _samples_off: int = 0
    _is_stuck: bool = False
    _inhibited: int = 0
    _expected: Any = 0.0
    _deviates: bool = False
    _released: bool = False
    _start_angle: Any = 0.0
    _stuck_angle: Any = 0.0
    _offset: Any = 0.0
    _waited: int = 0
    _inputs: dict[int, _Input] = field(init=False)
    _controller: SecondController = field(init=False)

    def __post_init__(self) -> None:
        motion, conditions = self.can.vehicle_motion, self.can.vehicle_conditions
        self._inputs = {
            message.id: _Input(
                name, message.e2e_data_id, Receiver(self.can.e2e, self.can.frame_bytes), Supervision(self.can.e2e)
            )
            for name, message in (("MOTION", motion), ("CONDITIONS", conditions))
        }
        self._controller = self.make(0.0)

    def run(self, frames: tuple[Frame, ...]) -> tuple[int, bytes]:
        """Run one cycle on the frames since the last one. Return id and data of the frame to send."""
        for frame in frames:
            self.receive(frame)
        self.is_complete = False
        motion, conditions = self._inputs.values()
        lacks_angle, was_valid = self._lacks_angle(motion.is_heard or conditions.is_heard), conditions.is_valid
        diagnostics = self._rhythm(motion.advance) | self._of_bus(motion.has_returned() or conditions.has_returned())
        diagnostics |= motion.close() | conditions.close()
        is_good = motion.is_usable and conditions.is_usable
        received = conditions.contents.rear_angle if conditions.is_usable else None
        measured = received if is_good or self._measured is not None else None
        if not lacks_angle:
            diagnostics |= self._of_actuator(received, starts=measured is not None, returns=not was_valid)
        found = self._causes(diagnostics, conditions)
        sample = self._sample(motion, conditions, any(CAUSES[each].holds_integrator for each in found))
        if lacks_angle and not self._start(measured):
            found.add(Cause.ANGLE_UNKNOWN)
        last, ran = self._controller.angle, self._controller.runs
        command = Command(0.0, 0.0, Status.STANDBY)
        if self._is_inhibited_for_good(conditions):
            command = self._rest()
        elif Cause.ANGLE_UNKNOWN not in found or self._measured is not None:
            command = self._controller.step(sample)
        self._released = ran and not self._controller.runs
        if ran != self._controller.runs:
            self._start_angle, self._offset, self._waited = self._controller.angle, self._controller.real(0.0), 0
        if measured is not None and self._is_plausible(measured):
            command = self._near_wheels(command, last, measured)
            self._measured, self._samples_without_angle = measured, 0
        found |= self._causes_of_controller(command.status)
        self._state = next_state(self._state, min(found))
        diagnostics |= self._of_controller(is_good, command.status)
        has_command = STATES[self._state].has_command
        sent = (command.rear_angle, command.yaw_rate_reference) if has_command else (math.nan, math.nan)
        message, status = self.can.rear_steer_command, status_of(self._state, command.status is Status.LIMITED)
        contents = self.codec.encode(RearSteerCommand(*sent, status, diagnostics))
        data = protect(message.e2e_data_id, self._counter, contents, self.can.e2e.definition)
        self._counter = next_counter(self._counter, self.can.e2e.definition)
        return message.id, data

    def receive(self, frame: Frame) -> None:
        """Receive a frame. The set is complete with conditions that come after the motion."""
        motion, conditions = self._inputs
        if frame.id == conditions:
            self.is_complete = self._inputs[motion].frames > 0
        if frame.id in self._inputs and self._inputs[frame.id].receive(frame.data):
            self._inputs[frame.id].contents = self.codec.decode(frame.id, frame.data)

    def _rhythm(self, advance: int) -> int:
        """Detect a late task: the sender's counter advances faster than the calls."""
        self._cycles = (self._cycles + 1) % FORGIVEN_EVERY
        behind = max(self._backlog + advance - 1, 0)
        behind = max(behind - (self._cycles == 0), 0)
        self._backlog = min(behind, BACKLOG_MAX + 2)
        return _BITS["TASK_LATE"] if behind > BACKLOG_MAX else 0

    def _of_bus(self, has_returned: bool) -> int:
        changed = self._disturbance + (DISTURBANCE_WEIGHT if has_returned else -1)
        self._disturbance = min(max(changed, 0), DISTURBANCE_MAX + DISTURBANCE_WEIGHT)
        return _BITS["INTERMITTENT"] if self._disturbance > DISTURBANCE_MAX else 0

    def _of_actuator(self, measured: float | None, starts: bool, returns: bool) -> int:
        """Compare the measured angle (None: not received) with a first-order lag behind the previous commands.

        starts: the car measures the angle, so that the command may start from it. returns: the conditions were not valid
        before; with them, commands may have been lost.
        """
        real, most = self._controller.real, self.parameters.actuator_samples_max
        command, expected = real(self._controller.angle), real(self._expected)
        moved = expected + real(self.parameters.actuator_share) * (command - expected)
        self._expected = moved if abs(moved) <= real(self.parameters.inputs.rear_angle_max) else command
        self._deviates = False
        if measured is not None:
            distance = abs(command - self._expected)
            tolerance = real(self.parameters.actuator_error_max) + (distance + distance)
            if abs(real(measured) - self._expected) <= tolerance:
                self._offset = real(0.0)
            error = (real(measured) - self._expected) - self._offset
            self._deviates = bool(abs(error) > tolerance)
            starts &= self._is_plausible(measured)
            leads = (self._deviates and returns) or (self._released and abs(real(measured)) > abs(command))
            if starts and self._released and self._deviates:
                self._offset, self._deviates = error, False
            elif starts and leads and not self._is_stuck:
                self._place(measured)
            elif not self._deviates:
                self._samples_off -= self._samples_off > 0 and (not self._is_stuck or self._has_come_free(real(measured)))
            elif self._is_stuck:
                self._samples_off = most
            elif self._controller.runs:
                self._samples_off, self._stuck_angle = self._samples_off + 1, real(measured)
            self._is_stuck = self._samples_off > (0 if self._is_stuck else most)
        return _BITS["ACTUATOR_STUCK"] if self._is_stuck else 0

    def _has_come_free(self, measured: Any) -> bool:
        """Return whether stuck wheels have moved or are near zero: those that the command is kept near show nothing else."""
        most = self._controller.real(self.parameters.actuator_error_max)
        return bool(abs(measured) <= most or abs(measured - self._stuck_angle) > most)

    def _near_wheels(self, command: Command, last: Any, measured: float) -> Command:
        """Return the command near wheels that it does not reach: no farther out than the law's, the last one and the wheels."""
        parameters, real, angle = self.parameters, self._controller.real, self._controller.angle
        measured, zero = real(measured), real(0.0)
        kept = measured - self._offset
        if self._controller.runs:
            if self._deviates or self._is_stuck:
                angle = max(min(angle, max(last, measured, zero)), min(last, measured, zero))
        elif self._deviates and self._waits(kept, last):
            moved, bound = abs(real(self._measured or 0.0) - self._offset) - abs(kept), abs(self._start_angle)
            has_moved = moved > real(parameters.actuator_share) * real(parameters.actuator_error_max)
            angle = min(max(kept, -bound), bound) if has_moved and bound > abs(last) else last
            self._waited += 1
        if angle == self._controller.angle:
            return command
        self._controller.place(float(angle))
        return replace(command, rear_angle=float(self._controller.angle))

    def _waits(self, wheels: Any, last: Any) -> bool:
        """Return whether a return to zero waits for wheels on the side of the last command, farther out than this one."""
        is_ahead = bool(wheels * last > 0.0) and abs(wheels) > abs(self._controller.angle)
        return bool(is_ahead and self._waited < max(int(WHEELS_WAIT_S / float(self._controller.period) + 1e-6), 1))

    def _place(self, angle: float) -> None:
        """Start from the angle in rad that the actuator holds."""
        self._controller.place(angle)
        self._expected, self._start_angle, self._deviates = self._controller.angle, self._controller.angle, False
        self._offset = self._controller.real(0.0)

    def _causes(self, diagnostics: int, conditions: _Input) -> set[Cause]:
        """Return the causes that are known before the step of the controller."""
        there = {
            Cause.NONE: True,
            Cause.ACTUATOR_STUCK: diagnostics & _BITS["ACTUATOR_STUCK"],
            Cause.TASK_LATE: diagnostics & _BITS["TASK_LATE"],
            Cause.BUS_INTERMITTENT: diagnostics & _BITS["INTERMITTENT"],
            Cause.CONDITIONS_UNKNOWN: not conditions.is_valid,
            Cause.INHIBIT: conditions.contents is not None and conditions.contents.inhibit,
        }
        return {cause for cause, is_there in there.items() if is_there}

    def _is_inhibited_for_good(self, conditions: _Input) -> bool:
        is_inhibited = conditions.contents is not None and conditions.contents.inhibit
        if not is_inhibited:
            self._inhibited = 0
        elif conditions.is_usable:
            self._inhibited = min(self._inhibited, self.parameters.inhibit_samples_max) + 1
        return bool(self._inhibited > self.parameters.inhibit_samples_max)

    def _rest(self) -> Command:
        """Return the command of a sample without control: the angle returns to zero, and the controller starts anew."""
        real, parameters = self._controller.real, self.parameters
        self._controller.approach_zero(min(real(parameters.fail_safe_rate), real(parameters.limiter.rear_rate_max)))
        self._controller = self.make(float(self._controller.angle))
        return Command(float(self._controller.angle), 0.0, Status.STANDBY)

    def _causes_of_controller(self, status: Status) -> set[Cause]:
        """Return the causes that the status of the controller shows."""
        degraded = Cause.SAMPLE_MISSING if self._controller.quality is Quality.MISSING else Cause.SIGNAL_REPLACED
        shown = {Status.FAIL_SAFE: Cause.SAMPLE_LOST, Status.STANDBY: Cause.STANDBY, Status.DEGRADED: degraded}
        return {shown[status]} if status in shown else set()

    def _sample(self, motion: _Input, conditions: _Input, inhibit: bool) -> Measurement:
        """Return the measurement for the controller; missing values are not available."""
        car = motion.contents if motion.is_usable else VehicleMotion(math.nan, math.nan, math.nan)
        last: VehicleConditions = conditions.contents or VehicleConditions()
        state = replace(last, inhibit=inhibit) if conditions.is_usable else VehicleConditions(inhibit=inhibit)
        if self._deviates:
            state = replace(state, rear_angle=math.nan)
        return Measurement(**vars(car), **vars(state))

    @property
    def _wait(self) -> int:
        """Samples for which an angle is waited for."""
        return max(int(ANGLE_WAIT_S / float(self._controller.period) + 1e-6), 1)

    def _is_plausible(self, rear_angle: float) -> bool:
        return bool(abs(rear_angle) <= self.parameters.inputs.rear_angle_max)

    def _lacks_angle(self, has_frames: bool) -> bool:
        """Return whether the rear angle is unknown: until the start, and after a silence that led to the fail-safe.

        Once it was waited for in vain, no other silence is, until the angle is measured.
        """
        is_long = self._silence > self.parameters.inputs.missing_samples_max
        is_over = has_frames and is_long and self._measured is not None and self._samples_without_angle <= self._wait
        self._silence = 0 if has_frames else self._silence + 1
        return is_over or not STATES[self._state].has_command

    def _start(self, rear_angle: float | None) -> bool:
        """Start control from the measured rear angle (None: not received), not from an impossible one.

        Returns whether it has started.

        A car that does not measure it starts from zero. After a silence, one that did measure it goes on from the last one.
        """
        was_measured, started = self._measured is not None, False
        if rear_angle is not None and self._is_plausible(rear_angle):
            started = True
        elif was_measured or (rear_angle is not None and math.isnan(rear_angle)):
            self._samples_without_angle += 1
            started = self._samples_without_angle > self._wait
            rear_angle = self._measured if was_measured else rear_angle
        elif rear_angle is not None:
            self._samples_without_angle = 0
        if started:
            assert rear_angle is not None
            self._place(rear_angle)
        return started

    def _of_controller(self, is_good: bool, status: Status) -> int:
        """Return the bits of replaced signals. Without control, none is judged before the first step."""
        controller, found = self._controller, 0
        if is_good and controller.quality is Quality.MISSING:
            found |= _BITS["UNAVAILABLE"]
        replaced = [name for name in INPUTS if not getattr(controller.inputs, name).is_measured]
        if status is not Status.STANDBY or len(replaced) < len(INPUTS):
            found |= sum(_BITS[f"{name.upper()}_REPLACED"] for name in replaced)
        return found
