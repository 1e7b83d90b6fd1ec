"""Outline of the generated sources for rules about names: objects and functions at file scope, and their users.

The parser relies on the layout of the templates: a definition starts in the first column, a function definition with its
section macro, and a brace in the first column ends it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

_APART = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"', re.DOTALL)
_FUNCTION = re.compile(r"^\w+_SECTION_CODE (?P<static>static )?[^(=]*?\b(?P<name>\w+)\(")
_OBJECT = re.compile(r"^(?:\w+_SECTION_\w+ )?static const \w+ (?P<name>\w+)(?:\[[^=]*)? =")


@dataclass(frozen=True)
class Definition:
    """A function or an object at file scope. `line` is the line of its name and `end` its last line; both count from 1."""

    name: str
    line: int
    end: int
    static: bool


@dataclass(frozen=True)
class Unit:
    """A source file.

    Attributes:
        path: path in the build.
        text: content of the file.
    """

    path: str
    text: str

    @cached_property
    def lines(self) -> tuple[str, ...]:
        """Lines of the file, with blanks in place of comments and strings."""
        return tuple(_APART.sub(lambda part: re.sub(r"[^\n]", " ", part[0]), self.text).split("\n"))

    @cached_property
    def functions(self) -> tuple[Definition, ...]:
        """Functions that the file defines."""
        found = []
        for number, line in enumerate(self.lines, 1):
            if match := _FUNCTION.match(line):
                end = next((k for k in range(number, len(self.lines)) if self.lines[k].startswith("}")), len(self.lines) - 1)
                found.append(Definition(match["name"], number, end + 1, bool(match["static"])))
        return tuple(found)

    @cached_property
    def static_objects(self) -> tuple[Definition, ...]:
        """Constants that no other unit sees."""
        matches = ((number, _OBJECT.match(line)) for number, line in enumerate(self.lines, 1))
        return tuple(Definition(match["name"], number, number, True) for number, match in matches if match)

    def users(self, name: str) -> tuple[Definition, ...]:
        """Return the functions whose definition uses a name other than as a member."""
        word = re.compile(rf"(?<![\w.>]){name}\b")
        return tuple(each for each in self.functions if any(word.search(line) for line in self.lines[each.line - 1 : each.end]))

    def function_at(self, line: int) -> str:
        """Return the name of the function that a line belongs to, "" at file scope."""
        return next((each.name for each in self.functions if each.line <= line <= each.end), "")

    def mentions(self, name: str) -> int:
        """Return the number of occurrences of a name in the file."""
        word = re.compile(rf"\b{name}\b")
        return sum(len(word.findall(line)) for line in self.lines)


def units(files: Mapping[str, bytes]) -> tuple[Unit, ...]:
    """Return the ECU sources among the files of a build, sorted by path."""
    paths = sorted(path for path in files if path.startswith("src/") and path.endswith(".c"))
    return tuple(Unit(path, files[path].decode("ascii", "replace")) for path in paths)
