"""Filters of the templates: the examples in their docstrings."""

import doctest

from codegen.emit import render


def test_the_examples_in_the_docstrings() -> None:
    result = doctest.testmod(render)
    assert result.failed == 0 < result.attempted
