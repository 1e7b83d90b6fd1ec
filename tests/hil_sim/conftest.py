"""A build on disk that the bench's tests share."""

from __future__ import annotations

from pathlib import Path

import pytest

from codegen.emit.write import write_folder
from codegen.sil.software import Software, load
from tests import builds


@pytest.fixture(scope="session")
def build_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's build, as `codegen build` leaves it."""
    folder = tmp_path_factory.mktemp("builds") / "4ws2"
    write_folder(builds.paper().folder, folder)
    return folder


@pytest.fixture(scope="session")
def software(build_folder: Path) -> Software:
    """That build, compiled."""
    return load(build_folder)
