"""Addresses without a scheduler; tests/evidence/drives starts a cluster."""

from __future__ import annotations

import contextlib
import socket
import threading

import pytest

from codegen.errors import CodegenError
from codegen.sweep.engine import Dask


@pytest.mark.parametrize("greeting", [None, b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_nobody_or_another_program_at_the_address(greeting: bytes | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cases: no listener; one that waits for a request, as Dask's client does too; one whose first bytes resemble a
    size."""
    monkeypatch.setattr("codegen.sweep.engine.CONNECT_TIMEOUT", 0.3)
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
