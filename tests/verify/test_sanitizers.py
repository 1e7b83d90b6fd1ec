"""Check 6: the generated C runs clean under the sanitizers, and each kind of fault is found and told by its line."""

from __future__ import annotations

import re
import sys
from dataclasses import replace

import pytest

from codegen import config as configuration
from codegen.config import Kind
from codegen.emit.build import BuildInputs, BuildOptions, build
from codegen.emit.folder import Folder
from codegen.refmap.solve import solve_case
from codegen.verify import suites
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.drives import Ground
from codegen.verify.map_reference import lookup_of
from codegen.verify.packages import MissingTool
from codegen.verify.sanitizers import check as sanitizers
from codegen.verify.sanitizers import sanitized, served_ecu
from tests.verify import builds, planted

TRACKING = builds.made("tracking")
FAR = "    const int32_t far = (input->demand > 0.05f) ? 6 : 0;\n\n    "


@pytest.fixture(autouse=True)
def compiler() -> sanitized.Compiler:
    try:
        return sanitized.find_compiler()
    except MissingTool as error:
        pytest.skip(str(error))


@pytest.fixture
def no_trap_build(monkeypatch: pytest.MonkeyPatch) -> None:
    """That half has tests of its own."""
    monkeypatch.setattr("codegen.verify.sanitizers.trap_build.trapped", lambda subject, effort: ())


