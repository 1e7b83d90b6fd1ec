"""The evidence: parts run alone, resume, and leave records that name their subject."""

import json
import os
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
from codegen.verify.check import Effort, Outcome, Verdict
from codegen.verify.packages import MissingTool
from tests import shared
from tests.evidence import __main__ as command
from tests.evidence import pytest_part
from tests.evidence.parts import PARTS, ROOT, Part, hash_of, matching, with_imports
from tests.evidence.progress import Progress
from tests.evidence.record import Record

PASSED = Outcome("it works", "3 of 3", Verdict.PASSED, figures={"count": 3})
Make = Callable[..., Part]


@pytest.fixture
def part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Return a part with a given outcome or error, whose subject is a file that a test can change."""
    (tmp_path / "subject.c").write_text("int a;\n", encoding="ascii")
    monkeypatch.setattr("tests.evidence.parts.ROOT", tmp_path)
    monkeypatch.setattr(
        Part, "hashes", lambda self: {"subject": hash_of(matching(self.subject, tmp_path), tmp_path), "own_code": ""}
    )
    monkeypatch.setattr(command, "SCRATCH", tmp_path / "scratch")

    def make(result: Outcome | Exception = PASSED) -> Part:
        def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
            if isinstance(result, Exception):
                raise result
            return result

        module = ModuleType("evidence_sample")
        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)
        return Part("sample", "it works", ("*.c",), module.__name__)

    return make


def test_a_record_is_current_until_its_subject_changes(part: Make, tmp_path: Path) -> None:
    sample = part()
    assert command.main(["--check"], [sample], tmp_path) == 1, "there is none yet"
    assert command.main(["--quick"], [sample], tmp_path) == 0
    record = Record.read(sample, tmp_path)
    assert (record.is_current("full"), record.is_current("quick"), record.matches) == (False, True, True)
    assert record.runs["quick"]["figures"] == {"count": 3}
    assert command.main([], [sample], tmp_path) == command.main(["--check"], [sample], tmp_path) == 0
    assert Record.read(sample, tmp_path).runs.keys() == {"full", "quick"}
    (tmp_path / "subject.c").write_text("int b;\n", encoding="ascii")
    assert command.main(["--check"], [sample], tmp_path) == 1


@pytest.mark.parametrize(("words", "what"), [(["smple"], "no part 'smple'.*did you mean 'sample'"), (["--quik"], "--quik")])
def test_bad_input_is_an_error_of_one_line(part: Make, tmp_path: Path, words: list[str], what: str) -> None:
    with pytest.raises(CodegenError, match=what):
        command.main(words, [part(AssertionError("it ran"))], tmp_path)


def test_the_check_counts_existing_records(part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--check"], [], tmp_path) == 0
    assert capsys.readouterr().out == "0 records match what is there\n"


def test_the_check_names_the_cause(part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def cause() -> str:
        assert command.main(["--check"], [sample], tmp_path) == 1
        return capsys.readouterr().out

    sample = part(Outcome("it works", "2 of 3", Verdict.FAILED, ("the third is wrong",)))
    assert "full run: there is none; quick run: there is none; run: make evidence PART=sample" in cause()
    command.main([], [sample], tmp_path)
    assert "full run: failed; quick" in cause()
    command.main([], [sample := part()], tmp_path)
    (tmp_path / "subject.c").write_text("int b;\n", encoding="ascii")
    assert "full run: subject changed since; quick" in cause()
    (tmp_path / "other.json").write_text("{}", encoding="ascii")
    assert "other.json: there is no such part" in cause()
    for spoiled in ("{", "[]", '{"part": "sample", "runs": {"full": {}}}'):
        (tmp_path / "sample.json").write_text(spoiled, encoding="ascii")
        assert "sample.json: it is not a record of part sample; delete it" in cause()
        with pytest.raises(CodegenError, match="not a record"):
            command.main([], [sample], tmp_path)


def test_the_page_shows_the_run_that_is_current(part: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "docs/_ext"))
    import evidence_tables

    figures = {"count": 30000, "a.c": {"of_all": 1, "wrong": 0}, "b.c": {"of_all": 2000, "wrong": 0}, "kind": {"x|y": [1, 2]}}
    sample = part(Outcome("it works", "2 of 3", Verdict.FAILED, ("the third is wrong",), figures))
    monkeypatch.setattr(evidence_tables, "PARTS", [sample])
    monkeypatch.setattr(Record.read.__func__, "__defaults__", (tmp_path,))
    assert "| `sample` | it works | no record | | |" in evidence_tables.summary()
    command.main([], [sample], tmp_path)
    assert "| 2 of 3 (**failed**) | full |" in evidence_tables.summary()
    page = evidence_tables.details()
    assert "- the third is wrong\n" in page and "| count | 30,000 |" in page and r"| kind: x\|y | 1, 2 |" in page
    assert "|  | of all | wrong |\n| --- | --- | --- |\n| a.c | 1 | 0 |\n| b.c | 2,000 | 0 |\n" in page
    command.main(["--quick"], [part()], tmp_path)
    assert "| 3 of 3 | quick |" in evidence_tables.summary()
    (tmp_path / "subject.c").write_text("int b;\n", encoding="ascii")
    assert "| 2 of 3 (**failed, and subject changed since**) | full |" in evidence_tables.summary()


def test_a_failed_run_is_recorded_and_a_missing_tool_is_not(
    part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    missing = MissingTool("it is not installed", where="cbmc", remedy="apt install cbmc")
    assert command.main([], [part(missing)], tmp_path) == 1
    assert capsys.readouterr().out == "sample: not run: cbmc: it is not installed; apt install cbmc\n"
    lacking = replace(part(AssertionError("it ran")), tools=("no-such-gcov", "sh", "no-such-clang"))
    capsys.readouterr()
    assert command.main([], [lacking], tmp_path) == 1
    first, second = (f"sample: not run: {name} is not installed: apt install {name}\n" for name in lacking.tools[::2])
    assert capsys.readouterr().out == first + second
    assert not list(tmp_path.glob("*.json"))
    failed = part(Outcome("it works", "2 of 3", Verdict.FAILED, ("the third is wrong",)))
    assert command.main([], [failed], tmp_path) == 1
    assert "sample: the third is wrong" in capsys.readouterr().out
    assert not Record.read(failed, tmp_path).matches


def test_the_duration_includes_interrupted_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now, steps = [100.0], tmp_path / "sample.jsonl"
    monkeypatch.setattr(command.time, "time", lambda: now[0])
    for begun, last_step, before in ((100.0, 130.0, 0.0), (500.0, 520.0, 30.0), (900.0, 0.0, 50.0), (990.0, 0.0, 50.0)):
        now[0] = begun
        assert command._seconds_before(tmp_path / "sample") == before
        if last_step:
            steps.touch()
            os.utime(steps, (last_step, last_step))


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
    folder, sample = ROOT / "build" / f"evidence-sample-{tmp_path.name}", Part("sample", "it works", (), worker_count=0)
    monkeypatch.setattr(Part, "folder", folder)
    monkeypatch.setenv("PYTEST_ADDOPTS", "-p tests.evidence.conftest -p no:cacheprovider")
    folder.mkdir(parents=True, exist_ok=True)

    def run(good: str, long: str, quick: bool = False) -> Outcome:
        (folder / "test_sample.py").write_text(TESTS.format(good=good, long=long), encoding="utf-8")
        return pytest_part.run(sample, Effort(quick), tmp_path / f"passed {quick}")

    try:
        failed = run("pass", "assert False")
        assert (failed.verdict, failed.figures["passed"], len(failed.findings)) == (Verdict.FAILED, 1, 1)
        skipped = run("assert 'run' == 'again'", "pytest.skip('no cmake')")
        assert skipped.verdict is Verdict.NOT_RUN and "no cmake" in skipped.findings[0]
        assert run("pass", "assert False", quick=True).verdict is Verdict.PASSED
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
run(Part("sample", "", (), worker_count=0), Effort(), Part.folder / "passed")
"""
    with (
        subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.DEVNULL) as process,
        pipe.open("rb", 0) as end,
    ):
        assert end.read(1) == b"."
        process.kill()
        assert select.select([end], [], [], 60.0)[0] and not end.read(1), "the test goes on"


