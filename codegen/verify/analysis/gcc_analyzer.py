"""gcc's -fanalyzer over single units, at the optimisation that is shipped.

As with cppcheck, a unit with a fault goes first: where it is not found, this gcc does not analyse.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from codegen.errors import BuildError
from codegen.sil.toolchain import require_success, run
from codegen.verify.analysis.findings import Finding, once, plain
from codegen.verify.packages import MissingTool

FLAGS = (
    *("-std=c99", "-O2", "-ffp-contract=off", "-fanalyzer", "-Wanalyzer-too-complex", "-fdiagnostics-plain-output"),
    # Far beyond gcc's own limits, so that every path of what goes into an ECU is followed to its end.
    *("--param", "analyzer-bb-explosion-factor=100", "--param", "analyzer-max-enodes-per-program-point=400"),
)
LEFT = "-Wanalyzer-too-complex"
"""What gcc says where it leaves a path. Not a finding."""

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
    """What gcc found.

    Attributes:
        findings: once each.
        left: sources in which it did not follow every path to its end.
    """

    findings: tuple[Finding, ...]
    left: tuple[str, ...]


def analyse(program: str, units: Sequence[str], tree: Path) -> Analysis:
    """Look at each of the units.

    Args:
        program: gcc.
        units: paths below `tree`, which also gets the unit with a fault.

    Raises:
        MissingTool: this gcc does not analyse.
        BuildError: a unit does not compile.
    """
    (tree / CANARY).write_text(CANARY_TEXT, encoding="ascii")
    try:
        planted = _told(program, CANARY, tree)
    except BuildError:  # too old to know the flags
        planted = []
    if CANARY_FAULT not in {finding.rule for finding in planted}:
        raise MissingTool("it does not find what was planted for it", where="gcc -fanalyzer", remedy="take a newer gcc")
    told = {unit: _told(program, unit, tree) for unit in units}
    left = tuple(unit for unit in units if any(finding.rule == LEFT for finding in told[unit]))
    return Analysis(once(finding for unit in units for finding in told[unit] if finding.rule != LEFT), left)


def _told(program: str, unit: str, tree: Path) -> list[Finding]:
    result = run([program, *FLAGS, "-Iinclude", "-c", unit, "-o", f"../{Path(unit).name}.o"], tree)
    require_success(result, unit)
    return [
        Finding(plain(match["file"]), int(match["line"]), match["rule"], match["text"])
        for match in _WARNING.finditer(result.stderr)
    ]
