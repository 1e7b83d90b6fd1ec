"""States of the C that its own code does not leave behind: memory of any content, and numbers that are NaN or too large.

`initialised`, `started_with` and `Damage` return what the C does from such states.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator, Sequence
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
DAMAGED_MARKS = (0x00000000, 0x00000001, 0x5A5A5A5A, 0xA5A5A5A5, 0xFFFFFFFF)
"""Contents of the mark in memory that was never initialised."""


def initialised_states(software: Software) -> tuple[str, ...]:
    """Return the states of a build that a function initialises; the states inside are initialised with them."""
    has_task = hasattr(software.compiled.lib, f"{software.prefix}_task_init")
    return ("controller", "supervision", "task") if has_task else ("controller",)


def initialised(software: Software, name: str) -> list[Any]:
    """Return the states that an initialisation leaves in memory of each of CONTENTS."""
    ffi, states = software.ffi, []
    arguments: dict[str, Any] = {"controller": (0.01,), "task": (software.parameters(),)}
    for content in CONTENTS:
        state = software.new(name)
        ffi.memmove(state, bytes([content]) * ffi.sizeof(state[0]), ffi.sizeof(state[0]))
        software.function(f"{name}_init")(state, *arguments.get(name, ()))
        states.append(state[0])
    return states


def started_with(software: Software, mark: int | None, paths: Iterable[str]) -> list[bytes]:
    """Return the frame of a task, its parameters and members of its state after a call from a state with a wrong mark.

    The parameters of that state are not the default ones. All but the mark is sound, so that no fault of the test for it can
    crash. None: the outcome of a new task with the default parameters.
    """
    ffi, state, parameters = software.ffi, software.new("task"), software.parameters()
    if mark is not None:
        parameters.fail_safe_rate *= 0.5
    software.function("task_init")(state, parameters)
    if mark is not None:
        state.cycles = 1
        setattr(state.controller, MARK, mark)
    data = ffi.new("uint8_t[]", software.config.can.frame_bytes)
    software.function(task_name(software.config.controller.sampling_time_s))(state, data)
    members = (path for path in paths if path != "parameters")
    return [*images(ffi, state[0], members), bytes(ffi.buffer(state.parameters)), bytes(ffi.buffer(data))]


def damages(software: Software, samples: Sequence[Measurement]) -> Iterator[Damage]:
    """Yield damages every DISTANCE samples of a drive."""
    for place in range(COMPARED, len(samples) - COMPARED, DISTANCE):
        yield Damage(software, samples[:place], samples[place : place + COMPARED])


class Damage:
    """Damage to the state of a controller that has driven `before`, and the outcomes of the samples `after`.

    `numbers` are the paths of the state's real numbers, `place` is the number of samples before, and `command` the last command
    of those in rad.
    """

    def __init__(self, software: Software, before: Sequence[Measurement], after: Sequence[Measurement]) -> None:
        self.software, self._parameters, self.place = software, software.parameters(), len(before)
        self._step, self._measured = software.function("controller_step"), software.new("measurement")
        controller = software.new("controller")
        software.function("controller_init")(controller, before[0].rear_angle)
        self.command = self.commands(controller, before)[-1][0]
        self._image = bytes(software.ffi.buffer(controller))
        paths = fields(software.ffi, controller[0], "primitive")
        self.numbers = [path for path in paths if isinstance(_member(controller[0], path.split(".")), float)]
        firsts = (after[0], before[-1], Measurement(math.nan, math.nan, math.nan))  # the next, a frozen and a missing one
        self.after = [[first, *after[1:]] for first in firsts]

    def outcomes(self, numbers: Iterable[str], path: str = "", content: float = 0.0) -> list[Any]:
        """Return the commands, and numbers of the state after the first step, with a content of one member.

        A number that stays NaN may enter the command much later.
        """
        ffi, found = self.software.ffi, []
        for first, *others in self.after:
            state = self.software.new("controller")
            ffi.memmove(state, self._image, len(self._image))
            if path:
                *parents, last = path.split(".")
                setattr(_member(state[0], parents), last, content)
            command = self.commands(state, [first])
            found.append((command, images(ffi, state[0], numbers), self.commands(state, others)))
        return found

    def commands(self, state: Any, samples: Sequence[Measurement]) -> list[tuple[float, float, int]]:
        """Return rear angle, reference and status of the samples from a state."""
        commands = []
        for sample in samples:
            self.software.fill(self._measured, sample)
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


def images(ffi: Any, struct: Any, paths: Iterable[str]) -> list[bytes]:
    """Return the bytes of members of a struct."""
    data = bytes(ffi.buffer(ffi.addressof(struct)))
    return [data[place] for place in _slices(ffi, ffi.typeof(struct), tuple(paths))]


@functools.lru_cache
def _slices(ffi: Any, declared: Any, paths: tuple[str, ...]) -> list[slice]:
    """Return where the members are in a struct."""
    found = []
    for path in paths:
        kind, names = declared, path.split(".")
        for name in names:
            kind = dict(kind.fields)[name].type
        start = ffi.offsetof(declared, *names)
        found.append(slice(start, start + ffi.sizeof(kind)))
    return found
