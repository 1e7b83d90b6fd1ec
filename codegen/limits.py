"""Limits on the processor time and the memory that reading one file may take.

They grow with the file. Damaged and hostile files can make a parser work for ever or fill the memory: names of names, packed
zeros, types inside types. A reader in Python runs inside `enforced`; a library that computes without returning to Python, or
that crashes when memory runs out, runs in a process of its own (see `codegen.importing.child`).
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from codegen.errors import CodegenError

MIB = 2**20
SECONDS = 15.0
"""Processor time for a small file. With the start of a command an answer comes within 20 s."""
MEMORY_BYTES = 1_600_000_000
"""Memory for a small file. With Python and its libraries a command stays within 2 GB."""
SMALL_BYTES = 64 * MIB
"""Files up to this size have the limits of a small one; those of larger files grow in proportion."""
SMALL_SLOW_BYTES = 16 * MIB
"""The same for programs: pyelftools needs 3 s for 8 MiB of one with 20,000 variables and their types."""
REPEAT_S = 1.0
"""Interval of further signals, for a library that catches the first exception."""
_is_enforced = False


class ExceededError(BaseException):
    """The time is over. Libraries catch every Exception."""


@dataclass
class Limits:
    """Limits of reading one file. The time of several calls adds up.

    Attributes:
        seconds: processor time that is left.
        memory_bytes: memory in addition to what the process has.
    """

    seconds: float = SECONDS
    memory_bytes: int = MEMORY_BYTES

    @classmethod
    def of(cls, size: int, small: int = SMALL_BYTES) -> Limits:
        """Return the limits of a file of `size` bytes; those up to `small` bytes have the ones of a small file."""
        factor = max(1.0, size / small)
        return cls(SECONDS * factor, round(MEMORY_BYTES * factor))

    @contextlib.contextmanager
    def enforced(self, where: object, kind: type[CodegenError] = CodegenError) -> Iterator[None]:
        """Limit the block. Inside another one, or in a thread other than the main one, it has no limits of its own.

        Raises:
            CodegenError: of class `kind`, if the block takes more.
        """
        global _is_enforced
        if _is_enforced or threading.current_thread() is not threading.main_thread():
            yield
            return
        _is_enforced = True
        whole, start = self.seconds, time.process_time()
        try:
            with _timer(whole), _memory(self.memory_bytes), _quiet():
                yield
        except ExceededError:
            raise too_much(f"{whole:g} s", where, kind) from None
        except MemoryError:
            raise too_much(f"{self.memory_bytes / 1e9:.1f} GB of memory", where, kind) from None
        finally:
            _is_enforced = False
            self.seconds = max(whole - (time.process_time() - start), 0.1)


def too_much(what: str, where: object, kind: type[CodegenError] = CodegenError) -> CodegenError:
    """Return the error of a file whose reading takes more than `what`."""
    return kind(
        f"reading it takes more than {what}, the limit for its size", where=where, remedy="check the file, or shorten it"
    )


@contextlib.contextmanager
def _timer(seconds: float) -> Iterator[None]:
    """Raise ExceededError in the block after some processor time."""
    is_armed = True

    def end(number: int, frame: FrameType | None) -> None:
        del number, frame
        if is_armed:
            raise ExceededError

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, seconds, REPEAT_S)
    try:
        try:
            yield
        finally:
            is_armed = False  # from here on nothing interrupts
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Print nothing about errors in the block that nobody can catch, as in a finaliser: they follow from the limits.

    The hook is a function of the interpreter, for one in Python fails without memory, and that is printed too.
    """
    before, sys.unraisablehook = sys.unraisablehook, callable
    try:
        yield
    finally:
        sys.unraisablehook = before


@contextlib.contextmanager
def _memory(spare_bytes: int) -> Iterator[None]:
    """Limit the memory of this process in the block, where Linux reports its size."""
    if sys.platform != "linux":
        yield
        return
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    limit_memory(spare_bytes)
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def limit_memory(spare_bytes: int) -> None:
    """Limit the memory of this process to `spare_bytes` more, where Linux reports its size, but not above an earlier limit."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        wanted = pages * resource.getpagesize() + spare_bytes
        smallest = min(limit for limit in (wanted, soft, hard) if limit != resource.RLIM_INFINITY)
        resource.setrlimit(resource.RLIMIT_AS, (smallest, hard))
