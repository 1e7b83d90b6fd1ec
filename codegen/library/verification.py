"""Verification of the C of a build."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from codegen.errors import CheckFailed
from codegen.files import write_atomically
from codegen.judgement.build_warnings import read_record
from codegen.library.builds import BuildLike, edited_notes, folder_of
from codegen.library.result import PathLike, Progress, Result, Work, path_of, public
from codegen.requirements import packages_of, pip_install
from codegen.sil.software import require_can_side
from codegen.verify import record, requirements, runner
from codegen.verify.outcomes import Effort, Subject, Verdict
from codegen.verify.runner import VerificationReport


class Verification(Result):
    """Result of a verification.

    Attributes:
        passed: whether no check failed, and at least one was run.
        verdicts: name of each check -> "passed", "failed" or "not run".
        folder: folder of the build, where `verify.json` and `verify.md` are.
    """

    def __init__(self, folder: Path, report: VerificationReport) -> None:
        self.folder, self._report = folder, report
        self._found = self._kept = record.to_dict(report)
        self.notes = edited_notes(folder, report.subject.edited)
        self.verdicts = {name: str(outcome.verdict) for name, outcome in report.outcomes.items()}
        self._written = record.write(report, folder)
        if not self._written:
            self._kept = read_record(folder) or self._found
            kept = f"{folder / record.JSON} and {record.MANUAL} record a full run on the same files and are kept"
            self.notes = (*self.notes, kept)
        if report.failed:
            what = f"{len(report.failed)} of {len(report.outcomes)} checks failed: {', '.join(report.failed)}"
            self.failure = CheckFailed(what, where=folder)
        elif not report.count(Verdict.PASSED):
            remedy = pip_install(*packages_of("verify"))
            self.failure = CheckFailed("no check could be run", where=folder, remedy=remedy)
        self.passed = self.failure is None

    def save(self, path: PathLike) -> None:
        """Write the result as JSON."""
        write_atomically(path_of(path, "the path of a JSON file"), record.render(self._found))

    def save_requirements(self, path: PathLike) -> None:
        """Write the requirements with their evidence and results as CSV: after a quick run those of a recorded full run."""
        write_atomically(path_of(path, "the path of a CSV file"), requirements.table(self._kept["requirements"]))

    def lines(self) -> Iterator[str]:
        """Yield a table of the checks, what they found, and their numbers."""
        yield record.table(self._report)
        yield from record.findings(self._report)
        if self._written:
            yield f"written: {self.folder / record.JSON}, {self.folder / record.MANUAL}"
        if self.failure is None:
            harnesses = self._found["checks"].get("contracts", {}).get("figures", {}).get("harnesses", {})
            open_count = sum(verdict == "open" for verdict in harnesses.values())
            counts = {"not run": self._report.count(Verdict.NOT_RUN), "contracts open": open_count}
            more = "".join(f", {count} {what}" for what, count in counts.items() if count)
            yield f"{self._report.count(Verdict.PASSED)} checks passed{more}"

    def to_dict(self) -> dict[str, Any]:
        """Return the content of `verify.json`."""
        return self._found


@public
def verify(build: BuildLike, *, quick: bool = False, progress: Progress | None = None) -> Verification:
    """Verify the C of a build, and write `verify.json` and `verify.md`, the safety manual, into its folder.

    Compiles it for ECU cores, analyses it, runs it on emulated processors, counts its instructions, proves its bounds, and
    tests it with faults and random bytes. A check whose tool is missing is reported as not run.

    Args:
        build: a build, or the path of its folder.
        quick: run only the checks that finish in half a minute.
        progress: called with the share of the work that is done.

    Raises:
        CodegenError: it is no build, or its folder cannot be written.
    """
    folder = folder_of(build)
    subject = Subject.read(folder)
    require_can_side(subject.manifest, folder)
    record.require_place(folder)
    with Work(progress).stage(f"verifying {folder}") as tell, without_main():
        report = runner.run(subject, Effort(quick), tell)
    return Verification(folder, report)


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """Let processes start without the user's script, which would otherwise run again in each of them.

    They need only modules of this package. `multiprocessing` otherwise demands `if __name__ == "__main__"` in the script.
    """
    script = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = script
