"""Part "faults": each planted fault makes exactly the responsible checks of `codegen verify` fail.

Every check runs on every fault, in its quick form if it has one. The contracts run with the harnesses that include the changed
unit. The faults are in planted.txt.
"""

import dataclasses
import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from codegen.errors import CodegenError
from codegen.verify import contracts
from codegen.verify.cbmc import installed
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.runner import CHECKS
from codegen.verify.runner import run as run_checks
from codegen.verify.tools import stored
from tests.evidence.progress import Progress

SHOWS = "each planted fault makes exactly the responsible checks of codegen verify fail"
CONTRACT_TIME_LIMIT_S = 60.0
"""Time limit of each harness."""


class Fault(NamedTuple):
    """A fault: its kind, the unit without prefix, the checks that must fail, and texts of the unit with their replacements."""

    kind: str
    name: str
    unit: str
    found_by: tuple[str, ...]
    replacements: tuple[tuple[str, str], ...]


_FAULT = re.compile(r"^(?P<name>[^\n#+-].*) \((?P<unit>\w+)\):(?P<found>.*)\n(?P<changes>(?:[-+].*\n)+)", re.MULTILINE)
_CHANGE = re.compile(r"((?:^-.*\n)+)((?:^\+.*\n)+)", re.MULTILINE)


def read_faults(text: str) -> list[Fault]:
    """Return the faults in a text: headings of kinds after "## ", below each its faults."""
    faults = []
    for section in text.split("\n## ")[1:]:
        for fault in _FAULT.finditer(section):
            changes = _CHANGE.findall(fault["changes"])
            pairs = tuple((_code(old), _code(new)) for old, new in changes)
            faults.append(Fault(section.splitlines()[0], fault["name"], fault["unit"], tuple(fault["found"].split()), pairs))
    return faults


def _code(lines: str) -> str:
    """Return lines of code without their marks."""
    return "\n".join(line[2:] for line in lines.splitlines())


FAULTS = read_faults(Path(__file__).with_suffix(".txt").read_text(encoding="ascii"))
QUICK = "a broken invariant"
"""Fault of a quick run: the one that makes the most checks fail. All checks of one fault take minutes."""


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Plant each fault in the last build; a quick run plants one, because the tests of each check plant others."""
    subject = Subject.read(folders[-1])
    faults = [fault for fault in FAULTS if fault.name == QUICK or not effort.quick]
    found = {each.name: progress.once(each.name, partial(verdicts, planted(subject, each), each)) for each in faults}
    findings: list[str] = []
    for fault in faults:
        findings += [f"{fault.name}: {name} was not run: {reason}" for name, reason in found[fault.name]["not run"].items()]
        failed = found[fault.name]["failed"]
        if failed != sorted(fault.found_by):
            findings.append(
                f"{fault.name}: found by {' '.join(failed) or 'none'} instead of {' '.join(fault.found_by) or 'none'}"
            )
    kind_count, found_count = len({fault.kind for fault in faults}), sum(bool(each["failed"]) for each in found.values())
    figure = (
        f"{len(faults)} of {len(FAULTS)} faults planted, of {kind_count} kinds, {found_count} found, {len(findings)} findings"
    )
    verdict = Verdict.FAILED if findings else Verdict.PASSED
    figures = {fault.name: {"kind": fault.kind, "found by": found[fault.name]["failed"]} for fault in faults}
    return Outcome(SHOWS, figure, verdict, tuple(findings), figures)


def planted(subject: Subject, fault: Fault) -> Subject:
    """Return the build with a fault. Raises CodegenError unless each text to replace occurs exactly once."""
    path = f"src/{subject.prefix}_{fault.unit}.c"
    text = subject.files[path].decode("ascii")
    for old, new in fault.replacements:
        if (count := text.count(old)) != 1:
            raise CodegenError(f"a text of {fault.name!r} occurs {count} times", where=path, remedy="update planted.txt")
        text = text.replace(old, new)
    return dataclasses.replace(subject, files={**subject.files, path: text.encode("ascii")}, edited=(path,))


def verdicts(subject: Subject, fault: Fault) -> dict[str, object]:
    """Run every check; return the names of failed checks, and the reasons of those that did not run."""
    others = [dataclasses.replace(check, quick=True) for check in CHECKS if check.name != "contracts"]
    report = run_checks(subject, Effort(quick=True), checks=others)
    missing = {name: one.findings[0] for name, one in report.outcomes.items() if one.verdict is Verdict.NOT_RUN}
    source = f"src/{subject.prefix}_{fault.unit}.c".encode()
    proofs = [proof for proof in contracts.proofs_of(subject) if source in subject.files[proof.path]]
    with stored(subject.sources("include", "src", "verify")) as folder:
        results = contracts.prove(folder, proofs, installed(), CONTRACT_TIME_LIMIT_S)
    failed = [*report.failed, *(["contracts"] if any(one.verdict == "failed" for one in results) else [])]
    return {"failed": sorted(failed), "not run": missing}
