"""Check 7, its bounded part: nothing is found in what is generated, and each property is able to fail."""

from __future__ import annotations

import re

import pytest

from codegen import config as configuration
from codegen.config import Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.refmap.solve import solve_case
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.fuzzing import check as fuzzing
from codegen.verify.fuzzing import harness as fuzz_harness
from codegen.verify.packages import MissingTool
from codegen.verify.sanitizers import check as sanitizers
from codegen.verify.sanitizers import sanitized
from tests.verify import builds, planted

TRACKING = builds.made("tracking")
CHECK = "ars_e2e_status_t ars_e2e_check(ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8])"
MENDED = (
    "    uint8_t mended[8];\n    uint32_t k;\n\n    for (k = 0u; k < 8u; k++) {{\n        mended[k] = data[k];\n    }}\n"
    "    if ({}) {{\n        mended[{}] = {};\n    }}\n"
    "    return planted_ars_e2e_check(self, data_id, mended);"
)


@pytest.fixture(autouse=True)
def compiler() -> sanitized.Compiler:
    try:
        return sanitized.find_compiler()
    except MissingTool as error:
        pytest.skip(str(error))


def checked(subject: Subject) -> Outcome:
    return fuzzing.check(subject, Effort(quick=True))


def one(monkeypatch: pytest.MonkeyPatch, name: fuzz_harness.Name) -> None:
    """Run that harness alone."""
    monkeypatch.setattr(fuzzing, "HARNESSES", (name,))


def skipped_crc(folder: Folder, where: str) -> Subject:
    """The build whose check of the CRC is skipped for frames with `data` like that."""
    return planted.wrapped(folder, "ars_e2e", "ars_e2e_check", CHECK, MENDED.format(where, 0, "ars_e2e_crc(data_id, mended)"))


# --- what is generated ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", builds.KINDS)
def test_nothing_is_found_in_what_is_generated(kind: Kind) -> None:
    outcome = checked(planted.subject_of(builds.made(kind)))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    assert outcome.figure == f"{2 * fuzzing.INPUTS_QUICK:,} inputs, 0 crashes"
    for figures in outcome.figures.values():
        assert figures["inputs"] == fuzzing.INPUTS_QUICK
        assert figures["corpus"] > figures["seeds"] == 18
        assert figures["edges"] > 200


@pytest.mark.parametrize("precision", ["single", "double"])
def test_nor_with_uneven_axes_and_several_frictions(precision: builds.Precision) -> None:
    outcome = checked(planted.subject_of(builds.made("tracking", "uneven", layers=True, precision=precision)))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)


def test_another_prefix_and_another_layout_of_the_frames() -> None:
    """Motorola byte order, an offset, unsigned signals, other identifiers; the same inputs twice give the same outcome."""
    data = configuration.preset("paper").model_dump(mode="json")
    motion, command = data["can"]["vehicle_motion"], data["can"]["rear_steer_command"]
    motion["byte_order"], command["byte_order"] = "motorola", "motorola"
    motion["qualifier"]["start_bit"] = 15
    for message, starts in ((motion, (23, 39, 55)), (command, (23, 39))):
        names = [name for name, signal in message.items() if isinstance(signal, dict) and "factor" in signal]
        for name, start in zip(names, starts, strict=True):
            message[name]["start_bit"] = start
    command["status"]["start_bit"], command["diagnostics"]["start_bit"] = 15, 55
    command["id"], command["data_id"] = 0x3A0, 0x1234
    command["rear_angle"].update(signed=False, offset=-1.6)
    config = configuration.parse(data, "test")
    options = BuildOptions("sample", prefix="rear2")
    folder = build(solve_case(config, "4ws-2"), config, options, BuildInputs("s.npz", "0" * 64, "preset"))
    first, second = (checked(planted.subject_of(folder)) for _ in range(2))
    assert (first.findings, first.verdict) == ((), Verdict.PASSED)
    assert first == second


