"""The cyclic task as its header describes it, in Python: frames in, one frame out, around the second controller."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from codegen.can_sections import FRAME_BYTES, Can
from codegen.sil.software import Measurement
from codegen.verify.law.controller import SecondController
from codegen.verify.law.inputs import Quality
from hil_sim.codec import Codec, RearSteerCommand, VehicleConditions, VehicleMotion
from hil_sim.diagnostics import DIAGNOSTICS
from hil_sim.e2e import E2eStatus, Receiver, next_counter, protect
from hil_sim.frames import Frame

_BITS = {name: 1 << bit for bit, (name, _) in DIAGNOSTICS.items()}
_CAUSES = {
    E2eStatus.OK: "",
    E2eStatus.INITIAL: "",
    E2eStatus.OK_SOME_LOST: "SOME_LOST",
    E2eStatus.WRONG_CRC: "WRONG_CRC",
    E2eStatus.REPEATED: "REPEATED",
}
"""What a status of the check of a frame tells; all others tell a wrong sequence."""
_USABLE = (E2eStatus.OK, E2eStatus.INITIAL, E2eStatus.OK_SOME_LOST)


@dataclass
class _Input:
    """One message: what came of it in this cycle, and the last contents that could be used."""

    name: str
    data_id: int
    receiver: Receiver
    frames: int = 0
    is_good: bool = False
    causes: int = 0
    contents: Any = None

    def receive(self, data: bytes) -> bool:
        """Whether the frame may be used."""
        self.frames += 1
        status = self.receiver.check(self.data_id, data)
        cause = _CAUSES.get(status, "WRONG_SEQUENCE")
        self.causes |= _BITS[f"{self.name}_{cause}"] if cause else 0
        self.is_good |= status in _USABLE
        return status in _USABLE

    def close(self) -> int:
        """The end of a cycle: its diagnostics."""
        if not self.frames:
            self.receiver.no_new_data()
        causes = self.causes | (0 if self.frames else _BITS[f"{self.name}_MISSING"])
        self.frames, self.is_good, self.causes = 0, False, 0
        return causes


@dataclass
class SecondTask:
    """A task that has just been initialised.

    Attributes:
        parameters: anything with the fields of the C parameter struct.
        codec: of the build's numbers.
        make: a controller of the build's kind that starts from a rear angle in rad.
    """

    can: Can
    parameters: Any
    codec: Codec
    make: Callable[[float], SecondController]
    _started: bool = False
    _samples_without_angle: int = 0
    _wrong_length: bool = False
    _counter: int = 0
    _inputs: dict[int, _Input] = field(init=False)
    _controller: SecondController = field(init=False)

    def __post_init__(self) -> None:
        motion, conditions = self.can.vehicle_motion, self.can.vehicle_conditions
        self._inputs = {
            message.id: _Input(name, message.e2e_data_id, Receiver(self.can.e2e))
            for name, message in (("MOTION", motion), ("CONDITIONS", conditions))
        }
        self._controller = self.make(0.0)

    def run(self, frames: tuple[Frame, ...]) -> tuple[int, bytes]:
        """One cycle: the frames that came since the last one, and identifier and data of the frame to send."""
        for frame in frames:
            self._receive(frame)
        motion, conditions = self._inputs.values()
        diagnostics = self._rhythm(motion.frames, conditions.frames)
        is_good = motion.is_good and conditions.is_good
        sample = self._sample(motion, conditions)  # which may start the controller anew
        command = self._controller.step(sample)
        diagnostics |= self._of_controller(is_good)
        diagnostics |= motion.close() | conditions.close() | (_BITS["WRONG_LENGTH"] if self._wrong_length else 0)
        self._wrong_length = False
        told = (command.rear_angle, command.yaw_rate_reference) if self._started else (math.nan, math.nan)
        message = self.can.rear_steer_command
        contents = self.codec.encode(RearSteerCommand(*told, command.status, diagnostics))
        data = protect(message.e2e_data_id, self._counter, contents)
        self._counter = next_counter(self._counter)
        return message.id, data

    def _receive(self, frame: Frame) -> None:
        if frame.id not in self._inputs:
            return
        if len(frame.data) != FRAME_BYTES:
            self._wrong_length = True
        elif self._inputs[frame.id].receive(frame.data):
            self._inputs[frame.id].contents = self.codec.decode(frame.id, frame.data)

    @staticmethod
    def _rhythm(motion_frames: int, conditions_frames: int) -> int:
        if max(motion_frames, conditions_frames) > 1:
            return _BITS["TASK_LATE"]
        return 0 if motion_frames or conditions_frames else _BITS["TASK_EARLY"]

    def _sample(self, motion: _Input, conditions: _Input) -> Measurement:
        """What the controller is told: what did not come is not available."""
        car = motion.contents if motion.is_good else VehicleMotion(math.nan, math.nan, math.nan)
        last: VehicleConditions = conditions.contents or VehicleConditions()
        state = last if conditions.is_good else VehicleConditions(inhibit=last.inhibit)
        if motion.is_good and conditions.is_good and not self._started:
            self._start(state.rear_angle)
        return Measurement(car.speed, car.front_angle, car.yaw_rate, state.rear_angle, state.friction, state.inhibit)

    def _start(self, rear_angle: float) -> None:
        """Control starts from where the rear wheels are; not from where they cannot be, and from zero where nobody measures."""
        if abs(rear_angle) <= self.parameters.inputs.rear_angle_max:
            self._started = True
        elif math.isnan(rear_angle):
            self._samples_without_angle += 1
            self._started = self._samples_without_angle > self.parameters.inputs.recovery_samples
        else:
            self._samples_without_angle = 0
        if self._started:
            self._controller = self.make(rear_angle)

    def _of_controller(self, is_good: bool) -> int:
        quality, found = self._controller.quality, 0
        if is_good and quality is Quality.MISSING:
            found |= _BITS["UNAVAILABLE"]
        if quality is Quality.REPLACED:
            found |= _BITS["REPLACED"]
        if quality is Quality.UNUSABLE:
            found |= _BITS["UNUSABLE"]
        return found
