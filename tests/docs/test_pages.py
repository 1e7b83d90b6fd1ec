"""README and guide without running them: blocks, commands, links, and reference pages. tests/evidence/guide runs them."""

import re
import shlex
from pathlib import Path
from urllib.parse import unquote

import click
import pytest

from codegen.cli import cli
from scripts.guide import commands, config_tables, pages
from tests.docs.blocks import PAGES, ROOT, blocks, commands_of
from tests.docs.page import EXAMPLES, NOT_RUN, REPLACEMENTS

ALL = {page: blocks(page) for page in PAGES}
COMMANDS = [
    (block, command)
    for page in PAGES
    for block in ALL[page]
    if block.language in ("console", "sh") and block.mark is None
    for command in commands_of(block)
]
NAME_IN_C = re.compile(r"\b(?:ars|ARS)_\w+")
LINK = re.compile(r"\]\((?!https?://|mailto:)([^)#\s]*)(?:#([^)\s]+))?\)")
FENCED = re.compile(r"^( *```+)(.*?)^\1$", re.MULTILINE | re.DOTALL)
LINKED = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("benchmarks/*.md"), *ROOT.glob("generated/*/*.md")])


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


def prose_of(page: Path) -> str:
    """Return the text of a page without its fenced blocks."""
    return FENCED.sub("", page.read_text(encoding="utf-8"))


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page as GitHub makes them; MyST makes the same."""
    titles = [
        re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title) for title in re.findall(r"^#{1,6} (.+)$", prose_of(page), re.MULTILINE)
    ]
    plain = [re.sub(r"[^\w\- ]", "", title.strip().lower()).replace(" ", "-") for title in titles]
    repeated = [plain[:number].count(anchor) for number, anchor in enumerate(plain)]
    return {f"{anchor}-{count}" if count else anchor for anchor, count in zip(plain, repeated, strict=True)}


@pytest.mark.parametrize("page", LINKED, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_and_pictures_have_a_target_on_a_code_host(page: Path) -> None:
    broken = []
    for name, anchor in LINK.findall(re.sub(r"`[^`\n]*`", "", prose_of(page))):
        target = (page.parent / unquote(name)).resolve() if name else page
        is_known = target.is_relative_to(ROOT) and target.exists()
        if not is_known or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            broken.append(f"{name}#{anchor}" if anchor else name)
    assert broken == []


def test_pages_are_plain_markdown() -> None:
    """Directives, roles and targets of MyST appear as text on a code host."""
    text = {page: (ROOT / page).read_text(encoding="utf-8") for page in PAGES}
    noise = re.compile(r"^ *`{3,}\{.+?\}|\{[\w:]+\}`|^\([\w-]+\)=$|<project:|^ *:::", re.MULTILINE)
    assert {page: found for page in PAGES if (found := noise.findall(text[page]))} == {}


def test_parts_of_pages_that_come_from_the_code_are_current() -> None:
    made = pages.pages()
    stale = [path.name for path, text in made.items() if path.read_text(encoding="utf-8") != text]
    assert stale == [], "run `make docs`, and commit the pages"
    regions = [name for path in made for name in re.findall(r"^<!-- from the code: (\S+)", made[path], re.MULTILINE)]
    assert {*regions} == {*pages.REGIONS}
    assert sum(path.read_text(encoding="utf-8").count("\n<!-- end -->") for path in made) == len(regions)


def test_every_key_of_ars_toml_has_its_meaning() -> None:
    text = config_tables.markdown()
    fields = [(key, field) for _, model in config_tables.sections() for key, field in model.model_fields.items()]
    plain = {key for key, field in fields if config_tables._section_of(field.annotation) is None} - {"cases"}
    assert plain <= set(re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE))


def test_every_command_and_option_has_its_line() -> None:
    sections = re.split(r"^## ", commands.markdown(), flags=re.MULTILINE)[1:]
    assert [section.partition("\n")[0] for section in sections] == [
        "codegen",
        *(f"codegen {name}" for name in cli.list_commands(None)),
    ]
    for section, command in zip(sections, [cli, *(cli.commands[name] for name in sorted(cli.commands))], strict=True):
        listed = set(re.findall(r"--[\w-]+", " ".join(re.findall(r"^\| `(.+?)` \|", section, re.MULTILINE))))
        shown = [each for each in command.params if isinstance(each, click.Option) and not each.hidden]
        assert listed == {name for each in shown for name in each.opts + each.secondary_opts if len(name) > 2}
        assert "```text\ncodegen" in section.partition("Example")[2], section


def test_the_interface_names_every_command() -> None:
    text = (ROOT / "docs/interface.md").read_text(encoding="utf-8")
    synopsis = text.split("```text", 1)[1].split("```", 1)[0]
    assert set(re.findall(r"^codegen (\w+)", synopsis, re.MULTILINE)) == set(cli.commands)
