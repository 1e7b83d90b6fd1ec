"""README and guide without running them: each block has a use, each command parses, each link has a target.

The blocks are run in tests/evidence/guide; see blocks.py for their rules.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from urllib.parse import unquote

import click
import pytest

from codegen.cli import cli
from tests.docs.blocks import PAGES, ROOT, Block, Command, blocks, commands, matches
from tests.docs.page import EXAMPLES, INSTEAD, NAME_IN_C, NOT_READ, NOT_RUN, names_in_headers, unread, with_keys

ALL = {page: blocks(page) for page in PAGES}
COMMANDS = [
    (block, command)
    for page in PAGES
    for block in ALL[page]
    if block.language in ("console", "sh") and block.mark is None
    for command in commands(block)
]
LINK = re.compile(r"\]\((?!https?://|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)")


def words_of(text: str) -> list[list[str]]:
    """Split a shell command into the words of its simple commands, without redirections."""
    lexer = shlex.shlex(text.replace("\\\n", " "), posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    found: list[list[str]] = [[]]
    skip = False
    for word in lexer:
        if skip:
            skip = False
        elif set(word) <= set("<>"):
            skip = True
        elif set(word) <= set("();|&"):
            found.append([])
        else:
            found[-1].append(word)
    return found


def test_every_codegen_command_parses() -> None:
    """Options and their values are those of the command; nothing is run."""
    count = 0
    for block, command in COMMANDS:
        for words in words_of(command.plain):
            if words[:1] != ["codegen"] or len(words) == 1:
                continue
            count += 1
            if words[1].startswith("-"):
                continue
            assert words[1] in cli.commands, f"{block.place}: {command.text}"
            is_wrong = command.shown is not None and "error: " in command.shown
            try:
                cli.commands[words[1]].make_context(words[1], words[2:])
            except click.exceptions.Exit:
                pass
            except click.ClickException as error:
                assert is_wrong, f"{block.place}: {command.text}: {error.format_message()}"
    assert count > len(PAGES)


def test_every_block_has_a_use() -> None:
    assert [reason for page in PAGES for block in ALL[page] if (reason := unread(block)) is not None] == []
    assert unread(Block("page.md", 1, "toml", "a = 1")) is not None
    assert unread(Block("page.md", 1, "toml", "a = 1", ("file", "a.toml"))) is None


def test_exceptions_are_still_on_the_pages() -> None:
    every = {command.plain for _, command in COMMANDS}
    assert [text for table in (NOT_RUN, INSTEAD, EXAMPLES) for text in table if text not in every] == []
    first_lines = {(block.page, block.text.splitlines()[0]) for page in PAGES for block in ALL[page]}
    assert [entry for entry in NOT_READ if entry not in first_lines] == []


def test_names_in_blocks_of_c_exist() -> None:
    """Such as in a list of prototypes, which is not compiled. A name that ends in `_` stands for several."""
    known = names_in_headers()
    for block in (block for page in PAGES for block in ALL[page] if block.language == "c" and block.mark is None):
        names = {name for name in NAME_IN_C.findall(block.text) if not name.endswith("_")}
        assert names <= known, f"{block.place}: {sorted(names - known)}"


def anchors(path: Path) -> set[str]:
    """Return the anchors of the headings of a page: those of MyST (as GitHub's), and those of docutils."""
    text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    titles = [title.lower() for title in re.findall(r"^#{1,4} (.+)$", text, re.MULTILINE)]
    github = {re.sub(r"[^\w\- ]", "", title).replace(" ", "-") for title in titles}
    return github | {re.sub(r"[^a-z0-9]+", "-", title).strip("-") for title in titles}


@pytest.mark.parametrize("page", [*PAGES, "CONTRIBUTING.md", "CHANGELOG.md", "THIRD-PARTY-LICENSES.md"])
def test_links_have_a_target(page: str) -> None:
    source = ROOT / page
    for name, anchor in LINK.findall(source.read_text(encoding="utf-8")):
        target = source.parent / unquote(name) if name else source
        assert target.exists(), f"{page}: {name}"
        if anchor and target.suffix == ".md":
            assert anchor in anchors(target), f"{page}: {name}#{anchor}"


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("a\n...\nd", "a  \nb\nc\nd", True),
        ("took ... s", "took 0.31 s", True),
        ("a", "a\nb", False),
        ("1.5 (mean)", "105 (mean)", False),
    ],
)
def test_output_is_compared(shown: str, printed: str, same: bool) -> None:
    assert matches(shown, printed) is same


def test_commands_are_distinguished_from_their_output() -> None:
    block = Block("page.md", 1, "console", "$ one \\\n  --two  # why\nout\n\nmore\n$ three")
    assert commands(block) == [Command("one \\\n  --two  # why", "out\n\nmore"), Command("three")]
    assert commands(block)[0].plain == "one \\\n  --two"


def test_keys_go_where_a_reader_would_put_them() -> None:
    text = "top = 1\n[a]\nx = 1 # old\n[b.c]\ny = 2\n"
    changes = "[a]\nx = 3\nz = 4\n[b.c]\ny = 5\n[d]\nw = 6\n"
    assert with_keys(text, changes) == "top = 1\n[a]\nz = 4\nx = 3\n[b.c]\ny = 5\n\n[d]\nw = 6\n"
