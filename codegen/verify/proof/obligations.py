"""What has to hold at places of a run, and what is taken of its tables."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from codegen.verify.proof.terms import Term


class Kind(StrEnum):
    """Of what has to hold."""

    INDEX = "index inside its array"
    CONVERSION = "float-to-integer conversion defined"
    DIVISION = "no division by zero"
    OVERFLOW = "no signed overflow"
    SHIFT = "shift within the width"
    WRITTEN = "nothing read that was not written"
    CLAIM = "claim"
    INVARIANT = "invariant"


@dataclass(frozen=True)
class Obligation:
    """What has to hold at a place.

    Attributes:
        place: file and line.
        path: what the inputs fulfil where the place is reached.
        goal: what has to hold there.
        text: of it, for a message.
    """

    kind: Kind
    place: str
    path: Term
    goal: Term
    text: str


@dataclass(frozen=True)
class Widened:
    """What the entries of a table may be calibrated to; whether each is above the one before."""

    low: float
    high: float
    is_increasing: bool = False
