"""Fixtures of the tests of the checks."""

from tests.verify.test_law import few

__all__ = ["few"]
