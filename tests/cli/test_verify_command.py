"""`codegen verify` at the command line; the checks themselves are those of tests/verify."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from codegen.verify import runner
from codegen.verify.check import Effort, Outcome, Subject, Verdict
from codegen.verify.runner import CHECKS, Report

from .conftest import Run, everything_in

BUILD = Path(__file__).parents[2] / "generated" / "4ws2"
Come = Callable[[Sequence[Verdict]], None]


@pytest.fixture
def build(tmp_path: Path) -> Path:
    return shutil.copytree(BUILD, tmp_path / "build", ignore=shutil.ignore_patterns("verify.*"))


@pytest.fixture
def come(monkeypatch: pytest.MonkeyPatch) -> Come:
    """`come(verdicts)`: what the checks come to, without being run."""

    def given(verdicts: Sequence[Verdict]) -> None:
        def run(subject: Subject, effort: Effort, *_: Any) -> Report:
            outcomes = {
                check.name: Outcome(check.shows, "a figure", verdict, () if verdict is Verdict.PASSED else ("why",))
                for check, verdict in zip(CHECKS, verdicts, strict=True)
            }
            return Report(subject, effort, outcomes)

        monkeypatch.setattr(runner, "run", run)

    return given


@pytest.mark.parametrize(
    ("verdicts", "code", "last"),
    [
        ([Verdict.PASSED] * 8, 0, "8 checks passed"),
        ([Verdict.PASSED] * 7 + [Verdict.NOT_RUN], 0, "7 checks passed, 1 not run"),
        ([Verdict.PASSED] * 7 + [Verdict.FAILED], 1, "1 of 8 checks failed: fuzzing"),
        ([Verdict.NOT_RUN] * 8, 1, 'no check could be run; pip install "ars-codegen[verify]"'),
    ],
)
def test_exit_code_and_last_line(run: Run, build: Path, come: Come, verdicts: list[Verdict], code: int, last: str) -> None:
    come(verdicts)
    answer = run("verify", build)
    assert answer.code == code
    assert (answer.out if code == 0 else answer.err).rstrip().endswith(last)
    record = json.loads((build / "verify.json").read_bytes())
    assert [check["verdict"] for check in record["checks"].values()] == [str(verdict) for verdict in verdicts]
    assert (build / "verify.md").is_file()


def test_the_result_as_json_elsewhere(run: Run, build: Path, come: Come, tmp_path: Path) -> None:
    come([Verdict.PASSED] * 8)
    assert run("verify", build, "--json", tmp_path / "result.json").code == 0
    assert (tmp_path / "result.json").read_bytes() == (build / "verify.json").read_bytes()


def test_what_is_no_build_leaves_everything_as_it_is(run: Run, build: Path, come: Come) -> None:
    come([Verdict.PASSED] * 7)
    (build / "verify.md").mkdir()
    before = everything_in(build)
    answer = run("verify", build)
    assert (answer.code, answer.err.count("\n")) == (2, 1)
    assert everything_in(build) == before
    (build / "manifest.json").write_text("{")
    assert run("verify", build).code == 2
