"""Ctrl-C and SIGTERM around code that would swallow them.

Layer 0: imports nothing of the project.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator

STOPPING = (signal.SIGINT, signal.SIGTERM)


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
