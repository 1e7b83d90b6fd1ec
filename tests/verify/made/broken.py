"""A check with a fault of its own."""

from __future__ import annotations

from codegen.verify.check import Effort, Outcome, Subject


def check(subject: Subject, effort: Effort) -> Outcome:
    raise RuntimeError("a fault of the program")
