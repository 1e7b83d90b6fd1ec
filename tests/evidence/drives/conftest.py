"""Fixtures of the command line's tests."""

from tests.cli.conftest import here, refused, run
from tests.cli.test_show import maps
from tests.cli.test_suite_command import good, suite

__all__ = ["good", "here", "maps", "refused", "run", "suite"]
