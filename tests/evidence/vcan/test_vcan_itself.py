"""The bus of these tests, `codegen doctor` with it, and the blocks of README and guide that use vcan0."""

from __future__ import annotations

from pathlib import Path

import pytest

from codegen import doctor
from codegen.doctor import State
from tests.docs.blocks import PAGES, blocks
from tests.docs.page import run_page
from tests.evidence.vcan.interfaces import set_interface

ON_VCAN = {page: found for page in PAGES if (found := [block for block in blocks(page) if block.needs_vcan])}


@pytest.mark.parametrize("attempt", [1, 2])
def test_an_interface_that_is_down_is_reported_and_up_for_the_next_test(vcan: str, attempt: int) -> None:
    assert doctor.socketcan().state is State.GOOD
    set_interface(vcan, up=False)
    found = doctor.socketcan()
    assert (found.state, found.what) == (State.MISSING, f"{vcan} is down")


@pytest.mark.long
@pytest.mark.parametrize("page", ON_VCAN)
def test_the_blocks_of_a_page_on_vcan(vcan: str, page: str, tmp_path: Path) -> None:
    run_page(ON_VCAN[page], tmp_path)
