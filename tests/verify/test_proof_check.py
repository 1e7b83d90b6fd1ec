"""Check `proof`: a build is proved, and faults are not. Whole builds of every kind are proved in tests/evidence/verify."""

from __future__ import annotations

import re

import pytest

from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.proof import claims
from codegen.verify.proof.check import check
from tests.verify import builds

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
