"""Builds of every kind equal their second implementation, and long drives find faults of counters."""

import dataclasses
import re

import pytest

from codegen.sil.software import Status
from codegen.verify.outcomes import Subject
from codegen.verify.unit_drives import Size
from tests.evidence.verify.test_builds import BUILDS
from tests.oracle.check import check
from tests.verify import builds, planted

PI = builds.made("pi", "uneven")
FEW = Size(60, 300, 3, 200)


@pytest.mark.long
@pytest.mark.parametrize("name", BUILDS)
def test_a_build_equals_its_second_implementation(name: str) -> None:
    found = check(planted.subject_of(BUILDS[name]()))
    assert not found.findings
    assert name != "tracking" or found.statuses.keys() == set(Status)


@pytest.mark.parametrize(
    ("path", "removed", "finding"),
    [
        ("controller.c", "    squares += self->law.integral * self->law.integral;\n", "a step goes on with law.integral = nan"),
        ("controller.c", "    squares += self->inputs.speed.value * self->inputs.speed.value;\n", "inputs.speed.value = "),
        ("controller.c", "    self->yaw_rate_error = 0.0f;\n    self->sample", "yaw_rate_error is not initialised"),
        ("task.c", "    self->late_cycles = 0u;\n", "ars_task_init: late_cycles is not initialised"),
    ],
)
def test_stale_initialisations_and_unsound_numbers_are_found(path: str, removed: str, finding: str) -> None:
    kept = "    self->sample" if removed.endswith("sample") else ""
    files = builds.with_text(PI, f"src/ars_{path}", removed, kept)
    found = check(Subject("planted", files, PI.manifest), FEW, with_long_drives=False)
    assert any(finding in line for line in found.findings)


COUNTERS = (
    # The fail-safe is left at one sample.
    ("include/ars_controller.h", "    bool enabled; ", "    uint32_t count;\n    bool enabled; "),
    (
        "src/ars_controller.c",
        "    self->enabled = false;\n    self->quality",
        "    self->enabled = false;\n    self->count = 0u;\n    self->quality",
    ),
    (
        "src/ars_controller.c",
        "    if (self->quality == ARS_QUALITY_UNUSABLE) {\n",
        "    self->count = (self->quality == ARS_QUALITY_UNUSABLE) ? (self->count + 1u) : 0u;\n"
        "    if ((self->quality == ARS_QUALITY_UNUSABLE) && (self->count != 40000u)) {\n",
    ),
    # After 256 rejected samples in a row, one good sample less of several is required.
    ("include/ars_inputs.h", "    ars_signal_source_t source;\n", "    ars_signal_source_t source;\n    uint32_t count;\n"),
    (
        "src/ars_inputs.c",
        "    self->missing = 0u;\n    self->good = is",
        "    self->missing = self->count = 0u;\n    self->good = is",
    ),
    (
        "src/ars_inputs.c",
        "        self->good = 0u;\n    }\n    if (self",
        "        self->good = 0u;\n        self->count++;\n    }\n    if (self",
    ),
    (
        "src/ars_inputs.c",
        "    if (self->good >= parameters->recovery_samples) {\n",
        "    if ((self->good + (((self->count == 256u) && (parameters->recovery_samples > 1u)) ? 1u : 0u)) "
        ">= parameters->recovery_samples) {\n"
        "        self->count = 0u;\n",
    ),
    # A 16-bit counter overflows.
    ("include/ars_limiter.h", "    bool speed_known; ", "    uint16_t count;\n    bool speed_known; "),
    ("src/ars_limiter.c", "    self->speed_known = false;\n", "    self->speed_known = false;\n    self->count = 0u;\n"),
    (
        "src/ars_limiter.c",
        "            limited_demand = clamp(limited_demand, low, high); /*",
        "            self->count++;\n            limited_demand = (self->count == 0u) ? 0.0f : limited_demand; /*",
    ),
    ("src/ars_e2e.c", "(counter < counter_max) ? (uint8_t)(counter + 1u) : counter", "(uint8_t)(counter + 1u)"),
    ("src/ars_task.c", "    if (self->frames < UINT8_MAX) {\n        self->frames++;\n    }", "    self->frames++;"),
)
"""Faults of counters: path, text and replacement."""
FOUND = (
    r"an hour of no signal, sample 400\d\d: .*, STANDBY; by the law .*, FAIL_SAFE; after \(nan, ",
    r"losses around overflows, recovery after 10 samples, sample \d+: quality 0, .*; by the law quality 3, ",
    r"limiter without demand, sample 65635: ",
    r"E2E, silence, sample \d+: ",
    r"task, limits of its counters, sample \d+: 0x",
)


def test_faults_of_counters_are_found_by_long_drives_only() -> None:
    files = dict(PI.files)
    for path, old, new in COUNTERS:
        files[path] = builds.with_text(dataclasses.replace(PI, files=files), path, old, new)[path]
    found = check(Subject("planted", files, PI.manifest), FEW).findings
    for pattern in FOUND:
        assert any(re.match(pattern, line) for line in found), (pattern, found)
    long = ("an hour of ", "losses ", "input losses ", "limiter ", "E2E, ", "task, ")
    assert all(line.startswith(long) for line in found), found
