"""The bounds themselves are able to fail."""

from __future__ import annotations

import pytest

from tests.property.guard import MIB, Endless, bounded


def test_what_takes_too_much_memory_fails() -> None:
    with bounded(4 * MIB):
        bytearray(2 * MIB)
    with pytest.raises(AssertionError, match="8 MiB at a time"), bounded(4 * MIB):
        bytearray(8 * MIB)


def endless() -> None:
    with bounded(seconds=1):
        while True:
            pass


def failing() -> None:
    with bounded(0):
        bytearray(MIB)
        raise KeyError("inside")


def test_what_does_not_end_is_ended() -> None:
    with pytest.raises(Endless):
        endless()


def test_what_fails_inside_is_told_as_it_is() -> None:
    with pytest.raises(KeyError):
        failing()
