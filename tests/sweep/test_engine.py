"""Addresses without a scheduler, and proofs of workers; tests/evidence/drives starts a cluster."""

from __future__ import annotations

import contextlib
import socket
import threading
from types import SimpleNamespace

import pytest

from codegen.errors import BuildError, CodegenError
from codegen.sweep import engine, versions
from codegen.sweep.engine import Answer, Dask


@pytest.mark.parametrize("greeting", [None, b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_nobody_or_another_program_at_the_address(greeting: bytes | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cases: no listener; one that waits for a request, as Dask's client does too; one whose first bytes resemble a
    size."""
    monkeypatch.setattr(engine, "CONNECT_TIMEOUT", 0.3)
    connections: list[socket.socket] = []

    def listen() -> None:
        with contextlib.suppress(OSError):  # closed
            while True:
                connections.append(listener.accept()[0])
                connections[-1].sendall(greeting or b"")

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=listen, daemon=True).start()
        port, cause = listener.getsockname()[1], r"\(another program responds\)"
        if greeting is None:
            port, cause = 9, ""
        with pytest.raises(CodegenError, match=f"no Dask scheduler answers {cause}"):
            Dask(f"tcp://127.0.0.1:{port}")
    for connection in connections:
        connection.close()
    with pytest.raises(CodegenError, match="is not a valid address"):
        Dask("tcp://127.0.0.1:99999")


OWN = {"codegen": "1.0", "sources": "a" * 64}


def test_a_worker_works_only_with_the_identity_of_the_campaign(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("distributed.get_worker", lambda: SimpleNamespace(address="tcp://worker:1"))
    monkeypatch.setattr(engine, "identity", lambda: OWN)
    assert engine._call(str, 7, OWN) == Answer("tcp://worker:1", OWN, "7")
    assert engine._call(str, 7, {**OWN, "sources": "b" * 64}) == Answer("tcp://worker:1", OWN, None)


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (Answer("tcp://w:1", {**OWN, "sources": "b" * 64}, 1), rf"^Dask worker tcp://w:1: it has sources {'b' * 40}, and the "),
        (Answer("tcp://w:1", {"codegen": "1.0"}, 1), "it has sources missing, and the campaign aaaa"),
        (Answer("tcp://w:1", {**OWN, "C library": "musl"}, 1), "it has C library musl, and the campaign none; install"),
        ({"run": [1.0]}, "^`scheduler=`: a worker does not prove its sources; install"),
    ],
)
def test_a_result_without_proof_is_refused(answer: object, message: str) -> None:
    with pytest.raises(BuildError, match=message):
        engine._proven(answer, OWN)
    assert engine._proven(Answer("tcp://w:1", OWN, 1), OWN) == 1


def test_the_identity_covers_every_source_and_notices_sources_that_changed_since_the_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sources = dict(versions._sources())
    assert {"codegen/sweep/chunk.py", "hil_sim/scenarios.py", "templates/_macros.j2"} < sources.keys()
    assert any(name.endswith(".toml") for name in sources)
    before = versions.identity()
    assert before["sources"] == versions.sources_digest()
    for name in ("codegen/units.py", "templates/_macros.j2"):
        monkeypatch.setattr(versions, "_sources", lambda name=name: iter({**sources, name: b"edited"}.items()))
        assert versions.sources_digest() != before["sources"]
        assert versions.identity() == {**before, "sources": "changed since it started"}
