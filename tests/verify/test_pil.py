"""Processor in the loop: the same bits on emulated cores, and every planted difference found."""

from __future__ import annotations

import functools
import json
import sys

import numpy as np
import pytest

from codegen.config import Kind
from codegen.sil.software import Status
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool
from codegen.verify.pil import check as pil
from codegen.verify.target.cross import CORTEX_M4F, CORTEX_M7, POWERPC_BE, Core
from tests.verify import builds, planted

STEPS = 1_500
"""Enough for the tour through every status, and for some of everything else."""

PI = builds.made("pi")
ALL = (CORTEX_M4F, CORTEX_M7, POWERPC_BE)


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pil, "QUICK_STEPS", STEPS)


@pytest.fixture
def no_dynamics(monkeypatch: pytest.MonkeyPatch) -> None:
    """Images of their own, which a fault elsewhere does not touch."""
    monkeypatch.setattr(pil, "_dynamics", lambda *given: {})


def outcome(subject: Subject) -> Outcome:
    return pil.check(subject, Effort(quick=True))


def faults(found: Outcome) -> set[str]:
    """Cores with mismatches."""
    return {core for core, counts in found.figures["mismatches"].items() if any(counts.values())}


def only(monkeypatch: pytest.MonkeyPatch, *cores: Core) -> None:
    monkeypatch.setattr(pil, "CORES", {True: cores})


@functools.cache
def clean() -> Outcome:
    return outcome(planted.subject_of(PI))


# --- what is right -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", builds.KINDS)
def test_every_kind_has_the_same_bits_everywhere(kind: Kind) -> None:
    found = clean() if kind == "pi" else outcome(planted.subject_of(builds.made(kind)))
    assert found.findings == ()
    assert found.verdict is Verdict.PASSED
    assert found.figures["rows"]["random steps"] == STEPS
    assert found.figures["rows"]["scenario step-steer"] > 1_000
    assert set(found.figures["mismatches"]) == {core.name for core in ALL}
    assert ("model" in found.figures["rows"]) == (kind == "tracking")
    assert set(found.figures["statuses"]) == {status.name for status in Status}
    assert min(found.figures["statuses"].values()) > 0


def test_uneven_axes_and_several_frictions() -> None:
    assert outcome(planted.subject_of(builds.made("tracking", "uneven", layers=True))).findings == ()


def test_double_precision_runs_where_there_is_an_fpu_for_it() -> None:
    found = outcome(planted.subject_of(builds.made("pi", precision="double")))
    assert found.findings == ()
    assert set(found.figures["mismatches"]) == {POWERPC_BE.name}
    assert any("double precision" in limit for limit in found.limits)


def test_everything_that_is_told_is_the_same_each_time() -> None:
    again = outcome(planted.subject_of(PI))
    assert json.dumps(again.figures) == json.dumps(clean().figures)
    calls = 3 * (sum(clean().figures["rows"].values()) - STEPS)
    assert again.figure == clean().figure == f"0 mismatches in {3 * STEPS:,} steps and {calls:,} other calls on 3 cores"


def test_the_dynamics_are_within_the_bound_of_their_library() -> None:
    for apart in clean().figures["dynamics"].values():
        assert 0.0 < apart["share_of_bound"] < 1.0
        assert apart["library_ulps"] <= 2
    assert any("atanf, cosf, sinf" in limit for limit in clean().limits)


def test_more_is_run_without_haste(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pil, "STEPS", 2 * STEPS)
    only(monkeypatch, CORTEX_M4F)
    found = pil.check(planted.subject_of(PI), Effort())
    assert found.verdict is Verdict.PASSED
    assert found.figures["rows"]["random steps"] == 2 * STEPS
    assert found.figures["rows"]["recorded scenarios"] > 5_000


def test_how_much_is_asked_for() -> None:
    """In the code itself, which the fixture above does not touch."""
    assert pil.STEPS == 100_000


