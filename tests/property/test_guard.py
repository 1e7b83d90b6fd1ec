"""The bounds of `guard` can fail."""

from __future__ import annotations

import pytest

from tests.property.guard import MIB, Endless, bounded


def test_memory() -> None:
    with bounded(4 * MIB):
        bytearray(2 * MIB)
    with pytest.raises(AssertionError, match="8 MiB at a time"), bounded(4 * MIB):
        bytearray(8 * MIB)
    with pytest.raises(KeyError), bounded(0):
        raise KeyError("inside")


def endless() -> None:
    with bounded(seconds=0.1):
        while True:
            pass


def test_time() -> None:
    with pytest.raises(Endless):
        endless()
