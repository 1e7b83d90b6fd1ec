"""Result of one check."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class State(enum.StrEnum):
    """State of the checked item."""

    GOOD = "good"
    MISSING = "missing"
    """Not there; something does without it."""
    BAD = "bad"
    """There, and it does not work or does not fit."""


@dataclass(frozen=True)
class Finding:
    """One line of the answer.

    Attributes:
        name: of the thing.
        state: how it is.
        what: its version, or what is wrong.
        serves: what it is for, in words.
        remedy: what to type, "" where there is nothing to do.
        needed: whether `codegen sil` needs it.
    """

    name: str
    state: State
    what: str
    serves: str = ""
    remedy: str = ""
    needed: bool = False

    @property
    def stops(self) -> bool:
        """Whether `codegen sil` cannot work because of it."""
        return self.needed and self.state is not State.GOOD
