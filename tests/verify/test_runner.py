"""The runner of the checks, the table of the results, and the record beside the build."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from codegen.emit.folder import verify_hashes
from codegen.errors import CodegenError
from codegen.verify import manual, record, runner, table
from codegen.verify.check import Effort, Subject, Verdict
from codegen.verify.runner import LEFT_OUT, Registered, Report

BUILD = Path(__file__).parents[2] / "generated" / "4ws2"


def registered(name: str, quick: bool = True) -> Registered:
    return Registered(name, f"the {name} one", f"tests.verify.made.{name}", f"What {name} would show", quick)


NAMES = ("passing", "failing", "missing", "refusing", "broken")
ENDS = tuple(map(registered, NAMES))


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A copy of a build that was never verified."""
    return shutil.copytree(BUILD, tmp_path / "build", ignore=shutil.ignore_patterns("verify.*"))


@pytest.fixture(scope="module")
def report() -> Report:
    return runner.run(Subject.read(BUILD), Effort(), checks=ENDS)


def passed(folder: Path, quick: bool = False) -> Report:
    """Return the report of one check that passes, run in this process."""
    subject, effort = Subject.read(folder), Effort(quick)
    return Report(subject, effort, {"passing": runner.outcome_of(ENDS[0], subject, effort)})


def test_each_check_has_its_verdict_in_the_order_of_the_list(report: Report) -> None:
    failed, not_run = Verdict.FAILED, Verdict.NOT_RUN
    verdicts = {name: outcome.verdict for name, outcome in report.outcomes.items()}
    assert list(verdicts.items()) == list(zip(NAMES, (Verdict.PASSED, failed, not_run, failed, failed), strict=True))
    assert report.failed == ("failing", "refusing", "broken")
    assert [report.count(verdict) for verdict in Verdict] == [1, 3, 1]
    findings = {name: report.outcomes[name].findings for name in NAMES[2:]}
    assert findings == {
        "missing": ("nothing: it is not installed; install it",),
        "refusing": ("src/x.c:3: the C does not compile",),
        "broken": ("could not be completed: RuntimeError: a fault of the program",),
    }
    assert all(report.outcomes[name].shows == f"What {name} would show" for name in findings)


def test_a_check_whose_process_ends_has_failed_and_the_others_go_on() -> None:
    done: list[tuple[int, int]] = []
    checks = (registered("crashing"), registered("failing", quick=False), registered("passing"))
    report = runner.run(Subject.read(BUILD), Effort(quick=True), lambda *counts: done.append(counts), checks)
    verdicts = [outcome.verdict for outcome in report.outcomes.values()]
    assert verdicts == [Verdict.FAILED, Verdict.NOT_RUN, Verdict.PASSED]
    assert report.outcomes["crashing"].findings == (runner.CRASHED,)
    assert report.outcomes["failing"].findings == (LEFT_OUT,)
    assert report.outcomes["passing"].figures["quick"] is True
    assert done == [(1, 2), (2, 2)]


