"""Explorers of small maps (the paper's PI and the recommended controller), and a client of the server."""

import http.client
import json
import threading
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from codegen.configuration import Config, parse
from codegen.explore.explorer import Explorer
from codegen.explore.server import ExploreServer
from codegen.explore.toml_file import Target, preset_bases
from codegen.map_file import map as npz

GENERATED = Path(__file__).resolve().parents[2] / "generated"
KINDS = {"pi": "4ws2-paper", "tracking": "4ws2"}


def small(kind: str) -> Config:
    """Return the configuration of a committed map with a small grid."""
    data = npz.load(GENERATED / f"{KINDS[kind]}.npz").config.model_dump(mode="json")
    data["grid"] |= {"speed_points": 21, "front_angle_points": 25}
    return parse(data, "test")


def explorer_of(kind: str) -> Explorer:
    return Explorer(small(kind), "4ws-2", "small")


@pytest.fixture(scope="session")
def pi() -> Explorer:
    return explorer_of("pi")


@pytest.fixture(scope="session")
def tracking() -> Explorer:
    return explorer_of("tracking")


@dataclass
class Answer:
    """Status, headers and body of a response."""

    status: int
    headers: dict[str, str]
    body: bytes

    @property
    def data(self) -> Any:
        return json.loads(self.body)


@dataclass
class Client:
    """A client that sends exactly the headers it is given."""

    server: ExploreServer

    @property
    def host(self) -> str:
        return f"127.0.0.1:{self.server.server_port}"

    def ask(self, method: str, path: str, body: bytes | None = None, **headers: str | None) -> Answer:
        """Send one request; a header of None is omitted."""
        length = {} if body is None else {"Content_Length": str(len(body))}
        with closing(http.client.HTTPConnection("127.0.0.1", self.server.server_port, timeout=60)) as connection:
            connection.putrequest(method, path, skip_host=True, skip_accept_encoding=True)
            for name, value in ({"Host": self.host} | length | headers).items():
                if value is not None:
                    connection.putheader(name.replace("_", "-"), value)
            connection.endheaders(body)
            answer = connection.getresponse()
            return Answer(answer.status, dict(answer.getheaders()), answer.read())

    def post(self, path: str, data: object, **headers: str | None) -> Answer:
        """Send JSON, or bytes unchanged, with the headers of the page."""
        usual = {"Content_Type": "application/json", "X_Explore_Key": self.server.key}
        return self.ask("POST", path, data if isinstance(data, bytes) else json.dumps(data).encode(), **(usual | headers))


@pytest.fixture
def client(pi: Explorer, tmp_path: Path) -> Iterator[Client]:
    """Provide a client of a server whose button writes to `tmp_path`."""
    with ExploreServer(pi, Target(tmp_path / "ars.toml", preset_bases())) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield Client(server)
        server.shutdown()
        thread.join()
