"""The blocks of README and guide that name vcan0, run where there is one (tests/docs/blocks.py)."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.blocks import PAGES, blocks
from tests.docs.page import run_page

ON_VCAN = {page: found for page in PAGES if (found := [block for block in blocks(page) if block.needs_vcan])}


@pytest.mark.vcan
@pytest.mark.parametrize("page", ON_VCAN)
def test_a_page_does_what_it_says_on_vcan(vcan: str, page: str, tmp_path: Path) -> None:
    assert vcan == "vcan0"
    run_page(ON_VCAN[page], tmp_path)
