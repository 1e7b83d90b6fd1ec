"""The exhaustive part of the evidence: each claim finds a planted fault, and no helper is left out."""

import dataclasses
import shutil
from collections.abc import Mapping
from concurrent.futures import Future
from pathlib import Path

import pytest

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Subject
from codegen.verify.sanitizers.sanitized import find_compiler
from tests.evidence.exhaustive import exhaustive
from tests.evidence.exhaustive.claim import FLOATS, Claim, Source
from tests.evidence.parts import FOLDERS
from tests.evidence.progress import Progress

PI, TRACKING = FOLDERS
QUICK = Effort(quick=True)

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
        ("(numbers[k] >= low)", "(numbers[k] > low)", {"are_between"}),
        ("breakpoints[0] <= 0.0f", "breakpoints[0] < 0.0f", {"are_increasing"}),
        ("(deviation >= -tolerance)", "(deviation > -10.0f)", {"are_even"}),
        ("0xF00F9344u", "0xF00F9345u", {"crc_of"}),
    ],
    "can": [
        ("(outward > 0.0f) || ((outward >= 0.0f) && odd)", "outward >= 0.0f", {"to_code", "ars_can_pack"}),
        ("if ((scaled > (float)low) && (scaled < (float)high)) {", "if (scaled > (float)low) {", {"to_code"}),
        ("value * 4097.0f", "value * 4096.0f", {"leading_part"}),
        ("data[5] & 0xFFu) << 8u", "data[5] & 0x7Fu) << 8u", {"ars_can_unpack"}),
        ("((float)code / steps)", "((float)code * (1.0f / steps))", {"to_value"}),
        ("0x7FC00000u", "0x7F800001u", {"ars_can_not_available"}),
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
"""By unit: text, replacement, and beginnings of the names of the claims that must fail."""


def changed(folder: Path, tmp_path: Path, *changes: tuple[str, str, str]) -> Path:
    """Copy a build and replace text in its units: unit, text, replacement."""
    copy = tmp_path / folder.name
    shutil.copytree(folder, copy)
    for unit, old, new in changes:
        path = copy / "src" / f"ars_{unit}.c"
        text = path.read_text(encoding="ascii")
        assert old in text, old
        path.write_text(text.replace(old, new), encoding="ascii")
    return copy


def failed(outcome: Outcome) -> set[str]:
    """Unit and function of the claims that do not hold."""
    places = (finding.split(": ", 2)[:2] for finding in outcome.findings)
    return {f"{Path(path).stem.removeprefix('ars_')}: {text.split()[0]}" for path, text in places}


def test_planted_faults_fail_their_claims_and_no_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    faults = [(unit, *fault) for unit, faults in FAULTS.items() for fault in faults]
    planted, steps = changed(TRACKING, tmp_path, *(fault[:3] for fault in faults)), tmp_path / "steps"
    outcome = exhaustive.run([planted], QUICK, Progress(steps))
    expected = {f"{unit}: {name}" for unit, _, _, names in faults for name in names}
    found = {next((name for name in expected if each.startswith(name)), each) for each in failed(outcome)}
    assert found == expected
    assert any("src/ars_can.c:75: undefined behaviour: " in finding for finding in outcome.findings)
    start = "4ws2-tracking/src/ars_limiter.c: ars_limiter_init of 0x3F800000 (1): itself, or zero beyond one radian: 0, not 1; "
    assert any(finding.startswith(start) for finding in outcome.findings)
    # Finished claims are not judged again.
    monkeypatch.setattr(exhaustive, "compile_program", None)
    assert exhaustive.run([planted], QUICK, Progress(steps)) == outcome


def test_helpers_without_claim_and_claims_without_helper_are_findings(tmp_path: Path) -> None:
    new = "static float doubled(float value)\n{\n    return 2.0f * value;\n}\n\nARS_SECTION_CODE static float magnitude("
    old = "ARS_SECTION_CODE static float magnitude("
    planted = changed(PI, tmp_path, ("limiter", old, new), ("limiter", "is_between", "is_from_to"))
    _, findings = exhaustive.claims_of(Source(Subject.read(planted)))
    assert set(findings) == {
        "4ws2/src/ars_limiter.c: is_between is not there",
        "4ws2/src/ars_limiter.c: doubled() takes a number and has neither a claim nor a reason for having none",
        "4ws2/src/ars_limiter.c: is_from_to() takes a number and has neither a claim nor a reason for having none",
    }
    subject = Subject.read(PI)
    _, findings = exhaustive.claims_of(Source(without(subject, "src/ars_e2e.c")))
    assert findings == [f"4ws2/src/ars_e2e.c: {name} is not there" for name in ("ars_e2e_crc", "increased")]
    manifest = {**subject.manifest, "options": {**subject.manifest["options"], "precision": "double"}}
    with pytest.raises(BuildError, match="double precision"):
        exhaustive.claims_of(Source(dataclasses.replace(subject, manifest=manifest)))


def without(subject: Subject, path: str) -> Subject:
    """Return a build without one of its files."""
    return dataclasses.replace(subject, files={name: content for name, content in subject.files.items() if name != path})


def test_reasons_for_having_no_claim_name_functions_that_exist() -> None:
    names = {
        f"{path.removeprefix('src/ars_').removesuffix('.c')}: {name}".replace(": ars_", ": @_")
        for folder in FOLDERS
        for path, functions in Source(Subject.read(folder)).functions.items()
        for name in functions
    }
    assert set(exhaustive.OTHERS) <= names


def test_all_inputs_run_once() -> None:
    parts = exhaustive.pieces_of(Claim("u", "f", "", ""), 1)
    assert [first for first, _, _ in parts] == [0, *(end for _, end, _ in parts[:-1])]
    assert parts[-1][1:] == (FLOATS, 1)
    assert exhaustive.run([], QUICK, Progress()).findings == ("no claim was judged",)


def test_equal_claims_about_equal_c_have_one_key() -> None:
    def keys(subject: Subject) -> dict[str, str]:
        source = Source(subject)
        return {f"{claim.unit}: {claim.name}": source.key(claim) for claim in exhaustive.claims_of(source)[0]}

    pi, tracking = map(Subject.read, FOLDERS)
    own, other = keys(pi), keys(tracking)
    assert own["controller: magnitude"] == own["limiter: magnitude"] == other["limiter: magnitude"]
    assert {"map: road_of", "map: locate_speed", "e2e: ars_e2e_crc"} <= {name for name in own if own[name] == other[name]}
    # Another state to set is other C; so is another callee, another constant, and another breakpoint of the map.
    assert own["controller: ars_controller_init"] != other["controller: ars_controller_init"]
    for path, old, new, name in (
        ("src/ars_can.c", b"4097.0f", b"4095.0f", "can: to_code (0 to 254, 100 a unit)"),
        ("src/ars_map.c", b"map_friction = 0.9f", b"map_friction = 0.8f", "map: road_of"),
        ("src/ars_calibration.c", b"5.5555553f", b"5.6f", "map: locate_speed"),
    ):
        text = pi.files[path]
        assert old in text
        edited = keys(dataclasses.replace(pi, files={**pi.files, path: text.replace(old, new)}))
        assert edited[name] != own[name]
        assert edited["limiter: clamp"] == own["limiter: clamp"]


def test_one_wrong_input_in_a_vectorized_block_is_found(tmp_path: Path) -> None:
    fault = ("limiter", "(value < 0.0f) ? -value", "((value < 0.0f) && (value != -3.0f)) ? -value")
    source = Source(Subject.read(changed(PI, tmp_path, fault)))
    claims = [claim for claim in exhaustive.claims_of(source)[0] if claim.unit == "limiter"][:2]
    program: Future[Path] = Future()
    program.set_result(exhaustive.compile_program(find_compiler(), source, "src/ars_limiter.c", claims, tmp_path))
    number = 0xFFFFFFFF - 0xC0400000  # of the bits of -3
    piece = (number - 5_000, number + 5_000, 1)
    finding = "of 0xC0400000 (-3): the number without its sign: -3, not 3"
    assert [exhaustive._run(program, k, piece) for k in (0, 1)] == [(10_000, 1, [finding]), (10_000, 0, [])]
