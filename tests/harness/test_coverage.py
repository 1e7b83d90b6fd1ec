"""Coverage and MC/DC: what no test runs, and what no test decides, is told; the project's own tests leave nothing."""

from __future__ import annotations

import shutil
from collections.abc import Sequence

import pytest

from codegen.errors import BuildError
from codegen.verify.check import Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.coverage import coverage, mcdc
from tests.evidence.coverage.coverage import Covered
from tests.evidence.coverage.mcdc import Condition
from tests.evidence.part import FOLDERS
from tests.sil.case import Case
from tests.sil.suite import MEMORY, Judge, judges_of

PI = FOLDERS[0]
E2E, CAN = "4ws2/src/ars_e2e.c", "4ws2/src/ars_can.c"
needs_clang = pytest.mark.skipif(shutil.which("clang-19") is None, reason="clang-19 is not installed")


def of_frames(case: Case) -> Sequence[Judge]:
    """The tests of one unit alone."""
    return [judge for judge in judges_of(case, "src/ars_can.c") if judge.name != MEMORY]


def lazy(case: Case) -> Sequence[Judge]:
    """They send frames that are right, and never a wrong one."""

    def judge(case: Case) -> None:
        software = case.built.software
        state, data = software.new("e2e_receiver"), software.ffi.new("uint8_t[8]")
        counter = software.ffi.new("uint8_t *", 0)
        software.function("e2e_receiver_init")(state)
        for _ in range(3):
            software.function("e2e_protect")(0x101, counter, data)
            software.function("e2e_check")(state, 0x101, data)

    return [Judge("lazy", judge)]


def test_lines_and_branches_that_no_test_runs_are_told() -> None:
    units = {unit.path: unit for unit in coverage.measured(PI, lazy)}
    e2e = units[E2E]
    assert 0 < e2e.lines_missed < e2e.lines
    assert 0 < e2e.branches_missed < e2e.branches
    assert units["4ws2/src/ars_limiter.c"].lines_missed == units["4ws2/src/ars_limiter.c"].lines > 30
    outcome = coverage.outcome_of([e2e])
    assert outcome.verdict is Verdict.FAILED
    assert len(outcome.findings) == len(e2e.missed) > 5
    text = (PI / "src/ars_e2e.c").read_text(encoding="ascii").splitlines()
    idle = [int(finding.split(":")[1]) for finding in outcome.findings if finding.endswith("never run")]
    assert any("ARS_E2E_REPEATED" in text[line - 1] for line in idle)


def test_the_tests_of_a_unit_run_all_of_it() -> None:
    (can,) = [unit for unit in coverage.measured(PI, of_frames) if unit.path == CAN]
    assert coverage.outcome_of([can]).verdict is Verdict.PASSED, can.missed
    assert can.lines > 50


@needs_clang
def test_conditions_that_no_test_decides_are_told() -> None:
    missed = {one.text for one in mcdc.measured(PI, lazy) if one.path == E2E and not one.covered}
    assert "(counter > counter_max)" in missed
    can = [one for one in mcdc.measured(PI, of_frames) if one.path == CAN]
    assert can
    assert mcdc.outcome_of(can).verdict is Verdict.PASSED


def test_tests_that_the_c_does_not_pass_measure_nothing() -> None:
    def judge(case: Case) -> None:
        raise AssertionError("no")

    with pytest.raises(BuildError, match="unaltered, it fails wrong: AssertionError no"):
        coverage.measured(PI, lambda _: [Judge("wrong", judge)])


def test_nothing_measured_is_not_all_covered() -> None:
    assert coverage.outcome_of([]).verdict is Verdict.FAILED
    assert mcdc.outcome_of([]).verdict is Verdict.FAILED


def test_the_figures_add_up() -> None:
    outcome = coverage.outcome_of([Covered("a", 10, 4, 0, 0, ()), Covered("b", 5, 2, 1, 1, ("b:3: never run",))])
    assert outcome.figure == "14 of 15 lines, 5 of 6 branches"
    assert outcome.findings == ("b:3: never run",)
    assert outcome.figures["b"] == {"lines": 5, "lines_run": 4, "branches": 2, "branches_taken": 1}


def test_a_condition_that_does_not_decide_is_told() -> None:
    conditions = [Condition("a.c", 3, "x", True), Condition("a.c", 3, "y", False)]
    assert mcdc.outcome_of(conditions).findings == ("a.c:3: `y` was never shown to decide",)
    passed = mcdc.outcome_of(conditions[:1])
    assert (passed.verdict, passed.figure) == (Verdict.PASSED, "1 of 1 conditions decide")


@pytest.mark.parametrize(("part", "tool"), [(coverage, "gcov"), (mcdc, "llvm-cov-19")])
def test_a_tool_that_is_missing_is_told(part: object, tool: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None if name == tool else f"/usr/bin/{name}")
    with pytest.raises(MissingTool, match="not installed"):
        part.measured(PI)  # type: ignore[attr-defined]
