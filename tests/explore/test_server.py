"""The server over plain HTTP: it serves one user on this computer, and only the page."""

import json
import re
import socket
from pathlib import Path
from unittest.mock import Mock

import pytest

from codegen.explore.controls import ExploreError
from codegen.explore.explorer import Explorer
from codegen.explore.server import BODY_MAX, ExploreServer
from codegen.explore.toml_file import Target
from codegen.figures.data import CONTROLLER_COLOURS, INK

from .conftest import Answer, Client

GOOD = {"page": 1, "number": 1, "values": {}}
ENDPOINTS = ("/api/picture", "/api/family", "/api/write")
# Headers of every response, with the start of their values.
HEADERS = {"Content-Security-Policy": "default-src 'none'", "X-Content-Type-Options": "nosniff", "Cache-Control": "no-store"}


def check_refused(answer: Answer, status: int, text: str) -> None:
    assert answer.status == status
    error = answer.data["error"]
    assert text in error
    assert "\n" not in error and "Traceback" not in error


def test_the_page_needs_the_key_of_its_address(client: Client, tmp_path: Path) -> None:
    assert client.server.socket.getsockname()[0] == "127.0.0.1"
    page = client.ask("GET", client.server.address.removeprefix(f"http://{client.host}"))
    assert page.status == 200
    assert page.headers["Content-Type"].startswith("text/html")
    key = client.server.key
    assert key.encode() in page.body and len(key) >= 32
    for wrong in ("/", "/?key=", "/?key=guess", "/?other=1"):
        answer = client.ask("GET", wrong)
        assert (answer.status, key.encode() in answer.body) == (403, False)
    with ExploreServer(client.server.explorer, Target(tmp_path / "ars.toml")) as other:
        assert other.key != key


def test_the_parts_of_the_page_load_nothing_else(client: Client) -> None:
    for path in ("/style.css", "/explore.css", "/plots.js", "/explore.js", "/plotly.js"):
        found = client.ask("GET", path)
        assert found.status == 200
        assert all(found.headers[name].startswith(value) for name, value in HEADERS.items())
        assert path == "/plotly.js" or not re.search(rb"https?://", found.body)


def test_lines_have_the_colours_of_the_report(client: Client) -> None:
    """The page names the kind of its controller, and the style sheet has its colour; black follows the theme."""
    page = client.ask("GET", client.server.address.removeprefix(f"http://{client.host}")).body.decode()
    kind = client.server.explorer.start.controller.kind
    assert f'<html lang="en" data-kind="{kind}">' in page
    style = client.ask("GET", "/explore.css").body.decode()
    assert set(re.findall(r'data-kind="(.*?)"\] \{ --now: (#\w+);', style)) == {
        (name, colour) for name, colour in CONTROLLER_COLOURS.items() if name != "passive"
    }
    assert re.findall(r"--passive: ([^;]*);", style) == ["var(--ink)"] and CONTROLLER_COLOURS["passive"] == INK


@pytest.mark.parametrize("host", ["evil.example:{port}", "127.0.0.1:1", "localhost", "", None])
def test_another_host_name_is_refused(client: Client, host: str | None) -> None:
    """DNS rebinding can make a foreign name resolve to 127.0.0.1."""
    named = host if host is None else host.format(port=client.server.server_port)
    page = client.ask("GET", f"/?key={client.server.key}", Host=named)
    assert page.status == 421
    assert client.server.key.encode() not in page.body
    assert client.post("/api/picture", GOOD, Host=named).status == 421


@pytest.mark.parametrize(("method", "status"), [("PUT", 501), ("OPTIONS", 501), ("HEAD", 501), ("GET two", 400)])
def test_errors_of_the_library_have_the_headers_of_every_answer(client: Client, method: str, status: int) -> None:
    with socket.create_connection(("127.0.0.1", client.server.server_port), timeout=60) as connection:
        connection.sendall(f"{method} /<script> HTTP/1.1\r\nHost: {client.host}\r\n\r\n".encode())
        whole = b"".join(iter(lambda: connection.recv(65536), b"")).decode()
    head, _, body = whole.partition("\r\n\r\n")
    assert head.startswith(f"HTTP/1.1 {status} ")
    assert all(f"{name}: {value}" in head for name, value in HEADERS.items())
    assert "<script>" not in whole
    assert (body == "") == (method == "HEAD")


