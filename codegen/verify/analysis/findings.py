"""Findings of static analysers in a common form."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, order=True)
class Finding:
    """One finding of a tool.

    Attributes:
        file, line: location; line 0 is the whole file.
        rule: number of a MISRA rule, or the tool's own name for what it finds.
        text: message of the tool.
    """

    file: str
    line: int
    rule: str
    text: str

    def __str__(self) -> str:
        """Format as one line."""
        return f"{self.file}:{self.line}: {self.text} [{self.rule}]"


def once(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return the first finding of each file, line and rule, sorted."""
    first: dict[tuple[str, int, str], Finding] = {}
    for finding in sorted(findings):
        first.setdefault((finding.file, finding.line, finding.rule), finding)
    return tuple(first.values())


def plain(path: str) -> str:
    """Convert a path from a tool's notation to the build's."""
    return re.sub(r"^(?:\./)+", "", path.replace("\\", "/"))
