"""Check `sanitizers`: a build passes on this machine and as a trap build, and each kind of fault is located."""

import itertools
import re
from dataclasses import replace

import pytest

from codegen.verify import suites
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.sanitizers import check as sanitizers
from codegen.verify.sanitizers import served_ecu, trap_build
from hil_sim import fault_catalogue
from tests.verify import builds, planted

PI, TRACKING = builds.made("pi", "uneven"), builds.made("tracking", "uneven")
QUICK = Effort(quick=True)
FAULTS = ("corrupt-3", "corrupt-50")


@pytest.fixture(autouse=True)
def few_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run two scenarios, two faults of the catalogue, and few samples."""
    scenarios, faults = suites.loops, fault_catalogue.catalogue
    monkeypatch.setattr(suites, "loops", lambda config: itertools.islice(scenarios(config), 2))
    monkeypatch.setattr(fault_catalogue, "catalogue", lambda *given: [each for each in faults(*given) if each.name in FAULTS])
    monkeypatch.setattr(sanitizers, "SAMPLES_QUICK", 1_000)
    monkeypatch.setattr(trap_build, "QUICK_STEPS", 1_500)


def checked(subject: Subject) -> Outcome:
    return sanitizers.check(subject, QUICK)


def test_a_build_passes_both_halves() -> None:
    outcome = checked(planted.subject_of(TRACKING))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    assert outcome.figures["trap_build"] == "Cortex-M4F"
    assert outcome.figure == f"0 findings in 2 scenarios, 2 faults and {8 * sanitizers.SAMPLES_QUICK:,} steps"
    assert outcome.limits == sanitizers.LIMITS, "every status is reached"


UNDEFINED = {
    "result += 0.0f * (float)(int8_t)((float)far * 1.0e6f);": (
        "undefined behaviour: 6e+06 is outside the range of representable values of type"
    ),
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
    assert "trap_build" not in outcome.figures, "the same code is faulty there"


ACCEPT_ANY_CRC = (
    "    uint8_t mended[8];\n    uint32_t k;\n\n    for (k = 0u; k < 8u; k++) {\n        mended[k] = data[k];\n    }\n"
    "    mended[0] = ars_e2e_crc(data_id, mended);\n    return planted_ars_e2e_check(self, data_id, mended);"
)
"""Body of ars_e2e_check that accepts any CRC."""


def test_wrong_results_of_every_suite_are_found() -> None:
    folder = TRACKING
    for function, body in {
        "selftest": "    return false;",
        "limiter_step": "    return (input->demand > 0.0f) ? 0.07f : planted_ars_limiter_step(self, parameters, input);",
        "e2e_check": ACCEPT_ANY_CRC,
        "map_yaw_rate_on_road": (
            "    return planted_ars_map_yaw_rate_on_road(speed, front_angle, friction)"
            " * ((friction < 0.2f) ? 1.0000002f : 1.0f);"
        ),
    }.items():
        folder = replace(folder, files=planted.wrapped(folder, f"ars_{function}", body).files)
    outcome = checked(planted.subject_of(folder))
    assert outcome.verdict is Verdict.FAILED
    assert outcome.figure.startswith(f"{len(outcome.findings)} findings in 2 scenarios, 2 faults and ")
    for pattern in (
        r"src/ars_selftest\.c: the self-test fails",
        r"drive \d, step \d+: 0\.07\d* rad, reference \S+ rad/s, status \d after \(",
        r"src/ars_map\.c: the look-up at \S+ m/s, \S+ rad, friction \S+ gives .*, the reference .* are wrong\)",
        r"scenario \S+: the rear angle goes to 0\.07 rad, or a signal is no number",
        r"scenario \S+ through CAN frames: the rear angle goes to ",
        r"fault corrupt-50, a bit flipped in 50 samples: ",
    ):
        assert any(re.match(pattern, finding) for finding in outcome.findings), (pattern, outcome.findings)


def test_c_that_does_not_compile_or_does_not_return(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sanitizers, "run_all", lambda config, runner: [])  # the fault catalogue takes longest
    (finding,) = checked(planted.subject_of(TRACKING, ars_limiter="int broken(;\n")).findings
    assert re.match(r"src/ars_limiter\.c:\d+: the C does not compile: ", finding)
    monkeypatch.setattr(served_ecu, "SECONDS_MAX", 1.0)
    endless = planted.limiter(TRACKING, "    while (input->demand > 0.05f) {\n        result += 0.0f;\n    }")
    assert checked(endless).findings == ("the program ended early: signal 9",)


def test_without_tools_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    outcome = checked(planted.subject_of(TRACKING))
    assert outcome.verdict is Verdict.NOT_RUN
    host, target = outcome.findings
    assert host.startswith("sanitizers: no C compiler whose sanitizers find a planted fault (no C compiler is here); install")
    assert target.startswith("trap build: no C compiler was found; install")
