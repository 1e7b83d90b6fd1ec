"""The server over plain HTTP: for one user on this computer, and nothing but the page."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest

from codegen.explore.controls import ExploreError
from codegen.explore.explorer import Explorer
from codegen.explore.server import BODY_MAX, ExploreServer, Newest
from codegen.explore.toml_file import Target

from .conftest import Answer, Client

GOOD = {"page": 1, "number": 1, "values": {}}


def test_it_listens_on_the_loopback_address_alone(client: Client) -> None:
    assert client.server.socket.getsockname()[0] == "127.0.0.1"


def test_the_page_needs_the_key_of_its_address(client: Client) -> None:
    path = client.server.address.removeprefix(f"http://127.0.0.1:{client.server.server_port}")
    page = client.ask("GET", path)
    assert page.status == 200
    assert page.headers["Content-Type"].startswith("text/html")
    assert client.server.key.encode() in page.body
    for wrong in ("/", "/?key=", "/?key=guess", "/?other=1"):
        refused = client.ask("GET", wrong)
        assert refused.status == 403
        assert client.server.key.encode() not in refused.body


def test_two_servers_have_two_keys(pi: Explorer, tmp_path: Path) -> None:
    with ExploreServer(pi, Target(tmp_path / "ars.toml")) as first, ExploreServer(pi, Target(tmp_path / "ars.toml")) as second:
        assert first.key != second.key
        assert len(first.key) >= 32


@pytest.mark.parametrize("path", ["/style.css", "/explore.css", "/plots.js", "/explore.js", "/plotly.js"])
def test_the_parts_of_the_page_are_there_and_name_no_other_place(client: Client, path: str) -> None:
    found = client.ask("GET", path)
    assert found.status == 200
    assert found.headers["X-Content-Type-Options"] == "nosniff"
    assert "default-src 'none'" in found.headers["Content-Security-Policy"]
    if path != "/plotly.js":
        assert b"http://" not in found.body
        assert b"https://" not in found.body


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "127.0.0.1", "127.0.0.1:1", "localhost", "", None])
def test_another_host_name_is_refused(client: Client, host: str | None) -> None:
    """A name of somebody else's may be made to point to 127.0.0.1 (DNS rebinding)."""
    named = host if host is None else host.format(port=client.server.server_port)
    page = client.ask("GET", f"/?key={client.server.key}", Host=named)
    assert page.status == 421
    assert client.server.key.encode() not in page.body
    assert client.post("/api/picture", GOOD, Host=named).status == 421


@pytest.mark.parametrize(("method", "status"), [("PUT", 501), ("OPTIONS", 501), ("HEAD", 501), ("GET two", 400)])
def test_what_the_library_refuses_has_the_headers_of_every_answer(client: Client, method: str, status: int) -> None:
    lines = (f"{method} /<script> HTTP/1.1", f"Host: 127.0.0.1:{client.server.server_port}", "", "")
    with socket.create_connection(("127.0.0.1", client.server.server_port), timeout=60) as connection:
        connection.sendall("\r\n".join(lines).encode())
        whole = b"".join(iter(lambda: connection.recv(65536), b"")).decode()
    head, _, body = whole.partition("\r\n\r\n")
    assert head.startswith(f"HTTP/1.1 {status} ")
    for name in ("Content-Security-Policy: default-src 'none'", "X-Content-Type-Options: nosniff", "Cache-Control: no-store"):
        assert name in head
    assert "<script>" not in whole
    assert (body == "") == (method == "HEAD")


@pytest.mark.parametrize("path", ["http://[", "//[", "http://[::1"])
def test_what_is_no_address_is_refused(client: Client, path: str) -> None:
    answer = client.ask("GET", path)
    assert answer.status in (400, 404)  # newer releases of Python take a leading // for /
    if path.startswith("http"):
        assert (answer.status, answer.body) == (400, b"this is no address\n")


def test_localhost_is_this_host_too(client: Client) -> None:
    assert client.post("/api/picture", GOOD, Host=f"localhost:{client.server.server_port}").status == 200


@pytest.mark.parametrize("path", ["/api/picture", "/api/family", "/api/write"])
def test_a_question_needs_the_key_and_its_own_origin(client: Client, tmp_path: Path, path: str) -> None:
    assert client.post(path, GOOD, X_Explore_Key=None).status == 403
    assert client.post(path, GOOD, X_Explore_Key="guess").status == 403
    assert client.post(path, GOOD, Origin="http://evil.example").status == 403
    assert client.post(path, GOOD, Origin="null").status == 403
    assert list(tmp_path.iterdir()) == []
    assert client.post(path, GOOD, Origin=f"http://127.0.0.1:{client.server.server_port}").status == 200


