"""Table of the supervision in the C, entry by entry, against the one in Python."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from codegen.emit.supervision import STATES, Cause, State, next_state, status_of
from codegen.sil.software import Software, Status


def transition_findings(software: Software) -> Iterator[str]:
    """Yield the start, and the first next state, status or command, that differ from the table."""
    where = f"src/{software.prefix}_supervision.c"
    step, supervision = software.function("supervision_step"), software.new("supervision")
    software.function("supervision_init")(supervision)
    if supervision.state != State.START or supervision.has_command != STATES[State.START].has_command:
        yield f"{where}: it starts in {_name(supervision.state)} instead of START"
    for state, cause, status in itertools.product(State, Cause, Status):
        supervision.state, following = state, next_state(state, cause)
        sent = step(supervision, cause, status)
        wanted = status_of(following, status is Status.LIMITED)
        if supervision.state != following:
            yield f"{where}: from {state.name}, {cause.name} leads to {_name(supervision.state)} instead of {following.name}"
            break
        if sent != wanted or supervision.status != wanted:
            yield f"{where}: in {following.name} the status is {sent} instead of {wanted.name}"
            break
        if supervision.has_command != STATES[following].has_command or supervision.cause != cause:
            yield f"{where}: in {following.name} has_command is {supervision.has_command}, after {cause.name}"
            break


def _name(state: int) -> str:
    return State(state).name if state in set(State) else f"state {state}, which is none"