def test_an_interruption_is_no_outcome_and_neither_is_anything_else(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(subject: Subject, effort: Effort) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("tests.verify.made.passing.check", interrupted)
    with pytest.raises(KeyboardInterrupt):
        runner.outcome_of(registered("passing"), Subject.read(BUILD), Effort())
    monkeypatch.setattr("tests.verify.made.passing.check", lambda subject, effort: 3)
    (finding,) = runner.outcome_of(registered("passing"), Subject.read(BUILD), Effort()).findings
    assert finding.endswith("tests.verify.made.passing.check gave int, not an Outcome")


def test_every_registered_check_exists() -> None:
    for check in runner.CHECKS:
        assert callable(__import__(check.module, fromlist=["check"]).check)
    assert {check.name for check in runner.CHECKS} == set(runner.SLOWEST_FIRST)
    slow = [check.name for check in runner.CHECKS if not check.quick]
    assert slow == ["proof", "sanitizers", "fuzzing"]


def test_the_table_fits_and_names_everything(report: Report) -> None:
    text = table.table(report)
    for columns in (40, 80, 120, 160, 400):
        drawn = table.table(report, columns).splitlines()
        assert max(map(len, drawn)) <= min(max(columns, 80), 160)
        assert sum(set(line) == {"─"} for line in drawn) == 1, "one rule, unbroken"
        assert ("what it shows" in drawn[0]) == (columns >= 100)
    for name, outcome in report.outcomes.items():
        row = next(line for line in text.splitlines() if line.startswith(name))
        assert row.endswith(str(outcome.verdict))
    lines = list(table.findings(report))
    assert lines[0] == "failing: src/x.c:0: wrong"
    assert lines[table.FINDINGS_TOLD] == "failing: and 2 more"
    assert "refusing: src/x.c:3: the C does not compile" in lines
    assert not any(line.startswith("passing") for line in lines)


def test_the_record_holds_the_report_and_changes_nothing_else(report: Report, place: Path) -> None:
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    assert record.write(report, place)
    after = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    assert after.keys() - before.keys() == {place / record.JSON, place / record.MANUAL}
    assert {path: after[path] for path in before} == before
    assert verify_hashes(place) == []
    content = (place / record.JSON).read_bytes()
    assert content == record.render(report)
    data = json.loads(content)
    assert data["counts"] == {"passed": 1, "failed": 3, "not run": 1}
    assert data["checks"]["passing"]["figures"]["files"] == len(report.subject.files)
    assert len(data["checks"]["failing"]["findings"]) == 12
    assert data["build"]["kind"] == "pi"
    assert data["files"].keys() == report.subject.files.keys()
    assert str(BUILD) not in content.decode()


def test_a_quick_record_does_not_replace_a_whole_one_of_the_same_files(place: Path) -> None:
    quick, whole = passed(place, quick=True), passed(place)
    (place / record.JSON).write_text("{", encoding="ascii")  # what cannot be read is replaced
    assert record.write(quick, place)
    assert json.loads((place / record.JSON).read_bytes())["effort"] == "quick"
    assert record.write(whole, place)
    kept = (place / record.JSON).read_bytes()
    assert not record.write(quick, place)
    assert (place / record.JSON).read_bytes() == kept
    edited = place / "src" / "ars_map.c"
    edited.write_bytes(edited.read_bytes() + b"\n")
    assert record.write(passed(place, quick=True), place)
    assert json.loads((place / record.JSON).read_bytes())["edited"] == ["src/ars_map.c"]
    assert "**Not as it was built:** `src/ars_map.c`" in (place / record.MANUAL).read_text()


def test_a_record_that_cannot_be_written_is_reported_before_and_after_the_run(place: Path) -> None:
    record.require_place(place)
    for name in (record.JSON, record.MANUAL):
        (place / name).mkdir()
        with pytest.raises(CodegenError, match=rf"{name}: not a regular file"):
            record.require_place(place)
        with pytest.raises(CodegenError, match="cannot be written"):
            record.write(passed(place), place)
        (place / name).rmdir()


def test_the_manual_reports_failures_and_missing_checks(report: Report) -> None:
    text = manual.manual(report)
    assert "no certificate, neither of ISO 26262" in text
    for heading in ("Road and map", "Sensors", "Actuator", "Timing and memory", "Reaction to loss"):
        assert f"### {heading}" in text
    assert "1 checks passed, 3 failed, 1 not run." in text
    assert "**not run**" in text
    assert "- src/x.c:11: wrong" in text
    assert "It says nothing of the rest." in text
    assert "It shows \\| nothing" in text, "a bar inside a cell of a table"
    assert "A quick run" not in text
    assert "A quick run" in manual.manual(replace(report, effort=Effort(quick=True)))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda manifest: manifest.pop("margins"), "margins: field required"),
        (lambda manifest: manifest.update(margins="wide"), "margins: input should be a valid dictionary"),
        (lambda manifest: manifest["map"].update(frictions=[]), "map.frictions: list should have at least 1 item"),
        (lambda manifest: manifest["options"].update(prefix="../x"), "options.prefix: string should match"),
        (lambda manifest: manifest["configuration"].pop("controller"), "configuration.controller: missing"),
    ],
)
def test_a_damaged_manifest_is_rejected(place: Path, damage: Callable[[dict[str, Any]], object], message: str) -> None:
    manifest = json.loads((place / "manifest.json").read_bytes())
    damage(manifest)
    (place / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(CodegenError) as caught:
        Subject.read(place)
    assert str(caught.value).startswith(f"{place / 'manifest.json'}: {message}")
    assert caught.value.exit_code == 2
