"""The supervision of the task: states, causes, and the table of transitions between them.

In each sample the task finds the most urgent cause. The table gives the next state for the state so far and that cause; the
state gives the reaction and the status that is sent. The C, its contracts, the requirements, the safety manual, the guide and
the fault catalogue read this table.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass

from codegen.configuration.signals import Status


class Reaction(enum.Enum):
    """Reaction to a state: the command that the receiver gets."""

    FOLLOW = "the command of the control law"
    PREDICT = "the command of the control law, which continues from the last sample"
    RAMP = (
        "the command returns to zero at a limited rate, from the measured angle if that is farther out, "
        "and waits for wheels that do not follow"
    )
    REST = "the command returns to zero at a limited rate; before the first speed, it is held"
    NOT_AVAILABLE = 'no command ("not available"), the actuator holds its angle'


class State(enum.IntEnum):
    """State of the supervision; the C enum `<prefix>_supervision_state_t`."""

    START = 0
    RUN = 1
    PREDICTED = 2
    DEGRADED = 3
    LOST = 4
    RESYNCHRONISE = 5
    STANDBY = 6
    INHIBITED = 7


@dataclass(frozen=True)
class StateRow:
    """A state.

    Attributes:
        text: when it holds.
        reaction: of the command.
        status: status that is sent. TRACKING becomes LIMITED while the command is at a limit.
    """

    text: str
    reaction: Reaction
    status: Status

    @property
    def has_command(self) -> bool:
        """Whether a command is sent."""
        return self.reaction is not Reaction.NOT_AVAILABLE


STATES: Mapping[State, StateRow] = {
    State.START: StateRow("the rear angle has not been known since the start", Reaction.NOT_AVAILABLE, Status.FAIL_SAFE),
    State.RUN: StateRow("nothing is wrong", Reaction.FOLLOW, Status.TRACKING),
    State.PREDICTED: StateRow("a signal is missing for a short time", Reaction.PREDICT, Status.DEGRADED),
    State.DEGRADED: StateRow("a signal is replaced, or the loop is impaired", Reaction.FOLLOW, Status.DEGRADED),
    State.LOST: StateRow("neither front angle nor yaw rate is valid", Reaction.RAMP, Status.FAIL_SAFE),
    State.RESYNCHRONISE: StateRow(
        "after a silence, the rear angle is not yet measured again", Reaction.NOT_AVAILABLE, Status.FAIL_SAFE
    ),
    State.STANDBY: StateRow("without control", Reaction.REST, Status.STANDBY),
    State.INHIBITED: StateRow("the car inhibits the integrator", Reaction.FOLLOW, Status.TRACKING),
}
"""Meaning, reaction and status of each state."""


class Cause(enum.IntEnum):
    """Cause of a sample, the most urgent first; the C enum `<prefix>_supervision_cause_t`."""

    ANGLE_UNKNOWN = 0
    STANDBY = 1
    SAMPLE_LOST = 2
    SAMPLE_MISSING = 3
    SIGNAL_REPLACED = 4
    ACTUATOR_STUCK = 5
    TASK_LATE = 6
    CONDITIONS_UNKNOWN = 7
    BUS_INTERMITTENT = 8
    INHIBIT = 9
    NONE = 10


@dataclass(frozen=True)
class CauseRow:
    """A cause.

    Attributes:
        text: what it is.
        leads_to: the next state, from every state that `EXCEPTIONS` does not list.
        bits: bits of `Diagnostics` that may be set with it.
        holds_integrator: it is known before the step of the controller, which then learns nothing.
        confines: the command goes no farther out.
    """

    text: str
    leads_to: State
    bits: tuple[str, ...] = ()
    holds_integrator: bool = False
    confines: bool = False


_FRAMES = tuple(f"{side}_{fault}" for side in ("MOTION", "CONDITIONS") for fault in ("MISSING", "WRONG_CRC", "WRONG_COUNTER"))

CAUSES: Mapping[Cause, CauseRow] = {
    Cause.ANGLE_UNKNOWN: CauseRow("no rear angle to start from, at the start or after a silence", State.RESYNCHRONISE),
    Cause.STANDBY: CauseRow(
        "no speed was received yet, Inhibit is set for good, or the speed is below the enabling one (kind `pi`)",
        State.STANDBY,
    ),
    Cause.SAMPLE_LOST: CauseRow(
        "front angle and yaw rate are lost or rejected",
        State.LOST,
        (*_FRAMES, "UNAVAILABLE", "FRONT_ANGLE_REPLACED", "YAW_RATE_REPLACED"),
    ),
    Cause.SAMPLE_MISSING: CauseRow(
        "a signal is missing, for a tolerated time so far", State.PREDICTED, (*_FRAMES, "UNAVAILABLE")
    ),
    Cause.SIGNAL_REPLACED: CauseRow(
        "a signal is rejected and computed from the others",
        State.DEGRADED,
        ("SPEED_REPLACED", "FRONT_ANGLE_REPLACED", "YAW_RATE_REPLACED"),
    ),
    Cause.ACTUATOR_STUCK: CauseRow(
        "the rear angle does not follow the command", State.DEGRADED, ("ACTUATOR_STUCK",), holds_integrator=True, confines=True
    ),
    Cause.TASK_LATE: CauseRow("the task is called too rarely", State.DEGRADED, ("TASK_LATE",), True),
    Cause.CONDITIONS_UNKNOWN: CauseRow(
        "the conditions are not valid: it is unknown whether the car inhibits the integrator",
        State.DEGRADED,
        tuple(name for name in _FRAMES if name.startswith("CONDITIONS")),
        True,
    ),
    Cause.BUS_INTERMITTENT: CauseRow("the bus is disturbed again and again", State.DEGRADED, ("INTERMITTENT",), True),
    Cause.INHIBIT: CauseRow("the car sets Inhibit", State.INHIBITED, (), True),
    Cause.NONE: CauseRow("none", State.RUN),
}
"""Meaning and next state of each cause."""

EXCEPTIONS: Mapping[tuple[State, Cause], State] = {(State.START, Cause.ANGLE_UNKNOWN): State.START}
"""Next states that depend on the state so far."""


def next_state(state: State, cause: Cause) -> State:
    """Return the state that follows from a state and a cause."""
    return EXCEPTIONS.get((state, cause), CAUSES[cause].leads_to)


def status_of(state: State, is_limited: bool = False) -> Status:
    """Return the status that is sent in a state, `is_limited` while the command is at a limit."""
    status = STATES[state].status
    return Status.LIMITED if is_limited and status is Status.TRACKING else status


def status_text(state: State) -> str:
    """Return the status of a state in words."""
    status = STATES[state].status
    return "TRACKING or LIMITED" if status is Status.TRACKING else status.name


def reaction_of(cause: Cause) -> str:
    """Return the reaction to a cause in words, for the tables of manual and guide."""
    row = STATES[CAUSES[cause].leads_to]
    held = ", integrator and learned values are held" if CAUSES[cause].holds_integrator else ""
    confined = ", which goes no farther out" if CAUSES[cause].confines else ""
    return f"{row.reaction.value}{confined}{held}"


def causes_of_bit(name: str) -> tuple[Cause, ...]:
    """Return the causes with which a bit of `Diagnostics` may be set, the most urgent first."""
    return tuple(cause for cause, row in CAUSES.items() if name in row.bits)


HOLDING = sum(1 << cause for cause, row in CAUSES.items() if row.holds_integrator)
"""Bits of the causes that hold the integrator."""
