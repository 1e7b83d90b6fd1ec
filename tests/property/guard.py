"""Bounds for a loader of arbitrary files: it ends, and needs no more memory than the size limits of its files allow."""

import contextlib
import signal
import tracemalloc
from collections.abc import Iterator
from types import FrameType

MEMORY_MAX = 64 * 2**20
SECONDS_MAX = 60  # of processor time; a loader takes milliseconds, and one that runs for so long never ends


class Endless(BaseException):
    """Not an Exception, so that no handler catches it."""


@contextlib.contextmanager
def bounded(memory_max: int = MEMORY_MAX, seconds: float = SECONDS_MAX) -> Iterator[None]:
    """Fail if the block does not end, or allocates more bytes at a time than `memory_max`."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise Endless(f"not done after {seconds} s")

    before = signal.signal(signal.SIGPROF, interrupt)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    assert peak <= memory_max, f"{peak / 2**20:.0f} MiB at a time"
