"""A CAN frame on the bench, on any bus."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Frame:
    """A classical CAN frame.

    Attributes:
        id: 11 or 29 bits.
        data: 0 to 8 bytes.
        time: s since the start of the run; 0.0 if unknown.
        extended, remote, error: kind of the frame; all false for frames between controller and car.
    """

    id: int
    data: bytes
    time: float = 0.0
    extended: bool = False
    remote: bool = False
    error: bool = False
