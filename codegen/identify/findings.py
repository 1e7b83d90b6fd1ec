"""Findings about the input of an identification."""

from __future__ import annotations

from dataclasses import dataclass

CLOCK = "clock"
GAP = "gap"
RESERVED = "not available"
SATURATED = "saturation"
IMPOSSIBLE = "impossible value"
FROZEN = "frozen"
OFFSET = "offset"
SIGN = "sign or unit"
UNUSED = "not used"
REMARK = "remark"


@dataclass(frozen=True)
class Finding:
    """Something in the data of a drive that a user should know.

    Attributes:
        drive: name of the drive.
        quantity: key of QUANTITIES; "" for the whole log.
        kind: one of the constants of this module.
        text: one line: what, where, and a remedy if there is one.
        lost: number of samples (of the log) that became NaN because of it.
    """

    drive: str
    quantity: str
    kind: str
    text: str
    lost: int = 0

    def __str__(self) -> str:
        place = f"{self.drive}: {self.quantity}" if self.quantity else self.drive
        return f"{place}: {self.text}"
