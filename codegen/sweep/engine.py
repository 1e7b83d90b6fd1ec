"""Who drives the chunks: threads of this machine, or the workers of a Dask cluster. The results are the same.

An engine yields (number of the chunk, its result) as chunks end, in any order, with only so many under way that memory stays
as it is however long the campaign.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import Any, Protocol

from codegen.errors import CheckFailed, CodegenError

ADDRESS = re.compile(r"[a-z]+://[^\s/]+:\d+\Z")
AHEAD = 2
"""Chunks under way for each worker: one that is driven, one that waits."""
CONNECT_TIMEOUT = "20s"
DEATHS_MAX = 10
"""Times that the cluster may give up a chunk because the workers that drove it died, each time after several deaths of its own
counting: more, and it is the chunk that kills them."""

Work = Callable[[int], Any]


class Engine(Protocol):
    """Runs work over numbers."""

    def run(self, work: Work, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        """(number, work(number)) for all numbers, in any order."""


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads:
    """Threads of this process: the C runs without the interpreter's lock."""

    def __init__(self, workers: int | None = None) -> None:
        self.workers = cores() if workers is None else workers

    def run(self, work: Work, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        """See `Engine`. What the work raises is raised here."""
        waiting = iter(numbers)
        with ThreadPoolExecutor(self.workers) as pool:
            under_way: dict[Any, int] = {}
            try:
                while True:
                    while len(under_way) < AHEAD * self.workers and (number := next(waiting, None)) is not None:
                        under_way[pool.submit(work, number)] = number
                    if not under_way:
                        return
                    done, _ = wait(under_way, return_when=FIRST_COMPLETED)
                    for future in done:
                        yield under_way.pop(future), future.result()
            finally:
                # An error, Ctrl-C, or a caller that has enough: what has not begun does not begin.
                for future in under_way:
                    future.cancel()


class Dask:
    """The workers of a running Dask scheduler; they need this package, its `sweep` extra and a C compiler.

    Raises:
        CodegenError: `distributed` is missing, or nobody answers at the address.
    """

    def __init__(self, address: str) -> None:
        if not ADDRESS.match(address):
            raise CodegenError(
                f"{address!r} is no address",
                where="--scheduler",
                remedy="give it as tcp://HOST:PORT, as `dask scheduler` tells it",
            )
        try:
            import distributed
        except ImportError:
            raise CodegenError(
                "distributed is missing", where="--scheduler", remedy='pip install "ars-codegen[sweep]"'
            ) from None
        library: Any = distributed  # it has types, but not for all
        self._as_completed, self._killed = library.as_completed, library.scheduler.KilledWorker
        try:
            self._client = library.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise CodegenError(
                f"no Dask scheduler answers ({error})",
                where=address,
                remedy="start one with `dask scheduler`, check the address",
            ) from None

    def run(self, work: Work, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        """See `Engine`. A worker that dies loses nothing: what it had goes to another.

        Raises:
            CheckFailed: the cluster gave up, or went away.
        """
        client = self._client
        # Builds and plan go once to each worker; as a task, not as data: where all that have it die, it is sent again.
        sent = client.submit(_itself, work, key=f"work-{id(self)}-{id(work)}", pure=False)
        waiting = iter(numbers)
        under_way: dict[Any, int] = {}
        deaths: dict[int, int] = {}
        ended = self._as_completed(loop=client.loop)

        def submit(number: int | None) -> bool:
            if number is None:
                return False
            key = f"chunk-{id(self)}-{number}-{deaths.get(number, 0)}"
            future = client.submit(_call, sent, number, key=key, pure=False)
            under_way[future] = number
            ended.add(future)
            return True

        window = AHEAD * max(sum(client.nthreads().values()), 1)
        while len(under_way) < window and submit(next(waiting, None)):
            pass
        try:
            while under_way:
                future = next(ended)
                number = under_way.pop(future)
                if self._lost(future) and deaths.get(number, 0) < DEATHS_MAX:
                    deaths[number] = deaths.get(number, 0) + 1
                    submit(number)
                    continue
                yield number, _result(future, number)
                submit(next(waiting, None))
        finally:
            for future in under_way:
                future.cancel()

    def _lost(self, future: Any) -> bool:
        """Whether a chunk has no result because the workers that drove it died."""
        return future.status == "error" and isinstance(future.exception(), self._killed)

    def close(self) -> None:
        """Leave the cluster, which goes on."""
        self._client.close()


def _itself(work: Work) -> Work:
    return work


def _call(work: Work, number: int) -> Any:
    return work(number)


def _result(future: Any, number: int) -> Any:
    try:
        return future.result()
    except CodegenError:
        raise
    except Exception as error:
        raise CheckFailed(
            f"the cluster did not finish chunk {number} ({type(error).__name__}: {error})",
            where="--scheduler",
            remedy="see the workers' logs; the same command goes on from here",
        ) from error
