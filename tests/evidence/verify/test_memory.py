"""Check `memory`: Frama-C's EVA reports faults of memory in the C that compilers and CBMC accept."""

from codegen.verify import memory
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from tests.verify import builds

PI = builds.made("pi", "uneven")

PLANTED = {
    "an index beyond an array inside a struct": (
        "src/ars_limiter.c",
        "for (k = 1u; k < (uint32_t)ARS_LIMITER_POINTS; k++)",
        "for (k = 1u; k <= (uint32_t)ARS_LIMITER_POINTS; k++)",
        "index bound in opposite_phase_bound",
    ),
    "a pointer to an object whose block has ended": (
        "src/ars_can.c",
        "    return quiet_nan.value;",
        "    const float *gone; { const float value = quiet_nan.value; gone = &value; } return *gone;",
        "dangling pointer in ars_can_not_available",
    ),
    "an object that is read before it is written": (
        "src/ars_e2e.c",
        "    uint32_t crc = crc_table[data_id & 0xFFu];",
        "    uint32_t none; uint32_t crc = none ^ crc_table[data_id & 0xFFu];",
        "initialization in ars_e2e_crc",
    ),
}
"""File, text, replacement, and kind and function of the alarm."""


def checked(**changed: bytes) -> Outcome:
    return memory.check(Subject("sample", {**PI.files, **changed}, PI.manifest), Effort())


def test_faults_of_memory_are_located() -> None:
    files = dict(PI.files)
    for name, (path, old, new, _) in PLANTED.items():
        text = files[path].decode("ascii")
        assert text.count(old) == 1, name
        files[path] = text.replace(old, new).encode("ascii")
    outcome = memory.check(Subject("sample", files, PI.manifest), Effort(quick=True))
    assert outcome.verdict is Verdict.FAILED
    for name, (path, _, _, alarm) in PLANTED.items():
        assert any(each.startswith(f"{path}:") and alarm in each for each in outcome.findings), (name, outcome.findings)


def test_c_that_does_not_parse_fails_with_the_location() -> None:
    outcome = checked(**{"src/ars_can.c": PI.files["src/ars_can.c"] + b"int x = ;\n"})
    assert (outcome.verdict, len(outcome.findings)) == (Verdict.FAILED, 1)
    assert "ars_can.c" in outcome.findings[0]
