"""The user at the command line of tests/cli, here too."""

from tests.cli.conftest import refused, run

__all__ = ["refused", "run"]
