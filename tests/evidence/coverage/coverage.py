"""Coverage of the generated C by the project's own tests: lines and branches, by gcc's counters, read by gcovr."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Verdict
from codegen.verify.packages import MissingTool, require
from tests.sil.case import Case, case_of
from tests.sil.library import FLAGS, Compiler
from tests.sil.suite import Judge, whole

SHOWS = "the project's own tests run every line and every branch of the generated C"
COUNTED = ("--coverage", "-fprofile-abs-path")


@dataclass(frozen=True)
class Covered:
    """What a unit's lines and branches are, and what of them was never run.

    Attributes:
        path: of the unit, with its build. lines, branches: how many there are.
        missed: each line, or branch of a line, that was not run, in words.
    """

    path: str
    lines: int
    branches: int
    lines_missed: int
    branches_missed: int
    missed: tuple[str, ...]


def run(folders: Sequence[Path], effort: Effort) -> Outcome:
    """The part of the campaign; the same, quick or not."""
    return outcome_of([unit for folder in folders for unit in measured(folder)])


def measured(folder: Path, judges_of: Callable[[Case], Sequence[Judge]] = whole) -> list[Covered]:
    """Coverage of each unit of a build.

    Raises:
        MissingTool: there is no gcc, gcov or gcovr. BuildError: a judge does not pass.
    """
    gcc, gcov = (_found(name) for name in ("gcc", "gcov"))
    require("gcovr")
    with tempfile.TemporaryDirectory(prefix="ars-coverage-") as name:
        root = Path(name).resolve()
        case = case_of(folder, root, Compiler((gcc,), FLAGS, COUNTED))
        exercise(case, judges_of)
        return [_of_unit(case.name, one) for one in _read(root, gcov)]


def _found(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        raise MissingTool("it is not installed", where=name, remedy="apt install gcc")
    return path


def exercise(case: Case, judges_of: Callable[[Case], Sequence[Judge]]) -> Path:
    """Compile the units so that they count, run the judges, and let the counts be written. Gives the library.

    Raises:
        BuildError: a judge does not pass.
    """
    case.compiler.compile_all(case.tree)
    path = case.tree.root / "counted.so"
    case.open(path)
    for judge in judges_of(case):
        try:
            judge.run(case)
        except Exception as error:
            said = f"{type(error).__name__} {error}".strip().partition("\n")[0]
            raise BuildError(f"unaltered, it fails {judge.name}: {said}", where=case.name) from error
    case.opened.close()
    return path


def _read(root: Path, gcov: str) -> list[dict[str, Any]]:
    """gcovr's account of each source."""
    target = root / "coverage.json"
    command = [sys.executable, "-m", "gcovr", "--root", str(root), "--gcov-executable", gcov, "--filter", f"{root}/src/"]
    done = subprocess.run(
        [*command, "--json", str(target), str(root / "src")], cwd=root, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise BuildError(done.stderr.strip().rpartition("\n")[2] or "it failed", where="gcovr")
    files: list[dict[str, Any]] = json.loads(target.read_text(encoding="utf-8"))["files"]
    return files


def _of_unit(build: str, account: dict[str, Any]) -> Covered:
    lines = [line for line in account["lines"] if not line.get("gcovr/noncode")]
    branches = [
        (line["line_number"], number, branch["count"]) for line in lines for number, branch in enumerate(line["branches"])
    ]
    path = f"{build}/{account['file']}"
    idle = [line["line_number"] for line in lines if line["count"] == 0]
    untaken = [(line, number) for line, number, count in branches if count == 0]
    missed = [f"{path}:{line}: never run" for line in idle]
    missed += [f"{path}:{line}: branch {number} never taken" for line, number in untaken if line not in idle]
    return Covered(path, len(lines), len(branches), len(idle), len(untaken), tuple(missed))


def outcome_of(units: Sequence[Covered]) -> Outcome:
    """Passed where nothing was missed."""
    lines, branches = sum(unit.lines for unit in units), sum(unit.branches for unit in units)
    ran, took = lines - sum(unit.lines_missed for unit in units), branches - sum(unit.branches_missed for unit in units)
    findings = tuple(text for unit in units for text in unit.missed)
    if not units:
        findings = ("nothing was measured",)
    figure = f"{ran:,} of {lines:,} lines, {took:,} of {branches:,} branches"
    figures = {
        unit.path: {
            "lines": unit.lines,
            "lines_run": unit.lines - unit.lines_missed,
            "branches": unit.branches,
            "branches_taken": unit.branches - unit.branches_missed,
        }
        for unit in units
    }
    return Outcome(SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, findings, figures)
