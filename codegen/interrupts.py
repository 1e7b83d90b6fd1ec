"""Ctrl-C and SIGTERM around code that would swallow them."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from types import FrameType

Handler = Callable[[int, FrameType | None], None]

STOPPING = (signal.SIGINT, signal.SIGTERM)

SWALLOWING = ("casadi.casadi",)
"""Modules that catch every exception, those of signals too, and go on: operators of CasADi's symbols."""
RETRY = 0.01
"""s, after which a signal that came inside of them is tried again."""

IMPATIENCE = 2.0
"""s, in which another Ctrl-C is taken for the same wish: what cleans up after the first one is not cut short."""


def raise_once() -> Handler:
    """A handler of SIGINT: KeyboardInterrupt, but not again for `IMPATIENCE` seconds."""
    last = -IMPATIENCE

    def handle(number: int, frame: FrameType | None) -> None:
        del number, frame
        nonlocal last
        now = time.monotonic()
        if now - last >= IMPATIENCE:
            last = now
            raise KeyboardInterrupt

    return handle


def take(handlers: Mapping[int, Handler]) -> None:
    """Install handlers that raise, each of which waits while a package runs that would swallow what it raises."""
    waiting: list[tuple[int, Handler]] = []

    def patient(handler: Handler) -> Handler:
        def handle(number: int, frame: FrameType | None) -> None:
            if _is_swallowed(frame):
                waiting.append((number, handle))
                signal.setitimer(signal.ITIMER_REAL, RETRY)
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
        signal.signal(number, patient(handler))


def _is_swallowed(frame: FrameType | None) -> bool:
    while frame is not None:
        # Python prints what a destructor raises, and goes on.
        if frame.f_globals.get("__name__") in SWALLOWING or frame.f_code.co_name == "__del__":
            return True
        frame = frame.f_back
    return False


@contextlib.contextmanager
def deferred() -> Iterator[Callable[[], None]]:
    """Let SIGINT and SIGTERM wait until the function that is yielded is called, and until the block ends.

    CasADi turns a KeyboardInterrupt inside a solver into a warning and goes on. Outside the main thread, which alone gets
    signals, and for signals that are ignored, nothing changes.

    Raises:
        KeyboardInterrupt, SystemExit: from the yielded function and from the end of the block, where a signal waits.
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
