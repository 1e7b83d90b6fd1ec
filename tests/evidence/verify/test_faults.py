"""Planted faults that only some cores, harnesses or searches find. tests/verify has one faulty build for each check."""

import re
from dataclasses import replace

import pytest

from codegen.verify import bounded_loops, resource_usage, sanitized, sanitizer_runs
from codegen.verify import budgets as budgets
from codegen.verify import compilers as compiles
from codegen.verify import emulated_runs as pil
from codegen.verify import sanitizer_runs as sanitizers
from codegen.verify.outcomes import Effort, Subject, Verdict
from codegen.verify.resource_usage import CYCLE, measure_step
from codegen.verify.target import POWERPC_BE
from tests.verify import builds, planted

PI, TRACKING = builds.made("pi", "uneven"), builds.made("tracking", "uneven")
QUICK = Effort(quick=True)


def changed(unit: str, old: str, new: str, folder: builds.Folder = PI) -> Subject:
    return Subject("planted", builds.with_text(folder, f"src/ars_{unit}.c", old, new), folder.manifest)


# Processor in the loop: faults of single cores.

CORES = {
    # The host lacks the instruction, or gcc ignores the pragma; clang considers it too slow for a Cortex-M4F.
    "a fused multiplication": (
        "limiter_step",
        "    float result = planted_ars_limiter_step(self, parameters, input);\n"
        "#ifdef __clang__\n    {\n#pragma STDC FP_CONTRACT ON\n#endif\n"
        "    result = (result * 1.0000001f) + (0.1f * self->front_angle);\n#ifdef __clang__\n    }\n#endif\n    return result;",
        "random steps, step ",
    ),
    # clang compiles it to a maximum for the Cortex-M7, which returns such a NaN; a comparison with a jump does not.
    "a signalling NaN in a comparison": (
        "map_yaw_rate_on_road",
        "    const float bounded = (speed > 0.5f) ? speed : 0.5f;\n"
        "    return planted_ars_map_yaw_rate_on_road(bounded, front_angle, friction);",
        "lookup, call ",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize(("function", "body", "finding"), CORES.values(), ids=CORES)
def test_a_fault_of_a_cortex_m7_is_found_there(monkeypatch: pytest.MonkeyPatch, function: str, body: str, finding: str) -> None:
    monkeypatch.setattr(pil, "QUICK_STEPS", 1_500)
    monkeypatch.setattr(pil, "_dynamics", lambda *given: {})
    found = pil.check(planted.wrapped(PI, f"ars_{function}", body), QUICK)
    faulty = {name for name, counts in found.figures["mismatches"].items() if any(counts.values())}
    assert "Cortex-M7" in faulty and "Cortex-M4F" not in faulty
    assert any(each.startswith(f"Cortex-M7: {finding}") for each in found.findings), found.findings


def test_dynamics_beyond_their_bound_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pil, "QUICK_STEPS", 1_500)
    monkeypatch.setattr(pil, "CORES", {True: (POWERPC_BE,)})
    body = (
        "    ars_dynamics_state_t result = planted_ars_dynamics_magic_formula(state, input);\n"
        "#ifdef __powerpc__\n    result.yaw_rate *= 1.00001f;\n#endif\n    return result;"
    )
    found = pil.check(planted.wrapped(PI, "ars_dynamics_magic_formula", body), QUICK)
    assert not any(any(counts.values()) for counts in found.figures["mismatches"].values())
    (finding,) = found.findings
    assert re.match("PowerPC, big-endian: dynamics, magic_formula.yaw_rate is .*, further apart than ", finding)


# Budgets: a rare longest step, and the cost of a step.

NOP_COUNT = 1_000
"""More instructions than a step has, so that a step with them is the longest."""
RARE_STEPS = {
    "the law starts afresh": (
        "controller",
        "            self->status = self->law.is_limited ?",
        "phase == ARS_LAW_STARTS",
        True,
    ),
    "a recovery ends": ("inputs", "        self->source = ARS_SIGNAL_MEASURED;", "true", True),
    "there again": ("inputs", "        self->missing--;", "true", True),
    "lost for long": ("inputs", "            self->source = ARS_SIGNAL_LOST;", "true", False),
}


@pytest.mark.long
@pytest.mark.parametrize(("unit", "place", "condition", "goes_on"), RARE_STEPS.values(), ids=RARE_STEPS)
def test_a_rare_long_step_is_found(unit: str, place: str, condition: str, goes_on: bool) -> None:
    """If the law runs after it, the finding includes at least 85 % of a usual longest step."""
    nops = f'    if ({condition}) {{ __asm__ volatile ("{"nop; " * NOP_COUNT}"); }}\n'
    usual = measure_step(planted.subject_of(PI), QUICK).instructions.max
    longest = measure_step(changed(unit, place, nops + place), QUICK).instructions.max
    assert longest >= NOP_COUNT + (0.85 * usual if goes_on else 0)


def test_stack_use_unknown_to_the_compiler_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few calls are enough, because every call uses it. The search for loops would reject the assembly."""
    monkeypatch.setattr(resource_usage, "QUICK_SAMPLES", 40)
    monkeypatch.setattr(bounded_loops, "complaints", lambda *given: ())
    hidden = '    __asm__ volatile ("sub sp, #512; str r0, [sp]; add sp, #512" ::: "memory");\n'
    findings = budgets.check(planted.started(PI, "ars_limiter_step", hidden), QUICK).findings
    pattern = r"\d+ bytes of stack were used; the bound from the compiler's frames is \d+"
    for name in ("limiter_step", "controller_step", CYCLE):
        assert any(re.fullmatch(f"{name}: {pattern}", each) for each in findings), findings


# Compilation and sanitizers.


def test_functions_that_a_target_may_lack_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """The code has no warnings: every conversion is explicit and every function is declared."""
    for name in ("by_gcc", "not_refused", "takes_fast_math"):
        monkeypatch.setattr(compiles, name, lambda *given: ())
    files = dict(PI.files)
    for unit, before, signature, body in (
        ("limiter", "", "float ars_half(float x)", "return (float)((double)x * 0.1);"),
        ("e2e", "float sinf(float x);\n", "float ars_sine(float x)", "return sinf(x);"),
        ("task", "", "void ars_clear(float *x)", "*x = 0.0f;"),
    ):
        files[f"src/ars_{unit}.c"] += f"{before}{signature};\n{signature}\n{{\n    {body}\n}}\n".encode()
    outcome = compiles.check(Subject("planted", files, PI.manifest), QUICK)
    assert set(outcome.findings) >= {
        "include/: no header declares ars_clear",
        "src/ars_limiter.c: needs __aeabi_dmul, double precision (Cortex-M4F)",
        "src/ars_e2e.c: needs sinf, which a bare target need not have (x86-64, Cortex-M4F)",
    }


@pytest.mark.long
def test_a_header_that_is_not_for_cxx_is_found() -> None:
    header = "include/ars_e2e.h"
    files = builds.with_text(PI, header, '#ifdef __cplusplus\nextern "C" {\n#endif\n', "")
    files[header] = files[header].replace(b"#ifdef __cplusplus\n}\n#endif\n", b"")
    outcome = compiles.check(Subject("planted", files, PI.manifest), QUICK)
    assert 'include/: ars_e2e_crc is not declared extern "C" for C++' in outcome.findings
    assert all("ars_e2e_" in finding and "extern" in finding for finding in outcome.findings)


@pytest.mark.long
def test_the_map_of_another_version_is_judged_by_its_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its order of operations may differ; a wrong cell is still detected."""
    monkeypatch.setattr(sanitizers, "run_all", lambda config, runner: [])
    # A harness compares both look-ups, of which only one is changed.
    monkeypatch.setattr(sanitizer_runs, "run_harness", lambda *given: ({"inputs": 0}, ()))
    for factor, verdict in ((0.999999, Verdict.PASSED), (0.999, Verdict.FAILED)):
        body = f"    return planted_ars_map_yaw_rate_on_road(speed, front_angle, friction) * {factor}f;"
        old = replace(TRACKING, manifest={**TRACKING.manifest, "version": "0.0.1"})
        assert sanitizers.check(planted.wrapped(old, "ars_map_yaw_rate_on_road", body), QUICK).verdict is verdict


# Fuzzing: each property of a harness can fail.

CALL = {
    "e2e_protect": "planted_ars_e2e_protect(data_id, counter, data);",
    "can_unpack_vehicle_motion": "planted_ars_can_unpack_vehicle_motion(data, signals);",
    "reference_model_step": "planted_ars_reference_model_step(self, input);",
    "controller_step": "ars_command_t result = planted_ars_controller_step(self, parameters, measurement);",
}
"""Call of the original function at the start of a body. Bodies of other functions call it themselves."""
ACCEPT_ANY_CRC = (
    "uint8_t mended[8]; for (int k = 0; k < 8; k++) { mended[k] = data[k]; }\n"
    "    mended[0] = ars_e2e_crc(data_id, mended);\n    return planted_ars_e2e_check(self, data_id, mended);"
)
"""Accepts any CRC."""
SENT = "ars_rear_steer_command_t sent = *signals; sent.rear_angle *= 2; planted_ars_can_pack_rear_steer_command(&sent, data);"
ROAD = "return planted_ars_map_yaw_rate_on_road(speed, (front_angle < -0.5f) ? -0.5f : front_angle, friction);"
UNUSED = "a frame that must not be used makes no difference"
REFERENCE, STATUS = "result.yaw_rate_reference", "result.status"
FAULTS: dict[sanitizer_runs.Name, list[tuple[str, str, str]]] = {
    "can": [
        ("e2e_check", ACCEPT_ANY_CRC, UNUSED),
        ("e2e_check", ACCEPT_ANY_CRC.replace("mended[0] =", "if ((data[7] & 0xF0u) == 0x50u) mended[0] ="), UNUSED),
        ("e2e_protect", "*counter += (*counter == 7u);", "counter of the command"),
        ("task_on_can_frame", "planted_ars_task_on_can_frame(self, id, data, (length < 8u) ? 8u : length);", "src/ars_e2e.c:"),
        ("task_10ms", "return planted_ars_task_10ms(self, data) + (data[6] == 0x09u);", "identifier of the command"),
        ("can_pack_rear_steer_command", SENT, "rear angle "),
    ],
    "step": [
        ("controller_step", "result.rear_angle *= 1.5f;", "rear angle "),
        ("controller_step", f"{REFERENCE} = measurement->speed * 1.0e38f;", "reference is a number"),
        ("controller_step", f"{STATUS} = (ars_status_t)({STATUS} + ({STATUS} == 4));", "status has a name"),
        ("controller_step", f"if ({STATUS} == 3) {STATUS} = ARS_STATUS_TRACKING;", "no control upon a signal out of range"),
        ("controller_step", f"if ({STATUS} == 2) {STATUS} = ARS_STATUS_TRACKING;", "no control below the disabling speed"),
        ("controller_step", f"if ({STATUS} == 4) {REFERENCE} = 0.01f;", "no reference in standby and fail-safe"),
        (
            "controller_step",
            f"if ({STATUS} == 3) {REFERENCE} = 5.0f;",
            "degraded, the reference is within what the road allows",
        ),
        (
            "limiter_step",
            "ars_limiter_parameters_t fast = *parameters; fast.rear_rate_max *= 1.5f;"
            "return planted_ars_limiter_step(self, &fast, input);",
            "the limiter moves by its rate at most",
        ),
        ("map_yaw_rate_on_road", ROAD, ""),
        ("can_unpack_vehicle_motion", "signals->speed *= 1.001f;", "a signal comes back"),
        ("reference_model_step", "self->yaw_rate += 0.0f * input->friction;", "the reference model holds numbers"),
    ],
}


def fuzzed(subject: Subject, name: sanitizer_runs.Name) -> tuple[str, ...]:
    """Return the findings of one harness."""
    compiler, plain = sanitized.find_compiler(), sanitizer_runs.sources(subject)
    with sanitized.compiled(compiler, subject.sources(), plain, (sanitizer_runs.COVERAGE_FLAG,)) as path:
        return sanitizer_runs.run_harness(path, name, sanitizer_runs.seeds(subject)[name], sanitizers.INPUTS_QUICK)[1]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "function", "statement", "finding"), [(name, *fault) for name, faults in FAULTS.items() for fault in faults]
)
def test_every_property_can_fail(name: sanitizer_runs.Name, function: str, statement: str, finding: str) -> None:
    call = CALL.get(function, "")
    end = "return result;" if "result =" in call else ""
    subject = planted.wrapped(TRACKING, f"ars_{function}", f"    {call}\n    {statement}\n    {end}")
    start = f"{name}: {finding}" if finding.startswith("src/") else f"{name}: property not held: {finding}"
    assert fuzzed(subject, name)[0].startswith(start)


def test_an_input_with_an_endless_loop_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sanitizer_runs, "SECONDS_MAX", 1.0)
    endless = planted.limiter(TRACKING, "    while (input->demand > 0.05f) {\n        result += 0.0f;\n    }")
    assert fuzzed(endless, "step") == ("step: an input does not end",)
