"""Check `fuzzing`: a build passes, and each harness finds faults. tests/evidence/verify tests each property."""

import re

import pytest

from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.fuzzing import check as fuzzing
from codegen.verify.fuzzing.check import Name
from codegen.verify.packages import MissingTool
from tests.verify import builds, planted

TRACKING = builds.made("tracking", "uneven")


@pytest.fixture(autouse=True)
def few_inputs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzzing, "INPUTS_QUICK", 1_000)


def checked(subject: Subject) -> Outcome:
    return fuzzing.check(subject, Effort(quick=True))


def test_a_build_passes() -> None:
    outcome = checked(planted.subject_of(TRACKING))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    assert outcome.figure == f"{2 * fuzzing.INPUTS_QUICK:,} inputs, 0 crashes"
    for figures in outcome.figures.values():
        assert figures["inputs"] == fuzzing.INPUTS_QUICK
        assert figures["corpus"] > figures["seeds"] == 20
        assert figures["edges"] > 200


CRC = "    planted_ars_e2e_protect(data_id, counter, data);\n    data[0] ^= (uint8_t)(data[7] & 1u);"
FAR = (
    "    ((volatile uint8_t *)self)[4096] = (uint8_t)(input->demand > 0.05f);\n"
    "    return planted_ars_limiter_step(self, parameters, input);"
)


@pytest.mark.parametrize(
    ("name", "function", "body", "finding"),
    [
        ("can", "e2e_protect", CRC, r"property not held: CRC of the command \(\d+, \d+\), at input \d+ of 1000"),
        ("step", "limiter_step", FAR, r"src/ars_limiter\.c:\d+: wrong address: "),
    ],
    ids=["a property", "an address"],
)
def test_a_fault_is_found(monkeypatch: pytest.MonkeyPatch, name: Name, function: str, body: str, finding: str) -> None:
    monkeypatch.setattr(fuzzing, "HARNESSES", (name,))
    outcome = checked(planted.wrapped(TRACKING, f"ars_{function}", body))
    assert outcome.verdict is Verdict.FAILED
    assert outcome.figure.endswith(" inputs, 1 crashes")
    assert re.match(f"{name}: {finding}", outcome.findings[0]), outcome.findings


def test_c_that_does_not_compile_fails_and_without_a_compiler_it_cannot_run(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = checked(planted.subject_of(TRACKING, ars_limiter="int broken(;\n"))
    (finding,) = outcome.findings
    assert re.match(r"src/ars_limiter\.c:\d+: the C does not compile: ", finding)
    assert outcome.verdict is Verdict.FAILED
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingTool, match="no C compiler whose sanitizers find a planted fault"):
        checked(planted.subject_of(TRACKING))
