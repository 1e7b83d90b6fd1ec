"""README and guide without running them: blocks, commands, links, and reference pages. tests/evidence/guide runs them."""

import re
import shlex
from pathlib import Path
from urllib.parse import unquote

import click
import pytest

from codegen.cli import cli
from tests.docs.blocks import PAGES, ROOT, blocks, commands
from tests.docs.page import EXAMPLES, NOT_RUN, REPLACEMENTS

ALL = {page: blocks(page) for page in PAGES}
COMMANDS = [
    (block, command)
    for page in PAGES
    for block in ALL[page]
    if block.language in ("console", "sh") and block.mark is None
    for command in commands(block)
]
NAME_IN_C = re.compile(r"\b(?:ars|ARS)_\w+")
LINK = re.compile(r"\]\((?!https?://|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)")


def words_of(text: str) -> list[list[str]]:
    """Split a shell command into the words of its simple commands, without redirections."""
    lexer = shlex.shlex(text.replace("\\\n", " "), posix=True, punctuation_chars=True)
    lexer.whitespace_split = True
    found: list[list[str]] = [[]]
    for word in lexer:
        if set(word) <= set("<>"):
            next(lexer)
        elif set(word) <= set("();|&"):
            found.append([])
        else:
            found[-1].append(word)
    return found


def test_every_block_is_run_written_or_checked() -> None:
    idle = [block for page in PAGES for block in ALL[page] if block.language not in ("console", "sh", "python", "text", "c")]
    first_lines = [block.text.splitlines()[0] for block in idle if block.mark is None]
    assert first_lines == ["list(APPEND ZEPHYR_EXTRA_MODULES ${CMAKE_CURRENT_SOURCE_DIR}/4ws2)"]  # needs a Zephyr SDK
    every = {command.plain for _, command in COMMANDS}
    assert [text for table in (NOT_RUN, REPLACEMENTS, EXAMPLES) for text in table if text not in every] == []


def test_every_codegen_command_parses() -> None:
    """Options and values are parsed by the command; nothing is run."""
    lines = [(block, command, words) for block, command in COMMANDS for words in words_of(command.plain)]
    calls = [line for line in lines if line[2][:1] == ["codegen"] and line[2][1:] and line[2][1][0] != "-"]
    assert len(calls) > len(PAGES)
    for block, command, (_, name, *rest) in calls:
        try:
            cli.commands[name].make_context(name, rest)
        except click.exceptions.Exit:
            pass
        except click.ClickException as error:
            assert "error: " in (command.shown or ""), f"{block.place}: {command.text}: {error.format_message()}"


def test_names_in_blocks_of_c_exist() -> None:
    """This includes lists of prototypes, which are not compiled. A name that ends in `_` is a prefix of several."""
    headers = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "generated").glob("*/include/*.h"))
    known = set(NAME_IN_C.findall(headers))
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


def test_every_key_of_ars_toml_has_its_meaning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs/_ext"))
    import config_tables

    text = config_tables.markdown()
    fields = [(key, field) for _, model in config_tables.sections() for key, field in model.model_fields.items()]
    plain = {key for key, field in fields if config_tables._section_of(field.annotation) is None} - {"cases"}
    assert plain <= set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))


def test_the_interface_names_every_command() -> None:
    text = (ROOT / "docs/interface.md").read_text(encoding="utf-8")
    synopsis = text.split("```text", 1)[1].split("```", 1)[0]
    assert set(re.findall(r"^codegen (\w+)", synopsis, re.MULTILINE)) == set(cli.commands)
