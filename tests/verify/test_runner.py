"""What runs the checks, the table, and what is left beside the build."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from codegen.emit.folder import verify_hashes
from codegen.emit.write import write_folder
from codegen.errors import CodegenError
from codegen.verify import manual, record, runner, table
from codegen.verify.check import Effort, Subject, Verdict
from codegen.verify.runner import LEFT_OUT, Registered, Report
from tests.verify import builds


def registered(name: str, quick: bool = True) -> Registered:
    return Registered(name, f"the {name} one", f"tests.verify.made.{name}", f"What {name} would show", quick)


ENDS = tuple(registered(name) for name in ("passing", "failing", "missing", "refusing"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("builds") / "sample"
    write_folder(builds.made("pi"), place)
    return place


@pytest.fixture(scope="module")
def report(folder: Path) -> Report:
    return runner.run(Subject.read(folder), Effort(), checks=ENDS)


def test_each_check_has_its_verdict_in_the_order_of_the_list(report: Report) -> None:
    verdicts = {name: outcome.verdict for name, outcome in report.outcomes.items()}
    assert list(verdicts) == ["passing", "failing", "missing", "refusing"]
    assert list(verdicts.values()) == [Verdict.PASSED, Verdict.FAILED, Verdict.NOT_RUN, Verdict.FAILED]
    assert report.failed == ("failing", "refusing")
    assert [report.count(verdict) for verdict in Verdict] == [1, 2, 1]


def test_a_missing_tool_is_told_with_its_remedy(report: Report) -> None:
    outcome = report.outcomes["missing"]
    assert outcome.findings == ("nothing: it is not installed; install it",)
    assert outcome.shows == "What missing would show"


def test_a_fault_of_one_check_leaves_the_others_theirs(folder: Path) -> None:
    report = runner.run(Subject.read(folder), Effort(), checks=(registered("broken"), registered("passing")))
    broken = report.outcomes["broken"]
    assert broken.verdict is Verdict.FAILED
    assert broken.findings == ("could not be completed: RuntimeError: a fault of the program",)
    assert broken.shows == "What broken would show"
    assert report.outcomes["passing"].verdict is Verdict.PASSED


def test_a_check_whose_process_ends_has_failed_and_leaves_the_others_theirs(folder: Path) -> None:
    told: list[int] = []
    checks = (registered("crashing"), registered("passing"), registered("failing"))
    report = runner.run(Subject.read(folder), Effort(), lambda count, of: told.append(count), checks)
    verdicts = [outcome.verdict for outcome in report.outcomes.values()]
    assert verdicts == [Verdict.FAILED, Verdict.PASSED, Verdict.FAILED]
    assert report.outcomes["crashing"].findings == (runner.CRASHED,)
    assert told == [1, 2, 3]


def test_its_traceback_is_shown_where_asked(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    subject = Subject.read(folder)
    for arguments, is_shown in ((["codegen"], False), (["codegen", "--debug"], True)):
        monkeypatch.setattr("sys.argv", arguments)
        runner.outcome_of(registered("broken"), subject, Effort())
        assert ("Traceback" in capsys.readouterr().err) is is_shown


def test_an_interruption_is_none_of_a_check(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(subject: Subject, effort: Effort) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("tests.verify.made.passing.check", interrupted)
    with pytest.raises(KeyboardInterrupt):
        runner.outcome_of(registered("passing"), Subject.read(folder), Effort())


def test_a_quick_run_leaves_out_what_is_not_quick_and_tells_the_others(folder: Path) -> None:
    told: list[tuple[int, int]] = []
    checks = (registered("failing", quick=False), registered("passing"))
    report = runner.run(Subject.read(folder), Effort(quick=True), lambda done, total: told.append((done, total)), checks)
    assert report.outcomes["failing"].verdict is Verdict.NOT_RUN
    assert report.outcomes["failing"].findings == (LEFT_OUT,)
    assert report.outcomes["passing"].figures["quick"] is True
    assert told == [(1, 1)]
    assert not list(table.findings(report))


def test_every_registered_check_is_there() -> None:
    for check in runner.CHECKS:
        assert callable(__import__(check.module, fromlist=["check"]).check)
    assert {check.name for check in runner.CHECKS} == set(runner.SLOWEST_FIRST)
    assert [check.name for check in runner.CHECKS if check.quick] == [
        *("compiles", "static-analysis", "processor-in-the-loop", "budgets", "law"),
    ]


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


def test_findings_are_told_up_to_a_number(report: Report) -> None:
    lines = list(table.findings(report))
    assert lines[0] == "failing: src/x.c:0: wrong"
    assert lines[table.FINDINGS_TOLD] == "failing: and 2 more"
    assert "refusing: src/x.c:3: the C does not compile" in lines
    assert not any(line.startswith("passing") for line in lines)


class TestRecord:
    def test_it_stands_beside_and_changes_nothing_else(self, report: Report, folder: Path, tmp_path: Path) -> None:
        place = tmp_path / "sample"
        shutil.copytree(folder, place)
        before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
        assert record.write(report, place)
        after = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
        assert after.keys() - before.keys() == {place / "verify.json", place / "verify.md"}
        assert {path: after[path] for path in before} == before
        assert verify_hashes(place) == []
        assert write_folder(builds.made("pi"), place) is False, "what stands beside is no change of the build"

    def test_the_json_holds_the_whole_report(self, report: Report, folder: Path) -> None:
        data = json.loads(record.render(report))
        assert data["counts"] == {"passed": 1, "failed": 2, "not run": 1}
        assert data["checks"]["passing"]["figures"]["files"] == len(report.subject.files)
        assert len(data["checks"]["failing"]["findings"]) == 12
        assert data["build"]["kind"] == "pi"
        assert data["files"].keys() == report.subject.files.keys()
        assert str(folder) not in record.render(report).decode()

    def test_the_same_run_gives_the_same_bytes(self, report: Report, folder: Path) -> None:
        again = runner.run(Subject.read(folder), Effort(), checks=ENDS)
        assert record.render(again) == record.render(report)
        assert manual.manual(again) == manual.manual(report)

    def test_a_quick_run_does_not_replace_a_whole_one_of_the_same_files(self, folder: Path, tmp_path: Path) -> None:
        place = tmp_path / "sample"
        shutil.copytree(folder, place)
        quick, whole = (runner.run(Subject.read(place), Effort(quick), checks=ENDS[:1]) for quick in (True, False))
        assert record.write(quick, place)
        assert record.write(whole, place)
        kept = (place / "verify.json").read_bytes()
        assert not record.write(quick, place)
        assert (place / "verify.json").read_bytes() == kept
        (place / "src" / "ars_map.c").write_bytes(report_of_another(place))
        assert record.write(runner.run(Subject.read(place), Effort(quick=True), checks=ENDS[:1]), place)
        assert json.loads((place / "verify.json").read_bytes())["edited"] == ["src/ars_map.c"]

    def test_an_unreadable_record_is_replaced(self, report: Report, folder: Path, tmp_path: Path) -> None:
        place = tmp_path / "sample"
        shutil.copytree(folder, place)
        (place / "verify.json").write_text("{", encoding="ascii")
        quick = runner.run(Subject.read(place), Effort(quick=True), checks=ENDS[:1])
        assert record.write(quick, place)
        assert json.loads((place / "verify.json").read_bytes())["effort"] == "quick"

    def test_what_cannot_be_written_is_told(self, report: Report, folder: Path, tmp_path: Path) -> None:
        place = tmp_path / "sample"
        shutil.copytree(folder, place)
        (place / "verify.md").mkdir()
        with pytest.raises(CodegenError, match="cannot be written"):
            record.write(report, place)


def report_of_another(place: Path) -> bytes:
    """The map with a blank more at its end."""
    return (place / "src" / "ars_map.c").read_bytes() + b"\n"


class TestManual:
    def test_it_says_what_it_is_not(self, report: Report) -> None:
        text = manual.manual(report)
        assert "no certificate, neither of ISO 26262" in text
        for heading in ("Road and map", "Sensors", "Actuator", "Timing and memory", "Reaction to loss"):
            assert f"### {heading}" in text
        assert text.isascii()

    def test_it_tells_what_failed_and_what_was_not_run(self, report: Report) -> None:
        text = manual.manual(report)
        assert "1 checks passed, 2 failed, 1 not run." in text
        assert "**not run**" in text
        assert "- src/x.c:11: wrong" in text
        assert "It says nothing of the rest." in text
        assert "It shows \\| nothing" in text, "a bar inside a cell of a table"

    def test_a_quick_run_says_so(self, folder: Path) -> None:
        report = runner.run(Subject.read(folder), Effort(quick=True), checks=ENDS[:1])
        assert "A quick run" in manual.manual(report)

    def test_an_edited_file_is_named(self, folder: Path, tmp_path: Path) -> None:
        place = tmp_path / "sample"
        shutil.copytree(folder, place)
        (place / "src" / "ars_map.c").write_bytes(report_of_another(place))
        report = runner.run(Subject.read(place), Effort(), checks=ENDS[:1])
        assert "**Not as it was built:** `src/ars_map.c`" in manual.manual(report)

    @pytest.mark.parametrize("kind", builds.KINDS)
    def test_every_kind_has_one(self, kind: str, tmp_path: Path) -> None:
        place = tmp_path / "sample"
        write_folder(builds.made(kind), place)  # type: ignore[arg-type]
        text = manual.manual(runner.Report(Subject.read(place), Effort(), {}))
        assert "The command moves by at most" in text, "as the recommended configuration has it"
        assert f"kind `{kind}`" in text


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (lambda manifest: manifest.pop("margins"), "margins: field required"),
        (lambda manifest: manifest.update(margins="wide"), "margins: input should be a valid dictionary"),
        (lambda manifest: manifest.pop("map"), "map: field required"),
        (lambda manifest: manifest["map"].update(frictions=[]), "map.frictions: list should have at least 1 item"),
        (lambda manifest: manifest["options"].pop("kind"), "options.kind: field required"),
        (lambda manifest: manifest["options"].update(prefix="../x"), "options.prefix: string should match"),
        (lambda manifest: manifest["configuration"].pop("controller"), "configuration.controller: missing"),
    ],
)
def test_a_damaged_manifest_is_told_before_anything_runs(
    folder: Path, tmp_path: Path, damage: Callable[[dict[str, Any]], object], told: str
) -> None:
    copy = shutil.copytree(folder, tmp_path / "copy")
    manifest = json.loads((copy / "manifest.json").read_bytes())
    damage(manifest)
    (copy / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(CodegenError) as caught:
        Subject.read(copy)
    assert str(caught.value).startswith(f"{copy / 'manifest.json'}: {told}")
    assert caught.value.exit_code == 2


def test_what_could_not_be_written_is_told_before_anything_runs(folder: Path, tmp_path: Path) -> None:
    copy = shutil.copytree(folder, tmp_path / "copy")
    record.require_place(copy)
    for name in (record.JSON, record.MANUAL):
        (copy / name).mkdir()
        with pytest.raises(CodegenError, match=rf"{name}: not a regular file"):
            record.require_place(copy)
        (copy / name).rmdir()
