"""Check `sanitizers`: a build passes the suites and the fuzz harnesses, and wrong results of each are found."""

import re
from dataclasses import replace

import pytest

from codegen.verify import sanitized, sanitizer_runs
from codegen.verify import sanitizer_runs as sanitizers
from codegen.verify.outcomes import Verdict
from tests.verify import planted
from tests.verify.test_sanitizers import PI, TRACKING, checked, few_cases  # noqa: F401


@pytest.mark.long
def test_a_build_passes() -> None:
    outcome = checked(planted.subject_of(TRACKING))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    steps = 8 * sanitizers.SAMPLES_QUICK
    assert outcome.figure == f"0 findings in 2 scenarios, 2 faults, {steps:,} steps and 2,000 fuzzed inputs"
    assert outcome.limits == sanitizers.LIMITS, "every status is reached"
    for figures in outcome.figures["fuzzing"].values():
        assert figures["inputs"] == sanitizers.INPUTS_QUICK
        assert figures["corpus"] > figures["seeds"] == 4
        assert figures["edges"] > 200


def test_types_whose_width_depends_on_the_target_are_found() -> None:
    """A long of 64 bits does not overflow where one of 32 bits does."""
    subject = planted.limiter(
        PI, "    /* as long as it takes */\n    result += 0.0f * (float)((long)(input->demand > 0.05f) * 3L);"
    )
    line = 1 + subject.files["src/ars_limiter.c"].decode().splitlines().index("    /* as long as it takes */")
    assert checked(subject).findings == (f"src/ars_limiter.c:{line + 1}: the width of long depends on the target",)


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
            " * ((friction < 0.2f) ? (1.0f / 0.0f) : 1.0f);"
        ),
    }.items():
        folder = replace(folder, files=planted.wrapped(folder, f"ars_{function}", body).files)
    outcome = checked(planted.subject_of(folder))
    assert outcome.verdict is Verdict.FAILED
    assert outcome.figure.startswith(f"{len(outcome.findings)} findings in 2 scenarios, 2 faults, ")
    for pattern in (
        r"src/ars_selftest\.c: the self-test fails",
        r"drive \d, step \d+: 0\.07\d* rad, reference \S+ rad/s, status \d after \(",
        r"src/ars_map\.c: the look-up at \(\S+, \S+\) on a road of friction \S+, at 0 m/s\^2 is no number",
        r"scenario \S+: the rear angle goes to 0\.07 rad, or a signal is no number",
        r"scenario \S+ through CAN frames: the rear angle goes to ",
        r"fault corrupt-50, a bit flipped in 50 samples: ",
    ):
        assert any(re.match(pattern, finding) for finding in outcome.findings), (pattern, outcome.findings)


@pytest.mark.long
def test_c_that_does_not_compile_or_does_not_return(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sanitizers, "run_all", lambda config, runner: [])  # the fault catalogue takes longest
    (finding,) = checked(planted.subject_of(TRACKING, ars_limiter="int broken(;\n")).findings
    assert re.match(r"src/ars_limiter\.c:\d+: the C does not compile: ", finding)
    for module in (sanitized, sanitizer_runs):
        monkeypatch.setattr(module, "SECONDS_MAX", 1.0)
    endless = planted.limiter(TRACKING, "    while (input->demand > 0.05f) {\n        result += 0.0f;\n    }")
    first, *others = checked(endless).findings
    assert (first, others[-1]) == ("the program ended early: signal 9", "step: an input does not end")
