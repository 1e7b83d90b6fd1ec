"""Fenced code blocks in README and guide. The language determines their use.

- `console`: lines after `$ ` are run; the lines below are their output, with `...` for omitted text. - `sh`: every line is run;
`python` is run as a separate program; `text` is the content of a file or a screen. - Any language after `<!-- file: NAME -->`:
written to that file. - `toml` after `<!-- into: NAME -->`: its keys are added to that ars.toml, which must stay valid. - `c`
without a mark: each name of the generated C in it must be in a header.

A fence without a language, in README, is `console` if a line starts with `$ `, else `sh`.
"""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = ("README.md", *sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").glob("*.md")))

FENCE = re.compile(r"^(?P<indent> *)(?P<ticks>`{3,})(?P<language>[^\s`]*)\s*(?P<rest>.*)$")
MARK = re.compile(r"^<!-- (?P<name>file|into): (?P<value>\S+) -->$")


@dataclass(frozen=True)
class Block:
    """A fenced block: page, line of its first fence, language, text, and the mark before it (`file` or `into`, and a name)."""

    page: str
    line: int
    language: str
    text: str
    mark: tuple[str, str] | None = None

    @property
    def place(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def needs_vcan(self) -> bool:
        return "vcan0" in self.text and self.language in ("console", "sh", "python")


@dataclass(frozen=True)
class Command:
    """A command of a block, and the output shown on the page, or None."""

    text: str
    shown: str | None = None

    @property
    def plain(self) -> str:
        """Return the command without its trailing comment."""
        return re.sub(r"\s+#\s.*$", "", self.text).strip()


def blocks(page: str) -> list[Block]:
    """Return all blocks of a page, in order, without Sphinx directives (`{figure}` and the like)."""
    found: list[Block] = []
    lines = (ROOT / page).read_text(encoding="utf-8").splitlines()
    number = 0
    while number < len(lines):
        fence = FENCE.match(lines[number])
        number += 1
        if fence is None:
            continue
        start = number
        close = fence["indent"] + fence["ticks"]
        while number < len(lines) and lines[number].rstrip() != close:
            number += 1
        assert number < len(lines), f"{page}:{start}: the block is not closed"
        body = [line.removeprefix(fence["indent"]) for line in lines[start:number]]
        number += 1
        if not fence["language"].startswith("{"):
            language = fence["language"] or ("console" if any(line.startswith("$ ") for line in body) else "sh")
            found.append(Block(page, start, language, "\n".join(body), _mark(lines, start - 2)))
    return found


def _mark(lines: list[str], before: int) -> tuple[str, str] | None:
    while before >= 0 and not lines[before].strip():
        before -= 1
    mark = MARK.match(lines[before].strip()) if before >= 0 else None
    return None if mark is None else (mark["name"], mark["value"])


def commands_of(block: Block) -> list[Command]:
    """Return the commands of a `console` or `sh` block; a backslash at the end of a line joins the next one."""
    console, going = block.language == "console", False
    found: list[tuple[list[str], list[str]]] = []  # lines of a command, and of its output
    for line in block.text.splitlines():
        is_output = console and not going and not line.startswith("$ ")
        if is_output:
            assert found, f"{block.place}: output precedes the first command"
            found[-1][1].append(line)
        elif going:
            found[-1][0].append(line)
        elif line.strip() and not line.lstrip().startswith("#"):
            found.append(([line.removeprefix("$ ") if console else line], []))
        going = not is_output and line.endswith("\\")
    return [Command("\n".join(lines), "\n".join(shown).strip("\n") or None) for lines, shown in found]


def matches(shown: str, printed: str) -> bool:
    """Return whether a page shows the printed text; `...` matches any text, including lines. Trailing blanks are ignored."""
    shown, printed = ("\n".join(line.rstrip() for line in text.strip().splitlines()) for text in (shown, printed))
    return re.fullmatch(".*?".join(map(re.escape, shown.split("..."))), printed, re.DOTALL) is not None
