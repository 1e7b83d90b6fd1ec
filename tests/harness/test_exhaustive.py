"""Helpers for all their inputs, as a part of the campaign: what is planted in them is found, and no helper is left out."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path

import pytest

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.exhaustive import exhaustive
from tests.evidence.exhaustive.exhaustive_helper import FLOATS
from tests.evidence.exhaustive.exhaustive_program import Judge, pieces
from tests.evidence.exhaustive.exhaustive_source import Absent, Judged
from tests.evidence.part import FOLDERS

PI, TRACKING = FOLDERS
QUICK = Effort(quick=True)

# Unit -> what is planted in it, each -> the claims that must fail, and no others.
FAULTS: Mapping[str, list[tuple[str, str, set[str]]]] = {
    "limiter": [
        ("    if (result > high) {\n        result = high;\n    }\n", "", {"clamp"}),
        ("return (value < 0.0f) ? -value : value;", "return (value < -1.0f) ? -value : value;", {"magnitude", "is_within"}),
        ("(speed - from) / (to - from)", "(speed - from) / to", {"opposite_phase_bound"}),
        ("is_between(rear_angle, -1.0f, 1.0f)", "is_between(rear_angle, -1.0f, 0.99999994f)", {"ars_limiter_init"}),
    ],
    "controller": [
        ("(value >= low) && (value <= high)", "(value >= low) && (value < high)", {"is_between"}),
        ("return !(magnitude(value) > largest);", "return magnitude(value) <= largest;", {"is_absent_or_within"}),
        ("result = value + step;", "result = -step;", {"toward_zero"}),
        (
            "(measurement->friction < parameters->friction_min)",
            "!(measurement->friction >= parameters->friction_min)",
            {"known_friction"},
        ),
        ("clamp(rear_angle, -actuator_angle_max, actuator_angle_max)", "rear_angle", {"ars_controller_init"}),
        ("k < ((uint32_t)ARS_SCHEDULE_POINTS - 1u)", "k < ((uint32_t)ARS_SCHEDULE_POINTS - 2u)", {"gains_at"}),
    ],
    "map": [
        ("if (steps >= 100.0f) {", "if (steps >= 101.0f) {", {"locate_speed"}),
        ("position.fraction = (fraction < 1.0f) ? fraction : 1.0f;", "position.fraction = fraction;", {"locate_front_angle"}),
        ("((friction > 0.0f) ? friction : 0.0f)", "friction", {"road_of"}),
        ("0xF00F9344u", "0xF00F9345u", {"crc_of"}),
    ],
    "can": [
        ("(outward > 0.0f) || ((outward >= 0.0f) && odd)", "outward >= 0.0f", {"to_code", "ars_can_pack"}),
        ("value * 4097.0f", "value * 4096.0f", {"leading_part"}),
        ("data[5] & 0xFFu) << 8u", "data[5] & 0x7Fu) << 8u", {"ars_can_unpack"}),
    ],
    "e2e": [
        ("0xFEu, 0xD9u, 0xC4u", "0xFEu, 0xD9u, 0xC5u", {"ars_e2e_crc"}),
        ("return (counter < counter_max)", "return (counter <= counter_max)", {"increased"}),
    ],
    "reference_model": [
        ("if (value >= high) {", "if (value >= (1.0000001f * high)) {", {"between", "bounded"}),
        ("0.85196245f", "0.84196245f", {"ars_reference_model_front_curve", "ars_reference_model_rear_curve"}),
    ],
    "dynamics": [
        (
            "(input->speed > speed_min) ? input->speed : speed_min",
            "(input->speed < speed_min) ? speed_min : input->speed",
            {"arrange"},
        )
    ],
}


def changed(folder: Path, tmp_path: Path, *changes: tuple[str, str, str]) -> Path:
    """A copy of a build; unit, text, what takes its place."""
    copy = tmp_path / folder.name
    shutil.copytree(folder, copy)
    for unit, old, new in changes:
        path = copy / "src" / f"ars_{unit}.c"
        text = path.read_text(encoding="ascii")
        assert old in text
        path.write_text(text.replace(old, new), encoding="ascii")
    return copy


def failed(outcome: Outcome) -> set[str]:
    """The functions whose claims do not hold."""
    return {finding.partition(": ")[2].split()[0] for finding in outcome.findings}


def test_every_helper_of_the_committed_builds_holds() -> None:
    outcome = exhaustive.run(FOLDERS, QUICK)
    assert (outcome.findings, outcome.verdict) == ((), Verdict.PASSED)
    count, _, rest = outcome.figure.partition(" helpers x ")
    assert int(count) > 20
    # At least a float in QUICK_STRIDE.
    assert int(rest.partition(" ")[0].replace(",", "")) > FLOATS // exhaustive.QUICK_STRIDE
    assert all(figures["inputs"] > 0 and figures["wrong"] == 0 for figures in outcome.figures.values())
    # The same C is judged once.
    assert outcome.figures["4ws2/src/ars_map.c: road_of"]["same_c_in"] == ["4ws2-tracking/src/ars_map.c"]
    assert len(outcome.figures["4ws2/src/ars_controller.c: magnitude"]["same_c_in"]) == 3
    # Another state to set is other C.
    assert "4ws2-tracking/src/ars_controller.c: ars_controller_init" in outcome.figures


@pytest.mark.parametrize("unit", FAULTS)
def test_planted_faults_make_their_claims_fail_and_no_others(unit: str, tmp_path: Path) -> None:
    planted = changed(TRACKING, tmp_path, *((unit, old, new) for old, new, _ in FAULTS[unit]))
    found = failed(exhaustive.run([planted], QUICK, {unit}))
    expected = {name for _, _, names in FAULTS[unit] for name in names}
    assert {next((name for name in expected if each.startswith(name)), each) for each in found} == expected


def test_what_is_undefined_is_told_with_its_line(tmp_path: Path) -> None:
    condition = "if ((scaled > (float)low) && (scaled < (float)high)) {"
    outcome = exhaustive.run([changed(PI, tmp_path, ("can", condition, "if (scaled > (float)low) {"))], QUICK, {"can"})
    assert any("src/ars_can.c:75: undefined behaviour: " in finding for finding in outcome.findings)


def test_a_finding_names_the_input_by_its_bits(tmp_path: Path) -> None:
    planted = changed(
        PI, tmp_path, ("limiter", "is_between(rear_angle, -1.0f, 1.0f)", "is_between(rear_angle, -1.0f, 0.99999994f)")
    )
    (finding,) = exhaustive.run([planted], QUICK, {"limiter"}).findings
    assert finding.startswith("4ws2/src/ars_limiter.c: ars_limiter_init of 0x3F800000 (1): ")
    assert finding.partition("beyond one radian: ")[2].startswith("0, not 1; ")


def test_a_helper_that_nobody_judges_and_one_that_is_gone_are_told(tmp_path: Path) -> None:
    new = "static float doubled(float value)\n{\n    return 2.0f * value;\n}\n\nARS_SECTION_CODE static float magnitude("
    planted = changed(
        PI,
        tmp_path,
        ("limiter", "ARS_SECTION_CODE static float magnitude(", new),
        ("limiter", "is_between", "is_from_to"),
    )
    outcome = exhaustive.run([planted], QUICK, {"limiter"})
    assert outcome.verdict is Verdict.FAILED
    assert set(outcome.findings) == {
        "4ws2/src/ars_limiter.c: is_between() is not there: is_between cannot be judged",
        "4ws2/src/ars_limiter.c: doubled() takes a number and is neither judged nor argued",
        "4ws2/src/ars_limiter.c: is_from_to() takes a number and is neither judged nor argued",
    }


def test_parameters_are_found_by_their_names() -> None:
    subject = Subject.read(PI)
    judged = Judged("src/ars_limiter.c", subject)
    assert judged.call("clamp", {"high": "2", "low": "1", "value": "x", "more": "y"}) == "clamp(x, 1, 2)"
    with pytest.raises(Absent, match=r"src/ars_limiter.c: clamp\(\) takes 'high', which its check does not know of"):
        judged.call("clamp", {"low": "1", "value": "x"})


def test_what_is_argued_is_there() -> None:
    defined = {
        f"{path.removeprefix('src/ars_').removesuffix('.c')}: {name.replace('ars_', '@_', 1)}"
        for subject in map(Subject.read, FOLDERS)
        for path in subject.sources("src")
        for name in Judged(path, subject).functions
    }
    assert set(exhaustive.OTHERS) <= defined


def test_all_inputs_are_gone_through_and_none_twice() -> None:
    judge = Judge("f", "", True, FLOATS, "", "", "", "", "")
    parts = pieces(judge, 1)
    assert [first for first, _, _ in parts] == [0, *(last for _, last, _ in parts[:-1])]
    assert parts[-1][1] == FLOATS
    assert {stride for _, _, stride in parts} == {1}


def test_a_unit_that_is_gone_is_told(tmp_path: Path) -> None:
    copy = changed(PI, tmp_path)
    (copy / "src/ars_e2e.c").unlink()
    manifest = json.loads((copy / "manifest.json").read_text(encoding="utf-8"))
    del manifest["files"]["src/ars_e2e.c"]
    (copy / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    outcome = exhaustive.run([copy], QUICK, {"dynamics"})
    assert outcome.findings == ("4ws2: there is no unit 'e2e', of which something is claimed",)


def test_builds_in_double_precision_are_refused(tmp_path: Path) -> None:
    copy = changed(PI, tmp_path)
    manifest = json.loads((copy / "manifest.json").read_text(encoding="utf-8"))
    manifest["options"]["precision"] = "double"
    (copy / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    with pytest.raises(BuildError, match="double precision"):
        exhaustive.run([copy], QUICK)


def test_nothing_judged_is_not_passed() -> None:
    assert exhaustive.run([], QUICK).verdict is Verdict.FAILED


def test_without_a_compiler_it_is_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(MissingTool, match="no C compiler"):
        exhaustive.run([PI], QUICK)
