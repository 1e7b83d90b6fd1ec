"""Deviations of the generated C from MISRA C:2012 and findings of checkers, with their reasons: `deviations.md`.

The build does not run the checkers. `codegen verify` checks that the list is complete and has no obsolete entry.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from codegen.emit.c_outline import Unit, units
from codegen.emit.misra_rules import RULES, category

FILE = "deviations.md"

CHECKER = "checker"
"""Category of a finding that a checker reports by its own rules, not by those of MISRA."""

CODE_MAX = 90

_ROW = re.compile(
    r"\| (?P<file>\S+) \| (?P<line>\d+) \| (?P<rule>\S+) \| (?P<category>\w+) \| `(?P<code>.*)` \| (?P<reason>.+) \|"
)


@dataclass(frozen=True)
class Deviation:
    """One row of `deviations.md`.

    Attributes:
        file, line: location; lines count from 1.
        rule: number of a MISRA rule, or the checker's own name of the finding.
        code: excerpt of the line, see `excerpt`.
        reason: reason for the deviation.
    """

    file: str
    line: int
    rule: str
    code: str
    reason: str
    category: str

    @property
    def row(self) -> str:
        """The deviation as a row of the table."""
        code = self.code.replace("|", "\\|")
        return f"| {self.file} | {self.line} | {self.rule} | {self.category} | `{code}` | {self.reason} |"


def category_of(rule: str) -> str:
    """Return the category of a MISRA rule by its number, `CHECKER` for a checker's own finding."""
    return category(rule) if rule in RULES else CHECKER


def excerpt(line: str) -> str:
    """Return a line of C as `deviations.md` prints it."""
    text = " ".join(line.split())
    return text if len(text) <= CODE_MAX else f"{text[: CODE_MAX - 3]}..."


Places = Iterator[tuple[Unit, int]]


@dataclass(frozen=True)
class Entry:
    """A deviation from a rule: a function that finds its locations in the code, and the reason."""

    rule: str
    find: Callable[[tuple[Unit, ...]], Places]
    reason: str


def _names_of_several_units(sources: tuple[Unit, ...]) -> Places:
    """Yield static functions and objects that have the same name as one in another unit."""
    defined = [(unit, each) for unit in sources for each in (*unit.functions, *unit.static_objects) if each.static]
    for unit, each in defined:
        if any(other.name == each.name and place is not unit for place, other in defined):
            yield unit, each.line


def _objects_of_one_function(sources: tuple[Unit, ...]) -> Places:
    """Yield static objects at file scope that only one function uses."""
    for unit in sources:
        yield from ((unit, each.line) for each in unit.static_objects if len(unit.users(each.name)) == 1)


def _functions_for_callers(sources: tuple[Unit, ...]) -> Places:
    """Yield external functions that nothing in the build calls."""
    for unit in sources:
        for each in unit.functions:
            if not each.static and sum(source.mentions(each.name) for source in sources) == 1:
                yield unit, each.line


def _unions(sources: tuple[Unit, ...]) -> Places:
    """Yield lines that declare a union or an object of its type."""
    for unit in sources:
        text = "\n".join(unit.lines)
        names = re.findall(r"^typedef union \{[^}]*\} (\w+);", text, re.MULTILINE)
        ends = {text.count("\n", 0, each.end()) + 1 for each in re.finditer(r"\bunion \{[^}]*\} \w+ =", text)}
        found = re.compile("|".join((r"\bunion\b", *(rf"\b{name} \w+(?: =|;|\[)" for name in names))))
        yield from ((unit, number) for number, line in enumerate(unit.lines, 1) if found.search(line) or number in ends)


_CONDITION = re.compile(r"if \((\w+) (<=?|>=?) ([^()|&]*(?:\(\w+\)\w+)?)\) \{$")
_OPPOSITE = {"<": ">=", ">=": "<", ">": "<=", "<=": ">"}


def _opposite_comparisons(sources: tuple[Unit, ...]) -> Places:
    """Yield every `else if` whose condition is the opposite of an earlier one in its chain."""
    for unit in sources:
        chain: set[tuple[str, ...]] = set()
        for number, line in enumerate(unit.lines, 1):
            match = _CONDITION.search(line)
            if match is None:
                continue
            left, operator, right = match.groups()
            if not line.lstrip().startswith("} else"):
                chain = set()
            elif (left, _OPPOSITE[operator], right) in chain:
                yield unit, number
            chain.add((left, operator, right))


ENTRIES = (
    Entry(
        "5.9",
        _names_of_several_units,
        "each unit brings its own small helpers, so that it can be read, tested and taken alone; the limiter must share "
        "nothing with what it guards",
    ),
    Entry(
        "8.7",
        _functions_for_callers,
        "part of the public interface: its callers are in the ECU project, not in this build",
    ),
    Entry(
        "8.9",
        _objects_of_one_function,
        "constants stand together at the head of their unit, with unit and meaning, where a reviewer and the linker's sections "
        "look for them",
    ),
    Entry(
        "19.2",
        _unions,
        "the bits of a number without a cast of pointers; both members have one size",
    ),
    Entry(
        "multiCondition",
        _opposite_comparisons,
        "no comparison is the opposite of another where a number may be NaN: both are false then, and the else acts",
    ),
)


def deviations(files: Mapping[str, bytes]) -> tuple[Deviation, ...]:
    """Return every deviation of a build's sources, sorted by file, line and rule.

    Args:
        files: content by path.
    """
    sources = units(files)
    found = {
        (unit.path, line, entry.rule): Deviation(
            unit.path, line, entry.rule, excerpt(unit.text.split("\n")[line - 1]), entry.reason, category_of(entry.rule)
        )
        for entry in ENTRIES
        for unit, line in entry.find(sources)
    }
    return tuple(found[key] for key in sorted(found))


def read_deviations(text: str) -> tuple[tuple[int, Deviation], ...]:
    """Parse the deviations in a `deviations.md`, each with the line number of its row.

    Raises:
        ValueError: malformed row; the message names the line.
    """
    rows = []
    body = False
    for number, line in enumerate(text.splitlines(), 1):
        if body and line.startswith("|"):
            match = _ROW.fullmatch(line)
            if match is None:
                raise ValueError(f"line {number} is not a row of the table")
            code = match["code"].replace("\\|", "|")
            row = Deviation(match["file"], int(match["line"]), match["rule"], code, match["reason"], match["category"])
            rows.append((number, row))
        body = body or line.startswith("|---")
    return tuple(rows)
