"""The Dask engine with a client that is played: what it asks of a cluster, and when."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import pytest

from codegen.errors import CodegenError
from codegen.sweep.engine import AHEAD, Dask


class Future:
    """Of work that is done when its result is asked for."""

    status = "finished"

    def __init__(self, work: Callable[[], Any]) -> None:
        self.result = work

    def cancel(self) -> None:
        pass


class Client:
    """As much of Dask's client as the engine uses."""

    status = "running"
    loop = None

    def __init__(self) -> None:
        self.keys: list[str] = []
        self.threads = 1

    @property
    def chunks(self) -> int:
        """Chunks that were ever asked for."""
        return sum(key.startswith("chunk-") for key in self.keys)

    def nthreads(self) -> dict[str, int]:
        return {"tcp://worker:1": self.threads}

    def submit(self, function: Callable[..., Any], *arguments: Any, key: str, pure: bool) -> Future:
        assert not pure
        self.keys.append(key)
        return Future(lambda: function(*(one.result() if isinstance(one, Future) else one for one in arguments)))


class Completed:
    """In the order in which they were asked for."""

    def __init__(self, loop: None) -> None:
        self.waiting: deque[Future] = deque()

    def add(self, future: Future) -> None:
        self.waiting.append(future)

    def __next__(self) -> Future:
        return self.waiting.popleft()


class Killed(Exception):
    """In the place of distributed's."""


def played(client: Client) -> Dask:
    engine = Dask.__new__(Dask)
    engine.address = "tcp://scheduler:1"
    engine._client, engine._as_completed, engine._killed = client, Completed, Killed
    return engine


def double(number: int) -> int:
    return 2 * number


def test_no_two_runs_share_a_key() -> None:
    client = Client()
    engine = played(client)
    for _ in range(2):
        assert list(engine.run(double, range(3))) == [(0, 0), (1, 2), (2, 4)]
    assert len(set(client.keys)) == len(client.keys) == 2 * (1 + 3)


def test_workers_that_come_get_work_and_those_that_go_leave_none_waiting() -> None:
    client = Client()
    results = played(client).run(double, range(100))
    seen = [next(results)]
    assert client.chunks == AHEAD
    client.threads = 5
    seen.append(next(results))
    assert client.chunks == 1 + 5 * AHEAD
    client.threads = 1
    seen.extend(next(results) for _ in range(5 * AHEAD - AHEAD))
    assert client.chunks == 1 + 5 * AHEAD
    assert [number for number, _ in [*seen, *results]] == list(range(100))
    assert client.chunks == 100


def test_a_cluster_that_is_lost_with_work_left_is_told() -> None:
    client = Client()
    results = played(client).run(double, range(AHEAD + 1))
    next(results)
    client.status = "closed"
    with pytest.raises(CodegenError, match="tcp://scheduler:1: the Dask scheduler went away"):
        next(results)


def test_a_cluster_that_is_lost_after_its_last_chunk_is_not_missed() -> None:
    client = Client()
    results = played(client).run(double, [7])
    assert next(results) == (7, 14)
    client.status = "closed"
    assert list(results) == []
