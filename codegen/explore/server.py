"""Server of the page, for one user, on the loopback address only, and the page with its assets.

A request is rejected unless its Host header is the listening address, which also excludes other names of this host, and unless
it carries the key that the command printed. Only the page's own parts are served: no path is read as a file. The page loads
nothing from elsewhere.
"""

from __future__ import annotations

import errno
import json
import secrets
import socketserver
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, cast
from urllib.parse import SplitResult, parse_qs, urlsplit

from codegen.emit.laws import law_of
from codegen.emit.render import environment, templates_root
from codegen.errors import CodegenError
from codegen.explore.controls import GROUP_TITLES, ExploreError
from codegen.explore.explorer import Explorer
from codegen.explore.toml_file import Existing, Target
from codegen.figures.data import CONTROLLER_COLOURS, INK, scale_of
from codegen.figures.maps import MAP_QUANTITIES
from codegen.report.html.page import plotly_javascript

CONFIGURATION_FILE = "ars.toml"
CONTROL_FIELDS = ("key", "label", "unit", "low", "high", "step", "bounds", "value", "logarithmic")
"""Fields of a control that the script of the page needs."""

SECURITY_POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self' 'unsafe-inline'",  # Plotly writes style attributes and a style sheet of its own
        "img-src 'self' data: blob:",  # a heat map is an image of its own making
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)


@dataclass(frozen=True)
class Asset:
    """A file that the server delivers."""

    content: bytes
    kind: str


def controller_colours() -> str:
    """Return CSS with the colour of each kind of controller as --now, and of the passive car as --passive; black is --ink."""
    colours = {kind: "var(--ink)" if colour == INK else colour for kind, colour in CONTROLLER_COLOURS.items()}
    passive = colours.pop("passive")
    rules = [f':root[data-kind="{kind}"] {{ --now: {colour}; }}' for kind, colour in colours.items()]
    return "\n".join((f":root {{ --passive: {passive}; }}", *rules, ""))


def assets() -> dict[str, Asset]:
    """Return path -> asset, without the page itself. Raises CodegenError if Plotly is not installed."""
    root = templates_root()
    style, script = "text/css; charset=utf-8", "text/javascript; charset=utf-8"
    return {
        "/style.css": Asset((root / "report" / "style.css").read_bytes(), style),
        "/explore.css": Asset(controller_colours().encode("ascii") + (root / "explore" / "explore.css").read_bytes(), style),
        "/plots.js": Asset((root / "explore" / "plots.js").read_bytes(), script),
        "/explore.js": Asset((root / "explore" / "explore.js").read_bytes(), script),
        "/plotly.js": Asset(plotly_javascript().encode("utf-8"), script),
    }


def page(explorer: Explorer, key: str, page_number: int) -> Asset:
    """Render the page of an exploration.

    Args:
        key: access key that requests must carry.
        page_number: distinguishes the requests of this page from those of others.
    """
    groups = [
        {"key": group, "title": title, "controls": [each for each in explorer.controls if each.group == group]}
        for group, title in GROUP_TITLES.items()
    ]
    data = {
        "key": key,
        "page": page_number,
        "file": CONFIGURATION_FILE,
        "scales": {quantity.attribute: scale_of(quantity.colours) for quantity in MAP_QUANTITIES},
        "controls": [{name: getattr(control, name) for name in CONTROL_FIELDS} for control in explorer.controls],
    }
    context = {
        "name": explorer.name,
        "case": explorer.case,
        "kind": explorer.start.controller.kind,
        "title": law_of(explorer.start).title,
        "file": CONFIGURATION_FILE,
        "groups": [group for group in groups if group["controls"]],
        "adjustable": any(each.group == "controller" for each in explorer.controls),
        "notes": explorer.notes,
        "data": json.dumps(data, allow_nan=False).replace("<", "\\u003c"),  # it cannot end a script element
    }
    text = environment().get_template("explore/page.html.j2").render(page=context)
    return Asset(text.encode("utf-8"), "text/html; charset=utf-8")


HOST = "127.0.0.1"
BODY_MAX = 64 * 1024
"""Largest request body in bytes; settings need less than 2000."""
IDLE_S = 60.0
LENGTH_DIGITS_MAX = 7
PAGES_MAX = 64


