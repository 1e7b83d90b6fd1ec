"""Calls in separate processes, for Python code that would hold the interpreter for a long time."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from multiprocessing.pool import AsyncResult, Pool
from multiprocessing.process import BaseProcess
from types import TracebackType
from typing import Any, Self, TypeVar

Result = TypeVar("Result")


class Background:
    """Pool of one process for each processor, started with the first call. Leaving the context stops running calls.

    Functions, arguments and results must be picklable. `get` raises the CodegenErrors of a call again.
    """

    def __init__(self) -> None:
        self._pool: Pool | None = None
        self._processes: list[BaseProcess] = []

    def __enter__(self) -> Self:
        """Prepare the pool; nothing is started yet."""
        return self

    @property
    def processes(self) -> tuple[BaseProcess, ...]:
        """Processes of the pool."""
        return tuple(self._processes)

    def call(self, function: Callable[..., Result], *arguments: Any) -> AsyncResult[Result]:
        """Submit a call; `get` of the returned object waits for the result."""
        if self._pool is None:
            # Not forked: threads of this process may hold locks.
            before = set(multiprocessing.active_children())
            self._pool = multiprocessing.get_context("spawn").Pool(os.cpu_count(), _leave_interrupts_to_parent)
            self._processes = [each for each in multiprocessing.active_children() if each not in before]
        return self._pool.apply_async(function, arguments)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        """Stop all calls."""
        if self._pool is not None:
            self._pool.terminate()
            self._pool.join()


def _leave_interrupts_to_parent() -> None:
    """Ignore SIGINT, which reaches every process of the terminal; the parent process ends the workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
