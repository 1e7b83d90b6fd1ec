"""Keys and values of a tyre property file, `.tir`, in the TeimOrbit format of Adams and MF-Tyre.

Sections in brackets, KEY = value, comments from `!` or `$`, text in quotation marks, small and capital letters alike. Tables
([SHAPE] and the like) are skipped. The section of a key matters only for units: MASS is a unit and an inertia.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from codegen.importing.source import MIB, ImportFault, Source, text_of

TIR_BYTES_MAX = MIB
"""Size limit; a file has about 20 KiB."""
NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?\Z", re.ASCII)
UNITS_SECTION = "UNITS"
KEY = re.compile(r"[A-Za-z][A-Za-z0-9_]*\Z", re.ASCII)


@dataclass(frozen=True)
class Entry:
    """A value as written in the file, without quotation marks, and its line."""

    text: str
    line: int
    section: str


@dataclass(frozen=True)
class PropertyFile:
    """The entries of a file, in capital letters.

    Attributes:
        source: the file.
        entries: key -> entry, of all sections but [UNITS].
        units: key -> entry of [UNITS].
    """

    source: Source
    entries: Mapping[str, Entry]
    units: Mapping[str, Entry]

    def text(self, key: str, default: str = "") -> str:
        """Return the text of a key; `default` where it is missing."""
        return self.entries[key].text if key in self.entries else default

    def number(self, key: str, section: str, default: float | None = None) -> float:
        """Return the number of a key; `default` where it is missing.

        Raises:
            ImportFault: it is no finite number, or it is missing and has no default; names the section that it belongs to.
        """
        entry = self.entries.get(key)
        if entry is None or not entry.text:
            if default is not None:
                return default
            raise ImportFault(f"{key} is missing", where=self.source.path, remedy=f"add it to [{section}]")
        where = f"{self.source.path}, line {entry.line}"
        if not NUMBER.match(entry.text):
            raise ImportFault(f"{key} = {entry.text!r} is no number", where=where, remedy="give a number")
        value = float(entry.text.lower().replace("d", "e"))  # Fortran writes 1.0D+3
        if not math.isfinite(value):
            raise ImportFault(f"{key} = {entry.text} is too large", where=where, remedy="give a finite number")
        return value

    def place(self, key: str) -> str:
        """Return file and line of a key; the file alone where it is missing."""
        entry = self.entries.get(key) or self.units.get(key)
        return f"{self.source.path}, line {entry.line}" if entry else str(self.source.path)


def parse(source: Source) -> PropertyFile:
    """Parse a file. Raises ImportFault: it is no property file, or a key has two different values."""
    entries: dict[str, Entry] = {}
    units: dict[str, Entry] = {}
    section, sections = "", 0
    for number, raw in enumerate(text_of(source).split("\n"), start=1):
        line = _without_comment(raw).strip()
        if line.startswith("["):
            section, sections = line.strip("[] \t").upper(), sections + 1
            continue
        left, equals, right = line.partition("=")
        key = left.strip().upper()
        if not equals or not KEY.match(key):
            continue
        target = units if section == UNITS_SECTION else entries
        entry = Entry(right.strip().strip("'\"").strip(), number, section)
        if key in target and target[key].text != entry.text:
            raise ImportFault(
                f"{key} is there twice (first in line {target[key].line})",
                where=f"{source.path}, line {number}",
                remedy="leave one out",
            )
        target.setdefault(key, entry)
    if not sections or not entries:
        remedy = "a .tir has sections such as [LATERAL_COEFFICIENTS] and lines KEY = value"
        raise ImportFault("no tyre property file", where=source.path, remedy=remedy)
    return PropertyFile(source, entries, units)


def _without_comment(line: str) -> str:
    """Return the line up to the first `!` or `$` outside of quotation marks."""
    quote = ""
    for position, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character in "!$":
            return line[:position]
    return line
