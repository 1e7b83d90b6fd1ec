"""The evidence: parts run alone, resume, and leave records that say what they are about."""

import json
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType

import pytest

from codegen.verify.check import Effort, Outcome, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence import __main__ as command
from tests.evidence import pytest_part
from tests.evidence.parts import PARTS, ROOT, Part, hash_of
from tests.evidence.progress import Progress
from tests.evidence.record import Record

PASSED = Outcome("it works", "3 of 3", Verdict.PASSED, figures={"count": 3})
Make = Callable[..., Part]


@pytest.fixture
def part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Return a part whose module gives an outcome or raises an error, about a file that a test can change."""
    (tmp_path / "subject.c").write_text("int a;\n", encoding="ascii")
    monkeypatch.setattr("tests.evidence.parts.ROOT", tmp_path)
    monkeypatch.setattr(Part, "hashes", lambda self: {"subject": hash_of(self.subject, tmp_path), "own_code": ""})
    monkeypatch.setattr(command, "SCRATCH", tmp_path / "scratch")

    def make(result: Outcome | Exception = PASSED, is_optional: bool = False, name: str = "sample") -> Part:
        def run(folders: Sequence[Path], effort: Effort, progress: Progress) -> Outcome:
            if isinstance(result, Exception):
                raise result
            return result

        module = ModuleType(f"evidence_{name}")
        module.run = run  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, module.__name__, module)
        return Part(name, "it works", ("*.c",), (), module.__name__, is_optional=is_optional)

    return make


def run(part: Part | Sequence[Part], tmp_path: Path, *arguments: str) -> int:
    return command.main(arguments, [part] if isinstance(part, Part) else part, tmp_path / "records")


def test_a_record_is_current_until_its_subject_changes(part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sample = part()
    assert run(sample, tmp_path, "--check") == 1, "there is none yet"
    assert "make evidence PART=sample" in capsys.readouterr().out
    assert run(sample, tmp_path, "--quick") == 0
    record = Record.read(sample, tmp_path / "records")
    assert (record.is_current("full"), record.is_current("quick"), record.matches) == (False, True, True)
    assert record.runs["quick"]["figures"] == {"count": 3}
    assert run(sample, tmp_path) == run(sample, tmp_path, "--check") == 0
    assert Record.read(sample, tmp_path / "records").runs.keys() == {"full", "quick"}
    (tmp_path / "subject.c").write_text("int b;\n", encoding="ascii")
    assert run(sample, tmp_path, "--check") == 1


def test_only_changed_and_named_parts_run(part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parts = [part(name=name) for name in ("one", "two", "three")]
    assert run(parts, tmp_path, "one", "two") == 0
    capsys.readouterr()
    assert run(parts, tmp_path, "two", "--changed", "--quick") == 0
    assert capsys.readouterr().err.splitlines() == ["... two", "... three"]


def test_a_failed_run_is_recorded_and_matches_nothing(part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    failed = part(Outcome("it works", "2 of 3", Verdict.FAILED, ("the third is wrong",)))
    assert run(failed, tmp_path) == 1
    assert "sample: the third is wrong" in capsys.readouterr().out
    assert not Record.read(failed, tmp_path / "records").matches


def test_a_missing_tool_is_one_line_and_no_record(part: Make, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    missing = MissingTool("it is not installed", where="frama-c", remedy="apt install frama-c-base")
    assert run(part(missing), tmp_path) == 1
    assert "sample: frama-c: it is not installed; apt install frama-c-base" in capsys.readouterr().out
    assert run(part(missing, is_optional=True), tmp_path) == 0
    assert not (tmp_path / "records").exists()


def test_an_unknown_part_is_a_usage_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        command.main(["no-such-part"])
    assert "there is no part 'no-such-part'; the parts are builds, " in capsys.readouterr().err


def test_a_hash_is_of_names_and_contents(tmp_path: Path) -> None:
    def found() -> str:
        return hash_of(("*.c", "**/*.h"), tmp_path)

    (tmp_path / "inner" / "__pycache__").mkdir(parents=True)
    hashes = [found()]
    for path, text in (("a.c", "1"), ("a.c", "2"), ("b.c", "2"), ("inner/a.h", "1")):
        (tmp_path / path).write_text(text, encoding="ascii")
        hashes.append(found())
    assert len(set(hashes)) == len(hashes)
    (tmp_path / "other.txt").touch()
    (tmp_path / "inner" / "__pycache__" / "a.h").touch()
    assert found() == hashes[-1]


def test_finished_steps_are_not_run_again(tmp_path: Path) -> None:
    path = tmp_path / "steps.jsonl"
    first = Progress(path)
    assert [first.once(key, lambda key=key: f"{key}!") for key in ("a", "b")] == ["a!", "b!"]  # type: ignore[misc]
    with path.open("a", encoding="utf-8") as stream:
        stream.write('{"key": "c", "va')  # a kill
    again = Progress(path)
    assert (again.get("a"), again.get("c")) == ("a!", None)
    assert again.once("b", lambda: "other") == "b!"


TESTS = """
import pytest
from pathlib import Path

@pytest.mark.parametrize("number", range(3))
def test_good(number):
    with Path({log!r}).open("a") as stream:
        stream.write("x")

@pytest.mark.long
def test_long():
    {long}
"""


def test_a_folder_of_tests_resumes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = ROOT / "build" / f"evidence-sample-{tmp_path.name}"
    log, passed, sample = tmp_path / "log", tmp_path / "passed", Part("sample", "it works", (), (), worker_count=0)
    monkeypatch.setattr(Part, "folder", folder)
    monkeypatch.setenv("PYTEST_ADDOPTS", "-p tests.evidence.conftest -p no:cacheprovider")
    folder.mkdir(parents=True, exist_ok=True)
    try:
        (folder / "test_sample.py").write_text(TESTS.format(log=str(log), long="assert False"), encoding="utf-8")
        failed = pytest_part.run(sample, Effort(), passed)
        assert (failed.verdict, failed.figures["passed"], len(failed.findings)) == (Verdict.FAILED, 3, 1)
        assert pytest_part.run(sample, Effort(quick=True), tmp_path / "quick").verdict is Verdict.PASSED
        assert log.read_text(encoding="utf-8") == "x" * 6
        (folder / "test_sample.py").write_text(TESTS.format(log=str(log), long="pytest.skip('no cmake')"), encoding="utf-8")
        skipped = pytest_part.run(sample, Effort(), passed)
        assert log.read_text(encoding="utf-8") == "x" * 6, "what passed is not run again"
        assert (skipped.verdict, len(skipped.findings)) == (Verdict.NOT_RUN, 1)
        assert "no cmake" in skipped.findings[0]
    finally:
        shutil.rmtree(folder)


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_each_part_is_there(part: Part) -> None:
    """Its patterns name files, its module or its folder exists, and a record names the part."""
    for pattern in (*part.subject, *part.own):
        assert any(path.is_file() for path in ROOT.glob(pattern)), pattern
    assert (ROOT / f"{part.module.replace('.', '/')}.py").is_file() if part.module else any(part.folder.glob("test_*.py"))
    record = ROOT / "docs" / "evidence" / f"{part.name}.json"
    assert part.is_optional or json.loads(record.read_text(encoding="utf-8"))["part"] == part.name