def test_seeds_are_recorded_frames_and_fit_the_driver() -> None:
    found = fuzz_harness.seeds(planted.subject_of(TRACKING))
    assert {name: len(seeds) for name, seeds in found.items()} == {"can": 18, "step": 18}
    longest = int(re.search(r"BYTES_MAX = (\d+)", fuzz_harness.driver().decode())[1])  # type: ignore[index]
    for seeds in found.values():
        assert len(set(seeds)) == len(seeds)
        assert all(100 < len(seed) <= longest for seed in seeds)


# --- planted faults: the CAN receive path --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("where", "others_pass"),
    [
        ("data[1] < 255u", False),
        # Only in frames that the fault catalogue never makes: no other check sees it.
        ("(data[7] & 0xF0u) == 0x50u", True),
    ],
)
def test_a_skipped_crc(where: str, others_pass: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    one(monkeypatch, "can")
    subject = skipped_crc(TRACKING, where)
    outcome = checked(subject)
    assert outcome.verdict is Verdict.FAILED
    (finding,) = outcome.findings
    assert re.match(
        r"can: property not held: a frame that must not be used makes no difference \(\d+, \d+\), at input \d+ of ", finding
    )
    if others_pass:
        monkeypatch.setattr("codegen.verify.sanitizers.trap_build.trapped", lambda subject, effort: ())
        assert sanitizers.check(subject, Effort(quick=True)).verdict is Verdict.PASSED


@pytest.mark.parametrize(
    ("name", "function", "signature", "body", "told"),
    [
        (
            "ars_e2e",
            "ars_e2e_check",
            CHECK,
            MENDED.format("(data[1] & 0xFu) == 15u", 1, "(uint8_t)(data[1] & 0xF0u)").replace(
                "    return", "    mended[0] = (data[1] & 0xFu) == 15u ? ars_e2e_crc(data_id, mended) : data[0];\n    return"
            ),
            "property not held: a frame that must not be used makes no difference",
        ),
        (
            "ars_e2e",
            "ars_e2e_protect",
            "void ars_e2e_protect(uint16_t data_id, uint8_t *counter, uint8_t data[8])",
            "    planted_ars_e2e_protect(data_id, counter, data);\n    data[0] ^= (data[7] > 0x7Fu) ? 1u : 0u;",
            "property not held: CRC of the command",
        ),
        (
            "ars_e2e",
            "ars_e2e_protect",
            "void ars_e2e_protect(uint16_t data_id, uint8_t *counter, uint8_t data[8])",
            "    planted_ars_e2e_protect(data_id, counter, data);\n    *counter += (*counter == 7u) ? 1u : 0u;",
            "property not held: counter of the command (8, 7)",
        ),
        (
            "ars_task",
            "ars_task_on_can_frame",
            "void ars_task_on_can_frame(ars_task_t *self, uint32_t id, const uint8_t *data, uint8_t length)",
            "    planted_ars_task_on_can_frame(self, id, data, (length < 8u) ? 8u : length);",
            "src/ars_e2e.c:",
        ),
        (
            "ars_task",
            "ars_task_10ms",
            "uint32_t ars_task_10ms(ars_task_t *self, uint8_t data[8])",
            "    return planted_ars_task_10ms(self, data) + ((data[6] == 0x21u) ? 1u : 0u);",
            "property not held: identifier of the command",
        ),
        (
            "ars_task",
            "ars_task_init",
            "void ars_task_init(ars_task_t *self, const ars_parameters_t *parameters)",
            "    static ars_parameters_t patient;\n\n    patient = *parameters;\n    patient.degraded_samples_max += 1u;\n"
            "    planted_ars_task_init(self, &patient);",
            "property not held: fail-safe after so many lost samples (3, 4)",
        ),
        (
            "ars_can",
            "ars_can_pack_rear_steer_command",
            "void ars_can_pack_rear_steer_command(const ars_rear_steer_command_t *signals, uint8_t data[8])",
            "    ars_rear_steer_command_t sent = *signals;\n\n    sent.rear_angle *= 1.1f;\n"
            "    planted_ars_can_pack_rear_steer_command(&sent, data);",
            "property not held: rear angle ",
        ),
        (
            "ars_can",
            "ars_can_pack_rear_steer_command",
            "void ars_can_pack_rear_steer_command(const ars_rear_steer_command_t *signals, uint8_t data[8])",
            "    ars_rear_steer_command_t sent = *signals;\n\n"
            "    sent.rear_angle = (sent.status == 3u) ? ars_can_not_available() : sent.rear_angle;\n"
            "    planted_ars_can_pack_rear_steer_command(&sent, data);",
            "property not held: a rear angle is commanded once it was",
        ),
        (
            "ars_can",
            "ars_can_pack_rear_steer_command",
            "void ars_can_pack_rear_steer_command(const ars_rear_steer_command_t *signals, uint8_t data[8])",
            "    ars_rear_steer_command_t sent = *signals;\n\n"
            "    sent.rear_angle = (sent.status == 4u) ? 0.0f : sent.rear_angle;\n"
            "    planted_ars_can_pack_rear_steer_command(&sent, data);",
            "property not held: ",
        ),
    ],
)
def test_what_must_hold_of_the_receive_path(
    name: str, function: str, signature: str, body: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    one(monkeypatch, "can")
    outcome = checked(planted.wrapped(TRACKING, name, function, signature, body))
    assert outcome.verdict is Verdict.FAILED
    (finding,) = outcome.findings
    assert finding.startswith(f"can: {told}"), finding
    assert outcome.figure.endswith(" inputs, 1 crashes")


# --- planted faults: the step --------------------------------------------------------------------------------------------

STEP = (
    "ars_command_t ars_controller_step("
    "ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement)"
)
STEPPED = "    ars_command_t result = planted_ars_controller_step(self, parameters, measurement);\n\n    {}\n    return result;"


@pytest.mark.parametrize(
    ("statement", "told"),
    [
        ("result.rear_angle *= 1.5f;", "rear angle "),
        ("result.rear_angle /= (result.rear_angle < 0.05f) ? 1.0f : 0.0f;", "src/ars_controller.c:"),
        ("result.yaw_rate_reference = measurement->speed * 1.0e38f;", "reference is a number"),
        ("result.yaw_rate_reference *= 1.3f;", "reference "),
        ("result.status = (ars_status_t)(result.status + (result.status == 4));", "status has a name (5, 4)"),
        (
            "result.status = (result.status == 3) ? ARS_STATUS_TRACKING : result.status;",
            "no control upon a signal out of range",
        ),
        ("result.status = (result.status == 2) ? ARS_STATUS_TRACKING : result.status;", "no control below the disabling speed"),
        (
            "result.yaw_rate_reference = (result.status == 4) ? 0.01f : result.yaw_rate_reference;",
            "no reference in standby and fail-safe (0.00999999978, 0)",
        ),
        ("result.yaw_rate_reference *= (result.status == 3) ? 0.99f : 1.0f;", "reference is held while degraded"),
    ],
)
def test_what_must_hold_of_a_step(statement: str, told: str, monkeypatch: pytest.MonkeyPatch) -> None:
    one(monkeypatch, "step")
    outcome = checked(planted.wrapped(TRACKING, "ars_controller", "ars_controller_step", STEP, STEPPED.format(statement)))
    assert outcome.verdict is Verdict.FAILED
    prefix = "" if told.startswith("src/") else "property not held: "
    assert outcome.findings[0].startswith(f"step: {prefix}{told}"), outcome.findings


def test_a_removed_clamp(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shows only where the parameters are changed while the controller runs."""
    one(monkeypatch, "step")
    pattern = r"self->rear_angle = clamp\(target, -parameters->rear_angle_max, parameters->rear_angle_max\);"
    text, count = re.subn(pattern, "self->rear_angle = target;", planted.source(TRACKING, "ars_limiter"))
    assert count == 1
    (finding,) = checked(planted.subject_of(TRACKING, ars_limiter=text)).findings
    assert finding.startswith("step: property not held: ")
    assert "bound" in finding


@pytest.mark.parametrize(
    ("name", "function", "signature", "body", "told"),
    [
        (
            "ars_limiter",
            "ars_limiter_step",
            "float ars_limiter_step("
            "ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input)",
            "    ars_limiter_parameters_t fast = *parameters;\n\n    fast.rear_rate_max *= 1.5f;\n"
            "    return planted_ars_limiter_step(self, &fast, input);",
            "property not held: the limiter moves by its rate at most",
        ),
        (
            "ars_map",
            "ars_map_yaw_rate_on_road",
            "float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction)",
            "    return planted_ars_map_yaw_rate_on_road(speed, front_angle, friction) * ((speed > 30.0f) ? 1.01f : 1.0f);",
            "property not held: ",
        ),
        (
            "ars_map",
            "ars_map_yaw_rate_on_road",
            "float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction)",
            "    return planted_ars_map_yaw_rate_on_road(speed, (front_angle < -0.5f) ? -0.5f : front_angle, friction);",
            "property not held: ",
        ),
        (
            "ars_can",
            "ars_can_unpack_vehicle_motion",
            "void ars_can_unpack_vehicle_motion(const uint8_t data[8], ars_vehicle_motion_t *signals)",
            "    planted_ars_can_unpack_vehicle_motion(data, signals);\n    signals->speed *= 1.001f;",
            "property not held: a signal comes back",
        ),
        (
            "ars_can",
            "ars_can_pack_vehicle_conditions",
            "void ars_can_pack_vehicle_conditions(const ars_vehicle_conditions_t *signals, uint8_t data[8])",
            "    planted_ars_can_pack_vehicle_conditions(signals, data);\n"
            "    data[2] = (uint8_t)(data[2] + ((int32_t)(signals->rear_angle * 1.0e4f) & 0));",
            "src/ars_can.c:",
        ),
        (
            "ars_reference_model",
            "ars_reference_model_step",
            "void ars_reference_model_step(ars_reference_model_t *self, const ars_reference_model_input_t *input)",
            "    planted_ars_reference_model_step(self, input);\n    self->yaw_rate += 0.0f * input->friction;",
            "property not held: the reference model holds numbers",
        ),
        (
            "ars_dynamics",
            "ars_dynamics_linear",
            "ars_dynamics_state_t ars_dynamics_linear(const ars_dynamics_state_t *state, const ars_dynamics_input_t *input)",
            "    ars_dynamics_state_t result = planted_ars_dynamics_linear(state, input);\n\n"
            "    result.yaw_rate /= (input->speed == input->speed) ? input->front_angle : 1.0f;\n    return result;",
            "src/ars_dynamics.c:",
        ),
    ],
)
def test_what_must_hold_of_the_units(
    name: str, function: str, signature: str, body: str, told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    one(monkeypatch, "step")
    outcome = checked(planted.wrapped(TRACKING, name, function, signature, body))
    assert outcome.verdict is Verdict.FAILED
    assert outcome.findings[0].startswith(f"step: {told}"), outcome.findings


# --- what goes wrong -----------------------------------------------------------------------------------------------------


def test_an_input_that_does_not_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fuzzing, "SECONDS_MAX", 1.0)
    one(monkeypatch, "step")
    outcome = checked(planted.limiter(TRACKING, "    while (input->demand > 0.05f) {\n        result += 0.0f;\n    }"))
    assert (outcome.findings, outcome.verdict) == (("step: an input does not end",), Verdict.FAILED)


def test_c_that_does_not_compile_is_a_finding() -> None:
    outcome = checked(planted.subject_of(TRACKING, ars_limiter=planted.source(TRACKING, "ars_limiter") + "\nint broken(;\n"))
    (finding,) = outcome.findings
    assert re.match(r"src/ars_limiter\.c:\d+: the C does not compile: ", finding)
    assert outcome.verdict is Verdict.FAILED


def test_without_a_compiler_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(MissingTool, match="no C compiler whose sanitizers find a planted fault"):
        checked(planted.subject_of(TRACKING))
