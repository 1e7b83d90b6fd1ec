"""The check "generator": edited C against the C that the manifest gives again."""

from dataclasses import replace

import pytest

from codegen.emit.build import code_again
from codegen.errors import BuildError
from codegen.verify import generator
from codegen.verify.long_drives import LongDrives
from codegen.verify.outcomes import Effort, Subject, Verdict
from codegen.verify.unit_drives import Size
from tests.verify import builds, planted

PI, TRACKING = builds.made("pi", "uneven"), builds.made("tracking", "uneven")
QUICK = Effort(quick=True)


@pytest.fixture(autouse=True)
def few_drives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run few drives, no recordings, and the long drives of one unit."""
    monkeypatch.setattr(generator, "QUICK_STEPS", 5_000)
    monkeypatch.setattr(generator, "SIZE_QUICK", Size(60, 300, 3, 200))
    monkeypatch.setattr(LongDrives, "drives", LongDrives._limiters)


@pytest.mark.parametrize("folder", [PI, TRACKING], ids=["pi", "tracking"])
def test_the_manifest_gives_the_c_again(folder: builds.Folder) -> None:
    again = code_again(folder.manifest, folder.files).files
    assert again == {path: text for path, text in folder.files.items() if path.startswith(("include/", "src/"))}
    found = generator.check(planted.subject_of(folder), QUICK)
    assert (found.verdict, found.findings) == (Verdict.PASSED, ())
    assert found.figure == f"all {len(again)} files of the C are the generator's own"


def test_an_edit_with_equal_behaviour_passes_and_is_named() -> None:
    edited = planted.started(TRACKING, "ars_limiter_step", "    (void)0;\n")
    found = generator.check(replace(edited, edited=("README.md", "src/ars_limiter.c")), QUICK)
    assert (found.verdict, found.findings) == (Verdict.PASSED, ())
    assert found.figures["edited"] == ["src/ars_limiter.c"] and found.figures["other_edited"] == ["README.md"]
    assert found.limits[3].endswith("only their name is reported: README.md.")
    assert found.limits[4] == "Not the generator's own bytes: src/ars_limiter.c."
    assert found.figures["calls"].keys() >= {"random steps", "disturbed traffic", "lookup", "vehicle dynamics"}


def test_the_first_difference_of_each_stream_is_reported_with_inputs_and_both_values() -> None:
    """A limiter and a car that are off by a bit, and a wrong number of the map, in one build."""
    limited = planted.limiter(PI, "    result = (input->speed > 20.0f) ? (result * 1.0000002f) : result;")
    wrong = planted.source(PI, "ars_calibration")
    start = wrong.index("{", wrong.index("map_yaw_rate_table"))
    number = next(each for each in wrong[start:].split() if each.endswith("f,") and float(each[:-2]) > 0.05)
    wrong = wrong[:start] + wrong[start:].replace(number, f"{float(number[:-2]) * 1.001:.9g}f,", 1)
    body = (
        "    ars_dynamics_state_t result = planted_ars_dynamics_magic_formula(state, input);\n"
        "    result.yaw_rate *= 1.0000002f;\n    return result;"
    )
    moved = planted.wrapped(PI, "ars_dynamics_magic_formula", body)
    files = {**limited.files, "src/ars_calibration.c": wrong.encode()}
    files["src/ars_dynamics.c"] = moved.files["src/ars_dynamics.c"]
    found = generator.check(replace(limited, files=files), QUICK)
    assert found.verdict is Verdict.FAILED and len(found.figures["edited"]) == 3
    for stream, output in (
        ("random steps, step ", "command.rear_angle"),
        ("limiter, step ", "result"),
        ("lookup, call ", "yaw_rate"),
        ("vehicle dynamics, point ", "magic_formula.yaw_rate"),
    ):
        (line,) = (each for each in found.findings if each.startswith(stream))
        assert f": {output}" in line and " by the generator's C; " in line


def test_faults_of_other_parameters_long_drives_and_damaged_states_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is invisible in drives with the default parameters."""
    monkeypatch.setattr(generator, "streams", lambda *given: ())
    default = PI.manifest["configuration"]["controller"]["fail_safe"]["recovery_samples"]
    limited = planted.started(
        PI,
        "ars_limiter_step",
        "    static uint32_t lost = 0u;\n\n    lost = (input->demand != input->demand) ? (lost + 1u) : 0u;\n"
        "    if (lost == 69000u) {\n        self->rear_angle = 0.0f;\n    }\n",
    )
    believed = planted.source(PI, "ars_inputs").replace(
        "self->good >= parameters->recovery_samples",
        f"(self->good + ((parameters->recovery_samples == {default}u) ? 0u : 1u)) >= parameters->recovery_samples",
    )
    squares = "    squares += self->law.integral * self->law.integral;\n"
    sound = builds.with_text(PI, "src/ars_controller.c", squares, "")
    files = {**sound, "src/ars_limiter.c": limited.files["src/ars_limiter.c"], "src/ars_inputs.c": believed.encode()}
    found = generator.check(replace(limited, files=files), QUICK)
    assert found.verdict is Verdict.FAILED and found.figures["parameter_sets"] == 3
    for start in (
        "src/ars_controller.c: another outcome than by the generator's C of law.integral = nan after ",
        "parameter set ",
        "limiter without demand, sample 69",
    ):
        assert any(line.startswith(start) for line in found.findings), (start, found.findings)
    assert not any(line.startswith("drive cycle ") for line in found.findings)


def test_a_wrong_default_and_an_initialisation_that_leaves_a_member_are_found() -> None:
    path = "src/ars_calibration.c"
    files = builds.with_text(PI, path, ".integral_gain = 1.0f,", ".integral_gain = 1.5f,")
    path_of_init, removed = "src/ars_controller.c", "    self->yaw_rate_error = 0.0f;\n"
    files |= {path_of_init: builds.with_text(PI, path_of_init, f"{removed}    self->sample", "    self->sample")[path_of_init]}
    sides = generator._Sides(Subject("planted", files, PI.manifest), planted.subject_of(PI), is_quick=True)
    default, *others = (*sides._defaults(), *sides._states())
    assert default == f"{path}: integral_gain is 1.5, and 1.0 by the generator's C"
    assert others[0] == "ars_controller_init: yaw_rate_error not as after that of the generator's C"


def test_what_cannot_be_compared() -> None:
    other = Subject("old", PI.files, {**PI.manifest, "version": "0.0.1"})
    assert generator.check(other, QUICK).verdict is Verdict.NOT_RUN
    without = {path: content for path, content in PI.files.items() if path != "verify/map.npz"}
    with pytest.raises(BuildError, match=r"verify/map\.npz: missing; build again"):
        generator.check(Subject("old", without, PI.manifest), QUICK)
    found = generator.check(replace(planted.subject_of(PI), edited=("verify/map.npz",)), QUICK)
    assert (found.verdict, found.findings) == (Verdict.FAILED, ("verify/map.npz: not the map of the build; build again",))
    broken = planted.subject_of(PI, ars_limiter="int broken(\n")
    found = generator.check(broken, QUICK)
    assert found.verdict is not Verdict.PASSED