def test_a_request_needs_the_key_and_its_own_origin(client: Client, tmp_path: Path) -> None:
    wrong: list[dict[str, str | None]] = [{"X_Explore_Key": None}, {"X_Explore_Key": "guess"}]
    wrong += [{"Origin": "http://evil.example"}, {"Origin": "null"}]
    for path in ENDPOINTS:
        for headers in wrong:
            assert client.post(path, GOOD, **headers).status == 403
        assert list(tmp_path.iterdir()) == []
    for path in ENDPOINTS:
        assert client.post(path, GOOD, Origin=f"http://{client.host}").status == 200
    assert client.post("/api/picture", GOOD, Host=f"localhost:{client.server.server_port}").status == 200


def test_no_path_leads_to_a_file(client: Client, tmp_path: Path) -> None:
    (tmp_path / "ars.toml").write_text("secret", encoding="utf-8")
    paths = ["/../pyproject.toml", "/..%2f..%2fetc/passwd", "//etc/passwd", "/etc/passwd", "/ars.toml", "/favicon.ico"]
    paths += ["/plots.js/../explore.js", "/%2e%2e/ars.toml", "/explore.js%00", "/page.html.j2", "/api/picture"]
    for path in paths:
        answer = client.ask("GET", path)
        assert (answer.status, answer.body) == (404, b"there is no such page\n"), path
    answer = client.ask("GET", "http://[::1")
    assert (answer.status, answer.body) == (400, b"not a valid address\n")


def test_a_body_that_is_not_a_json_object_is_rejected(client: Client) -> None:
    for body in (b"", b"{", b"[1]", b'"x"', b"\xff", b"[" * 30000, b"null"):
        check_refused(client.post("/api/picture", body), 400, "JSON")
    check_refused(client.post("/api/picture", GOOD, Content_Type="text/plain"), 415, "application/json")
    # Python counts a superscript as a digit but not as a number, and converts at most 4300 digits.
    keyed = {"Content_Type": "application/json", "X_Explore_Key": client.server.key}
    for length in (None, "-1", "many", str(BODY_MAX + 1), "²", "9" * 5000):
        answer = client.ask("POST", "/api/picture", None, **keyed, Content_Length=length)
        check_refused(answer, 413, str(BODY_MAX))  # unread: no body was sent


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ("null", "must be a table"),
        *((f'{{"limits.sideslip_max_deg": {value}}}', "0.2 to 20 deg") for value in ('"3"', "null", "true", 21.0, -1.0)),
        ('{"<script>": 1}', "there is no setting"),
        (f'{{"limits.sideslip_max_deg": {10**400}}}', "a number is needed"),
        ('{"lambda": NaN}', "Sideslip weight λ: a number is needed"),
    ],
)
def test_bad_values_give_one_line(client: Client, tmp_path: Path, values: str, text: str) -> None:
    for path in ENDPOINTS:
        check_refused(client.post(path, f'{{"page": 1, "number": 1, "values": {values}}}'.encode()), 422, text)
    assert list(tmp_path.iterdir()) == []


def test_a_picture_is_strict_json_and_only_for_the_newest_request(client: Client) -> None:
    data = json.loads(client.post("/api/picture", GOOD).body, parse_constant=pytest.fail)
    assert set(data) == {"map", "cut", "step", "margins", "judgement", "warnings", "took_ms"}
    client.server.newest.came(7, 5)
    for page, number, key in ((7, 4, "stale"), (7, 5, "map"), (8, 1, "map")):
        assert key in client.post("/api/picture", {"page": page, "number": number, "values": {}}).data
    check_refused(client.post("/api/picture", {"page": "7", "number": 5, "values": {}}), 400, "whole numbers")
    for page in range(1000):
        client.server.newest.came(page, 3)
    assert len(client.server.newest.numbers) <= 64  # many pages need no memory


def test_a_port_in_use_gives_one_line(pi: Explorer, client: Client, tmp_path: Path) -> None:
    with pytest.raises(ExploreError, match=r"--port: port \d+ is in use; choose another one"):
        ExploreServer(pi, Target(tmp_path / "ars.toml"), client.server.server_port)


def test_an_internal_error_is_reported_without_details_and_the_server_continues(
    client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(type(client.server.explorer), "picture", Mock(side_effect=RuntimeError("secret detail")))
        answer = client.post("/api/picture", GOOD)
    check_refused(answer, 500, "internal error: RuntimeError")
    assert b"secret" not in answer.body
    assert client.post("/api/picture", GOOD).status == 200
