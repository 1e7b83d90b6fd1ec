"""States of the C that its own code does not leave behind: memory of any content, and numbers that are NaN or too large.

An initialisation must not depend on what its memory held. A step must find a number of its state that is no number, or far too
large, and restart; or the number must make no difference, as the step writes it before it reads it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from codegen.sil.software import Measurement, Software

CONTENTS = (0x00, 0x5A, 0xA5, 0xFF)
"""Bytes of the memory before an initialisation. 0xFF is NaN in every number, 0x5A and 0xA5 are numbers of either sign."""
UNSOUND = (math.nan, math.inf, -1e30)
"""Numbers that no state has."""
COMPARED = 40
"""Samples after the damage; a number that enters the state shows in a few."""


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


def soundness_findings(software: Software, samples: Sequence[Measurement]) -> Iterator[str]:
    """Yield each number of a controller's state with which a step neither restarts nor goes on as without the damage.

    Args:
        samples: a drive under control; the damage is done before the last COMPARED of them.
    """
    ffi, controller = software.ffi, software.new("controller")
    step, parameters, measured = software.function("controller_step"), software.parameters(), software.new("measurement")

    def run(state: Any, samples: Sequence[Measurement]) -> list[tuple[float, float, int]]:
        commands = []
        for sample in samples:
            software.fill(measured, sample)
            command = step(state, parameters, measured)
            commands.append((command.rear_angle, command.yaw_rate_reference, int(command.status)))
        return commands

    software.function("controller_init")(controller, samples[0].rear_angle)
    run(controller, samples[:-COMPARED])
    size, image = ffi.sizeof(controller[0]), bytes(ffi.buffer(controller))
    good, missing = samples[-COMPARED:], Measurement(math.nan, math.nan, math.nan)

    def outputs(path: str = "", number: float = 0.0) -> list[list[tuple[float, float, int]]]:
        found = []
        for after in (good, [missing, *good[1:]]):
            state = software.new("controller")
            ffi.memmove(state, image, size)
            if path:
                *parents, last = path.split(".")
                setattr(_member(state[0], parents), last, number)
            found.append(run(state, after))
        return found

    going_on, restarted = outputs(), outputs("initialised", 0)
    for path in fields(ffi, controller[0], "primitive"):
        if isinstance(_member(controller[0], path.split(".")), float):
            for number in UNSOUND:
                if outputs(path, number) not in (going_on, restarted):
                    yield f"src/{software.prefix}_controller.c: a step goes on with {path} = {number:g}"
                    break


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
