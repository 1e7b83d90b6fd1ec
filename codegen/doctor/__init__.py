"""Checks of `codegen doctor` on a machine. It is on the same layer as `report` and imports `errors`, `sil` and `hil_sim`.

Each module checks one subject and returns findings; none of them raises because something is missing or broken.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass


class State(enum.StrEnum):
    """State of the checked item."""

    GOOD = "good"
    MISSING = "missing"
    """Not installed; some feature is not available."""
    BAD = "bad"
    """Installed, but broken or not suitable."""


@dataclass(frozen=True)
class Finding:
    """One line of the output.

    Attributes:
        name: name of the checked item.
        state: its state.
        what: its version, or the problem.
        serves: its purpose.
        remedy: what to type; "" if there is nothing to do.
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
