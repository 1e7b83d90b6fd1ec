"""A check that passes and reports its input."""

from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict


def check(subject: Subject, effort: Effort) -> Outcome:
    figures = {"files": len(subject.files), "quick": effort.quick}
    limits = ("It says nothing of the rest.",)
    return Outcome("It shows | nothing", "0 faults", Verdict.PASSED, figures=figures, limits=limits, tools={"none": "1.0"})
