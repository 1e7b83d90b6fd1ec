"""Part "faults": each planted fault makes exactly the responsible checks of `codegen verify` fail.

Every check runs on every fault, in its quick form if it has one. A fault changes one line, so that no line number in
deviations.md moves. The faults are in planted.txt.
"""

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from codegen.errors import CodegenError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.runner import CHECKS
from codegen.verify.runner import run as run_checks
from tests.evidence.progress import Progress

SHOWS = "each planted fault makes exactly the responsible checks of codegen verify fail"


class Fault(NamedTuple):
    """A fault: the unit without prefix, the checks that must fail, text on one line of the unit, and the replacement."""

    name: str
    unit: str
    found_by: str
    old: str
    new: str


_FAULT = re.compile(r"^(.+) \((\w+)\): (.+)\n- (.+)\n\+ (.+)$", re.MULTILINE)
FAULTS = [Fault(*match.groups()) for match in _FAULT.finditer(Path(__file__).with_suffix(".txt").read_text(encoding="ascii"))]
QUICK = "a broken invariant"
"""Fault of a quick run: the one that makes the most checks fail. All checks of one fault take minutes."""


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Plant each fault in the first build; a quick run plants one, because the tests of each check plant others."""
    subject = Subject.read(folders[0])
    faults = [fault for fault in FAULTS if fault.name == QUICK or not effort.quick]
    found = {fault.name: progress.once(fault.name, lambda fault=fault: verdicts(planted(subject, fault))) for fault in faults}
    findings: list[str] = []
    for fault in faults:
        findings += [f"{fault.name}: {name} was not run: {reason}" for name, reason in found[fault.name]["not run"].items()]
        failed = " ".join(found[fault.name]["failed"])
        findings += (
            [f"{fault.name}: found by {failed or 'none'} instead of {fault.found_by}"] if failed != fault.found_by else []
        )
    figure = f"{len(faults)} of {len(FAULTS)} faults planted, {len(findings)} findings"
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    return Outcome(SHOWS, figure, verdict, tuple(findings), {name: result["failed"] for name, result in found.items()})


def planted(subject: Subject, fault: Fault) -> Subject:
    """Return the build with a fault. Raises CodegenError unless the text to replace occurs exactly once."""
    path = f"src/{subject.prefix}_{fault.unit}.c"
    text = subject.files[path].decode("ascii")
    count = text.count(fault.old)
    if count == 0 or (count > 1 and fault.unit != "can"):
        raise CodegenError(f"the text of {fault.name!r} occurs {count} times", where=path, remedy="update planted.txt")
    files = {**subject.files, path: text.replace(fault.old, fault.new).encode("ascii")}
    return dataclasses.replace(subject, files=files, edited=(path,))


def verdicts(subject: Subject) -> dict[str, object]:
    """Run every check; return the names of failed checks, and the reasons of those that did not run."""
    report = run_checks(subject, Effort(quick=True), checks=[dataclasses.replace(check, quick=True) for check in CHECKS])
    missing = {name: one.findings[0] for name, one in report.outcomes.items() if one.verdict is Verdict.NOT_RUN}
    return {"failed": sorted(report.failed), "not run": missing}
