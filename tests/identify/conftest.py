"""Fixtures of the command line from tests/cli."""

from tests.cli.conftest import refused, run

__all__ = ["refused", "run"]
