"""Bounds around a loader that is given anything: it ends, and takes no more memory than the size limits of its files allow."""

from __future__ import annotations

import contextlib
import signal
import threading
import tracemalloc
from collections.abc import Iterator
from types import FrameType

MIB = 2**20
MEMORY_MAX = 64 * MIB
SECONDS_MAX = 20
"""A loader takes milliseconds; one that has not ended by then never does."""


class Endless(BaseException):
    """Not an Exception: nothing may catch it."""


@contextlib.contextmanager
def bounded(memory_max: int = MEMORY_MAX, seconds: int = SECONDS_MAX) -> Iterator[None]:
    """Fail where what is done inside does not end, or allocates more bytes at a time than `memory_max`."""
    with _alarm(seconds):
        tracemalloc.start()
        try:
            yield
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
    assert peak <= memory_max, f"{peak / MIB:.0f} MiB at a time"


@contextlib.contextmanager
def _alarm(seconds: int) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield  # no signals there
        return

    def ring(number: int, frame: FrameType | None) -> None:
        raise Endless(f"not done after {seconds} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
