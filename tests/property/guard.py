"""Memory limit for loaders of arbitrary files: no more than the size limits of their files allow.

The timeout of every test checks that a loader terminates.
"""

import contextlib
import tracemalloc
from collections.abc import Iterator

MEMORY_MAX = 64 * 2**20


@contextlib.contextmanager
def bounded(memory_max: int = MEMORY_MAX) -> Iterator[None]:
    """Fail if the block has more than `memory_max` bytes allocated at a time."""
    tracemalloc.start()
    try:
        yield
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak <= memory_max, f"{peak / 2**20:.0f} MiB at a time"