@pytest.mark.parametrize(
    "path",
    [
        "/../pyproject.toml",
        "/..%2f..%2fetc/passwd",
        "//etc/passwd",
        "/etc/passwd",
        "/ars.toml",
        "/plots.js/../explore.js",
        "/%2e%2e/ars.toml",
        "/explore.js%00",
        "/page.html.j2",
        "/favicon.ico",
        "/api/picture",
    ],
)
def test_no_path_leads_to_a_file(client: Client, tmp_path: Path, path: str) -> None:
    (tmp_path / "ars.toml").write_text("secret", encoding="utf-8")
    answer = client.ask("GET", path)
    assert answer.status == 404
    assert answer.body == b"there is no such page\n"


def refused(answer: Answer, status: int, text: str) -> None:
    assert answer.status == status
    error = answer.data["error"]
    assert text in error
    assert "\n" not in error
    assert "Traceback" not in error


@pytest.mark.parametrize("body", [b"", b"{", b"[1]", b'"x"', b"\xff", b"[" * 30000, b"null"])
def test_what_is_no_json_object_is_refused(client: Client, body: bytes) -> None:
    answer = client.ask("POST", "/api/picture", body, Content_Type="application/json", X_Explore_Key=client.server.key)
    refused(answer, 400, "JSON")


def test_a_body_of_no_length_or_too_much_is_refused_unread(client: Client) -> None:
    keyed = {"Content_Type": "application/json", "X_Explore_Key": client.server.key}
    # A superscript is a digit for Python, and no number; of a number, Python takes 4300 digits at most.
    for length in (None, "-1", "many", str(BODY_MAX + 1), "²", "9" * 5000):
        refused(client.ask("POST", "/api/picture", None, **keyed, Content_Length=length), 413, str(BODY_MAX))
    refused(client.post("/api/picture", GOOD, Content_Type="text/plain"), 415, "application/json")


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (None, "no table"),
        ([], "no table"),
        ({"limits.sideslip_max_deg": "3"}, "Sideslip limit: a number is needed; give 0.2 to 20 deg"),
        ({"limits.sideslip_max_deg": 1e300}, "is outside 0.2 to 20 deg"),
        ({"road.friction": 0.0}, "Friction of the road: 0 is outside"),
        ({"<script>": 1}, "there is no setting"),
        ({"limits.sideslip_max_deg": None}, "a number is needed"),
        ({"limits.sideslip_max_deg": 10**400}, "a number is needed"),
    ],
)
def test_values_that_are_none_are_one_line(client: Client, tmp_path: Path, values: object, text: str) -> None:
    for path in ("/api/picture", "/api/family", "/api/write"):
        refused(client.post(path, {"page": 1, "number": 1, "values": values}), 422, text)
    assert list(tmp_path.iterdir()) == []


def test_nan_in_json_is_no_number(client: Client) -> None:
    body = b'{"page": 1, "number": 1, "values": {"lambda": NaN}}'
    answer = client.ask("POST", "/api/picture", body, Content_Type="application/json", X_Explore_Key=client.server.key)
    refused(answer, 422, "Sideslip weight λ: a number is needed")


def test_a_picture_comes_as_strict_json(client: Client) -> None:
    answer = client.post("/api/picture", GOOD)
    assert answer.status == 200

    def refuse(name: str) -> None:
        raise AssertionError(name)

    data = json.loads(answer.body, parse_constant=refuse)
    assert set(data) == {"map", "cut", "step", "margins", "took_ms"}


def test_an_older_request_of_the_same_page_is_answered_as_stale(client: Client) -> None:
    client.server.newest.came(7, 5)
    assert client.post("/api/picture", {"page": 7, "number": 4, "values": {}}).data == {"stale": True}
    assert "map" in client.post("/api/picture", {"page": 7, "number": 5, "values": {}}).data
    assert "map" in client.post("/api/picture", {"page": 8, "number": 1, "values": {}}).data
    refused(client.post("/api/picture", {"page": "7", "number": 5, "values": {}}), 400, "whole numbers")


def test_the_newest_requests_of_many_pages_take_no_memory() -> None:
    newest = Newest()
    for page in range(1000):
        newest.came(page, 3)
    assert len(newest.numbers) <= 64
    assert newest.is_stale(999, 2)
    assert not newest.is_stale(999, 3)
    assert not newest.is_stale(0, 1)


def test_a_port_that_is_taken_is_one_line(pi: Explorer, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(ExploreError, match=r"--port: port \d+ is in use; name another one"):
            ExploreServer(pi, Target(tmp_path / "ars.toml"), taken.getsockname()[1])


def test_an_error_of_ours_is_told_as_one_and_the_server_goes_on(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("secret detail")

    with monkeypatch.context() as patch:
        patch.setattr(type(client.server.explorer), "picture", broken)
        answer = client.post("/api/picture", GOOD)
    refused(answer, 500, "internal error: RuntimeError")
    assert b"secret" not in answer.body
    assert client.post("/api/picture", GOOD).status == 200
