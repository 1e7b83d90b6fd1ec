"""Deviations of the generated C from MISRA C:2012 and findings of checkers, with their reasons: `deviations.md`.

The build does not run the checkers. `codegen verify` checks that the list is complete and has no obsolete entry. Rules about
names need an outline of the sources: objects and functions at file scope, and their users. Its parser relies on the layout of
the templates: a definition starts in the first column, a function definition with its section macro, and a brace in the first
column ends it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from codegen.emit.misra_rules import RULES, category

_APART = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"', re.DOTALL)
_WORD = re.compile(r"\w+")
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
class SourceFile:
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

    @cached_property
    def mentions(self) -> Counter[str]:
        """Number of occurrences of each name in the file."""
        return Counter(word for line in self.lines for word in _WORD.findall(line))


def units(files: Mapping[str, bytes]) -> tuple[SourceFile, ...]:
    """Return the ECU sources among the files of a build, sorted by path."""
    paths = sorted(path for path in files if path.startswith("src/") and path.endswith(".c"))
    return tuple(SourceFile(path, files[path].decode("ascii", "replace")) for path in paths)


DEVIATIONS_FILE = "deviations.md"

CHECKER = "checker"
"""Category of a finding that a checker reports by its own rules, not by those of MISRA."""

CODE_MAX = 90

_ROW = re.compile(
    r"\| (?P<file>\S+) \| (?P<function>\w*) ?\| (?P<rule>\S+) \| (?P<category>\w+) \| `(?P<code>.*)` \| (?P<reason>.+) \|"
)


@dataclass(frozen=True)
class Deviation:
    """One row of the table. It applies to every line of its function with the same text, so that added lines change nothing.

    Attributes:
        file, function: location; function is "" at file scope.
        rule: number of a rule, or a checker's own name for what it finds.
        code: text of the line, see `excerpt`.
        reason: for the deviation.
    """

    file: str
    function: str
    rule: str
    code: str
    reason: str
    category: str

    @property
    def row(self) -> str:
        """The deviation as a row of the table."""
        code = self.code.replace("|", "\\|")
        function = f"{self.function} " if self.function else ""
        return f"| {self.file} | {function}| {self.rule} | {self.category} | `{code}` | {self.reason} |"

    @property
    def key(self) -> tuple[str, str, str, str]:
        """File, function, rule and text: unique in a table."""
        return self.file, self.function, self.rule, self.code


def category_of(rule: str) -> str:
    """Return the category of a MISRA rule, or `CHECKER` for a finding by a checker's own rule."""
    return category(rule) if rule in RULES else CHECKER


def excerpt(line: str) -> str:
    """Return a line of C as `deviations.md` shows it."""
    text = " ".join(line.split())
    return text if len(text) <= CODE_MAX else f"{text[: CODE_MAX - 3]}..."


Places = Iterator[tuple[SourceFile, int]]


@dataclass(frozen=True)
class Entry:
    """A deviation from a rule: a function that finds its locations in the code, and the reason."""

    rule: str
    find: Callable[[tuple[SourceFile, ...]], Places]
    reason: str


def _names_of_several_units(sources: tuple[SourceFile, ...]) -> Places:
    """Yield static functions and objects whose name another unit also uses."""
    defined = [(unit, each) for unit in sources for each in (*unit.functions, *unit.static_objects) if each.static]
    for unit, each in defined:
        if any(other.name == each.name and place is not unit for place, other in defined):
            yield unit, each.line


def _objects_of_one_function(sources: tuple[SourceFile, ...]) -> Places:
    """Yield static objects at file scope that only one function uses."""
    for unit in sources:
        yield from ((unit, each.line) for each in unit.static_objects if len(unit.users(each.name)) == 1)


def _functions_for_callers(sources: tuple[SourceFile, ...]) -> Places:
    """Yield external functions that nothing in the build calls."""
    for unit in sources:
        for each in unit.functions:
            if not each.static and sum(source.mentions[each.name] for source in sources) == 1:
                yield unit, each.line


def _unions(sources: tuple[SourceFile, ...]) -> Places:
    """Yield lines that declare a union or an object of its type."""
    for unit in sources:
        text = "\n".join(unit.lines)
        names = re.findall(r"^typedef union \{[^}]*\} (\w+);", text, re.MULTILINE)
        ends = {text.count("\n", 0, each.end()) + 1 for each in re.finditer(r"\bunion \{[^}]*\} \w+ =", text)}
        found = re.compile("|".join((r"\bunion\b", *(rf"\b{name} \w+(?: =|;|\[)" for name in names))))
        yield from ((unit, number) for number, line in enumerate(unit.lines, 1) if found.search(line) or number in ends)


_CONDITION = re.compile(r"if \((\w+) (<=?|>=?) ([^()|&]*(?:\(\w+\)\w+)?)\) \{$")
_OPPOSITE = {"<": ">=", ">=": "<", ">": "<=", "<=": ">"}


def _opposite_comparisons(sources: tuple[SourceFile, ...]) -> Places:
    """Yield each `else if` whose condition is the opposite of an earlier one of its chain."""
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
        "each unit has its own small helpers, so that it can be read, tested and reused alone; the limiter must share nothing "
        "with the code that it guards",
    ),
    Entry(
        "8.7",
        _functions_for_callers,
        "part of the public interface: its callers are in the ECU project, not in this build",
    ),
    Entry(
        "8.9",
        _objects_of_one_function,
        "constants are grouped at the head of their unit, with unit and meaning, where reviewers and linker sections expect "
        "them",
    ),
    Entry(
        "19.2",
        _unions,
        "reads the bits of a number without a pointer cast; both members have the same size",
    ),
    Entry(
        "multiCondition",
        _opposite_comparisons,
        "no comparison is the opposite of another if a number may be NaN: both are then false, and the else branch applies",
    ),
)


def deviations(files: Mapping[str, bytes]) -> tuple[Deviation, ...]:
    """Return every deviation of a build's sources, in the order of the files and lines.

    Args:
        files: content by path.
    """
    sources = units(files)
    found: dict[tuple[str, str, str, str], Deviation] = {}
    places = [(unit, line, entry) for entry in ENTRIES for unit, line in entry.find(sources)]
    for unit, line, entry in sorted(places, key=lambda place: (place[0].path, place[1], place[2].rule)):
        code = excerpt(unit.text.split("\n")[line - 1])
        row = Deviation(unit.path, unit.function_at(line), entry.rule, code, entry.reason, category_of(entry.rule))
        found.setdefault(row.key, row)
    return tuple(found.values())


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
            row = Deviation(match["file"], match["function"], match["rule"], code, match["reason"], match["category"])
            rows.append((number, row))
        body = body or line.startswith("|---")
    return tuple(rows)
