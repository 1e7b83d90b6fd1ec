"""The exhaustive part of the evidence: each claim finds a planted fault, and no helper is missing."""

import shutil
from concurrent.futures import Future
from pathlib import Path

import pytest

from codegen.verify.outcomes import Effort, Outcome, Subject
from codegen.verify.sanitized import find_compiler
from tests.evidence.exhaustive import exhaustive
from tests.evidence.exhaustive.claim import Source
from tests.evidence.parts import FOLDERS
from tests.evidence.progress import Progress

PI, TRACKING = FOLDERS

FAULTS = [
    ("limiter", "        result = high;\n", "", {"clamp"}),
    ("limiter", "(breakpoints[k] - breakpoints[k - 1u])", "breakpoints[k]", {"opposite_phase_bound"}),
    ("limiter", "is_between(rear_angle, -1.0f, 1.0f)", "is_between(rear_angle, -1.0f, 0.99999994f)", {"ars_limiter_init"}),
    (
        "inputs",
        "return magnitude(value) <= largest;",
        "return !(magnitude(value) > largest);",
        {"is_within", "agrees", "is_right_again"},
    ),
    ("inputs", "0.25f * parameters->wheelbase", "1.25f * parameters->wheelbase", {"yaw_gain"}),
    ("inputs", "    float result = largest;", "    float result = 2.0f * largest;", {"bounded"}),
    ("controller", "result = value + step;", "result = -step;", {"toward_zero"}),
    ("controller", "(measured >= -plausible_max)", "(measured > -plausible_max)", {"restart_angle"}),
    ("map", "if (steps >= 117.0f) {", "if (steps >= 118.0f) {", {"locate_speed"}),
    ("map", "if (friction <= 0.0f) {", "if (friction <= 0.1f) {", {"road_of"}),
    ("map", "(deviation >= -tolerance)", "(deviation > -10.0f)", {"are_even"}),
    ("checksum", "0xF00F9344u", "0xF00F9345u", {"ars_checksum_real"}),
    ("can", "if ((scaled > (float)low) && (scaled < (float)high)) {", "if (scaled > (float)low) {", {"to_code"}),
    ("can", "value * 4097.0f", "value * 4096.0f", {"leading_part"}),
    ("can", "((float)code / steps)", "((float)code * (1.0f / steps))", {"to_value"}),
    ("e2e", "0xFEu, 0xD9u, 0xC4u", "0xFEu, 0xD9u, 0xC5u", {"ars_e2e_crc"}),
    ("reference_model", "0.86316043f", "0.85316043f", {"front_curve", "rear_curve"}),
]
"""Unit, text, replacement, and prefixes of the names of the claims that must fail."""


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
    """Return unit and function of the claims that do not hold."""
    places = (finding.split(": ", 2)[:2] for finding in outcome.findings)
    return {f"{Path(path).stem.removeprefix('ars_')}: {text.split()[0]}" for path, text in places}


def test_planted_faults_fail_exactly_their_claims(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exhaustive, "QUICK_STRIDE", 10_007)
    monkeypatch.setattr(exhaustive, "FLAGS", exhaustive.PLAIN)  # for few inputs, optimising takes longer than it saves
    planted, steps = changed(TRACKING, tmp_path, *(fault[:3] for fault in FAULTS)), tmp_path / "steps"
    outcome = exhaustive.run([planted], Effort(quick=True), Progress(steps))
    expected = {f"{unit}: {name}" for unit, _, _, names in FAULTS for name in names}
    found = {next((name for name in expected if each.startswith(name)), each) for each in failed(outcome)}
    assert found == expected
    assert any("src/ars_can.c:75: undefined behaviour: " in finding for finding in outcome.findings)
    start = "4ws2/src/ars_limiter.c: ars_limiter_init of 0x3F800000 (1): itself, or zero beyond one radian: 0, not 1; "
    assert any(finding.startswith(start) for finding in outcome.findings)
    # Finished claims are not run again.
    monkeypatch.setattr(exhaustive, "compile_program", None)
    assert exhaustive.run([planted], Effort(quick=True), Progress(steps)) == outcome


def test_helpers_without_claim_and_claims_without_helper_are_findings(tmp_path: Path) -> None:
    new = "static float doubled(float value)\n{\n    return 2.0f * value;\n}\n\nARS_SECTION_CODE static float magnitude("
    old = "ARS_SECTION_CODE static float magnitude("
    planted = changed(PI, tmp_path, ("limiter", old, new), ("limiter", "is_between", "is_from_to"))
    _, findings = exhaustive.claims_of(Source(Subject.read(planted)))
    assert set(findings) == {
        "4ws2-paper/src/ars_limiter.c: is_between is not there",
        "4ws2-paper/src/ars_limiter.c: doubled() takes a number and has neither a claim nor a reason for having none",
        "4ws2-paper/src/ars_limiter.c: is_from_to() takes a number and has neither a claim nor a reason for having none",
    }


def test_one_wrong_input_in_a_vectorized_block_is_found(tmp_path: Path) -> None:
    fault = ("limiter", "    return number.value;", "    return (value == -3.0f) ? value : number.value;")
    source = Source(Subject.read(changed(PI, tmp_path, fault)))
    named = {(claim.unit, claim.function): claim for claim in exhaustive.claims_of(source)[0]}
    claims = [named["limiter", "magnitude"], named["limiter", "clamp"]]
    program: Future[Path] = Future()
    program.set_result(exhaustive.compile_program(find_compiler(), source, "src/ars_limiter.c", claims, tmp_path))
    number = 0xFFFFFFFF - 0xC0400000  # the bits of -3
    piece = (number - 5_000, number + 5_000, 1)
    finding = "of 0xC0400000 (-3): the number without its sign: -3, not 3"
    assert [exhaustive._run(program, k, piece) for k in (0, 1)] == [(10_000, 1, [finding]), (10_000, 0, [])]
