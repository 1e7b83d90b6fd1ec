"""Tests of `pil` that take seconds each."""

from __future__ import annotations

import pytest

from codegen.verify.check import Verdict
from codegen.verify.target.cross import CORTEX_M4F
from tests.verify import builds, planted
from tests.verify.test_pil import PI, checked, on


@pytest.mark.usefixtures("no_dynamics")
def test_double_precision_runs_on_cores_with_its_fpu() -> None:
    found = checked(planted.subject_of(builds.made("tracking", "uneven", precision="double")))
    assert found.findings == ()
    assert "model" in found.figures["rows"]
    assert any("double precision" in limit for limit in found.limits)


@pytest.mark.usefixtures("steps_only")
def test_dynamics_beyond_their_bound_are_found() -> None:
    body = (
        "    ars_dynamics_state_t result = planted_ars_dynamics_magic_formula(state, input);\n"
        "#ifdef __powerpc__\n    result.yaw_rate *= 1.00001f;\n#endif\n    return result;"
    )
    found = checked(planted.wrapped(PI, "ars_dynamics_magic_formula", body))
    assert not any(any(counts.values()) for counts in found.figures["mismatches"].values())
    (finding,) = found.findings
    assert finding.startswith("PowerPC, big-endian: dynamics, magic_formula.yaw_rate is ")
    assert ", further apart than " in finding
    assert found.verdict is Verdict.FAILED


@pytest.mark.parametrize(
    ("body", "verdict", "finding"),
    [
        ("    while (result > -2.0f) { result += 0.0f; }", Verdict.NOT_RUN, "it might never return: src/ars_limiter.c:"),
        ("    result = ;", Verdict.FAILED, "src/ars_limiter.c:"),
    ],
)
def test_c_that_does_not_run(monkeypatch: pytest.MonkeyPatch, body: str, verdict: Verdict, finding: str) -> None:
    on(monkeypatch, CORTEX_M4F)
    found = checked(planted.limiter(PI, body))
    assert found.verdict is verdict
    assert finding in found.findings[0]
