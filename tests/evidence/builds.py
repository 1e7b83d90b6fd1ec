"""Part "builds": every check of `codegen verify` on the committed builds. A full run stores its record in each build."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

from codegen.verify import record, runner
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.runner import CHECKS, SLOWEST_FIRST, Registered, VerificationReport
from tests.evidence.progress import Progress

SHOWS = "all checks of `codegen verify` pass on the committed builds"
THREAD_COUNT = 2


def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
    """Run the checks, two at a time, slowest first."""
    subjects = {folder: Subject.read(folder) for folder in folders}
    chosen = sorted(
        (check for check in CHECKS if check.quick or not effort.quick), key=lambda one: SLOWEST_FIRST.index(one.name)
    )
    steps = [(folder, check) for check in chosen for folder in folders]

    def step(one: tuple[Path, Registered]) -> Outcome:
        folder, check = one

        def make() -> dict[str, Any]:
            report = runner.run(subjects[folder], Effort(effort.quick), checks=[check])
            return asdict(report.outcomes[check.name])

        values = progress.once(f"{folder.name} {check.name}", make)
        return Outcome(**{**values, "verdict": Verdict(values["verdict"])})

    with ThreadPoolExecutor(THREAD_COUNT) as pool:
        outcomes = dict(zip(steps, pool.map(step, steps), strict=True))
    if not effort.quick:
        for folder, subject in subjects.items():
            ordered = {check.name: outcomes[folder, check] for check in CHECKS}
            record.write(VerificationReport(subject, effort, ordered), folder)
    return _summary(outcomes)


def _summary(outcomes: dict[tuple[Path, Registered], Outcome]) -> Outcome:
    findings = [f"{folder.name}: {check.name}: {finding}" for (folder, check), outcome in outcomes.items()
                if outcome.verdict is not Verdict.PASSED for finding in outcome.findings]  # fmt: skip
    verdicts = {outcome.verdict for outcome in outcomes.values()}
    verdict = next(one for one in (Verdict.FAILED, Verdict.NOT_RUN, Verdict.PASSED) if one in verdicts)
    passed = sum(outcome.verdict is Verdict.PASSED for outcome in outcomes.values())
    figures = {f"{folder.name} {check.name}": outcome.figure for (folder, check), outcome in outcomes.items()}
    tools = {name: version for outcome in outcomes.values() for name, version in outcome.tools.items()}
    return Outcome(SHOWS, f"{passed} of {len(outcomes)} checks passed", verdict, tuple(findings), figures, tools=tools)
