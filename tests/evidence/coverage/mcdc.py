"""Part "mcdc": modified condition/decision coverage of the generated C by the project's tests, measured by clang.

For every condition of every decision, two calls in the tests must show that the condition alone determines the result. This is
unique-cause MC/DC, with masking only where "&&" and "||" skip the other conditions.
"""

import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from codegen.errors import BuildError
from codegen.verify.outcomes import Effort, Outcome, Verdict
from tests.evidence.coverage.coverage import exercise, find_tool, run_tool
from tests.evidence.progress import Progress
from tests.sil.case import committed
from tests.sil.library import FLAGS, Compiler

SHOWS = "the project's own tests show for every condition of the generated C that it alone can determine the result"
TOOLS = ("clang", "llvm-profdata", "llvm-cov")
VERSION = "19"
"""Version of clang and its tools; older ones lack MC/DC."""


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the part. A quick run is identical to a full one. Raises MissingTool: clang or one of its tools is missing."""
    return outcome_of([one for folder in folders for one in progress.once(folder.name, lambda folder=folder: measured(folder))])


def measured(folder: Path) -> list[tuple[str, str, bool]]:
    """Return place, text and coverage of each condition in decisions of several conditions, for the units of a build.

    Raises:
        MissingTool: clang or one of its tools is missing. BuildError: a judge fails.
    """
    clang, profdata, cov = (find_tool(f"{name}-{VERSION}", f"clang-{VERSION} llvm-{VERSION}") for name in TOOLS)
    with tempfile.TemporaryDirectory(prefix="ars-mcdc-") as name:
        root = Path(name).resolve()
        measuring = (f"-fprofile-instr-generate={root}/%m.profraw", "-fcoverage-mapping", "-fcoverage-mcdc")
        case = committed(folder, root, Compiler((clang,), FLAGS, measuring))
        library = exercise(case)
        run_tool([profdata, "merge", *map(str, sorted(root.glob("*.profraw"))), "-o", "all.profdata"], root)
        report = json.loads(run_tool([cov, "export", "--instr-profile=all.profdata", str(library)], root))
        return [one for file in report["data"][0]["files"] for one in _conditions(case.name, root, file)]


def _conditions(build: str, root: Path, file: dict[str, Any]) -> Iterator[tuple[str, str, bool]]:
    path = (root / file["filename"]).relative_to(root).as_posix()
    if not path.startswith("src/"):
        return
    lines = (root / path).read_text(encoding="ascii").splitlines()
    branches = sorted({tuple(branch[:4]) for branch in file["branches"]})
    for record in file["mcdc_records"]:
        start, end, covered = tuple(record[:2]), tuple(record[2:4]), record[-1]
        inside = [place for place in branches if start <= place[:2] and place[2:] <= end]
        if len(inside) != len(covered):
            raise BuildError(f"{len(inside)} conditions in {len(covered)} records", where=f"{path}:{start[0]}")
        for place, is_covered in zip(inside, covered, strict=True):
            yield f"{build}/{path}:{place[0]}", _text(lines, place), bool(is_covered)


def _text(lines: list[str], place: tuple[int, ...]) -> str:
    first, begin, last, end = place
    taken = [*lines[first - 1 : last - 1], lines[last - 1][: end - 1]]
    return " ".join(" ".join([taken[0][begin - 1 :], *taken[1:]]).split())


def outcome_of(conditions: Sequence[tuple[str, str, bool]]) -> Outcome:
    """Return the outcome: passed if every condition alone determines a result."""
    missed = [f"{place}: `{text}` is never shown to decide" for place, text, is_covered in conditions if not is_covered]
    covered = len(conditions) - len(missed)
    findings = missed if conditions else ["nothing was measured"]
    figure = f"{covered:,} of {len(conditions):,} conditions decide"
    figures = {"conditions": len(conditions), "covered": covered}
    return Outcome(SHOWS, figure, Verdict.FAILED if findings else Verdict.PASSED, tuple(findings), figures)
