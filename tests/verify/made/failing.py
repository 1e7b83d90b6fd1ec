"""A check that fails with many findings."""

from __future__ import annotations

from codegen.verify.check import Effort, Outcome, Subject, Verdict


def check(subject: Subject, effort: Effort) -> Outcome:
    return Outcome("It shows a fault", "12 faults", Verdict.FAILED, tuple(f"src/x.c:{line}: wrong" for line in range(12)))
