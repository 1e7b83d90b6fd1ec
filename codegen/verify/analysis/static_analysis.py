"""Compare the findings of static analysers with the `deviations.md` of a build: every finding is listed, and nothing else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

from codegen.emit.deviations import DEVIATIONS_FILE, Deviation, SourceFile, category_of, excerpt, read_deviations, units
from codegen.emit.misra_rules import RULES
from codegen.errors import BuildError, CodegenError
from codegen.verify import on_host
from codegen.verify.analysis import analysers
from codegen.verify.analysis.analysers import Finding, once
from codegen.verify.analysis.number_tables import malformed, without_tables
from codegen.verify.on_host import COMPILED_PROGRAMS, HOST_PROGRAMS
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool
from codegen.verify.target import source_tree

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
        found = [*analysers.judged_by_misra(tree), *analysers.judged_as_programs(tree, programs)]
        by_gcc: tuple[Finding, ...] = ()
        left: tuple[str, ...] = ()
        not_run = ""
        try:
            if (gcc := on_host.gcc()) is None:
                raise MissingTool(on_host.GCC_MISSING)
            by_gcc, left = analysers.analyse(gcc, _units(subject, effort), tree)
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
    return {path: () if effort.quick and path.startswith(HOST_PROGRAMS) else analysers.DEEP for path in paths}


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
            "checks_left_out": dict(analysers.NOT_FOR_LIBRARIES),
        },
        tools={"cppcheck": analysers.program_version(), **({"gcc": on_host.gcc_version(gcc)} if gcc else {})},
    )


def _tool(rule: str) -> str:
    return "MISRA C:2012" if rule in RULES else "gcc" if rule.startswith((GCC_PREFIX, "gcc")) else "cppcheck"


def _by_number(rule: str) -> tuple[bool, list[int], str]:
    return rule not in RULES, [int(part) for part in rule.split(".")] if rule in RULES else [], rule
