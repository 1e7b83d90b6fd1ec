"""Modified condition/decision coverage of the generated C by the project's own tests, with Debian's clang.

For every condition of every decision, two of the tests' calls must show that it alone decides: unique-cause MC/DC, with masking
only as far as "&&" and "||" leave the rest unasked.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.coverage.coverage import exercise
from tests.sil.case import Case, case_of
from tests.sil.library import FLAGS, Compiler
from tests.sil.suite import Judge, whole

SHOWS = "the project's own tests show of every condition of the generated C that it decides by itself"
VERSION = "19"
"""Of clang and its tools: older ones do not know MC/DC."""


@dataclass(frozen=True)
class Condition:
    """One condition of a decision of several.

    Attributes:
        path: of the unit, with its build. text: as it stands in the C.
    """

    path: str
    line: int
    text: str
    covered: bool


def run(folders: Sequence[Path], effort: Effort) -> Outcome:
    """The part of the campaign; the same, quick or not. Raises MissingTool: no clang of that version."""
    return outcome_of([condition for folder in folders for condition in measured(folder)])


def measured(folder: Path, judges_of: Callable[[Case], Sequence[Judge]] = whole) -> list[Condition]:
    """Every condition of every decision of several, for the units of a build.

    Raises:
        MissingTool: no clang of that version, with its tools. BuildError: a judge does not pass.
    """
    clang, profdata, cov = (_found(f"{name}-{VERSION}") for name in ("clang", "llvm-profdata", "llvm-cov"))
    with tempfile.TemporaryDirectory(prefix="ars-mcdc-") as name:
        root = Path(name).resolve()
        counted = (f"-fprofile-instr-generate={root}/%m.profraw", "-fcoverage-mapping", "-fcoverage-mcdc")
        case = case_of(folder, root, Compiler((clang,), FLAGS, counted))
        library = exercise(case, judges_of)
        _run([profdata, "merge", *map(str, sorted(root.glob("*.profraw"))), "-o", f"{root}/all.profdata"])
        account = json.loads(_run([cov, "export", f"--instr-profile={root}/all.profdata", str(library)]))
        return [condition for file in account["data"][0]["files"] for condition in _conditions(case.name, root, file)]


def _found(name: str) -> str:
    path = shutil.which(name)
    if path is None:
        raise MissingTool("it is not installed", where=name, remedy=f"apt install clang-{VERSION} llvm-{VERSION}")
    return path


def _run(command: list[str]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BuildError(done.stderr.strip().partition("\n")[0] or "it failed", where=Path(command[0]).name)
    return done.stdout


def _conditions(build: str, root: Path, file: dict[str, Any]) -> Iterator[Condition]:
    path = Path(file["filename"])
    relative = (root / path).relative_to(root).as_posix()
    if not relative.startswith("src/"):
        return
    lines = (root / path).read_text(encoding="ascii").splitlines()
    branches = sorted({tuple(branch[:4]) for branch in file["branches"]})
    for record in file["mcdc_records"]:
        start, end = tuple(record[:2]), tuple(record[2:4])
        inside = [place for place in branches if start <= place[:2] and place[2:] <= end]
        covered = record[-1]
        if len(inside) != len(covered):
            raise BuildError(f"{len(inside)} conditions seen and {len(covered)} told", where=f"{relative}:{start[0]}")
        for place, is_covered in zip(inside, covered, strict=True):
            yield Condition(f"{build}/{relative}", place[0], _text(lines, place), bool(is_covered))


def _text(lines: list[str], place: tuple[int, ...]) -> str:
    first, begin, last, end = place
    taken = lines[first - 1 : last]
    taken[-1] = taken[-1][: end - 1]
    taken[0] = taken[0][begin - 1 :]
    return " ".join(" ".join(taken).split())


def outcome_of(conditions: Sequence[Condition]) -> Outcome:
    """Passed where every condition decides."""
    missed = [one for one in conditions if not one.covered]
    findings = [f"{one.path}:{one.line}: `{one.text}` was never shown to decide" for one in missed]
    if not conditions:
        findings = ["nothing was measured"]
    covered = len(conditions) - len(missed)
    figure = f"{covered:,} of {len(conditions):,} conditions decide"
    figures = {"conditions": len(conditions), "covered": covered}
    return Outcome(SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, tuple(findings), figures)
