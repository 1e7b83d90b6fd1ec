"""Fixtures of the tests of the checks."""

from tests.verify.test_compiles import no_mixtures
from tests.verify.test_law import few
from tests.verify.test_pil import no_dynamics, steps_only

__all__ = ["few", "no_dynamics", "no_mixtures", "steps_only"]
