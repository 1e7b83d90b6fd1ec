"""A CAN frame on the bench, whatever carries it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Frame:
    """A classical CAN frame.

    Attributes:
        id: 11 or 29 bits.
        data: 0 to 8 bytes.
        time: s since the start of the run; 0.0 where nobody looked at a clock.
        extended, remote, error: what kind of frame; all false for what the controller and the car exchange.
    """

    id: int
    data: bytes
    time: float = 0.0
    extended: bool = False
    remote: bool = False
    error: bool = False
