"""The bits of `Diagnostics` in words: what the bench and its users are told."""

from __future__ import annotations

from collections.abc import Mapping

DIAGNOSTICS: Mapping[int, tuple[str, str]] = {
    0: ("MOTION_MISSING", "motion missing"),
    1: ("MOTION_WRONG_CRC", "motion CRC wrong"),
    2: ("MOTION_REPEATED", "motion repeated"),
    3: ("MOTION_WRONG_SEQUENCE", "motion out of sequence"),
    4: ("MOTION_SOME_LOST", "motion lost in between"),
    5: ("CONDITIONS_MISSING", "conditions missing"),
    6: ("CONDITIONS_WRONG_CRC", "conditions CRC wrong"),
    7: ("CONDITIONS_REPEATED", "conditions repeated"),
    8: ("CONDITIONS_WRONG_SEQUENCE", "conditions out of sequence"),
    9: ("CONDITIONS_SOME_LOST", "conditions lost in between"),
    10: ("UNAVAILABLE", "signal unavailable or out of range"),
    11: ("IMPLAUSIBLE", "yaw rate implausible"),
    12: ("TASK_LATE", "task late"),
    13: ("TASK_EARLY", "task early"),
    14: ("WRONG_LENGTH", "wrong length"),
    15: ("TIMEOUT", "timeout"),
}
"""Bit: name as in the generated C, and a few words."""


def causes(diagnostics: int) -> tuple[str, ...]:
    """The words for the bits that are set, from the lowest; "bit 20" for one without a name."""
    bits = [bit for bit in range(diagnostics.bit_length()) if diagnostics >> bit & 1]
    return tuple(DIAGNOSTICS[bit][1] if bit in DIAGNOSTICS else f"bit {bit}" for bit in bits)
