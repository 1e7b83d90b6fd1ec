"""The evidence: parts run alone and resume, and full runs leave records that name what they are about."""

import json
import multiprocessing
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from codegen.errors import CodegenError
from codegen.verify.outcomes import Effort, Outcome, Verdict
from codegen.verify.tools import MissingTool
from scripts.guide import evidence_tables
from tests import shared
from tests.evidence import __main__ as command
from tests.evidence import pytest_part, record
from tests.evidence.parts import PACKAGES, PARTS, RECORDS, ROOT, Part, matching
from tests.evidence.progress import Progress

PASSED = Outcome("it works", "3 of 3", Verdict.PASSED, figures={"count": 3})
Make = Callable[..., Part]


@pytest.fixture
def part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Return a part with a given outcome or error, whose subject is a file that a test can change."""
    (tmp_path / "subject.c").write_text("int a;\n", encoding="ascii")
    monkeypatch.setattr("tests.evidence.parts.ROOT", tmp_path)
    monkeypatch.setattr(command, "SCRATCH", tmp_path / "scratch")

    def make(result: Outcome | Exception | Callable[[Effort, Progress], Outcome] = PASSED, name: str = "sample") -> Part:
        def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
            if isinstance(result, Exception):
                raise result
            return result(effort, progress) if callable(result) else result

        module = ModuleType(f"tests.evidence.{name}_module")
        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)
        return Part(name, ("*.c",), f"{name}_module")

    return make


def change(folder: Path) -> None:
    (folder / "subject.c").write_text("int b;\n", encoding="ascii")


def test_a_full_run_leaves_a_record_that_is_current_until_its_subject_changes(part: Make, tmp_path: Path) -> None:
    sample = part()
    assert record.state(sample, record.read(sample, tmp_path)) == "no full run yet"
    assert command.main([], [sample], tmp_path) == 0
    found = record.read(sample, tmp_path)
    assert found is not None and found["figures"] == {"count": 3} and record.state(sample, found) == "current"
    change(tmp_path)
    assert record.state(sample, found) == "changed since"
    (tmp_path / "tests/evidence/sample_module").mkdir(parents=True)
    before = sample.hash()
    (tmp_path / "tests/evidence/sample_module/own.toml").touch()
    assert sample.hash() != before, "its own code"


def test_a_quick_run_needs_no_record_and_writes_none(part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = sorted(tmp_path.iterdir())
    assert command.main(["--quick"], [part()], tmp_path) == 0
    change(tmp_path)
    assert command.main(["--quick"], [part()], tmp_path) == 0
    assert re.fullmatch(r"(sample: passed: 3 of 3 \(\d+ s, CPU \d+ s\)\nin all \d+ s, CPU \d+ s\n){2}", capsys.readouterr().out)
    assert sorted(tmp_path.iterdir()) == before


def test_a_failed_full_run_fails_quick_runs_until_it_passes_or_its_subject_changes(
    part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    failed = Outcome("it works", "2 of 3", Verdict.FAILED, tuple(f"number {k} is wrong" for k in range(30)))
    assert command.main([], [part(failed)], tmp_path) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "sample: number 0 is wrong" and len(lines) == command.FINDINGS_SHOWN + 2
    sample = part(lambda effort, progress: PASSED)
    assert record.state(sample, record.read(sample, tmp_path)) == "failed"
    assert command.main(["--quick"], [sample], tmp_path) == 1
    assert capsys.readouterr().out.startswith(
        "sample: its recorded full run failed, and nothing has changed since; run it again\n"
    )
    assert command.main(["--quick", "other"], [sample, part(name="other")], tmp_path) == 0, "only the chosen parts"
    kept = (tmp_path / "sample.json").read_bytes()
    change(tmp_path)
    assert record.state(sample, record.read(sample, tmp_path)) == "failed, changed since"
    assert command.main(["--quick"], [sample], tmp_path) == 0
    (tmp_path / "subject.c").write_text("int a;\n", encoding="ascii")
    assert (tmp_path / "sample.json").read_bytes() == kept
    assert command.main(["--quick"], [sample], tmp_path) == 1
    assert command.main([], [sample], tmp_path) == command.main(["--quick"], [sample], tmp_path) == 0


def test_quick_forms_run_at_the_same_time(part: Make, tmp_path: Path) -> None:
    """Each of two parts waits for the other; only a failure waits long."""
    both = multiprocessing.get_context("fork").Barrier(2)

    def meet(effort: Effort, progress: Progress) -> Outcome:
        both.wait(60.0)
        return PASSED

    assert command.main(["--quick"], [part(meet, "one"), part(meet, "two")], tmp_path) == 0


def test_bad_input(part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, what in ((["smple"], "there is no part smple"), (["--quik"], "unrecognized arguments: --quik")):
        with pytest.raises(SystemExit, match="2"):
            command.main(words, [part(AssertionError("it ran"))], tmp_path)
        assert what in capsys.readouterr().err
    for spoiled in ("{", "[]", '{"part": "sample"}'):
        (tmp_path / "sample.json").write_text(spoiled, encoding="ascii")
        with pytest.raises(CodegenError, match=r"sample\.json: it is not a record of part sample; delete it"):
            command.main([], [part(AssertionError("it ran"))], tmp_path)


def test_the_page_shows_the_last_full_run(part: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures = {"count": 30000, "a.c": {"of_all": 1, "wrong": 0}, "b.c": {"of_all": 2000, "wrong": 0}, "kind": {"x|y": [1, 2]}}
    sample = part(Outcome("it works", "two of 3", Verdict.FAILED, ("the third is wrong",), figures))
    monkeypatch.setattr(evidence_tables, "PARTS", [sample])
    monkeypatch.setattr(record.read, "__defaults__", (tmp_path,))
    assert evidence_tables.label() == "**no full run yet**: `sample`.\n"
    assert "| `sample` | no full run yet |  |  |" in evidence_tables.summary() and not evidence_tables.details()
    command.main([], [sample], tmp_path)
    assert evidence_tables.label() == "**failed**: `sample`.\n"
    assert "| `sample` | failed | two of 3 | 0 s |" in evidence_tables.summary()
    page = evidence_tables.details()
    assert "\nTwo of 3.\n" in page and "- the third is wrong\n" in page
    assert "| count | 30,000 |" in page and r"| kind: x\|y | 1, 2 |" in page
    assert "|  | of all | wrong |\n| --- | --- | --- |\n| a.c | 1 | 0 |\n| b.c | 2,000 | 0 |\n" in page
    change(tmp_path)
    assert evidence_tables.label() == "**failed, changed since**: `sample`.\n"
    command.main([], [part()], tmp_path)
    assert evidence_tables.label() == "All are current.\n"


def test_a_missing_tool_is_reported_and_leaves_no_record(
    part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = MissingTool("it is not installed", where="cbmc", remedy="apt install cbmc")
    assert command.main([], [part(missing)], tmp_path) == 1
    assert "sample: cbmc: it is not installed; apt install cbmc\n" in capsys.readouterr().out
    lacking = replace(part(AssertionError("it ran")), tools=("no-such-gcov", "sh", "no-such-clang"))
    assert command.main(["--quick"], [lacking], tmp_path) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[:-1] == [f"sample: not run: {name} is not installed: apt install {name}" for name in lacking.tools[::2]]
    assert not list(tmp_path.glob("*.json"))


def test_a_part_about_files_of_the_user_runs_on_their_folder(
    part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sample = replace(part(name="public"), needs_files=True)
    module = sys.modules["tests.evidence.public_module"]
    module.run = lambda folders, effort, progress: replace(PASSED, figure=str(folders))  # type: ignore[attr-defined]
    assert command.main(["--quick", "--files", str(tmp_path)], [sample], tmp_path) == 0
    assert f"public: passed: {(tmp_path,)}" in capsys.readouterr().out
    needed = "public: not run: it needs public files, which are not in the repository: make evidence PART=public FILES=DIR"
    assert [command.main(words, [sample, part()], tmp_path) for words in ([], ["--quick"])] == [1, 0]
    assert capsys.readouterr().out.count(needed) == 2
    for words, what in ((["public"], needed), (["--files", str(tmp_path / "none")], "none is not a folder")):
        with pytest.raises(SystemExit, match="2"):
            command.main(words, [sample], tmp_path)
        assert what in capsys.readouterr().err


def test_an_interrupted_full_run_resumes_until_code_changes(part: Make, tmp_path: Path) -> None:
    def run(effort: Effort, progress: Progress) -> Outcome:
        steps = [progress.once(key, (tmp_path / key).read_text) for key in ("first", "second")]
        return replace(PASSED, figure=" ".join(steps))

    def figure() -> tuple[str, object]:
        command.main([], [sample], tmp_path)
        found = json.loads((tmp_path / "sample.json").read_bytes())
        return found["figure"], found["duration_s"]

    sample = part(run)
    (tmp_path / "first").write_text("one")
    for arguments in ([], ["--quick"]):
        assert command.main(arguments, [part(name="other"), sample], tmp_path) == 1
    assert not (tmp_path / "sample.json").exists() and (tmp_path / "other.json").exists()
    for name in ("first", "second"):
        (tmp_path / name).write_text("again")
    assert figure() == ("one again", None)
    assert figure() == ("again again", 0)
    (tmp_path / "second").unlink()
    (tmp_path / "first").write_text("one")
    assert command.main([], [sample], tmp_path) == 1
    change(tmp_path)
    for name in ("first", "second"):
        (tmp_path / name).write_text("new")
    assert figure() == ("new new", 0)


def test_folders_of_killed_runs_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv(shared.VARIABLE, "")
    shared.begin()
    killed, alive = tmp_path / f"{shared.PREFIX}killed", shared.folder()
    killed.mkdir()
    for path, is_old, left in ((killed, False, True), (alive, True, True), (killed, True, False)):
        if is_old:
            os.utime(path, (0, 0))
        shared.begin()
        assert path.exists() is left


TESTS = """
import pytest

