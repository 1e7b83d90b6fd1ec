"""The units of a build in C, each beside its second implementation, and their comparison on inputs that repeat for hours.

Both implementations are run side by side until the state of the second one, in Python, recurs. From there on its outputs
repeat with the inputs, so that only the C has to be run, and each of its outputs is compared with the one in the cycle.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.emit.laws import law_of
from codegen.sil.software import Measurement, Software, Status
from codegen.verify.drives import NUMBER_ROLES
from codegen.verify.long_drives import DAMAGED, SILENT
from codegen.verify.traffic import Cycle
from codegen.verify.unit_drives import Stretch
from hil_sim.codec import Codec, Frame
from hil_sim.e2e import Receiver, Supervision, protect
from tests.oracle.controller import SecondController, SecondLimiter
from tests.oracle.inputs import Quality, SecondInputs, strongest_braking
from tests.oracle.task import SecondTask

STATEFUL = ("tests.oracle.", "hil_sim.e2e", "codegen.configuration.signals")
"""Modules of the classes whose attributes are the state. Other objects, such as parameters and the map, do not change."""
SETTLING_MAX = 8_000
"""Largest number of inputs after which the state must recur."""


class Pair(ABC):
    """One unit in C and its second implementation, both in the same state."""

    _second: Any
    """The second implementation."""

    @abstractmethod
    def second(self, sample: Any) -> Any:
        """Advance the second implementation and return its output."""

    @abstractmethod
    def compiled(self, sample: Any) -> Any:
        """Advance the C and return its output, comparable with that of `second`."""

    def state(self) -> Any:
        """Return the objects that hold the state of the second implementation."""
        return self._second

    def first_difference(self, samples: Sequence[Any], wanted: Sequence[Any], rounds: int) -> tuple[int, Any] | None:
        """Run the C on the samples a number of times. Return index and output of the first difference."""
        compiled, number = self.compiled, 0
        for _ in range(rounds):
            for sample, output in zip(samples, wanted, strict=True):
                got = compiled(sample)
                if got != output:
                    return number, got
                number += 1
        return None

    def text(self, output: Any) -> str:
        """Format an output."""
        return str(output)


@dataclass
class Result:
    """Result of a comparison.

    Attributes:
        difference: index of the first output that differs, the output of the C and that of the second implementation.
        compared: number of outputs computed by both.
        repeated: number of outputs of the C compared with those of the cycle.
        unsettled: number of stretches that were cut because the state did not recur.
    """

    difference: tuple[int, Any, Any, Any] | None = None
    compared: int = 0
    repeated: int = 0
    unsettled: int = 0


def compare(pair: Pair, stretches: Iterable[Stretch]) -> Result:
    """Run both implementations on stretches in order, until an output differs."""
    result = Result()
    for stretch in stretches:
        _compare_stretch(pair, stretch, result)
        if result.difference is not None:
            break
    return result


def _compare_stretch(pair: Pair, stretch: Stretch, result: Result) -> None:
    outputs: list[Any] = []
    seen: dict[Hashable, int] = {}
    left, has_recurred = stretch.rounds, stretch.rounds == 1
    while left:
        with np.errstate(all="ignore"):
            wanted = [pair.second(sample) for sample in stretch.samples]
        if not _is_equal(pair, stretch, wanted, 1, result):
            return
        left -= 1
        result.compared += len(wanted)
        if has_recurred:
            continue
        outputs += wanted
        state = state_of(pair.state())
        if state in seen:
            has_recurred, cycle = True, outputs[seen[state] :]
            rounds, left = divmod(left, len(cycle) // len(stretch.samples))
            if not _is_equal(pair, stretch, cycle, rounds, result):
                return
            result.repeated += rounds * len(cycle)
        elif len(outputs) >= SETTLING_MAX:
            result.unsettled += 1
            return
        seen[state] = len(outputs)


def _is_equal(pair: Pair, stretch: Stretch, wanted: Sequence[Any], rounds: int, result: Result) -> bool:
    """Return whether the C gives the wanted outputs a number of times. If not, the difference is in the result."""
    samples = [*stretch.samples] * (len(wanted) // len(stretch.samples))
    found = pair.first_difference(samples, wanted, rounds)
    if found is not None:
        index, got = found
        at = index % len(wanted)
        result.difference = (result.compared + result.repeated + index, samples[at], got, wanted[at])
    return found is None


def state_of(value: Any) -> Hashable:
    """Return a value that is equal for equal states only: numbers by their bits, unchanging objects by their identity."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tobytes()
    if isinstance(value, float):
        return value.hex()
    if value is None or isinstance(value, int | str | bytes | Enum):
        return value
    if isinstance(value, list | tuple | deque):
        return tuple(map(state_of, value))
    if isinstance(value, set):
        return frozenset(map(state_of, value))
    if isinstance(value, dict):
        return tuple((key, state_of(each)) for key, each in value.items())
    if type(value).__module__.startswith(STATEFUL) and not getattr(value, "is_constant", False):
        return tuple(state_of(each) for name, each in vars(value).items())
    return id(value)


