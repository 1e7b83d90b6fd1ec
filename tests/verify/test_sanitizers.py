"""Check `sanitizers`: undefined behaviour is located. tests/evidence/verify has the other kinds of faults, and sound builds."""

import itertools

import pytest

from codegen.verify import drives
from codegen.verify import sanitizer_runs as sanitizers
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.tools import MissingTool
from hil_sim import fault_catalogue
from tests.verify import builds, planted

PI, TRACKING = builds.made("pi", "uneven"), builds.made("tracking", "uneven")
QUICK = Effort(quick=True)
FAULTS = ("corrupt-3", "corrupt-50")


@pytest.fixture(autouse=True)
def few_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run two scenarios, two faults of the catalogue, and few samples and fuzzed inputs."""
    scenarios, faults = drives.loops, fault_catalogue.catalogue
    monkeypatch.setattr(drives, "loops", lambda config: itertools.islice(scenarios(config), 2))
    monkeypatch.setattr(fault_catalogue, "catalogue", lambda *given: [each for each in faults(*given) if each.name in FAULTS])
    monkeypatch.setattr(sanitizers, "SAMPLES_QUICK", 1_000)
    monkeypatch.setattr(sanitizers, "INPUTS_QUICK", 1_000)


def checked(subject: Subject) -> Outcome:
    return sanitizers.check(subject, QUICK)


UNDEFINED = {
    "result += 0.0f * (float)(int8_t)((float)far * 1.0e6f);": (
        "undefined behaviour: 6e+06 is outside the range of representable values of type"
    ),
    "result += 0.0f * (input->demand / ((float)far * 0.0f));": "undefined behaviour: division by zero",
    "if (far > 0) { result += 0.0f * (float)(1 / (far - 6)); }": "undefined behaviour: division by zero",
    "result += 0.0f * (float)(1u << (far * 6));": "undefined behaviour: shift exponent 36 is too large for 32-bit type",
    "result += 0.0f * parameters->opposite_phase_max[far];": "undefined behaviour: index 6 out of bounds for type",
    "result += 0.0f * (float)(far * 400000000);": "undefined behaviour: signed integer overflow",
    "if (far > 0) { ((volatile uint8_t *)self)[4096] = 0u; }": "wrong address: heap-buffer-overflow, write of 1 bytes",
}


def test_undefined_behaviour_and_wrong_addresses_are_located() -> None:
    far = "    const int32_t far = (input->demand > 0.05f) ? 6 : 0;\n\n"
    subject = planted.limiter(TRACKING, far + "\n".join(f"    {statement}" for statement in UNDEFINED))
    lines = subject.files["src/ars_limiter.c"].decode().splitlines()
    outcome = checked(subject)
    assert outcome.verdict is Verdict.FAILED
    for statement, what in UNDEFINED.items():
        start = f"src/ars_limiter.c:{1 + lines.index(f'    {statement}')}: {what}"
        assert any(finding.startswith(start) for finding in outcome.findings), (start, outcome.findings)
    for harness in ("can", "step"):
        assert any(finding.startswith(f"{harness}: src/ars_limiter.c:") for finding in outcome.findings), outcome.findings


def test_without_a_compiler_it_cannot_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    message = r"^sanitizers: no C compiler whose sanitizers find a planted fault \(no C compiler is here\); install"
    with pytest.raises(MissingTool, match=message):
        checked(planted.subject_of(TRACKING))