@dataclass
class Newest:
    """Number of the newest request of each page. Older requests are outdated."""

    numbers: dict[int, int] = field(default_factory=dict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def came(self, page_number: int, number: int) -> None:
        """Record a request."""
        with self.lock:
            self.numbers[page_number] = max(number, self.numbers.pop(page_number, number))
            while len(self.numbers) > PAGES_MAX:
                del self.numbers[next(iter(self.numbers))]

    def is_stale(self, page_number: int, number: int) -> bool:
        """Return whether a newer request has arrived."""
        return number < self.numbers.get(page_number, number)


class ExploreServer(ThreadingHTTPServer):
    """HTTP server of one exploration.

    Args:
        port: port number; 0 selects a free one.

    Raises:
        ExploreError: the port is in use or not permitted.
        CodegenError: Plotly is not installed.
    """

    daemon_threads = True

    def __init__(self, explorer: Explorer, target: Target, port: int = 0) -> None:
        self.explorer, self.target = explorer, target
        self.key = secrets.token_urlsafe(24)
        self.assets = assets()
        self.newest = Newest()
        self.pages = 0
        self.turn = threading.Lock()
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            taken = error.errno == errno.EADDRINUSE
            what = f"port {port} is in use" if taken else f"port {port} cannot be listened on ({error.strerror})"
            raise ExploreError(what, where="--port", remedy="choose another one, or 0 for a free one") from None

    def server_bind(self) -> None:
        """Bind without the host name look-up of HTTPServer, which may query a name server."""
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = HOST, self.server_address[1]

    @property
    def address(self) -> str:
        """Address of the page, with its key."""
        return f"http://{HOST}:{self.server_port}/?key={self.key}"

    @property
    def hosts(self) -> frozenset[str]:
        """Accepted values of the Host header."""
        names = {f"{name}:{self.server_port}" for name in (HOST, "localhost")}
        return frozenset(names | ({HOST, "localhost"} if self.server_port == 80 else set()))

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a browser that disconnects during a response."""


class _Refusal(Exception):
    """A response other than 200."""

    def __init__(self, status: HTTPStatus, text: str) -> None:
        super().__init__(status, text)
        self.status, self.text = status, text


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "codegen-explore", ""
    timeout = IDLE_S

    @property
    def explore(self) -> ExploreServer:
        return cast(ExploreServer, self.server)

    def do_GET(self) -> None:
        """Serve the page and its parts."""
        try:
            self._check_host()
            where = self._where()
            if where.path == "/":
                self._check_key(parse_qs(where.query).get("key", [""])[0])
                server = self.explore
                with server.turn:
                    server.pages += 1
                    number = server.pages
                asset = page(server.explorer, server.key, number)
            else:
                found = self.explore.assets.get(where.path)
                if found is None:
                    raise _Refusal(HTTPStatus.NOT_FOUND, "there is no such page")
                asset = found
        except _Refusal as refusal:
            self._answer(refusal.status, f"{refusal.text}\n".encode(), "text/plain; charset=utf-8")
            return
        self._answer(HTTPStatus.OK, asset.content, asset.kind)

    def do_POST(self) -> None:
        """Answer a request of the page."""
        try:
            self._check_host()
            data = self._question()
            answering = {"/api/picture": self._picture, "/api/family": self._family, "/api/write": self._write}.get(self.path)
            if answering is None:
                raise _Refusal(HTTPStatus.NOT_FOUND, "there is no such page")
            answer = answering(data)
        except _Refusal as refusal:
            self._json(refusal.status, {"error": refusal.text})
            return
        except Existing as existing:
            told = {"error": str(existing), "sha256": existing.sha256, "text": existing.text, "changes": list(existing.changes)}
            self._json(HTTPStatus.CONFLICT, told)
            return
        except CodegenError as error:
            self._json(HTTPStatus.UNPROCESSABLE_ENTITY, {"error": str(error)})
            return
        except Exception as error:
            self._json(HTTPStatus.INTERNAL_SERVER_ERROR, {"error": f"internal error: {type(error).__name__}; please report it"})
            raise
        self._json(HTTPStatus.OK, answer)

    def _picture(self, data: dict[str, Any]) -> dict[str, Any]:
        is_stale = self._came(data)
        with self.explore.turn:
            return {"stale": True} if is_stale() else self.explore.explorer.picture(data.get("values"))

    def _family(self, data: dict[str, Any]) -> dict[str, Any]:
        # Not under the lock, so that requests for a picture are answered first.
        return self.explore.explorer.family(data.get("values"), self._came(data)) or {"stale": True}

    def _came(self, data: dict[str, Any]) -> Callable[[], bool]:
        """Record a request. Return a function that reports whether the same page has sent a newer one."""
        number, of_page = data.get("number", 0), data.get("page", 0)
        if type(number) is not int or type(of_page) is not int:
            raise _Refusal(HTTPStatus.BAD_REQUEST, "page and number must be whole numbers")
        newest = self.explore.newest
        newest.came(of_page, number)
        return lambda: newest.is_stale(of_page, number)

    def _write(self, data: dict[str, Any]) -> dict[str, Any]:
        replaces = data.get("replaces")
        if replaces is not None and not isinstance(replaces, str):
            raise _Refusal(HTTPStatus.BAD_REQUEST, "replaces must be a SHA-256 or null")
        explorer, target = self.explore.explorer, self.explore.target
        config = explorer.configured(data.get("values"))
        explorer.calibration(config)  # reject what cannot be solved
        with self.explore.turn:
            target.write(config, replaces)
        case = explorer.case
        return {
            "file": str(target.path),
            "next": f"codegen solve --config {target.path.name} --case {case} -o {explorer.name}.npz",
        }

    # --- what every request must be ----------------------------------------------------------------------------------

    def _check_host(self) -> None:
        hosts = self.explore.hosts
        if self.headers.get("Host") not in hosts:
            self.close_connection = True
            raise _Refusal(HTTPStatus.MISDIRECTED_REQUEST, "this address is not served here")
        origin = self.headers.get("Origin")
        if origin is not None and origin not in {f"http://{host}" for host in hosts}:
            self.close_connection = True
            raise _Refusal(HTTPStatus.FORBIDDEN, "requests of other sites are rejected")

    def _check_key(self, given: str) -> None:
        if not secrets.compare_digest(given.encode(), self.explore.key.encode()):
            self.close_connection = True
            raise _Refusal(HTTPStatus.FORBIDDEN, "open the whole address that `codegen explore` printed: its key is missing")

    def _where(self) -> SplitResult:
        try:
            return urlsplit(self.path)
        except ValueError:
            raise _Refusal(HTTPStatus.BAD_REQUEST, "not a valid address") from None

    def _question(self) -> dict[str, Any]:
        """Return the JSON of a request. The body is read only after the key is checked."""
        self._check_key(self.headers.get("X-Explore-Key", ""))
        length = self.headers.get("Content-Length", "")
        whole = length.isascii() and length.isdigit() and len(length) <= LENGTH_DIGITS_MAX
        if not whole or int(length) > BODY_MAX:
            self.close_connection = True
            raise _Refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a body of at most {BODY_MAX} bytes is needed")
        body = self.rfile.read(int(length))
        if self.headers.get_content_type() != "application/json":
            raise _Refusal(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "application/json is needed")
        try:
            data = json.loads(body)
        except (ValueError, RecursionError):
            raise _Refusal(HTTPStatus.BAD_REQUEST, "not JSON") from None
        if not isinstance(data, dict):
            raise _Refusal(HTTPStatus.BAD_REQUEST, "a JSON object is needed")
        return data

    # --- answers -------------------------------------------------------------------------------------------------------

    def _json(self, status: HTTPStatus, data: dict[str, Any]) -> None:
        content = json.dumps(data, allow_nan=False, separators=(",", ":")).encode()
        self._answer(status, content, "application/json")

    def _answer(self, status: HTTPStatus, content: bytes, kind: str) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("Content-Security-Policy", SECURITY_POLICY)
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(content)

    def send_error(self, code: int, message: str | None = None, explain: str | None = None) -> None:
        """Answer what the library itself rejects, such as methods other than GET and POST, with the usual headers."""
        del message, explain  # they quote the request
        self.close_connection = True
        status = HTTPStatus(code)
        self._answer(status, f"{status.phrase}\n".encode("ascii"), "text/plain; charset=utf-8")

    def log_message(self, format: str, *args: Any) -> None:
        """Log nothing: the terminal is for the user's commands, not for the browser's requests."""
