"""Fixtures of the command line's tests."""

from tests.cli.conftest import here, run

__all__ = ["here", "run"]
