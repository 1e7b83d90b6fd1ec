"""The runner of the checks, the table of results, and the record in the build."""

import json
import multiprocessing
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from codegen.errors import CodegenError
from codegen.verify import bounded_loops, record, runner
from codegen.verify.manual import manual
from codegen.verify.outcomes import Effort, Subject, Verdict
from codegen.verify.runner import CRASHED, LEFT_OUT, Registered, VerificationReport

BUILD = Path(__file__).parents[2] / "generated" / "4ws2-paper"
PASSED, FAILED, NOT_RUN = Verdict.PASSED, Verdict.FAILED, Verdict.NOT_RUN


def registered(name: str, module: str | None = None, quick: bool = True) -> Registered:
    return Registered(name, f"the {name} one", f"tests.verify.made.{module or name}", f"What {name} would show", quick)


EXPECTED = {
    "passing": (PASSED, ()),
    "failing": (FAILED, tuple(f"src/x.c:{line}: wrong" for line in range(12))),
    "slow": (NOT_RUN, (LEFT_OUT,)),
    "missing": (NOT_RUN, ("nothing: it is not installed; install it",)),
    "refusing": (FAILED, ("src/x.c:3: the C does not compile",)),
    "broken": (FAILED, ("could not be completed: RuntimeError: a fault of the program",)),
    "crashing": (FAILED, (CRASHED,)),
}
"""Verdict and findings of each check; a quick run skips the slow one."""


@pytest.fixture
def build_copy(tmp_path: Path) -> Path:
    """Return a copy of a build without a verification record."""
    return shutil.copytree(BUILD, tmp_path / "build", ignore=shutil.ignore_patterns("verify.*"))


@pytest.fixture(scope="module")
def report() -> VerificationReport:
    """Return the report of a quick run in several processes, one of which is killed."""
    checks = [registered("slow", "passing", quick=False) if name == "slow" else registered(name) for name in EXPECTED]
    return runner.run(Subject.read(BUILD), Effort(quick=True), lambda *counts: None, checks)


def passed(folder: Path, quick: bool = False) -> VerificationReport:
    """Return the report of one passing check, run in this process."""
    subject, effort = Subject.read(folder), Effort(quick)
    return VerificationReport(subject, effort, {"passing": runner.outcome_of(registered("passing"), subject, effort)})


def manual_of(report: VerificationReport) -> str:
    return manual(record.to_dict(report), report.subject.manifest, record.CHECK_TITLES)


def test_each_check_has_its_outcome_in_the_order_of_the_list(report: VerificationReport) -> None:
    assert [(name, (end.verdict, end.findings)) for name, end in report.outcomes.items()] == list(EXPECTED.items())
    assert report.failed == ("failing", "refusing", "broken", "crashing")
    assert report.outcomes["passing"].figures == {"files": len(report.subject.files), "quick": True}


def test_loops_are_searched_once_and_a_crash_meanwhile_ends_no_other_check(monkeypatch: pytest.MonkeyPatch) -> None:
    def complaints(*_: object) -> tuple[str, ...]:
        for process in multiprocessing.active_children():
            process.join()  # the crash of one process ends the others
        return ("src/x.c:1: while",)

    monkeypatch.setattr(bounded_loops, "complaints", complaints)  # in this process only
    checks, counts = [registered(name) for name in ("crashing", "passing", "bounded")], []
    found = runner.run(Subject.read(BUILD), Effort(quick=True), lambda *count: counts.append(count), checks)
    assert [outcome.verdict for outcome in found.outcomes.values()] == [FAILED, PASSED, PASSED]
    assert found.outcomes["bounded"].figure == "src/x.c:1: while"
    assert counts == [(1, 3), (2, 3), (3, 3)]


def test_the_record_holds_the_report_and_changes_nothing_else(report: VerificationReport, build_copy: Path) -> None:
    before = {path: path.read_bytes() for path in build_copy.rglob("*") if path.is_file()}
    assert record.write(report, build_copy)
    after = {path: path.read_bytes() for path in build_copy.rglob("*") if path.is_file()}
    content = after.pop(build_copy / record.JSON)
    assert {path: text for path, text in after.items() if path != build_copy / record.MANUAL} == before
    data = json.loads(content)
    assert data["counts"] == {"passed": 1, "failed": 4, "not run": 2}
    assert len(data["checks"]["failing"]["findings"]) == 12
    assert data["files"].keys() == report.subject.files.keys()
    assert str(BUILD) not in content.decode()


def test_a_quick_record_does_not_replace_a_whole_one_of_the_same_files(build_copy: Path) -> None:
    (build_copy / record.JSON).write_text("{", encoding="ascii")  # an unreadable record is replaced
    assert record.write(passed(build_copy, quick=True), build_copy)
    assert json.loads((build_copy / record.JSON).read_bytes())["effort"] == "quick"
    assert record.write(passed(build_copy), build_copy)
    kept = (build_copy / record.JSON).read_bytes()
    assert not record.write(passed(build_copy, quick=True), build_copy)
    assert (build_copy / record.JSON).read_bytes() == kept
    edited = build_copy / "src" / "ars_map.c"
    edited.write_bytes(edited.read_bytes() + b"\n")
    assert record.write(passed(build_copy, quick=True), build_copy)
    assert json.loads((build_copy / record.JSON).read_bytes())["edited"] == ["src/ars_map.c"]
    assert "**Changed after the build:** `src/ars_map.c`" in (build_copy / record.MANUAL).read_text()


def test_a_record_that_cannot_be_written_is_reported_before_and_after_the_run(build_copy: Path) -> None:
    record.require_place(build_copy)
    (build_copy / record.JSON).mkdir()
    with pytest.raises(CodegenError, match=rf"{record.JSON}: not a regular file"):
        record.require_place(build_copy)
    with pytest.raises(CodegenError, match="cannot be written"):
        record.write(passed(build_copy), build_copy)


def test_the_manual_reports_failures_and_missing_checks(report: VerificationReport) -> None:
    text = manual_of(report)
    for part in (
        "not a certificate, of ISO 26262",
        "1 checks passed, 4 failed, 2 not run.",
        "- src/x.c:11: wrong",
        "It says nothing of the rest.",
        "It shows \\| nothing",  # a bar inside a table cell
        "This was a quick run",
    ):
        assert part in text
    assert "This was a quick run" not in manual_of(replace(report, effort=Effort()))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda manifest: manifest.pop("margins"), "margins: it is missing"),
        (lambda manifest: manifest["options"].update(prefix="../x"), "options.prefix: another value is needed"),
    ],
)
def test_a_damaged_manifest_is_rejected(build_copy: Path, damage: Callable[[dict[str, Any]], object], message: str) -> None:
    manifest = json.loads((build_copy / "manifest.json").read_bytes())
    damage(manifest)
    (build_copy / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(CodegenError) as caught:
        Subject.read(build_copy)
    assert str(caught.value).startswith(f"{build_copy / 'manifest.json'}: {message}")