def test_good():
    {good}

@pytest.mark.long
def test_long():
    {long}
"""


def test_a_folder_of_tests_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, sample = ROOT / "build" / f"evidence-sample-{tmp_path.name}", Part("sample", ())
    monkeypatch.setattr(Part, "folder", folder)
    monkeypatch.setenv("PYTEST_ADDOPTS", "-p no:cacheprovider")
    folder.mkdir(parents=True, exist_ok=True)

    def run(good: str, long: str, quick: bool = False) -> Outcome:
        (folder / "test_sample.py").write_text(TESTS.format(good=good, long=long), encoding="utf-8")
        return pytest_part.run(sample, Effort(quick), tmp_path / f"results {quick}")

    try:
        failed = run("pass", "assert 'this' == 'that'")
        assert (failed.verdict, failed.figures) == (Verdict.FAILED, {"passed": 1, "failed": 1})
        assert failed.findings[0].endswith("test_sample.py::test_long: AssertionError: assert 'this' == 'that'")
        skipped = run("assert 'run' == 'again'", "pytest.skip('no cmake')")
        assert skipped.verdict is Verdict.NOT_RUN and "no cmake" in skipped.findings[0]
        assert run("pass", "assert False", quick=True).verdict is Verdict.PASSED
        assert run("import nothing_of_this_name", "pass", quick=True).verdict is Verdict.PASSED, "it passed before"
        (tmp_path / "results True").unlink()
        (folder / "test_sample.py").write_text("import nothing_of_this_name", encoding="utf-8")
        broken = pytest_part.run(sample, Effort(quick=True), tmp_path / "results True")
        assert (broken.verdict, broken.findings) == (Verdict.FAILED, ("pytest ended with exit code 2",))
    finally:
        shutil.rmtree(folder)


@pytest.mark.skipif(sys.platform != "linux", reason="Linux ends a process with its parent")
def test_a_folder_of_tests_ends_with_its_run(tmp_path: Path) -> None:
    """A run is killed while its test waits; the test keeps a pipe open until its process ends."""
    os.mkfifo(pipe := tmp_path / "pipe")
    (tmp_path / "test_sample.py").write_text(
        f"import pathlib, signal\n\ndef test():\n    with pathlib.Path({str(pipe)!r}).open('wb', 0) as stream:\n"
        "        stream.write(b'.')\n        signal.pause()\n"
    )
    code = f"""
from pathlib import Path
from tests.evidence.pytest_part import Effort, Part, run
Part.folder = Path({str(tmp_path)!r})
run(Part("sample", ()), Effort(quick=True), Part.folder / "results")
"""
    with (
        subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.DEVNULL) as process,
        pipe.open("rb", 0) as end,
    ):
        assert end.read(1) == b"."
        process.kill()
        assert select.select([end], [], [], 60.0)[0] and not end.read(1), "the test goes on"


def test_each_part_is_complete() -> None:
    """Its patterns match files, the page explains it, CI installs its tools, and no module of the project is in no part."""
    page = (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8")
    left = matching(["codegen/**/*.py", "hil_sim/**/*.py"])
    for part in PARTS:
        assert matching(part.patterns[-2:]), part
        for pattern in part.subject:
            found = matching([pattern])
            assert found, pattern
            left -= found
        assert f"\n| `{part.name}` | " in page
        assert PACKAGES.keys() >= set(part.tools)
        record.read(part)
    assert not left
    assert {path.stem for path in RECORDS.glob("*")} <= {part.name for part in PARTS}
