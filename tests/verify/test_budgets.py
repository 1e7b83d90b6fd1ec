"""Check `budgets`: a build passes, and each planted fault is found and named correctly."""

import functools
import json
import re
from collections.abc import Mapping
from dataclasses import replace

import pytest

from codegen.verify import bounded_loops, resource_usage
from codegen.verify import budgets as budgets
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.resource_usage import CYCLE
from tests.verify import builds, planted

PI = builds.made("pi", "uneven")
QUICK = Effort(quick=True)
LIMITS = ("lookup", "reference", "step", "limiter", "task")
AMPLE_BUDGETS = {
    **{f"{name}_instructions_max": 10_000 for name in LIMITS},
    "task_stack_bytes_max": 10_000,
    "state_bytes_max": 10_000,
}
"""Budgets that every build meets; each test lowers one of them."""


@pytest.fixture(autouse=True)
def few_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Count so few calls that only a fault in every call is found."""
    for name, value in {"QUICK_SAMPLES": 40, "USUAL_SAMPLES": 10, "SAMPLES": 100}.items():
        monkeypatch.setattr(resource_usage, name, value)


@functools.cache
def unmodified() -> Outcome:
    """Return the outcome of the unmodified build with its own budgets."""
    return budgets.check(planted.subject_of(PI), QUICK)


def largest(function: str) -> int:
    count = unmodified().figures["functions"][function]
    return int(count.get("instructions_bound", count["instructions"]["max"]))


def run(subject: Subject, limits: Mapping[str, int] | None = None, search_loops: bool = False) -> Outcome:
    """Return the outcome with ample budgets except for `limits`. No host compiler is used, and so no closed loop is simulated.

    The search for unbounded loops takes half of the time and has its own tests.
    """
    configuration = {**PI.manifest["configuration"], "budgets": {**AMPLE_BUDGETS, **(limits or {})}}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", "no-such-compiler")
        if not search_loops:
            patch.setattr(bounded_loops, "complaints", lambda files, manifest: ())
        return budgets.check(Subject("planted", subject.files, {**PI.manifest, "configuration": configuration}), QUICK)


def test_a_build_keeps_its_budgets() -> None:
    found = unmodified()
    assert (found.findings, found.verdict) == ((), Verdict.PASSED)
    figures = json.loads(json.dumps(found.figures, allow_nan=False))
    functions, stacks, step = figures["functions"], figures["stack_bytes"], figures["functions"]["controller_step"]
    assert step["instructions"]["max"] < step["instructions_with_limiter"]["max"]
    assert functions[CYCLE]["instructions_bound"] >= functions[CYCLE]["instructions"]["max"] > step["instructions"]["max"]
    assert all(0 <= stack["watermark"] <= stack["bound"] for stack in stacks.values())
    assert stacks[CYCLE]["watermark"] > 0
    assert figures["flash_bytes"] > figures["objects"]["src/ars_calibration.c"]["rodata"] >= PI.manifest["map"]["flash_bytes"]
    assert figures["mean_over"] == "the built-in scenarios in closed loop"


LOOP = "    uint32_t k;\n    volatile uint32_t planted = 0u;\n\n    for (k = 0u; k < 100u; k++) { planted = k; }\n"
BUFFER = "static volatile uint8_t planted_buffer[200];"
DEEP = (
    "    volatile float deep[64];\n    volatile uint32_t index = 0u;\n\n    deep[index] = 1.0f;\n    planted_buffer[0] = 1u;\n"
)
MEMORY = (
    r"cycle: \d{3} bytes of stack, budgets\.task_stack_bytes_max is 250; deepest in ars_task_10ms > .*ars_limiter_step",
    r"ars_controller_t: 2\d\d bytes, budgets\.state_bytes_max is 64",
    r"all objects: [\d,]+ bytes of flash, budgets\.flash_bytes_max is 4,000",
    r"src/ars_calibration\.c:\d+: 12 bytes of RAM of its own \(ars_map_other_table\); state is the caller's, and maps .*",
    r"src/ars_limiter\.c:LINE: 200 bytes of RAM of its own \(planted_buffer\); state is the caller's, and maps lie in flash",
)


def test_instructions_memory_stack_and_flash_beyond_their_budgets_are_found() -> None:
    """The instruction budgets equal the use of the build without the planted loops."""
    folder = replace(PI, files=planted.started(PI, "ars_limiter_step", DEEP, f"{BUFFER}\n\n").files)
    for function in ("limiter_step", "controller_step", "map_yaw_rate", "task_on_can_frame"):
        loop = f"    {{\n{LOOP}    }}\n" if function == "limiter_step" else LOOP
        folder = replace(folder, files=planted.started(folder, f"ars_{function}", loop).files)
    header, end = "include/ars_controller.h", "\n} ars_controller_t;"
    files = builds.with_text(folder, header, end, f"\n    float planted[16];{end}")
    files["src/ars_calibration.c"] += b"float ars_map_other_table[3] = { 1.0f, 2.0f, 3.0f };\n"
    keys = {"map_yaw_rate": "lookup", "controller_step": "step", "limiter_step": "limiter", CYCLE: "task"}
    limits = {f"{key}_instructions_max": largest(name) for name, key in keys.items()}
    limits |= {"task_stack_bytes_max": 250, "state_bytes_max": 64, "flash_bytes_max": 4_000}
    found = run(Subject("planted", files, PI.manifest), limits)
    assert found.verdict is Verdict.FAILED
    instructions, memory = found.findings[:4], found.findings[4:]
    for (name, key), finding in zip(keys.items(), instructions, strict=True):
        assert finding.startswith(f"{name}: ")
        place = "frames 101#" if name == CYCLE else "speed "
        assert f"budgets.{key}_instructions_max is {largest(name):,}; at {place}" in finding
        assert int(finding.split(" ")[1].replace(",", "")) > largest(name) + 100
    line = files["src/ars_limiter.c"].decode().splitlines().index(BUFFER) + 1
    for pattern, finding in zip(MEMORY, memory, strict=True):
        assert re.fullmatch(pattern.replace("LINE", str(line)), finding), finding
    assert found.figures["mean_over"] == "drawn inputs"
    assert budgets.NOT_IN_CLOSED_LOOP in found.limits


def test_unbounded_c_is_not_run() -> None:
    hook = "static float same(float value) { return value; }\nfloat (*volatile const hook)(float value) = same;\n"
    loop = "    do { self->speed = hook(rear_angle); } while (self->speed > 0.0f);\n"
    found = run(planted.started(PI, "ars_limiter_init", loop, hook), search_loops=True)
    assert found.verdict is Verdict.FAILED
    assert [re.sub(r"^src/ars_limiter\.c:\d+: ", "", finding) for finding in found.findings] == [
        "dowhile in ars_limiter_init: instructions without a bound",
        "a call of hook in ars_limiter_init: instructions without a bound",
    ]


def test_c_that_does_not_compile_and_double_precision() -> None:
    found = run(planted.started(PI, "ars_limiter_step", "    planted;\n"))
    assert found.verdict is Verdict.FAILED
    assert re.match(r"src/ars_limiter\.c:\d+: the C does not compile: ", found.findings[0])
    subject = planted.subject_of(builds.made("pi", "uneven", precision="double"))
    found = budgets.check(subject, Effort())
    assert found.verdict is Verdict.NOT_RUN
    assert found.findings == ("a build in double precision is not for a Cortex-M4F, whose FPU has single precision",)