@pytest.fixture
def no_faults(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the fault catalogue, which takes longest, where another part must find it."""
    monkeypatch.setattr(sanitizers, "run_all", lambda config, runner: [])


def checked(subject: Subject) -> Outcome:
    return sanitizers.check(subject, Effort(quick=True))


def replaced(folder: Folder, name: str, pattern: str, new: str, count: int = 1) -> Subject:
    """The build with so many places of src/NAME.c changed."""
    text, found = re.subn(pattern, new, planted.source(folder, name))
    assert found == count, f"{pattern} stands {found} times in {name}"
    return planted.subject_of(folder, **{name: text})


# --- what is generated ---------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_trap_build")
@pytest.mark.parametrize("kind", builds.KINDS)
def test_what_is_generated_passes(kind: Kind) -> None:
    outcome = checked(planted.subject_of(builds.made(kind)))
    assert outcome.findings == ()
    assert outcome.verdict is Verdict.PASSED
    assert outcome.figures["scenarios"] == 9
    assert outcome.figures["faults"] == 28
    assert outcome.figures["steps"] == 8 * sanitizers.SAMPLES_QUICK
    assert outcome.figure == f"0 findings in 9 scenarios, 28 faults and {outcome.figures['steps']:,} steps"
    assert not any("do not reach" in limit for limit in outcome.limits)


@pytest.mark.usefixtures("no_trap_build")
@pytest.mark.parametrize("precision", ["single", "double"])
def test_so_do_uneven_axes_and_several_frictions(precision: builds.Precision) -> None:
    outcome = checked(planted.subject_of(builds.made("tracking", "uneven", layers=True, precision=precision)))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    assert (sanitizers.NO_TRAP_BUILD in outcome.limits) == (precision == "double")


def test_another_prefix_and_the_paper_s_controller() -> None:
    """With the trap build, as a user gets it."""
    config = configuration.preset("paper")
    options = BuildOptions("sample", prefix="rear2")
    folder = build(solve_case(config, "4ws-2"), config, options, BuildInputs("s.npz", "0" * 64, "preset"))
    outcome = checked(planted.subject_of(folder))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    assert outcome.figures["trap_build"] == "Cortex-M4F"
    assert outcome == checked(planted.subject_of(folder))


# --- planted faults ------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_faults")
@pytest.mark.parametrize(
    ("statement", "what"),
    [
        (
            "result += 0.0f * (float)(int8_t)((float)far * 1.0e6f);",
            "6e+06 is outside the range of representable values of type",
        ),
        ("result += input->demand / ((float)far * 0.0f);", "division by zero"),
        ("result += 0.0f * parameters->opposite_phase_max[far];", "index 6 out of bounds for type"),
        ("result += 0.0f * (float)(far * 400000000);", "signed integer overflow"),
        ("result += 0.0f * (float)(1u << (far * 6));", "shift exponent 36 is too large"),
    ],
)
def test_undefined_behaviour_is_told_by_its_line(statement: str, what: str) -> None:
    subject = planted.limiter(TRACKING, FAR + statement)
    line = 1 + subject.files["src/ars_limiter.c"].decode().splitlines().index(f"    {statement}")
    outcome = checked(subject)
    assert outcome.verdict is Verdict.FAILED
    assert outcome.findings[0].startswith(f"src/ars_limiter.c:{line}: undefined behaviour: {what}")


@pytest.mark.usefixtures("no_faults")
@pytest.mark.parametrize(
    ("statement", "what"),
    [
        (
            "result += 0.0f * ((const volatile float *)(const void *)self)[far * 4];",
            "wrong address: heap-buffer-overflow, read of 4 bytes",
        ),
        ("if (far > 0) { ((volatile uint8_t *)self)[4096] = 0u; }", "wrong address: heap-buffer-overflow, write of 1 bytes"),
    ],
)
def test_a_wrong_address_is_told_by_its_line(statement: str, what: str) -> None:
    """It ends the program under test, and not the one that tests."""
    subject = planted.limiter(TRACKING, FAR + statement)
    line = 1 + subject.files["src/ars_limiter.c"].decode().splitlines().index(f"    {statement}")
    outcome = checked(subject)
    assert outcome.verdict is Verdict.FAILED
    assert outcome.findings[0].startswith(f"src/ars_limiter.c:{line}: {what}")
    assert outcome.findings[0].endswith(" in ars_limiter_step")


@pytest.mark.usefixtures("no_trap_build", "no_faults")
def test_swapped_indices_give_other_numbers_than_the_reference() -> None:
    """As many speeds as front angles: no address is wrong."""
    pattern = r"\[place->row\.(\w+)( \+ 1u)?\]\[place->column\.\w+\]"
    outcome = checked(replaced(TRACKING, "ars_map", pattern, r"[place->column.\1\2][place->row.\1]", 2))
    assert outcome.verdict is Verdict.FAILED
    assert not any("wrong address" in finding for finding in outcome.findings)
    told = next(finding for finding in outcome.findings if "look-up" in finding)
    assert re.match(
        r"src/ars_map\.c: the look-up at \S+ m/s, \S+ rad, friction \S+ gives .*, the reference .* are wrong\)", told
    )


@pytest.mark.usefixtures("no_trap_build", "no_faults")
@pytest.mark.parametrize(
    ("function", "signature", "body", "told"),
    [
        (
            "ars_map_reference",
            "ars_map_reference_t ars_map_reference(float speed, float front_angle, float friction)",
            "    ars_map_reference_t result = planted_ars_map_reference(speed, front_angle, friction);\n"
            "    result.rear_angle *= (speed > 25.0f) ? 1.0000002f : 1.0f;\n    return result;",
            "rad, the reference",
        ),
        (
            "ars_map_yaw_rate_on_road",
            "float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction)",
            "    return planted_ars_map_yaw_rate_on_road(speed, front_angle, friction)\n"
            "        * ((friction < 0.2f) ? 1.0000002f : 1.0f);",
            "friction 0 gives",
        ),
    ],
)
def test_one_unit_in_the_last_place_shows(function: str, signature: str, body: str, told: str) -> None:
    (finding,) = checked(planted.wrapped(TRACKING, "ars_map", function, signature, body)).findings
    assert finding.startswith("src/ars_map.c: the look-up at ")
    assert told in finding


@pytest.mark.usefixtures("no_trap_build")
def test_a_skipped_crc_leaves_faults_that_do_not_end_as_defined() -> None:
    signature = "ars_e2e_status_t ars_e2e_check(ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8])"
    body = (
        "    uint8_t mended[8];\n    uint32_t k;\n\n    for (k = 0u; k < 8u; k++) {\n        mended[k] = data[k];\n    }\n"
        "    mended[0] = ars_e2e_crc(data_id, mended);\n    return planted_ars_e2e_check(self, data_id, mended);"
    )
    outcome = checked(planted.wrapped(TRACKING, "ars_e2e", "ars_e2e_check", signature, body))
    assert outcome.verdict is Verdict.FAILED
    assert any(finding.startswith("fault corrupt-50, a bit flipped in 50 samples: ") for finding in outcome.findings)


@pytest.mark.usefixtures("no_trap_build", "no_faults")
@pytest.mark.parametrize(
    ("body", "told"),
    [
        ("    result *= 1.1f;", r"drive 0, step \d+: -?0\.06\d* rad, reference \S+ rad/s, status \d after \("),
        ("    result = (input->demand > 0.0f) ? 0.07f : result;", r"scenario \S+: the rear angle goes to 0\.07 rad"),
    ],
)
def test_a_bound_that_does_not_hold(body: str, told: str) -> None:
    findings = checked(planted.limiter(TRACKING, body)).findings
    assert any(re.match(told, finding) for finding in findings), findings


@pytest.mark.usefixtures("no_faults")
def test_a_self_test_that_fails() -> None:
    subject = planted.wrapped(TRACKING, "ars_selftest", "ars_selftest", "bool ars_selftest(void)", "    return false;")
    assert checked(subject).findings == ("src/ars_selftest.c: the self-test fails",)


@pytest.mark.usefixtures("no_faults")
def test_c_that_does_not_compile_is_a_finding() -> None:
    outcome = checked(planted.subject_of(TRACKING, ars_limiter=planted.source(TRACKING, "ars_limiter") + "\nint broken(;\n"))
    assert outcome.verdict is Verdict.FAILED
    (finding,) = outcome.findings
    assert re.match(r"src/ars_limiter\.c:\d+: the C does not compile: ", finding)


@pytest.mark.usefixtures("no_faults", "no_trap_build")
def test_c_without_a_table_is_a_finding() -> None:
    text = planted.source(TRACKING, "ars_calibration").replace("0.0f, 0.0f, 0.0f, 0.0f,", "0.0f, 0.0f, 0.0f,", 1)
    (finding,) = checked(planted.subject_of(TRACKING, ars_calibration=text)).findings
    assert finding == "src/ars_calibration.c: ars_map_yaw_rate_table has 10403 numbers, where 1 x 102 x 102 are expected"


@pytest.mark.usefixtures("no_faults")
def test_code_that_does_not_return_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(served_ecu, "SECONDS_MAX", 1.0)
    subject = planted.limiter(TRACKING, "    while (input->demand > 0.05f) {\n        result += 0.0f;\n    }")
    assert checked(subject).findings == ("the program ended early: signal 9",)


# --- what is missing -----------------------------------------------------------------------------------------------------


def test_without_a_compiler_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", "")
    outcome = checked(planted.subject_of(TRACKING))
    assert outcome.verdict is Verdict.NOT_RUN
    host, target = outcome.findings
    assert host.startswith("sanitizers: no C compiler whose sanitizers find a planted fault (no C compiler is here); install")
    assert target.startswith("trap build: no C compiler was found; install")


def test_a_compiler_without_sanitizers_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes the flags and looks for nothing."""
    monkeypatch.setenv("CC", f"{sys.executable} -c pass")
    with pytest.raises(MissingTool, match=r"\(python\S* -c pass\)"):
        sanitized.find_compiler()


@pytest.mark.usefixtures("no_faults")
def test_without_a_trap_build_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(subject: Subject, effort: Effort) -> tuple[str, ...]:
        raise MissingTool("it is not installed", where="unicorn", remedy="install it")

    monkeypatch.setattr("codegen.verify.sanitizers.trap_build.trapped", refuse)
    outcome = checked(planted.subject_of(TRACKING))
    assert (outcome.verdict, outcome.findings) == (
        Verdict.NOT_RUN,
        ("trap build: unicorn: it is not installed; install it",),
    )
    assert outcome.figures["scenarios"] == 9


@pytest.mark.usefixtures("no_faults")
def test_what_traps_makes_it_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("codegen.verify.sanitizers.trap_build.trapped", lambda subject, effort: ("src/ars_map.c:1: a trap",))
    outcome = checked(planted.subject_of(TRACKING))
    assert (outcome.verdict, outcome.findings) == (Verdict.FAILED, ("src/ars_map.c:1: a trap",))


# --- the suites ----------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("no_trap_build")
def test_faults_are_judged_only_where_they_are_defined() -> None:
    config = builds.config_of("tracking")
    data = config.model_dump(mode="json")
    data["controller"]["fail_safe"]["degraded_samples_max"] = 6
    other = configuration.parse(data, "test")
    assert suites.are_faults_defined_for(config)
    assert not suites.are_faults_defined_for(other)
    folder = build(solve_case(other, "4ws-2"), other, BuildOptions("sample"), BuildInputs("s.npz", "0" * 64, "preset"))
    outcome = checked(planted.subject_of(folder))
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    assert sanitizers.FAULTS_NOT_JUDGED in outcome.limits


@pytest.mark.usefixtures("no_faults", "no_trap_build")
def test_a_map_of_another_version_is_judged_by_the_bound() -> None:
    """The order of the operations may have been another one there; a wrong cell shows all the same."""
    manifest = {**TRACKING.manifest, "version": "0.0.1"}
    signature = "float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction)"
    body = "    return planted_ars_map_yaw_rate_on_road(speed, front_angle, friction) * {}f;"
    near, far = (
        replace(
            planted.wrapped(TRACKING, "ars_map", "ars_map_yaw_rate_on_road", signature, body.format(factor)), manifest=manifest
        )
        for factor in (1.000001, 1.001)
    )
    assert checked(near).verdict is Verdict.PASSED
    assert checked(far).verdict is Verdict.FAILED


def test_the_reference_of_a_stack_has_what_the_manifest_lacks() -> None:
    lookup = lookup_of(planted.subject_of(builds.made("tracking", "uneven", layers=True)))
    assert lookup.tables.shape == lookup.rear_tables.shape == (4, 9, 10)
    assert lookup.caps.tolist() == sorted(lookup.caps.tolist())
    assert lookup.lateral_acceleration_cap_per_friction == pytest.approx(lookup.caps[0] / 0.3, rel=1e-6)


def test_recordings_begin_where_the_driver_acts() -> None:
    config = builds.config_of("tracking")
    recorded = suites.recordings(config, "single", 12)
    assert len(recorded) == 9
    for recording in recorded:
        assert len(recording.frames) == len(recording.measurements) == 12
        assert all(
            [frame.id for frame in frames] == [config.can.vehicle_motion.id, config.can.vehicle_conditions.id]
            for frames in recording.frames
        )
    assert any(abs(recording.measurements[-1, 1]) > 0.01 for recording in recorded)


def test_places_go_everywhere() -> None:
    ground = Ground.of(TRACKING.manifest)
    places = suites.places(ground, 4_000, "single")
    speed, angle = places.T
    assert {-1.0, 1.0} <= set(((angle > 0.0) * 2.0 - 1.0).tolist())
    assert (speed != speed).any()
    assert (speed > ground.speed.max()).any()
    breakpoints = map(speed.dtype.type, TRACKING.manifest["map"]["speed_m_s"])
    assert sum(bool((speed == value).any()) for value in breakpoints) > 90
