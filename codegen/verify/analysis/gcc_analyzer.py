"""Run gcc -fanalyzer on single units at the optimisation level of a release.

A unit with a planted fault is analysed first. If gcc misses it, this gcc does not support the analysis.

As with cppcheck, a unit with a fault goes first: where it is not found, this gcc does not support -fanalyzer.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.errors import BuildError
from codegen.sil.toolchain import require_success, run
from codegen.verify.analysis.findings import Finding, once, plain
from codegen.verify.packages import MissingTool

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fanalyzer", "-Wanalyzer-too-complex", "-fdiagnostics-plain-output")
DEEP = ("--param", "analyzer-bb-explosion-factor=100", "--param", "analyzer-max-enodes-per-program-point=400")
"""Limits far above gcc's defaults, so that every path is followed to its end."""
LEFT = "-Wanalyzer-too-complex"
"""Warning for a path that gcc gave up; not a finding."""

CANARY = "analyzer_canary.c"
CANARY_TEXT = """int analyzer_canary(int count);
int analyzer_canary(int count)
{
    int *nowhere = 0;
    if (count > 7) {
        return *nowhere;
    }
    return count;
}
"""
CANARY_FAULT = "-Wanalyzer-null-dereference"

_WARNING = re.compile(
    r"^(?P<file>[^\s:][^:\n]*):(?P<line>\d+):(?:\d+:)? warning: (?P<text>.*) \[(?P<rule>-Wanalyzer-[\w-]+)\]$", re.MULTILINE
)


@dataclass(frozen=True)
class Analysis:
    """Result of an analysis.

    Attributes:
        findings: without duplicates.
        left: sources in which gcc did not follow every path to its end.
    """

    findings: tuple[Finding, ...]
    left: tuple[str, ...]


def analyse(program: str, units: Mapping[str, Sequence[str]], tree: Path) -> Analysis:
    """Analyse units one by one.

    Args:
        program: gcc.
        units: path below `tree` -> flags in addition to FLAGS. The unit with the planted fault is written to `tree` too.

    Raises:
        MissingTool: this gcc does not support -fanalyzer.
        BuildError: a unit does not compile.
    """
    (tree / CANARY).write_text(CANARY_TEXT, encoding="ascii")
    try:
        planted = _run_gcc(program, CANARY, (), tree)
    except BuildError:  # too old to know the flags
        planted = []
    if CANARY_FAULT not in {finding.rule for finding in planted}:
        raise MissingTool("it does not find what was planted for it", where="gcc -fanalyzer", remedy="take a newer gcc")
    reported = {unit: _run_gcc(program, unit, flags, tree) for unit, flags in units.items()}
    left = tuple(unit for unit in units if any(finding.rule == LEFT for finding in reported[unit]))
    return Analysis(once(finding for unit in units for finding in reported[unit] if finding.rule != LEFT), left)


def _run_gcc(program: str, unit: str, flags: Sequence[str], tree: Path) -> list[Finding]:
    result = run([program, *FLAGS, *flags, "-Iinclude", "-c", unit, "-o", f"../{Path(unit).name}.o"], tree)
    require_success(result, unit)
    return [
        Finding(plain(match["file"]), int(match["line"]), match["rule"], match["text"])
        for match in _WARNING.finditer(result.stderr)
    ]
