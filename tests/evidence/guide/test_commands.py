"""README and guide: the commands that they show work, and print what they show. See tests/docs/blocks.py for the rules."""

from pathlib import Path

import pytest

from tests.docs.blocks import PAGES, Block, blocks
from tests.docs.page import SETUPS, run_page

QUICK = ("README.md", "docs/own-map.md")
"""Pages of the quick form: the first commands of a new user, and a map of their own."""


def runnable(page: str) -> list[Block]:
    """Return the blocks of a page that are run here; those with vcan0 are run in tests/evidence/vcan."""
    found = [block for block in blocks(page) if not block.needs_vcan]
    return found if any(block.language in ("console", "sh", "python") or block.mark is not None for block in found) else []


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=() if page in QUICK else pytest.mark.long) for page in PAGES if runnable(page)]
)
def test_a_page_prints_what_it_shows(page: str, tmp_path: Path) -> None:
    run_page(runnable(page), tmp_path, SETUPS.get(page))
