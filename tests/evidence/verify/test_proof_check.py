"""Tests of `proof_check` that take seconds each."""

from __future__ import annotations

import sys

import pytest

from codegen.verify import packages
from codegen.verify.check import Effort, Subject, Verdict
from codegen.verify.proof.check import check
from tests.verify import builds, planted
from tests.verify.test_proof_check import COUNTER, PI, UNITS, checked


def test_what_cannot_be_proved_is_not_passed(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = checked(("ars_e2e", COUNTER, f"do {{ data[0]++; }} while (data[0] == 7u);\n    {COUNTER}"))
    assert any("cannot be judged: the statement DoWhile" in finding for finding in loop.findings)
    broken = checked(("ars_e2e", COUNTER, "this is no C;"))
    assert (broken.verdict, broken.figure) == (Verdict.FAILED, "could not be completed")
    double = check(planted.subject_of(builds.made("pi", "uneven", precision="double")), Effort())
    assert double.verdict is Verdict.NOT_RUN
    small = {path: text for path, text in PI.files.items() if path.startswith("include/") or path[4:-2] in UNITS}
    with monkeypatch.context() as patch:
        patch.setattr("codegen.verify.proof.session.Session.run", lambda self: self.report)
        findings = check(Subject("sample", small, PI.manifest), Effort()).findings
    missing = ("controller_step", "limiter_init", "limiter_step", "can_not_available")
    assert findings == tuple(f"no function ars_{name}: what is claimed of it is not shown" for name in missing)
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(packages.MissingTool, match="z3-solver"):
        check(planted.subject_of(PI), Effort())
