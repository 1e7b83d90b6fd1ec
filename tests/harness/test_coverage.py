"""Coverage and MC/DC as parts of the evidence: lines, branches and conditions that no test covers are findings."""

from collections.abc import Sequence
from pathlib import Path

from codegen.config import Kind
from codegen.verify.check import Verdict
from tests.evidence.coverage import coverage, mcdc
from tests.evidence.parts import FOLDERS
from tests.sil.case import Case
from tests.sil.suite import SANITIZED, Judge, judges_of

PI = FOLDERS[0]


def partial(kind: Kind) -> Sequence[Judge]:
    """Return the judges of the frames, and one that sends correct frames only."""

    def judge(case: Case) -> None:
        software = case.built.software
        state, data = software.new("e2e_receiver"), software.ffi.new("uint8_t[8]")
        counter = software.ffi.new("uint8_t *", 0)
        software.function("e2e_receiver_init")(state)
        for _ in range(3):
            software.function("e2e_protect")(0x101, counter, data)
            software.function("e2e_check")(state, 0x101, data)

    return [Judge("partial", judge), *(each for each in judges_of(kind, "src/ars_can.c") if each != SANITIZED)]


def test_lines_and_branches_that_do_not_run_are_findings() -> None:
    units = {unit["path"]: unit for unit in coverage.measured(PI, partial)}
    can, e2e, dynamics = (units[f"4ws2/src/ars_{name}.c"] for name in ("can", "e2e", "dynamics"))
    assert coverage.outcome_of([can]).verdict is Verdict.PASSED, can["missed"]
    assert can["lines"] > 50 and dynamics["lines_run"] == 0 < 30 < dynamics["lines"]
    assert 0 < e2e["lines_run"] < e2e["lines"] and 0 < e2e["branches_taken"] < e2e["branches"]
    outcome = coverage.outcome_of([can, e2e])
    assert (outcome.verdict, outcome.findings) == (Verdict.FAILED, tuple(e2e["missed"]))
    text = (PI / "src/ars_e2e.c").read_text(encoding="ascii").splitlines()
    idle = [int(finding.split(":")[1]) for finding in outcome.findings if finding.endswith("never runs")]
    assert any("ARS_E2E_REPEATED" in text[line - 1] for line in idle)
    assert any("branch" in finding for finding in outcome.findings)


def test_conditions_come_from_the_report_of_clang(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src/a.c").write_text("if ((a > 1)\n    && b) {\n", encoding="ascii")
    branches = [[1, 5, 1, 12, 3, 0, 0, 0, 4], [2, 8, 2, 9, 1, 2, 0, 0, 4], [9, 1, 9, 5, 1, 1, 0, 0, 4]]
    file = {"filename": "src/a.c", "branches": branches, "mcdc_records": [[1, 5, 2, 9, 0, 0, 0, 0, 5, [], [True, False]]]}
    conditions = list(mcdc._conditions("4ws2", tmp_path, file))
    assert conditions == [("4ws2/src/a.c:1", "(a > 1)", True), ("4ws2/src/a.c:2", "b", False)]
    outcome = mcdc.outcome_of(conditions)
    assert outcome.findings == ("4ws2/src/a.c:2: `b` is never shown to decide",)
    assert outcome.figure == "1 of 2 conditions decide"
    assert mcdc.outcome_of(conditions[:1]).verdict is Verdict.PASSED
    assert list(mcdc._conditions("4ws2", tmp_path, {"filename": str(tmp_path / "bench/plant.c")})) == []
    # Nothing measured is not passed.
    assert coverage.outcome_of([]).verdict is mcdc.outcome_of([]).verdict is Verdict.FAILED
