"""Fixtures of the command line's tests."""

from tests.cli.conftest import here, run
from tests.cli.test_show import maps
from tests.cli.test_suite_command import good, suite
from tests.cli.test_tune import solved

__all__ = ["good", "here", "maps", "run", "solved", "suite"]
