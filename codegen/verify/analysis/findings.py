"""What static analysers find, in one shape."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, order=True)
class Finding:
    """One finding of a tool.

    Attributes:
        file, line: where; line 0 stands for the whole file.
        rule: number of a MISRA rule, or the tool's own name for what it finds.
        text: what the tool says.
    """

    file: str
    line: int
    rule: str
    text: str

    def __str__(self) -> str:
        """In one line."""
        return f"{self.file}:{self.line}: {self.text} [{self.rule}]"


def once(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The first of each file, line and rule, sorted."""
    first: dict[tuple[str, int, str], Finding] = {}
    for finding in sorted(findings):
        first.setdefault((finding.file, finding.line, finding.rule), finding)
    return tuple(first.values())


def plain(path: str) -> str:
    """A path as the tools write it, as the build names it."""
    return re.sub(r"^(?:\./)+", "", path.replace("\\", "/"))