# --- byte order --------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_dynamics")
def test_a_signal_copied_into_a_frame_is_found_on_the_big_endian_core_alone() -> None:
    found = outcome(
        planted.wrapped(
            PI,
            "ars_can",
            "ars_can_pack_rear_steer_command",
            "void ars_can_pack_rear_steer_command(const ars_rear_steer_command_t *signals, uint8_t data[8])",
            "    union { uint16_t word; uint8_t bytes[2]; } unpacked;\n"
            "    planted_ars_can_pack_rear_steer_command(signals, data);\n"
            "    unpacked.word = signals->diagnostics;\n    data[6] = unpacked.bytes[0];\n    data[7] = unpacked.bytes[1];",
        )
    )
    assert found.verdict is Verdict.FAILED
    assert faults(found) == {POWERPC_BE.name}
    assert found.findings[0].startswith("PowerPC, big-endian: can, message ")
    assert ": command_data[4..7] is 0x" in found.findings[0]
    assert "on this machine; speed = " in found.findings[0]
    assert any(": disturbed traffic, cycle " in finding for finding in found.findings)


@pytest.mark.usefixtures("no_dynamics")
def test_a_data_id_taken_byte_by_byte_is_found_on_the_big_endian_core_alone() -> None:
    found = outcome(
        planted.wrapped(
            PI,
            "ars_e2e",
            "ars_e2e_check",
            "ars_e2e_status_t ars_e2e_check(ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8])",
            "    union { uint16_t word; uint8_t bytes[2]; } unpacked = { data_id };\n"
            "    const uint16_t id = (uint16_t)(unpacked.bytes[0] | ((uint32_t)unpacked.bytes[1] << 8));\n"
            "    return planted_ars_e2e_check(self, id, data);",
        )
    )
    assert faults(found) == {POWERPC_BE.name}
    assert found.figures["mismatches"][POWERPC_BE.name]["scenario step-steer"] > 1_000
    assert found.findings[0].startswith("PowerPC, big-endian: scenario step-steer, cycle 0: ")
    assert ", frames 0x101 [8] " in found.findings[0]


@pytest.mark.usefixtures("no_dynamics")
def test_a_self_test_that_fails_on_a_core_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, CORTEX_M4F)
    signature = "uint32_t ars_map_checksum(void)"
    body = "    uint32_t crc = planted_ars_map_checksum();\n#ifdef __thumb__\n    crc ^= 1u;\n#endif\n    return crc;"
    found = outcome(planted.wrapped(PI, "ars_map", "ars_map_checksum", signature, body))
    assert found.findings == ("Cortex-M4F: the self-test of the build says no",)
    assert found.verdict is Verdict.FAILED


