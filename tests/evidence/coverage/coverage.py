"""Part "coverage": lines and branches of the generated C that the project's tests execute, measured by gcc and gcovr."""

import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from codegen.errors import BuildError
from codegen.verify.outcomes import Effort, Outcome, Verdict
from codegen.verify.tools import MissingTool, require
from tests.evidence.progress import Progress
from tests.sil.case import Case, committed
from tests.sil.library import FLAGS, Compiler
from tests.sil.suite import whole

SHOWS = "the project's own tests execute every line and every branch of the generated C"
MEASURING = ("--coverage", "-fprofile-abs-path")


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part. A quick run is identical to a full one."""
    return outcome_of([one for folder in folders for one in progress.once(folder.name, lambda folder=folder: measured(folder))])


def measured(folder: Path) -> list[dict[str, Any]]:
    """Return the coverage of each unit of a build: path, counts, and a text for each line or branch that is not executed.

    Raises:
        MissingTool: gcc, gcov or gcovr is missing. BuildError: a judge fails.
    """
    gcc, gcov = (find_tool(name, "gcc") for name in ("gcc", "gcov"))
    require("gcovr")
    with tempfile.TemporaryDirectory(prefix="ars-coverage-") as name:
        root = Path(name).resolve()
        case = committed(folder, root, Compiler((gcc,), FLAGS, MEASURING))
        exercise(case)
        report = root / "coverage.json"
        gcovr = [sys.executable, "-m", "gcovr", "--root", str(root), "--gcov-executable", gcov, "--filter", f"{root}/src/"]
        run_tool([*gcovr, "--json", str(report), str(root / "src")], root)
        files = json.loads(report.read_text(encoding="utf-8"))["files"]
        return [_unit(case.name, file) for file in files]


def find_tool(name: str, package: str) -> str:
    """Return the path of a program. Raises MissingTool."""
    path = shutil.which(name)
    if path is None:
        raise MissingTool("it is not installed", where=name, remedy=f"apt install {package}")
    return path


def run_tool(command: Sequence[str], folder: Path) -> str:
    """Return the output of a program. Raises BuildError if it fails."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BuildError(done.stderr.strip().rpartition("\n")[2] or "it failed", where=" ".join(command[:3]))
    return done.stdout


def exercise(case: Case) -> Path:
    """Compile the units with counters, run the judges, and return the library. Closing it writes the counts.

    Raises:
        BuildError: a judge fails.
    """
    case.compile()
    for judge in whole(case.kind):
        try:
            judge.run(case)
        except Exception as error:
            reason = f"{type(error).__name__} {error}".strip().partition("\n")[0]
            raise BuildError(f"the unaltered C fails {judge.name}: {reason}", where=case.name) from error
    case.opened.close()
    return case.library


def _unit(build: str, file: dict[str, Any]) -> dict[str, Any]:
    path = f"{build}/{file['file']}"
    lines = {line["line_number"]: line for line in file["lines"] if not line.get("gcovr/noncode")}
    idle = [number for number, line in lines.items() if line["count"] == 0]
    branches = [(number, k, each["count"]) for number, line in lines.items() for k, each in enumerate(line["branches"])]
    untaken = [(number, k) for number, k, count in branches if count == 0]
    missed = [f"{path}:{number}: never runs" for number in idle]
    missed += [f"{path}:{number}: branch {k} is never taken" for number, k in untaken if number not in idle]
    counts = {"lines": len(lines), "lines_run": len(lines) - len(idle)}
    return {"path": path, **counts, "branches": len(branches), "branches_taken": len(branches) - len(untaken), "missed": missed}


def outcome_of(units: Sequence[dict[str, Any]]) -> Outcome:
    """Return the outcome: passed if every line and branch is executed."""
    findings = [text for unit in units for text in unit["missed"]] if units else ["nothing was measured"]
    names = ("lines_run", "lines", "branches_taken", "branches")
    run, lines, taken, branches = (sum(unit[name] for unit in units) for name in names)
    figure = f"{run:,} of {lines:,} lines, {taken:,} of {branches:,} branches"
    figures = {unit["path"]: {name: unit[name] for name in names} for unit in units}
    return Outcome(SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, tuple(findings), figures)
