"""The check "proof": what is shipped is proved, and what is planted is not."""

from __future__ import annotations

import sys

import pytest

from codegen.verify import packages
from codegen.verify.check import Effort, Subject, Verdict
from codegen.verify.proof.check import check
from tests.verify import builds


def subject(path: str = "", old: str = "", new: str = "") -> Subject:
    folder = builds.made("pi")
    files = builds.with_text(folder, path, old, new) if path else folder.files
    return Subject("sample", files, folder.manifest)


@pytest.mark.parametrize("kind", builds.KINDS)
def test_every_kind_is_proved(kind: builds.Kind) -> None:
    folder = builds.made(kind)
    outcome = check(Subject("sample", folder.files, folder.manifest), Effort())
    assert outcome.findings == ()
    assert outcome.verdict is Verdict.PASSED
    assert outcome.figures["obligations"].keys() >= {"claim", "invariant", "index inside its array", "no division by zero"}
    assert outcome.figures["sha256"].keys() == {path for path in folder.files if path.startswith(("include/", "src/"))}


@pytest.mark.parametrize(
    ("path", "old", "new", "told"),
    [
        pytest.param(
            "src/ars_limiter.c",
            "self->rear_angle = clamp(target, -parameters->rear_angle_max, parameters->rear_angle_max);",
            "self->rear_angle = target;",
            "src/ars_controller.c",
            id="a removed clamp",
        ),
        pytest.param(
            "src/ars_e2e.c",
            "*counter = (*counter < counter_max) ? (uint8_t)(*counter + 1u) : 0u;",
            "*counter = (uint8_t)(*counter + 1u);",
            "counter",
            id="a broken invariant",
        ),
        pytest.param(
            "src/ars_map.c", "if (steps >= 100.0f) {", "if (steps >= 200.0f) {", "index inside its array", id="an index outside"
        ),
        pytest.param(
            "src/ars_can.c",
            "if ((scaled > (float)low) && (scaled < (float)high)) {",
            "if (scaled > (float)low) {",
            "float-to-integer conversion defined",
            id="an undefined conversion",
        ),
        pytest.param(
            "src/ars_controller.c",
            "return magnitude(value) <= largest;",
            "return !(magnitude(value) > largest);",
            "src/ars_",
            id="NaN let in",
        ),
    ],
)
def test_what_does_not_hold_is_found(path: str, old: str, new: str, told: str) -> None:
    outcome = check(subject(path, old, new), Effort())
    assert outcome.verdict is Verdict.FAILED
    assert any(told in finding for finding in outcome.findings), outcome.findings


def test_c_that_is_not_understood_is_not_passed() -> None:
    outcome = check(
        subject("src/ars_task.c", "self->cycles++;", "do { self->cycles++; } while (self->cycles == 7u);"), Effort()
    )
    assert outcome.verdict is Verdict.FAILED
    assert any(finding.startswith("src/ars_task.c:") and "cannot be judged" in finding for finding in outcome.findings)


def test_c_that_does_not_compile_is_not_passed() -> None:
    outcome = check(subject("src/ars_task.c", "self->cycles++;", "self->cycles++"), Effort())
    assert outcome.verdict is Verdict.FAILED


def test_a_table_outside_of_its_range_is_told() -> None:
    folder = builds.made("pi")
    text = folder.files["src/ars_map.c"].decode("ascii")
    start = text.index("0.0f, 0.0f", text.index("yaw_rate_table["))
    files = {**folder.files, "src/ars_map.c": (text[:start] + "11.0f, 0.0f" + text[start + 10 :]).encode("ascii")}
    outcome = check(Subject("sample", files, folder.manifest), Effort())
    assert "yaw_rate_table: numbers from 0 to 11, the proof is for 0 to 10" in outcome.findings


def test_double_precision_is_not_run() -> None:
    folder = builds.made("pi", precision="double")
    assert check(Subject("sample", folder.files, folder.manifest), Effort()).verdict is Verdict.NOT_RUN


def test_a_missing_solver_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(packages.MissingTool, match="z3-solver"):
        check(subject(), Effort())
