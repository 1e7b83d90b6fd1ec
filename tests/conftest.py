"""Settings of every test: no screen, the same examples in each run, one store of shared results (see `tests.shared`)."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

from tests import shared

pytest.register_assert_rewrite(*(f"tests.sil.{path.stem}" for path in Path(__file__).with_name("sil").glob("checks_*.py")))

os.environ["MPLBACKEND"] = "Agg"

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


def pytest_configure(config: pytest.Config) -> None:
    if not hasattr(config, "workerinput"):
        shared.folder()
