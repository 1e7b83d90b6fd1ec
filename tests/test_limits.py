"""Limits on reading a file: a library that computes for ever or takes any amount of memory ends with one line."""

import gc
import signal
import sys
import threading
import time

import pytest

from codegen.errors import BuildError, CodegenError
from codegen.limits import MEMORY_BYTES, MIB, SECONDS, Limits

SHORT_S = 0.05


def endless() -> None:
    """Work of a library that catches every Exception."""
    while True:
        try:
            sum(range(100))
        except Exception:
            continue


def test_the_limits_grow_with_the_file() -> None:
    assert Limits.of(0) == Limits.of(64 * MIB) == Limits(SECONDS, MEMORY_BYTES)
    assert Limits.of(128 * MIB) == Limits(2 * SECONDS, 2 * MEMORY_BYTES)
    assert Limits.of(64 * MIB, small=16 * MIB) == Limits(4 * SECONDS, 4 * MEMORY_BYTES)
    assert SECONDS <= 20.0 and MEMORY_BYTES <= 2e9


def test_endless_work_ends_with_one_line() -> None:
    before = signal.getsignal(signal.SIGPROF)
    message = r"^evil\.elf: reading it takes more than 0\.05 s, the limit for its size; check the file, or shorten it$"
    with pytest.raises(BuildError, match=message), Limits(SHORT_S).enforced("evil.elf", BuildError):
        endless()
    assert signal.getsignal(signal.SIGPROF) is before
    assert signal.getitimer(signal.ITIMER_PROF) == (0.0, 0.0)


def test_the_time_of_several_calls_adds_up() -> None:
    limits = Limits(1.0)
    with limits.enforced("file"):
        end = time.process_time() + 0.05
        while time.process_time() < end:
            pass
    assert 0.5 < limits.seconds <= 0.95


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux enforces the limit")
def test_any_amount_of_memory_ends_with_one_line() -> None:
    import resource

    before = resource.getrlimit(resource.RLIMIT_AS)
    message = r"^file: reading it takes more than 0\.1 GB of memory, the limit for its size"
    with pytest.raises(CodegenError, match=message), Limits(memory_bytes=10**8).enforced("file"):
        bytearray(2 * 10**8)
    assert resource.getrlimit(resource.RLIMIT_AS) == before
    bytearray(2 * 10**8)


def test_the_outer_limits_hold_inside_and_other_threads_have_none() -> None:
    with pytest.raises(CodegenError, match=r"^outer: "), Limits(SHORT_S).enforced("outer"), Limits(60.0).enforced("inner"):
        endless()
    before = signal.getsignal(signal.SIGPROF)
    found: list[object] = []

    def read() -> None:
        with Limits(SHORT_S).enforced("file"):
            found.append(signal.getsignal(signal.SIGPROF))

    thread = threading.Thread(target=read)
    thread.start()
    thread.join()
    assert found == [before]


def test_errors_of_the_block_pass() -> None:
    with pytest.raises(KeyError), Limits().enforced("file"):
        raise KeyError
    with Limits(SHORT_S).enforced("file"):
        pass
    assert signal.getitimer(signal.ITIMER_PROF) == (0.0, 0.0)


def test_errors_that_nobody_can_catch_are_not_printed_before_the_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    printed: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda error: printed.append(error.exc_type))

    class Finalised:
        def __del__(self) -> None:
            raise MemoryError

    def lose() -> None:
        Finalised()

    with Limits().enforced("a file"):
        lose()
        gc.collect()
    assert printed == []
    lose()
    gc.collect()
    assert printed == [MemoryError]
