"""States of the C that its own code does not leave behind: memory of any content, and numbers that are NaN or too large.

An initialisation must not depend on what its memory held. A step must find a number of its state that is no number, or far too
large, and restart; or the number must make no difference, as the step writes it before it reads it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from codegen.emit.can_view import task_name
from codegen.sil.software import Measurement, Software

CONTENTS = (0x00, 0x5A, 0xA5, 0xFF)
"""Bytes of the memory before an initialisation. 0xFF is NaN in every number, 0x5A and 0xA5 are numbers of either sign."""
UNSOUND = (math.nan, math.inf, -1e30)
"""Numbers that no state has."""
DISTANCE, COMPARED = 50, 10
"""Samples between two damages, and those after each: a number that enters the state shows in a few."""
MARK = "initialised"
"""Member of a controller with the mark of an initialised state."""
MARKS = (0x00000000, 0x00000001, 0x5A5A5A5A, 0xA5A5A5A5, 0xFFFFFFFF)
"""Contents of the mark in memory that was never initialised."""


def initialised_states(software: Software) -> tuple[str, ...]:
    """Return the states of a build that a function initialises; the states inside are initialised with them."""
    has_task = hasattr(software.compiled.lib, f"{software.prefix}_task_init")
    return ("controller", "supervision", "task") if has_task else ("controller",)


def initialisation_findings(software: Software) -> Iterator[str]:
    """Yield each field of a state that an initialisation leaves as it was."""
    arguments: dict[str, Any] = {"controller": (0.01,), "task": (software.parameters(),)}
    for name in initialised_states(software):
        init, states = software.function(f"{name}_init"), []
        for content in CONTENTS:
            state = software.new(name)
            software.ffi.memmove(state, bytes([content]) * software.ffi.sizeof(state[0]), software.ffi.sizeof(state[0]))
            init(state, *arguments.get(name, ()))
            states.append(state[0])
        for path in fields(software.ffi, states[0]):
            if len({_image(software.ffi, state, path) for state in states}) > 1:
                yield f"{software.prefix}_{name}_init: {path} is not initialised"


def uninitialised_findings(software: Software) -> Iterator[str]:
    """Yield the first wrong mark with which a task runs on, instead of starting with the default parameters.

    All but the mark is sound, so that no fault of the test for it can crash.
    """
    ffi, init = software.ffi, software.function("task_init")
    run = software.function(task_name(software.config.controller.sampling_time_s))
    default, other = software.parameters(), software.parameters()
    other.fail_safe_rate *= 0.5
    data = ffi.new("uint8_t[]", software.config.can.frame_bytes)

    def outcome(parameters: Any, mark: int | None = None) -> list[bytes]:
        state = software.new("task")
        init(state, parameters)
        if mark is not None:
            state.cycles = 1
            setattr(state.controller, MARK, mark)
        run(state, data)
        members = [_image(ffi, state[0], path) for path in fields(ffi, state[0]) if path != "parameters"]
        return [*members, bytes(ffi.buffer(state.parameters)), bytes(ffi.buffer(data))]

    started = outcome(default)
    for mark in MARKS:
        if outcome(other, mark) != started:
            yield f"src/{software.prefix}_task.c: the task does not start anew with {MARK} = 0x{mark:X}"
            break


def soundness_findings(software: Software, samples: Sequence[Measurement]) -> Iterator[str]:
    """Yield each number of a controller's state with which a step neither restarts nor goes on as without the damage.

    The state is damaged every DISTANCE samples of a drive. The numbers of the state after the step count as well as the
    commands: one that stays NaN may enter the command much later. A wrong mark must restart.
    """
    found: dict[str, str] = {}
    for place in range(COMPARED, len(samples) - COMPARED, DISTANCE):
        for path, content in _Damage(software, samples[:place], samples[place : place + COMPARED]).unseen():
            found.setdefault(path, f"src/{software.prefix}_controller.c: a step goes on with {path} = {content}")
    yield from found.values()


class _Damage:
    """Damage to the state of a controller that has driven `before`, and the outcomes of the samples `after`."""

    def __init__(self, software: Software, before: Sequence[Measurement], after: Sequence[Measurement]) -> None:
        self._software, self._parameters = software, software.parameters()
        self._step, self._measured = software.function("controller_step"), software.new("measurement")
        controller = software.new("controller")
        software.function("controller_init")(controller, before[0].rear_angle)
        self._commands(controller, before)
        self._image = bytes(software.ffi.buffer(controller))
        paths = fields(software.ffi, controller[0], "primitive")
        self._numbers = [path for path in paths if isinstance(_member(controller[0], path.split(".")), float)]
        firsts = (after[0], before[-1], Measurement(math.nan, math.nan, math.nan))  # the next, a frozen and a missing one
        self._after = [[first, *after[1:]] for first in firsts]

    def unseen(self) -> Iterator[tuple[str, str]]:
        """Yield each member with a content that makes a difference, but no restart."""
        going_on, restarted = self._outcomes(), self._outcomes(MARK, 0)
        for path in self._numbers:
            for number in UNSOUND:
                if self._outcomes(path, number) not in (going_on, restarted):
                    yield path, f"{number:g}"
                    break
        yield from ((MARK, f"0x{mark:X}") for mark in MARKS if self._outcomes(MARK, mark) != restarted)

    def _outcomes(self, path: str = "", content: float = 0.0) -> list[Any]:
        """Return the commands, and the numbers of the state after the first step, with a content of one member."""
        ffi, found = self._software.ffi, []
        for first, *others in self._after:
            state = self._software.new("controller")
            ffi.memmove(state, self._image, len(self._image))
            if path:
                *parents, last = path.split(".")
                setattr(_member(state[0], parents), last, content)
            command = self._commands(state, [first])
            numbers = [_image(ffi, state[0], each) for each in self._numbers]
            found.append((command, numbers, self._commands(state, others)))
        return found

    def _commands(self, state: Any, samples: Sequence[Measurement]) -> list[tuple[float, float, int]]:
        commands = []
        for sample in samples:
            self._software.fill(self._measured, sample)
            command = self._step(state, self._parameters, self._measured)
            commands.append((command.rear_angle, command.yaw_rate_reference, int(command.status)))
        return commands


def fields(ffi: Any, struct: Any, kind: str = "") -> Iterator[str]:
    """Yield the paths of the members of a struct that are no structs themselves, such as `law.integral`."""
    for name, field in ffi.typeof(struct).fields:
        if field.type.kind == "struct":
            yield from (f"{name}.{path}" for path in fields(ffi, getattr(struct, name), kind))
        elif not kind or field.type.kind == kind:
            yield name


def _member(struct: Any, path: Sequence[str]) -> Any:
    for name in path:
        struct = getattr(struct, name)
    return struct


def _image(ffi: Any, struct: Any, path: str) -> bytes:
    *parents, last = path.split(".")
    parent = _member(struct, parents)
    field = dict(ffi.typeof(parent).fields)[last]
    return bytes(ffi.buffer(ffi.addressof(parent, last), ffi.sizeof(field.type)))
