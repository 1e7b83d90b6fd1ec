"""benchmarks/results.md: a section for each benchmark, replaced when that one is measured again."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from codegen.files import write_atomically

SECTION = re.compile(r"^## (?P<name>[a-z-]+): ", re.MULTILINE)


def update(path: Path, measured: Mapping[str, str], order: tuple[str, ...], reading: str) -> None:
    """Replace sections (name -> Markdown beginning with `section_title`) in the file; others are kept.

    `order`: all names. `reading`: introduction of the page. Raises CodegenError if it cannot be written.
    """
    sections = {**_sections(path.read_text(encoding="utf-8") if path.exists() else ""), **measured}
    head = ["# Measured", "By `make bench`; each section names the machine it was measured on.", reading]
    kept = [sections[name].strip() for name in order if name in sections]
    write_atomically(path, ("\n\n".join([*head, *kept]) + "\n").encode())


def section(name: str, markdown: str, machine: str) -> str:
    """Return a section: `Report.markdown` with the name in its title, and the machine."""
    return f"{markdown.replace('## ', f'## {name}: ', 1)}\n\n```text\n{machine}\n```"


def _sections(text: str) -> dict[str, str]:
    starts = [*SECTION.finditer(text)]
    ends = [*(start.start() for start in starts[1:]), len(text)]
    return {start["name"]: text[start.start() : end] for start, end in zip(starts, ends, strict=False)}
