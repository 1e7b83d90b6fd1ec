"""Fixtures of the command line from tests/cli. Measurements are read in this process."""

import pytest

from tests.cli.conftest import refused, run
from tests.importing.conftest import in_this_process

__all__ = ["in_this_process", "refused", "run"]


@pytest.fixture(autouse=True)
def without_child(in_this_process: None) -> None:
    """Apply `in_this_process` to every test."""
