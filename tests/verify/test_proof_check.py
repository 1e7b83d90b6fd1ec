"""The check "proof": what is shipped is proved, and what is planted is not."""

from __future__ import annotations

import re
import sys

import pytest

from codegen.verify import packages
from codegen.verify.check import Effort, Subject, Verdict
from codegen.verify.proof.check import check
from tests.verify import builds


def subject(*planted: tuple[str, str, str]) -> Subject:
    """A "pi", with texts of its files replaced: path, old, new."""
    folder = builds.made("pi")
    files = dict(folder.files)
    for path, old, new in planted:
        text = files[path].decode("ascii")
        assert text.count(old) == 1, old
        files[path] = text.replace(old, new).encode("ascii")
    return Subject("sample", files, folder.manifest)


@pytest.mark.parametrize("kind", ["feedforward", "proportional"])  # the others are committed, with the record of their proof
def test_every_kind_is_proved(kind: builds.Kind) -> None:
    folder = builds.made(kind)
    outcome = check(Subject("sample", folder.files, folder.manifest), Effort())
    assert outcome.findings == ()
    assert outcome.verdict is Verdict.PASSED
    assert outcome.figures["obligations"].keys() >= {"claim", "invariant", "index inside its array", "no division by zero"}
    assert outcome.figures["sha256"].keys() == {path for path in folder.files if path.startswith(("include/", "src/"))}


CLAMP = (
    "src/ars_limiter.c",
    "self->rear_angle = clamp(target, -parameters->rear_angle_max, parameters->rear_angle_max);",
    "self->rear_angle = target;",
)
COUNTER = (
    "src/ars_e2e.c",
    "*counter = (*counter < counter_max) ? (uint8_t)(*counter + 1u) : 0u;",
    "*counter = (uint8_t)(*counter + 1u);",
)
INDEX = ("src/ars_map.c", "if (steps >= 100.0f) {", "if (steps >= 200.0f) {")
SATURATION = (
    "src/ars_can.c",
    "= to_code(signals->yaw_rate_reference, 5000.0f, -32767, 32767, -32768);",
    "= (int32_t)(signals->yaw_rate_reference * 5000.0f);",
)
NAN = ("src/ars_controller.c", "return magnitude(value) <= largest;", "return !(magnitude(value) > largest);")
LOOP = ("src/ars_task.c", "self->cycles++;", "do { self->cycles++; } while (self->cycles == 7u);")
ROW = "yaw_rate_table[ARS_MAP_SPEED_POINTS][ARS_MAP_FRONT_ANGLE_POINTS] = {\n    /* 0 km/h */\n    {\n        "
TABLE = ("src/ars_calibration.c", f"{ROW}0.0f", f"{ROW}11.0f")


@pytest.mark.parametrize(
    "planted",
    [
        # Faults of units that do not call each other, or not for what is wrong there: each is told where it is.
        pytest.param(
            {
                CLAMP: r"ars_limiter_step: counterexample: claim: \|rear angle\| is at most rear_angle_max; with ",
                INDEX: r"ars_map_yaw_rate: counterexample: index inside its array: of 102; with speed ",
                LOOP: r"cannot be judged: the statement DoWhile",
            },
            id="a removed clamp, an index outside, C that is not understood",
        ),
        pytest.param(
            {
                COUNTER: r"ars_e2e_protect: counterexample: claim: the counter for the next frame is at most 14; with counter ",
                SATURATION: r"ars_can_pack_rear_steer_command: counterexample: float-to-integer conversion defined: ",
                NAN: r"ars_controller_step: counterexample: claim: speed stays finite; with ",
            },
            id="a broken invariant, an undefined conversion, NaN let in",
        ),
    ],
)
def test_what_does_not_hold_is_found(planted: dict[tuple[str, str, str], str]) -> None:
    outcome = check(subject(*planted, TABLE), Effort())
    assert outcome.verdict is Verdict.FAILED
    for (path, _, _), told in planted.items():
        found = [finding for finding in outcome.findings if re.match(rf"{re.escape(path)}:\d+: {told}", finding)]
        assert found, (told, outcome.findings)
    assert "yaw_rate_table: numbers from 0 to 11, the proof is for 0 to 10" in outcome.findings
    # And nothing else, but where what the limiter leaves goes on.
    places = {finding.partition(":")[0] for finding in outcome.findings}
    assert places <= {path for path, _, _ in planted} | {"src/ars_controller.c", "yaw_rate_table"}


def test_c_that_does_not_compile_is_not_passed() -> None:
    outcome = check(subject(("src/ars_task.c", "self->cycles++;", "self->cycles++")), Effort())
    assert outcome.verdict is Verdict.FAILED


def test_double_precision_is_not_run() -> None:
    folder = builds.made("pi", precision="double")
    assert check(Subject("sample", folder.files, folder.manifest), Effort()).verdict is Verdict.NOT_RUN


def test_a_missing_solver_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(packages.MissingTool, match="z3-solver"):
        check(subject(), Effort())
