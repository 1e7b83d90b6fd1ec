"""Engines that run the chunks: local threads, or the workers of a Dask cluster. The results are equal.

An engine yields (chunk number, result) as chunks end, in any order. The number of chunks in progress is limited, so that memory
does not grow with the campaign.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from codegen.errors import BuildError, CheckFailed, CodegenError
from codegen.requirements import missing
from codegen.sweep import store
from codegen.sweep.chunk import Work, software
from codegen.sweep.plan import Plan
from codegen.sweep.versions import identity

ADDRESS, PORT_MAX = re.compile(r"[a-z]+://[^\s/]+:(?P<port>\d{1,9})\Z"), 65_535
AHEAD = 2
"""Chunks submitted for each worker: one running, one waiting."""
CONNECT_TIMEOUT = 20.0
"""Timeout of a connection, in s."""
DEATHS_MAX = 10
"""Largest number of times that the cluster may give up a chunk because its workers died, each time after several deaths.
A chunk that exceeds it is considered the cause of the deaths."""
CLOSINGS_MAX = 10
"""Attempts to close a client, each of which waits for up to 0.1 s."""

Call = Callable[[int], Any]


class Engine(Protocol):
    """Runs a function for each number."""

    def run(self, work: Call, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        """Yield (number, work(number)) for all numbers, in any order."""


def cores() -> int:
    """Return the number of cores available to this process."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Threads:
    """Threads of this process; the C releases the interpreter lock."""

    def __init__(self, workers: int | None = None) -> None:
        self.workers = cores() if workers is None else workers

    def run(self, work: Call, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        """See `Engine`. Exceptions of the work are raised here."""
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
                # After an error, Ctrl-C or an early exit of the caller, cancel chunks that have not started.
                for future in under_way:
                    future.cancel()


class Dask:
    """The workers of a running Dask scheduler; they need this package, its `sweep` extra and a C compiler.

    Raises:
        CodegenError: `distributed` is missing, or nothing responds at the address.
    """

    def __init__(self, address: str) -> None:
        found = ADDRESS.match(address)
        if found is None or int(found["port"]) > PORT_MAX:
            raise CodegenError(
                f"{address!r} is not a valid address",
                where="`scheduler=`",
                remedy="give it as tcp://HOST:PORT, as `dask scheduler` prints it",
            )
        try:
            import distributed
        except ImportError:
            raise missing("distributed", "reaches the cluster", "`scheduler=`") from None
        library: Any = distributed  # it has types, but not for all
        self.address = address
        self._as_completed, self._killed = library.as_completed, library.scheduler.KilledWorker
        try:
            _knock(address)
            self._client = library.Client(address, timeout=CONNECT_TIMEOUT, set_as_default=False)
        # MemoryError: the first bytes of a response are read as its length, even if another protocol sent them.
        except (OSError, TimeoutError, ValueError, OverflowError, MemoryError) as error:
            cause = error if isinstance(error, OSError) and str(error) else "another program responds"
            raise CodegenError(
                f"no Dask scheduler answers ({cause})",
                where=address,
                remedy="start one with `dask scheduler`, check the address",
            ) from None

    def run(self, work: Call, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        """See `Engine`. If a worker dies, its chunks go to other workers.

        Raises:
            CodegenError: the scheduler went away.
            CheckFailed: the cluster gave up.
            BuildError: a worker cannot compile, lacks the instructions, or does not prove the same versions, sources and tools.
        """
        try:
            yield from self._run(work, numbers)
        except (OSError, CancelledError) as error:
            raise self._gone() from error
        except RuntimeError as error:
            # Message of the client for any call after it has given up the scheduler.
            if self._client.status in ("running", "newly-created"):
                raise
            raise self._gone() from error

    def _run(self, work: Call, numbers: Iterable[int]) -> Iterator[tuple[int, Any]]:
        client = self._client
        # Builds and plan are sent once to each worker, as a task and not as data: if all workers that have it die, it is sent
        # again. The scheduler also serves other clients, so the keys must differ from those of all clients and earlier runs.
        run = uuid.uuid4().hex
        sent = client.submit(_itself, work, key=f"work-{run}", pure=False)
        waiting = iter(numbers)
        coming = next(waiting, None)
        under_way: dict[Any, int] = {}
        deaths: dict[int, int] = {}
        ended = self._as_completed(loop=client.loop)
        own = identity()

        def submit(number: int) -> None:
            key = f"chunk-{run}-{number}-{deaths.get(number, 0)}"
            future = client.submit(_call, sent, number, own, key=key, pure=False)
            under_way[future] = number
            ended.add(future)

        def refill() -> None:
            nonlocal coming
            if coming is None:
                return
            if client.status != "running":  # a query would now try to connect for a long time
                raise self._gone()
            # Queried each time, because workers come and go.
            window = AHEAD * max(sum(client.nthreads().values()), 1)
            while coming is not None and len(under_way) < window:
                submit(coming)
                coming = next(waiting, None)

        try:
            refill()
            while under_way:
                future = next(ended)
                number = under_way.pop(future)
                if self._lost(future) and deaths.get(number, 0) < DEATHS_MAX:
                    deaths[number] = deaths.get(number, 0) + 1
                    submit(number)
                    continue
                yield number, _proven(_result(future, number), own)
                refill()
        finally:
            with contextlib.suppress(Exception):  # the scheduler may be gone
                for future in under_way:
                    future.cancel()

    def _lost(self, future: Any) -> bool:
        """Whether a chunk has no result because its workers died."""
        return future.status == "error" and isinstance(future.exception(), self._killed)

    def _gone(self) -> CodegenError:
        return CodegenError(
            "the Dask scheduler went away; what was finished is kept",
            where=self.address,
            remedy="run the same command again when it is back, to resume",
        )

    def close(self) -> None:
        """Disconnect from the cluster, which keeps running."""
        for _ in range(CLOSINGS_MAX):
            # A client whose scheduler is gone also closes itself. If both close a connection at the same time, asyncio
            # rejects the second attempt ("Cannot change state of expiring Timeout"), hence the retry.
            with contextlib.suppress(RuntimeError):
                self._client.close()
                break


def _knock(address: str) -> None:
    """Check that the listener speaks Dask's protocol. `Client` would wait without end for one that does not.

    Raises:
        OSError: nothing listens. TimeoutError, MemoryError, ValueError, OverflowError: another program, or an invalid port.
    """
    from distributed.comm.core import connect

    async def knock() -> None:
        connection = await connect(address, timeout=CONNECT_TIMEOUT)  # type: ignore[no-untyped-call]
        await connection.close()

    # In a separate thread, because the caller may already run an event loop.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(asyncio.run, asyncio.wait_for(knock(), 1.5 * CONNECT_TIMEOUT)).result()


def _itself(work: Call) -> Call:
    return work


@dataclass(frozen=True)
class Answer:
    """Answer of a worker for a chunk.

    Attributes:
        worker: its address.
        identity: its own `identity`, computed for this chunk, so that workers that join later prove theirs too.
        result: of the work; None if the identity is not the one of the campaign.
    """

    worker: str
    identity: Mapping[str, str]
    result: Any


def _call(work: Call, number: int, wanted: Mapping[str, str]) -> Answer:
    from distributed import get_worker

    address = get_worker().address
    try:
        own = identity()
        return Answer(address, own, work(number) if own == wanted else None)
    except BuildError as error:
        # One of many machines lacks the compiler or the instructions, so the message names the machine.
        where = f"Dask worker {address}{': ' if error.where else ''}{error.where}"
        raise BuildError(error.what, where=where, remedy=error.remedy) from None


def _proven(answer: object, wanted: Mapping[str, str]) -> Any:
    """Return the result of an answer. Raises BuildError if its worker does not prove the identity of the campaign."""
    if not isinstance(answer, Answer):  # `_call` of other sources
        raise BuildError("a worker does not prove its sources", where="`scheduler=`", remedy="install the same on all machines")
    if answer.identity == wanted:
        return answer.result
    # The longest names are digests, of which some digits suffice.
    differences = [
        f"{name} {str(answer.identity.get(name, 'missing'))[:40]}, and the campaign {wanted.get(name, 'none')[:40]}"
        for name in sorted(answer.identity.keys() | wanted)
        if answer.identity.get(name) != wanted.get(name)
    ]
    raise BuildError(
        f"it has {'; '.join(differences)}",
        where=f"Dask worker {answer.worker}",
        remedy="install the same on all machines, and start the worker again",
    )


def _result(future: Any, number: int) -> Any:
    try:
        return future.result()
    except (CodegenError, CancelledError):
        raise
    except Exception as error:
        raise CheckFailed(
            f"the cluster did not finish chunk {number} ({type(error).__name__}: {error})",
            where="`scheduler=`",
            remedy="see the workers' logs; run the same command to resume",
        ) from error


Progress = Callable[[int, int], None]


def run_campaign(plan: Plan, folder: Path, engine: Engine, progress: Progress | None = None) -> Path:
    """Simulate the runs that the folder does not contain yet and merge all runs into one file.

    Each chunk is complete on disk before it counts as done. After Ctrl-C, a kill or a loss of power, the same call resumes.

    Args:
        progress: called with (runs done, total runs).

    Returns:
        The path of the Parquet file, with one row for each run, by run number.

    Raises:
        CodegenError: see `store.open_folder`, `chunk.run_chunk` and the engine.
        KeyboardInterrupt: Ctrl-C; its text names the number of chunks kept.
    """
    store.require_pyarrow()
    for controller in plan.controllers:
        software(plan, controller)  # report compile errors before anything is written
    store.prepare(folder)
    with store.locked(folder):
        there = store.open_folder(folder, plan)
        try:
            return _drive(plan, folder, there, engine, progress)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(_what_is_kept(store.kept(folder, plan), plan.chunk_count)) from None


def _what_is_kept(kept: int, of: int) -> str:
    if kept == 0:
        return f"no chunk of {of} was finished; run the same command to start again"
    return f"{kept} of {of} chunks {'is' if kept == 1 else 'are'} kept; run the same command to resume"


def _drive(plan: Plan, folder: Path, there: set[int], engine: Engine, progress: Progress | None) -> Path:
    total, done = plan.spec.run_count, sum(len(plan.runs_of(chunk)) for chunk in there)
    if progress is not None and total:
        progress(done, total)
    missing = (chunk for chunk in range(plan.chunk_count) if chunk not in there)
    for chunk, table in engine.run(Work(plan), missing):
        store.save_part(folder, chunk, table, plan)
        done += len(plan.runs_of(chunk))
        if progress is not None:
            progress(done, total)
    return store.merge(folder, plan)
