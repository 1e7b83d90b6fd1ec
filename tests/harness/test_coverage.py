"""Coverage and MC/DC as parts of the evidence: lines, branches and conditions that no test covers are findings."""

from pathlib import Path

from codegen.verify.check import Verdict
from tests.evidence.coverage import coverage, mcdc
from tests.evidence.parts import FOLDERS
from tests.sil.suite import Judge


def test_lines_and_branches_that_do_not_run_are_findings() -> None:
    selftest = Judge("self-test", lambda case: case.built.software.selftest())
    units = {unit["path"]: unit for unit in coverage.measured(FOLDERS[0], lambda kind: [selftest])}
    can, e2e, look_up = (units[f"4ws2/src/ars_{name}.c"] for name in ("can", "e2e", "map"))
    assert can["lines_run"] == 0 < 50 < can["lines"]
    assert 0 < e2e["lines_run"] < e2e["lines"] and 0 < look_up["branches_taken"] < look_up["branches"]
    outcome = coverage.outcome_of([e2e, look_up])
    assert (outcome.verdict, outcome.findings) == (Verdict.FAILED, (*e2e["missed"], *look_up["missed"]))
    text = (FOLDERS[0] / "src/ars_e2e.c").read_text(encoding="ascii").splitlines()
    idle = [int(finding.split(":")[1]) for finding in e2e["missed"] if finding.endswith("never runs")]
    assert any("ARS_E2E_REPEATED" in text[line - 1] for line in idle)
    assert any("branch" in finding for finding in look_up["missed"])
    assert coverage.outcome_of([{**e2e, "missed": []}]).verdict is Verdict.PASSED


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
