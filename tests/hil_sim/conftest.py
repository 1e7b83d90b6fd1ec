"""The paper's build, on disk and compiled."""

from __future__ import annotations

from pathlib import Path

import pytest

from codegen.sil.software import Software
from tests import builds, shared


@pytest.fixture(scope="session")
def build_folder() -> Path:
    """The folder, as `codegen build` leaves it."""
    return shared.build_folder()


@pytest.fixture(scope="session")
def software() -> Software:
    """That build, compiled."""
    return builds.paper().software
