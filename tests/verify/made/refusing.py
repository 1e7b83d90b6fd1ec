"""A check that cannot use the build."""

from __future__ import annotations

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject


def check(subject: Subject, effort: Effort) -> Outcome:
    raise BuildError("the C does not compile", where="src/x.c:3")
