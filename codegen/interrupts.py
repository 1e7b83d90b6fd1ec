"""Handle Ctrl-C and SIGTERM around code that swallows exceptions."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from types import FrameType

Handler = Callable[[int, FrameType | None], None]

STOPPING = (signal.SIGINT, signal.SIGTERM)

EXCEPTION_SWALLOWING_MODULES = ("casadi.casadi",)
"""Modules that catch every exception, including those of signal handlers, and continue: operators of CasADi's symbols."""
RETRY_DELAY_S = 0.01
"""Delay in s before a signal that arrived inside such a module is handled again."""

REPEATED_INTERRUPT_IGNORED_S = 2.0
"""Time in s during which another signal is ignored, so that it does not interrupt the cleanup after the first."""


def raise_once(exception: Callable[[int], BaseException]) -> Handler:
    """Return a handler that raises the exception of a signal, but not again within `REPEATED_INTERRUPT_IGNORED_S` seconds."""
    last = -REPEATED_INTERRUPT_IGNORED_S

    def handle(number: int, frame: FrameType | None) -> None:
        del frame
        nonlocal last
        now = time.monotonic()
        if now - last >= REPEATED_INTERRUPT_IGNORED_S:
            last = now
            raise exception(number)

    return handle


def install_handlers(handlers: Mapping[int, Handler]) -> None:
    """Install handlers that raise. Each waits while a module that would swallow the exception runs."""
    waiting: list[tuple[int, Handler]] = []

    def delayed(handler: Handler) -> Handler:
        def handle(number: int, frame: FrameType | None) -> None:
            if _is_swallowed(frame):
                waiting.append((number, handle))
                signal.setitimer(signal.ITIMER_REAL, RETRY_DELAY_S)
            else:
                handler(number, frame)

        return handle

    def again(number: int, frame: FrameType | None) -> None:
        del number
        if waiting:
            first, handle = waiting.pop(0)
            handle(first, frame)

    signal.signal(signal.SIGALRM, again)
    for number, handler in handlers.items():
        signal.signal(number, delayed(handler))


def _is_swallowed(frame: FrameType | None) -> bool:
    while frame is not None:
        # Python prints an exception that a destructor raises, and continues.
        if frame.f_globals.get("__name__") in EXCEPTION_SWALLOWING_MODULES or frame.f_code.co_name == "__del__":
            return True
        frame = frame.f_back
    return False


@contextlib.contextmanager
def deferred() -> Iterator[Callable[[], None]]:
    """Defer SIGINT and SIGTERM until the yielded function is called or the block ends.

    CasADi turns a KeyboardInterrupt inside a solver into a warning and continues. Nothing changes for ignored signals, or
    outside the main thread, which alone receives signals.

    Raises:
        KeyboardInterrupt, SystemExit: from the yielded function and at the end of the block, if a signal is pending.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    waiting: list[int] = []
    wanted = [number for number in STOPPING if signal.getsignal(number) not in (signal.SIG_IGN, None)]
    previous = {number: signal.signal(number, lambda received, _: waiting.append(received)) for number in wanted}

    def check() -> None:
        if waiting:
            if waiting[0] == signal.SIGINT:
                raise KeyboardInterrupt
            raise SystemExit(128 + waiting[0])

    try:
        yield check
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    check()
