"""The committed build, compiled once for this folder."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.xcp.slave import Slave, compile_slave


@pytest.fixture(scope="package")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the generated slave."""
    return compile_slave(tmp_path_factory.mktemp("xcp"))


@pytest.fixture
def slave(program: Path) -> Iterator[Slave]:
    """Provide a connected slave."""
    with Slave(program) as slave:
        slave.positive("CONNECT", 0)
        yield slave