# --- arithmetic --------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_dynamics")
def test_a_fused_multiplication_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a compiler that contracts. The host has no such instruction, or gcc, which does not know the pragma; for a
    Cortex-M4 clang holds it for too slow."""
    only(monkeypatch, CORTEX_M7)
    found = outcome(
        planted.limiter(
            PI,
            "#ifdef __clang__\n    {\n#pragma STDC FP_CONTRACT ON\n#endif\n"
            "    result = (result * 1.0000001f) + (0.1f * self->front_angle);\n#ifdef __clang__\n    }\n#endif",
        )
    )
    assert faults(found) == {CORTEX_M7.name}
    assert any(finding.startswith("Cortex-M7: random steps, step ") for finding in found.findings)


def test_c_that_might_never_return_is_not_run() -> None:
    found = outcome(planted.limiter(PI, "    while (result > -2.0f) { result += 0.0f; }"))
    assert found.verdict is Verdict.NOT_RUN
    (finding,) = found.findings
    assert finding.startswith("it might never return: src/ars_limiter.c:")


def test_double_precision_in_between_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, CORTEX_M4F)
    found = outcome(planted.limiter(PI, "    result = (float)((double)result * 1.0000001);"))
    assert found.verdict is Verdict.FAILED
    assert found.figure == "the C does not run"
    assert "the C does not compile: undefined symbol: __aeabi_" in found.findings[0]


@pytest.mark.usefixtures("no_dynamics")
def test_a_signalling_nan_in_an_unguarded_comparison_is_found_on_the_cortex_m7_alone() -> None:
    """Its clang makes a maximum of it, which passes such a NaN on; a comparison and a jump do not."""
    found = outcome(
        planted.wrapped(
            PI,
            "ars_map",
            "ars_map_yaw_rate_on_road",
            "float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction)",
            "    const float bounded = (speed > 0.5f) ? speed : 0.5f;\n"
            "    return planted_ars_map_yaw_rate_on_road(bounded, front_angle, friction);",
        )
    )
    assert faults(found) == {CORTEX_M7.name}
    (finding,) = (each for each in found.findings if each.startswith("Cortex-M7: lookup, call "))
    assert ": yaw_rate_on_road is " in finding
    assert "speed = nan (0x" in finding


@pytest.mark.usefixtures("no_dynamics")
def test_what_differs_in_the_state_alone_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, POWERPC_BE)
    found = outcome(
        planted.wrapped(
            PI,
            "ars_limiter",
            "ars_limiter_init",
            "void ars_limiter_init(ars_limiter_t *self, float rear_angle)",
            "    planted_ars_limiter_init(self, rear_angle);\n#ifdef __powerpc__\n    self->speed = 1.0e-45f;\n#endif",
        )
    )
    assert ": state.limiter.speed is 1.40129846e-45 (0x00000001), and " in found.findings[0]


def test_dynamics_beyond_their_bound_are_found() -> None:
    found = outcome(
        planted.wrapped(
            PI,
            "ars_dynamics",
            "ars_dynamics_magic_formula",
            "ars_dynamics_state_t ars_dynamics_magic_formula("
            "const ars_dynamics_state_t *state, const ars_dynamics_input_t *input)",
            "    ars_dynamics_state_t result = planted_ars_dynamics_magic_formula(state, input);\n"
            "#ifdef __powerpc__\n    result.yaw_rate *= 1.00001f;\n#endif\n    return result;",
        )
    )
    assert faults(found) == set()
    (finding,) = found.findings
    assert finding.startswith("PowerPC, big-endian: dynamics, magic_formula.yaw_rate is ")
    assert ", further apart than " in finding
    assert found.verdict is Verdict.FAILED


# --- what the check must not take for good -----------------------------------------------------------------------------


@pytest.mark.usefixtures("no_dynamics")
def test_a_status_that_is_never_reached_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, CORTEX_M4F)
    text = planted.source(PI, "ars_controller").replace(
        "self->status = ARS_STATUS_DEGRADED;", "self->status = ARS_STATUS_FAIL_SAFE;"
    )
    found = outcome(planted.subject_of(PI, ars_controller=text))
    assert found.findings == ("the random steps never reach the status DEGRADED",)
    assert found.verdict is Verdict.FAILED


def test_c_that_does_not_compile_is_told_with_its_line() -> None:
    found = outcome(planted.subject_of(PI, ars_limiter=planted.source(PI, "ars_limiter") + "int;;(\n"))
    assert found.verdict is Verdict.FAILED
    assert found.findings[0].startswith("src/ars_limiter.c:")


def test_code_that_leaves_its_memory_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    only(monkeypatch, CORTEX_M7)
    found = outcome(planted.limiter(PI, "#ifdef __thumb__\n    result += *(volatile float *)0x90000000u;\n#endif"))
    assert found.verdict is Verdict.FAILED
    assert "the code on the Cortex-M7 ended at 0x" in found.findings[0]


@pytest.mark.parametrize(("name", "package"), [("unicorn", "unicorn"), ("elftools.elf.elffile", "pyelftools")])
def test_a_missing_package_is_no_verdict(monkeypatch: pytest.MonkeyPatch, name: str, package: str) -> None:
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(MissingTool, match=f"^{package}: it cannot be imported"):
        outcome(planted.subject_of(PI))


def test_a_missing_compiler_is_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(MissingTool, match=r"^CC: the compiler 'no-such-compiler' does not exist"):
        outcome(planted.subject_of(PI))
    monkeypatch.undo()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingTool, match=r"^ziglang: it is not installed"):
        outcome(planted.subject_of(PI))


def test_numbers_are_told_so_that_they_can_be_given_again() -> None:
    from codegen.verify.pil.streams import number_told

    assert number_told(np.uint32(0x3DCCCCCD)) == "0.100000001 (0x3dcccccd)"
    assert number_told(np.uint64(0x7FF0000000000001)) == "nan (0x7ff0000000000001)"
