"""Coverage, MC/DC and libFuzzer as parts of the evidence: gaps and faults in their reports become findings."""

from pathlib import Path

from codegen.verify.outcomes import Verdict
from tests.evidence.coverage import coverage, mcdc
from tests.evidence.libfuzzer import libfuzzer


def test_lines_and_branches_that_do_not_run_are_findings() -> None:
    """The input is a report of gcovr, which only the part itself runs because it needs gcc."""
    counts = {3: (2, [1, 0]), 4: (0, [0, 0]), 5: (1, [])}
    lines = [{"line_number": line, "count": count, "branches": [{"count": each} for each in branches]}
             for line, (count, branches) in counts.items()]  # fmt: skip
    unit = coverage._unit("4ws2-paper", {"file": "src/a.c", "lines": [*lines, {"line_number": 9, "gcovr/noncode": True}]})
    outcome = coverage.outcome_of([unit])
    assert outcome.findings == ("4ws2-paper/src/a.c:4: never runs", "4ws2-paper/src/a.c:3: branch 1 is never taken")
    assert (outcome.verdict, outcome.figure) == (Verdict.FAILED, "2 of 3 lines, 1 of 4 branches")
    assert coverage.outcome_of([{**unit, "missed": []}]).verdict is Verdict.PASSED


def test_conditions_come_from_the_report_of_clang(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src/a.c").write_text("if ((a > 1)\n    && b) {\n", encoding="ascii")
    branches = [[1, 5, 1, 12, 3, 0, 0, 0, 4], [2, 8, 2, 9, 1, 2, 0, 0, 4], [9, 1, 9, 5, 1, 1, 0, 0, 4]]
    file = {"filename": "src/a.c", "branches": branches, "mcdc_records": [[1, 5, 2, 9, 0, 0, 0, 0, 5, [], [True, False]]]}
    conditions = list(mcdc._conditions("4ws2-paper", tmp_path, file))
    assert conditions == [("4ws2-paper/src/a.c:1", "(a > 1)", True), ("4ws2-paper/src/a.c:2", "b", False)]
    outcome = mcdc.outcome_of(conditions)
    assert outcome.findings == ("4ws2-paper/src/a.c:2: `b` is never shown to decide",)
    assert outcome.figure == "1 of 2 conditions decide"
    assert mcdc.outcome_of(conditions[:1]).verdict is Verdict.PASSED
    assert list(mcdc._conditions("4ws2-paper", tmp_path, {"filename": str(tmp_path / "bench/plant.c")})) == []
    assert coverage.outcome_of([]).verdict is mcdc.outcome_of([]).verdict is Verdict.FAILED, "nothing was measured"


REPORT = """INFO: Running with entropic power schedule (0xFF, 100).
INFO: Loaded 1 modules   (457 inline 8-bit counters): 457 [0x5581, 0x5589),
#2\tINITED cov: 31 ft: 32 corp: 1/1b exec/s: 0 rss: 70Mb
#3000\tDONE   cov: 272 ft: 900 corp: 77/20Kb lim: 2048 exec/s: 100 rss: 71Mb
"""


def test_figures_and_findings_of_a_report_of_libfuzzer() -> None:
    assert libfuzzer.read(REPORT, 0) == libfuzzer.Run(3000, 272, 457, ())
    broken = REPORT + "property not held: status has a name (5, 4)\n==1== ERROR: libFuzzer: deadly signal\n"
    assert libfuzzer.read(broken, 77).findings == ("property not held: status has a name (5, 4)",)
    slow = libfuzzer.read("==1== ERROR: libFuzzer: timeout after 20 seconds\nTest unit written to ./x-timeout-1\n", 70)
    assert slow.findings == ("==1== ERROR: libFuzzer: timeout after 20 seconds (x-timeout-1)",)
    assert libfuzzer.read("", 1).findings == ("it ends with exit code 1",)
