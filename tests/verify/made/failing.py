"""A check that fails with many findings."""

from codegen.verify.outcomes import Outcome, Verdict


def check(*_: object) -> Outcome:
    return Outcome("It shows a fault", "12 faults", Verdict.FAILED, tuple(f"src/x.c:{line}: wrong" for line in range(12)))
