"""Properties of states that the code of the C does not leave behind.

An initialisation must not depend on what its memory held. A step must find a number of its state that is no number, or far too
large, and restart; or the number must make no difference, as the step writes it before it reads it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from codegen.sil.software import Measurement, Software
from codegen.verify.states import (
    DAMAGED_MARKS,
    MARK,
    UNSOUND,
    Damage,
    damages,
    fields,
    images,
    initialised,
    initialised_states,
    started_with,
)


def initialisation_findings(software: Software) -> Iterator[str]:
    """Yield each field of a state that an initialisation leaves as it was."""
    for name in initialised_states(software):
        states = initialised(software, name)
        paths = [*fields(software.ffi, states[0])]
        for path, *contents in zip(paths, *(images(software.ffi, state, paths) for state in states), strict=True):
            if len({*contents}) > 1:
                yield f"{software.prefix}_{name}_init: {path} is not initialised"


def uninitialised_findings(software: Software) -> Iterator[str]:
    """Yield the first wrong mark with which a task runs on, instead of starting with the default parameters."""
    paths = [*fields(software.ffi, software.new("task")[0])]
    for mark in DAMAGED_MARKS:
        if started_with(software, mark, paths) != started_with(software, None, paths):
            yield f"src/{software.prefix}_task.c: the task does not start anew with {MARK} = 0x{mark:X}"
            break


def soundness_findings(software: Software, samples: Sequence[Measurement]) -> Iterator[str]:
    """Yield each number of a controller's state with which a step neither restarts nor goes on as without the damage.

    The numbers of the state after the step count as well as the commands. A wrong mark must restart.
    """
    found: dict[str, str] = {}
    for damage in damages(software, samples):
        for path, content in _unseen(damage):
            found.setdefault(path, f"src/{software.prefix}_controller.c: a step goes on with {path} = {content}")
    yield from found.values()


def _unseen(damage: Damage) -> Iterator[tuple[str, str]]:
    """Yield each member with a content that makes a difference, but no restart."""
    numbers = damage.numbers
    going_on, commanded, blank = damage.outcomes(numbers), _restarts(damage, damage.command), _restarts(damage, 0.0)
    for path in numbers:
        restarted = blank if path == "rear_angle" else commanded
        for number in UNSOUND:
            if damage.outcomes(numbers, path, number) not in (going_on, restarted):
                yield path, f"{number:g}"
                break
    yield from ((MARK, f"0x{mark:X}") for mark in DAMAGED_MARKS if damage.outcomes(numbers, MARK, mark) != blank)


def _restarts(damage: Damage, command: float) -> list[Any]:
    """Return the outcomes of a restart from the measured angle, or from the last command where it is not measured."""
    software, found = damage.software, []
    for first, *others in damage.after:
        state = software.new("controller")
        software.function("controller_init")(state, command if math.isnan(first.rear_angle) else first.rear_angle)
        software.function("inputs_init")(software.ffi.addressof(state.inputs), False)
        found.append(
            (damage.commands(state, [first]), images(software.ffi, state[0], damage.numbers), damage.commands(state, others))
        )
    return found