def test_the_code_of_a_part_includes_its_imports_from_the_tests(tmp_path: Path) -> None:
    written = {
        "tests/evidence/a/test_a.py": "import tests.b.one\n\ndef test():\n    from tests import c\n",
        "tests/b/one.py": "from .two import x\nimport codegen.errors",
        "tests/b/two.py": "from tests.evidence.parts import PARTS\nfrom tests.evidence import a",
        "tests/b/data.c": "int a;",
        "tests/c/__init__.py": "",
    }
    for name, text in written.items() | {("tests/b/other.py", ""), ("tests/evidence/parts.py", ""), ("codegen/errors.py", "")}:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="ascii")
    found = with_imports(matching(["tests/evidence/a/*"], tmp_path), tmp_path)
    assert {path.relative_to(tmp_path).as_posix() for path in found} == written.keys()


def test_each_part_is_complete() -> None:
    """Its patterns match files, a record names the part, and no module of the project is missing."""
    left = matching(["codegen/**/*.py", "hil_sim/**/*.py"])
    for part in PARTS:
        for pattern in (*part.subject, *part.own):
            found = matching([pattern])
            assert found, pattern
            left -= found
        record = ROOT / "docs" / "evidence" / f"{part.name}.json"
        assert json.loads(record.read_text(encoding="utf-8"))["part"] == part.name
    assert not left
