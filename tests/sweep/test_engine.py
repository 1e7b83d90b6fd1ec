"""The Dask engine with a fake client: what it submits to a cluster, and when; addresses without a scheduler."""

import contextlib
import socket
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import pytest

from codegen.errors import CodegenError
from codegen.sweep.engine import AHEAD, Dask


class Future:
    """A future whose work is done when its result is requested."""

    status = "finished"

    def __init__(self, work: Callable[[], Any]) -> None:
        self.result = work

    def cancel(self) -> None:
        pass


class Client:
    """The part of Dask's client that the engine uses."""

    status, loop, threads = "running", None, 1

    def __init__(self) -> None:
        self.keys: list[str] = []

    @property
    def chunks(self) -> int:
        return sum(key.startswith("chunk-") for key in self.keys)

    def nthreads(self) -> dict[str, int]:
        return {"tcp://worker:1": self.threads}

    def submit(self, function: Callable[..., Any], *arguments: Any, key: str, pure: bool) -> Future:
        assert not pure
        self.keys.append(key)
        return Future(lambda: function(*(one.result() if isinstance(one, Future) else one for one in arguments)))


class Completed(deque[Future]):
    """Futures in the order of submission."""

    add = deque.append
    __next__ = deque.popleft


def engine_of(client: Client) -> Dask:
    engine = Dask.__new__(Dask)
    engine.address = "tcp://scheduler:1"
    engine._client, engine._killed = client, KeyError  # in place of distributed's exception
    engine._as_completed = lambda loop: Completed()
    return engine


def double(number: int) -> int:
    return 2 * number


def test_the_number_of_chunks_ahead_follows_the_workers_and_no_two_runs_share_a_key() -> None:
    client = Client()
    engine = engine_of(client)
    results = engine.run(double, range(100))
    seen = [next(results)]
    assert client.chunks == AHEAD
    client.threads = 5
    seen.append(next(results))
    assert client.chunks == 1 + 5 * AHEAD
    client.threads = 1
    seen.extend(next(results) for _ in range(5 * AHEAD - AHEAD))
    assert client.chunks == 1 + 5 * AHEAD
    assert [*seen, *results] == [(number, 2 * number) for number in range(100)]
    assert client.chunks == 100
    assert list(engine.run(double, range(3))) == [(0, 0), (1, 2), (2, 4)]
    assert len(set(client.keys)) == len(client.keys) == (1 + 100) + (1 + 3)


def test_a_cluster_that_is_lost_is_reported_while_work_is_left() -> None:
    client = Client()
    results = engine_of(client).run(double, range(AHEAD + 1))
    next(results)
    client.status = "closed"
    with pytest.raises(CodegenError, match="tcp://scheduler:1: the Dask scheduler went away"):
        next(results)
    client = Client()
    results = engine_of(client).run(double, [7])
    assert next(results) == (7, 14)
    client.status = "closed"
    assert list(results) == []


@pytest.mark.parametrize("greeting", [None, b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_nobody_or_another_program_at_the_address(greeting: bytes | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody; one that waits for a request, as Dask's client does too; one whose first bytes look like a size."""
    monkeypatch.setattr("codegen.sweep.engine.CONNECT_TIMEOUT", 0.3)
    connections: list[socket.socket] = []

    def listen() -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                connections.append(listener.accept()[0])
                connections[-1].sendall(greeting or b"")

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=listen, daemon=True).start()
        port, cause = listener.getsockname()[1], r"\(what answers is another program\)"
        if greeting is None:
            port, cause = 9, ""
        with pytest.raises(CodegenError, match=f"no Dask scheduler answers {cause}"):
            Dask(f"tcp://127.0.0.1:{port}")
    for connection in connections:
        connection.close()
    with pytest.raises(CodegenError, match="is no address"):
        Dask("tcp://127.0.0.1:99999")
