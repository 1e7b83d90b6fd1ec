"""The paper's car and its compiled software."""

from __future__ import annotations

import pytest

from codegen.config import Config
from codegen.sil.software import Software
from tests import builds


@pytest.fixture(scope="session")
def paper() -> Config:
    """The published vehicle."""
    return builds.CONFIG


@pytest.fixture(scope="session")
def software() -> Software:
    """Its 4WS-2 build in single precision, with the plant, compiled."""
    return builds.paper().software
