"""Check `proof`: a build is proved, and faults are not. Whole builds of every kind are proved in tests/evidence/verify."""

from __future__ import annotations

import re
import sys

import pytest

from codegen.verify import packages
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.proof import claims
from codegen.verify.proof.check import check
from tests.verify import builds, planted

PI = builds.made("pi", "uneven")
UNITS = ("ars_e2e", "ars_map", "ars_calibration")
"""Units that are proved in a second; the limiter and the controller take minutes."""
ROW = "yaw_rate_table[ARS_MAP_SPEED_POINTS][ARS_MAP_FRONT_ANGLE_POINTS] = {\n    /* 0 km/h */\n    {\n        "
COUNTER = "*counter = (*counter < counter_max) ? (uint8_t)(*counter + 1u) : 0u;"
FAULTS = {
    ("ars_e2e", COUNTER, "*counter = (uint8_t)(*counter + 1u);"): (
        r"src/ars_e2e\.c:\d+: ars_e2e_protect: counterexample: claim: the counter for the next frame is at most 14; with "
    ),
    ("ars_calibration", f"{ROW}0.0f", f"{ROW}11.0f"): r"yaw_rate_table: numbers from 0 to 11, the proof is for 0 to 10",
}


def checked(*changes: tuple[str, str, str]) -> Outcome:
    """Return the outcome for some units with texts replaced: unit, old, new."""
    files = {path: text for path, text in PI.files.items() if path.startswith("include/") or path[4:-2] in UNITS}
    for name, old, new in changes:
        files[f"src/{name}.c"] = builds.with_text(PI, f"src/{name}.c", old, new)[f"src/{name}.c"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(claims, "CLAIMED", ("e2e_protect",))
        return check(Subject("sample", files, PI.manifest), Effort())


def test_units_are_proved() -> None:
    outcome = checked()
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    kinds = outcome.figures["obligations"]
    assert kinds.keys() >= {"claim", "invariant", "index inside its array", "no division by zero"}
    assert outcome.figure == f"{sum(kinds.values())} of {sum(kinds.values())} obligations proved"
    assert outcome.figures["invariants"]["ars_e2e_receiver_t"]
    names = {f"src/{name}.c" for name in UNITS} | {path for path in PI.files if path.startswith("include/")}
    assert outcome.figures["sha256"].keys() == names


def test_faults_are_not_proved_and_nothing_else_is_found() -> None:
    outcome = checked(*FAULTS)
    assert outcome.verdict is Verdict.FAILED
    for finding in FAULTS.values():
        assert any(re.match(finding, each) for each in outcome.findings), (finding, outcome.findings)
    assert all(re.match(r"src/ars_e2e\.c:|yaw_rate_table: ", each) for each in outcome.findings)


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
