"""The copy that every test of this folder adds to."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.additions.copy import Copy


@pytest.fixture
def tree(tmp_path: Path) -> Copy:
    """A copy of the source tree, of this test alone."""
    return Copy.into(tmp_path / "tree")
