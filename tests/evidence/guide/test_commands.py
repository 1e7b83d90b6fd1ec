"""Commands in README and guide: they work and print the text shown. See tests/docs/blocks.py for the rules."""

from pathlib import Path

import pytest

from tests.docs.blocks import PAGES, Block, blocks
from tests.docs.page import SETUPS, run_page

QUICK = ("README.md", "docs/own-map.md")
"""Pages of the quick form: a new user's first commands, and a map of their own."""


def runnable(page: str) -> list[Block]:
    """Return a page's blocks to run here; blocks with vcan0 run in tests/evidence/vcan."""
    found = [block for block in blocks(page) if not block.needs_vcan]
    return found if any(block.language in ("console", "sh", "python") or block.mark is not None for block in found) else []


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=() if page in QUICK else pytest.mark.long) for page in PAGES if runnable(page)]
)
def test_a_page_shows_the_actual_output(page: str, tmp_path: Path) -> None:
    run_page(runnable(page), tmp_path, SETUPS.get(page))