BATCH = 36_000
"""Maximum samples in one call of the C."""
QUALITIES = tuple(Quality)
COMMAND = ("rear_angle", "yaw_rate_reference", "status")


class ControllerPair(Pair):
    """The controller: measurements in, (rear angle, reference yaw rate, status) out."""

    def __init__(self, software: Software, second: SecondController, parameters: Any, start: float) -> None:
        self._second, self._software = second, software
        self._controller = software.controller(start, parameters)
        self.statuses: Counter[Status] = Counter()

    def second(self, sample: Measurement) -> tuple[float, float, int]:
        command = self._second.step(sample)
        self.statuses[command.status] += 1
        return command.rear_angle, command.yaw_rate_reference, int(command.status)

    def compiled(self, sample: Measurement) -> tuple[float, float, int]:
        (command,) = self._run([sample], 1)
        return tuple(command.tolist())

    def first_difference(
        self, samples: Sequence[Measurement], wanted: Sequence[Any], rounds: int
    ) -> tuple[int, tuple[float, float, int]] | None:
        columns = [np.array(column) for column in zip(*wanted, strict=True)]
        at_once = max(BATCH // len(samples), 1)
        for first in range(0, rounds, at_once):
            count = min(at_once, rounds - first)
            found = self._run(samples, count)
            equal = [found[name] == np.tile(column, count) for name, column in zip(COMMAND, columns, strict=True)]
            if not all(each.all() for each in equal):
                index = int(np.flatnonzero(~np.logical_and.reduce(equal))[0])
                return first * len(samples) + index, tuple(found[index].tolist())
        return None

    def _run(self, samples: Sequence[Measurement], rounds: int) -> npt.NDArray[Any]:
        """Run the C on the samples a number of times, in one call. Return its commands, by COMMAND."""
        software, count = self._software, rounds * len(samples)
        ffi, prefix = software.ffi, software.prefix
        once = ffi.new(f"{prefix}_measurement_t[]", len(samples))
        for each, sample in zip(once, samples, strict=True):
            software.fill(each, sample)
        measurements, commands = (ffi.new(f"{prefix}_{name}_t[]", count) for name in ("measurement", "command"))
        ffi.buffer(measurements)[:] = bytes(ffi.buffer(once)) * rounds
        controller = self._controller
        software.compiled.lib.loop_controller(controller.state, controller.parameters, measurements, commands, count)
        command = ffi.typeof(f"{prefix}_command_t")
        layout: Any = {
            "names": COMMAND,
            "formats": (software.real, software.real, np.uint32),
            "offsets": [ffi.offsetof(command, name) for name in COMMAND],
            "itemsize": ffi.sizeof(command),
        }
        return np.frombuffer(ffi.buffer(commands), dtype=np.dtype(layout)).copy()

    def text(self, output: tuple[float, float, int]) -> str:
        rear_angle, reference, status = output
        name = Status(status).name if status in set(Status) else f"status {status}, which is none"
        return f"{rear_angle:.9g} rad, reference {reference:.9g} rad/s, {name}"


class InputsPair(Pair):
    """The input monitoring, untrusted at first: measurements in, quality and accepted values out, with a command of zero.

    A reference model that it needs turns by three quarters of the measured yaw rate, with half of the rear angle.
    """

    def __init__(self, software: Software, parameters: Any) -> None:
        period = software.config.controller.sampling_time_s
        self._second = SecondInputs(parameters.inputs, software.real, period, strongest_braking(software), is_trusted=False)
        self._software = software
        self._names = [name for name in NUMBER_ROLES if name in {signal.role for signal in software.measured}]
        self._parameters = software.ffi.addressof(parameters, "inputs")
        self._state, self._measured, self._found = (software.new(name) for name in ("inputs", "measurement", "measurement"))
        self._step, self._command = software.function("inputs_step"), software.real(0.0)
        self._model = software.new("reference_model") if law_of(software.config).uses_reference_model else None
        self._last: Measurement | None = None
        self._owner = parameters  # the struct above is a part of it
        software.function("inputs_init")(self._state, False)

    def second(self, sample: Measurement) -> tuple[Any, ...]:
        quality, found = self._second.step(sample, self._command, self._model and (None, *self._motion(sample)))
        return (QUALITIES.index(quality), found.inhibit, *(float(getattr(found, name)) for name in self._names))

    def _motion(self, sample: Measurement) -> tuple[Any, Any]:
        """Return yaw rate and rear angle of the reference model."""
        numbers = (0.75 * sample.yaw_rate, 0.5 * sample.rear_angle)
        yaw_rate, rear_angle = (self._software.real(number if math.isfinite(number) else 0.0) for number in numbers)
        return yaw_rate, rear_angle

    def compiled(self, sample: Measurement) -> tuple[Any, ...]:
        if sample is not self._last:
            self._software.fill(self._measured, sample)
            self._last = sample
            if self._model:
                self._model.yaw_rate, self._model.rear_angle = self._motion(sample)
        found, model = self._found, [self._model] if self._model else []
        quality = self._step(self._state, self._parameters, self._measured, self._command, *model, found)
        return (quality, found.inhibit, *[getattr(found, name) for name in self._names])

    def text(self, output: tuple[Any, ...]) -> str:
        quality, inhibit, *numbers = output
        return f"quality {quality}, inhibit {inhibit}, " + ", ".join(f"{number:.9g}" for number in numbers)


class LimiterPair(Pair):
    """The limiter: (speed, front angle, demand) in, rear angle out."""

    def __init__(self, software: Software, parameters: Any, period: float, start: float) -> None:
        self._second = SecondLimiter(parameters.limiter, period, software.real, start)
        self._parameters, self._owner = software.ffi.addressof(parameters, "limiter"), parameters
        self._state, self._input = software.new("limiter"), software.new("limiter_input")
        self._step = software.function("limiter_step")
        software.function("limiter_init")(self._state, start)

    def second(self, sample: tuple[float, float, float]) -> float:
        return float(self._second.step(*sample))

    def compiled(self, sample: tuple[float, float, float]) -> float:
        given = self._input
        given.speed, given.front_angle, given.demand = sample
        return float(self._step(self._state, self._parameters, given))


class ReceiverPair(Pair):
    """Receiver and supervision of a message. In: the advance of the sender's counter since the last frame, DAMAGED, or SILENT.
    Out: status and state."""

    def __init__(self, software: Software) -> None:
        can = software.config.can
        message, self._profile = can.vehicle_motion, can.e2e.definition
        self._data_id = message.e2e_data_id
        self._number = self._data_id if isinstance(self._data_id, int) else 0  # of the first list of data ids
        self._receiver, self._supervision = Receiver(can.e2e, can.frame_bytes), Supervision(can.e2e)
        self._c_receiver, self._c_supervision = software.new("e2e_receiver"), software.new("e2e_supervision")
        self._check, self._no_new_data, self._supervise = map(
            software.function, ("e2e_check", "e2e_no_new_data", "e2e_supervise")
        )
        self._counters = [0, 0]  # of the sender to each implementation
        counters = range(self._profile.counter_count)
        self._frames = [protect(self._data_id, counter, bytes(can.frame_bytes), self._profile) for counter in counters]
        self._damaged = bytes((self._frames[0][0] ^ 1, *self._frames[0][1:]))
        software.function("e2e_receiver_init")(self._c_receiver)
        software.function("e2e_supervision_init")(self._c_supervision)

    def _frame(self, sample: int, side: int) -> bytes:
        if sample == DAMAGED:
            return self._damaged
        self._counters[side] = (self._counters[side] + sample) % self._profile.counter_count
        return self._frames[self._counters[side]]

    def second(self, sample: int) -> tuple[int, int]:
        if sample == SILENT:
            status = self._receiver.no_new_data()
        else:
            status = self._receiver.check(self._data_id, self._frame(sample, 0))
        return int(status), int(self._supervision.step(*_judged(status)))

    def compiled(self, sample: int) -> tuple[int, int]:
        if sample == SILENT:
            status = self._no_new_data(self._c_receiver)
        else:
            status = self._check(self._c_receiver, self._number, self._frame(sample, 1))
        return status, self._supervise(self._c_supervision, *_judged(status))

    def state(self) -> Any:
        return self._receiver, self._supervision, self._counters[0]


def _judged(status: int) -> tuple[bool, bool]:
    """Return whether the data of a frame may be used, and whether it is damaged."""
    return status in (0, 4, 6), status == 2


class TaskPair(Pair):
    """The cyclic task: frames in; identifier, data, and whether the set is complete after each frame and the call, out."""

    def __init__(self, software: Software, second: SecondTask, codec: Codec, parameters: Any) -> None:
        self._task, self._second, self._codec = software.task(parameters), second, codec

    def second(self, sample: Cycle) -> tuple[int, bytes, tuple[bool, ...]]:
        second, complete = self._second, []
        for frame in sample:
            second.receive(frame)
            complete.append(second.is_complete)
        identifier, data = second.run(())
        return identifier, data, (*complete, second.is_complete)

    def compiled(self, sample: Cycle) -> tuple[int, bytes, tuple[bool, ...]]:
        task, complete = self._task, []
        for frame in sample:
            task.on_can_frame(frame.id, frame.data)
            complete.append(task.is_complete)
        identifier, data = task.run()
        return identifier, data, (*complete, task.is_complete)

    def text(self, output: tuple[int, bytes, tuple[bool, ...]]) -> str:
        identifier, data, complete = output
        try:
            contents = f" ({self._codec.decode(identifier, data)})"
        except LookupError:  # no identifier of the bus
            contents = ""
        *frames, after = ("yes" if each else "no" for each in complete)
        return f"0x{identifier:X} {data.hex()}{contents}, complete after its frames {' '.join(frames) or '-'}, then {after}"


def text_of(sample: Any) -> str:
    """Format an input."""
    if isinstance(sample, Measurement):
        numbers = ", ".join(f"{getattr(sample, name):.9g}" for name in NUMBER_ROLES)
        return f"({numbers}, inhibited)" if sample.inhibit else f"({numbers})"
    if isinstance(sample, tuple) and all(isinstance(each, Frame) for each in sample):
        return " ".join(f"0x{frame.id:X} {frame.data.hex()}" for frame in sample[:4]) or "no frame"
    return str(sample)
