"""README and guide: what they tell their reader to type works, and prints what they show. See blocks.py for the rules."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from tests.docs.blocks import PAGES, Block, Command, blocks, commands, matches
from tests.docs.page import (
    EXAMPLES,
    INSTEAD,
    NAME_IN_C,
    NOT_READ,
    NOT_RUN,
    PROGRAMS,
    SETUPS,
    names_in_headers,
    run_page,
    unread,
    with_keys,
)

ALL = {page: blocks(page) for page in PAGES}


def here(page: str) -> list[Block]:
    return [block for block in ALL[page] if not block.needs_vcan]


def is_run(block: Block) -> bool:
    return block.language in ("console", "sh", "python") or block.mark is not None


@pytest.mark.parametrize("page", [page for page in PAGES if any(is_run(block) for block in here(page))])
def test_a_page_does_what_it_says(page: str, tmp_path: Path) -> None:
    lacking = [program for program in PROGRAMS.get(page, ()) if shutil.which(program) is None]
    if lacking and os.environ.get("CI") != "true":
        pytest.skip(f"needs {', '.join(lacking)}")
    run_page(here(page), tmp_path, SETUPS.get(page))


def test_no_block_escapes() -> None:
    assert [reason for page in PAGES for block in ALL[page] if (reason := unread(block)) is not None] == []


def test_the_tables_name_what_the_pages_have() -> None:
    every = {
        command.plain
        for page in PAGES
        for block in ALL[page]
        if is_run(block) and block.mark is None
        for command in commands(block)
    }
    for table in (NOT_RUN, INSTEAD, EXAMPLES):
        assert [text for text in table if text not in every] == []
    first_lines = {(block.page, block.text.splitlines()[0]) for page in PAGES for block in ALL[page]}
    assert [entry for entry in NOT_READ if entry not in first_lines] == []


@pytest.mark.parametrize("page", PAGES)
def test_c_speaks_of_names_that_exist(page: str) -> None:
    """A C block that is not compiled, such as a list of prototypes; one whose name ends in `_` stands for several."""
    known = names_in_headers()
    for block in ALL[page]:
        if block.language == "c" and block.mark is None:
            names = {name for name in NAME_IN_C.findall(block.text) if not name.endswith("_")}
            assert names <= known, f"{block.place}: {sorted(names - known)}"


# --- the reader of blocks itself ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("a\nb", "a  \nb\n", True),
        ("a\n...\nd", "a\nb\nc\nd", True),
        ("a\n...", "a\nb", True),
        ("took ... s", "took 0.31 s", True),
        ("a\nc", "a\nb", False),
        ("a", "a\nb", False),
        ("took ... s\nend", "took 0.31 s", False),
        ("1.5 (mean)", "105 (mean)", False),
    ],
)
def test_output_is_compared(shown: str, printed: str, same: bool) -> None:
    assert matches(shown, printed) is same


def test_commands_are_told_from_their_output() -> None:
    block = Block("page.md", 1, "console", "$ one \\\n  --two  # why\nout\n\nmore\n$ three")
    assert commands(block) == [Command("one \\\n  --two  # why", "out\n\nmore"), Command("three")]
    assert commands(block)[0].plain == "one \\\n  --two"


def test_what_goes_wrong_on_a_page_fails(tmp_path: Path) -> None:
    for number, text in enumerate(("$ false", "$ echo one\ntwo", "$ codegen build --map missing.npz", "$ true\nerror: no")):
        folder = tmp_path / str(number)
        folder.mkdir()
        with pytest.raises(AssertionError, match=r"page\.md:7"):
            run_page([Block("page.md", 7, "console", text)], folder)


def test_keys_go_where_a_reader_would_put_them() -> None:
    text = "top = 1\n[a]\nx = 1 # old\n[b.c]\ny = 2\n"
    changes = "[a]\nx = 3\nz = 4\n[b.c]\ny = 5\n[d]\nw = 6\n"
    assert with_keys(text, changes) == "top = 1\n[a]\nz = 4\nx = 3\n[b.c]\ny = 5\n\n[d]\nw = 6\n"


def test_a_language_that_nobody_reads_is_seen() -> None:
    assert unread(Block("page.md", 1, "toml", "a = 1")) is not None
    assert unread(Block("page.md", 1, "toml", "a = 1", ("file", "a.toml"))) is None
