"""Fixtures of the command line tests."""

from tests.cli.conftest import here, run
from tests.cli.test_show import maps

__all__ = ["here", "maps", "run"]
