"""The command that runs the parts of the evidence: table, file, exit code."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.__main__ import FINDINGS_SHOWN, main
from tests.evidence.part import FOLDERS, MODULES, Run

MISSING = MissingTool("it is not installed", where="a tool", remedy="apt install it")


def run(tmp_path: Path, *arguments: str, result: Outcome | Exception | None = None) -> tuple[int, dict[str, dict[str, Any]]]:
    """Run parts that all have one result; return the exit code and the parts in the file."""

    def part_of(name: str) -> Run:
        def run(folders: Sequence[Path], effort: Effort, *others: object) -> Outcome:
            assert folders == FOLDERS
            assert effort.quick == ("--quick" in arguments)
            if isinstance(result, Exception):
                raise result
            return result or Outcome(f"what {name} shows", "all of it", Verdict.PASSED)

        return run

    code = main(arguments, tmp_path / "deep" / "campaign.json", part_of)
    return code, json.loads((tmp_path / "deep" / "campaign.json").read_text())["parts"]


def test_all_parts_run_in_order(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, written = run(tmp_path, "--quick")
    assert (code, list(written)) == (0, list(MODULES))
    shown = capsys.readouterr().out
    positions = [shown.index(f"{name} ") for name in MODULES]
    assert positions == sorted(positions)
    assert shown.count("passed") == len(MODULES)


def test_a_part_that_fails_is_exit_1_with_its_findings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    findings = tuple(f"a.c:{line}: wrong" for line in range(30))
    code, written = run(tmp_path, "mcdc", "coverage", result=Outcome("shows", "0 of 1", Verdict.FAILED, findings))
    assert (code, list(written)) == (1, ["coverage", "mcdc"])
    assert (written["mcdc"]["verdict"], written["mcdc"]["findings"]) == ("failed", list(findings))
    shown = capsys.readouterr().out
    assert shown.count("mcdc: a.c:") == FINDINGS_SHOWN
    assert f"and {30 - FINDINGS_SHOWN} more" in shown


@pytest.mark.parametrize(
    ("arguments", "result", "code", "verdict"),
    [
        (["mcdc"], MISSING, 1, "not run"),
        (["mcdc", "--allow-missing"], MISSING, 0, "not run"),
        (["frama-c"], MISSING, 0, "not run"),
        (["frama-c"], Outcome("shows", "1 alarm", Verdict.FAILED), 1, "failed"),
        (["coverage"], BuildError("it does not compile", where="a.c"), 1, "failed"),
    ],
)
def test_exit_codes(tmp_path: Path, arguments: list[str], result: Outcome | Exception, code: int, verdict: str) -> None:
    exit_code, written = run(tmp_path, *arguments, result=result)
    assert (exit_code, written[arguments[0]]["verdict"]) == (code, verdict)


def test_parts_that_do_not_run_stay_in_the_file(tmp_path: Path) -> None:
    run(tmp_path, "mutation", result=Outcome("shows", "old", Verdict.PASSED))
    _, written = run(tmp_path, "coverage")
    assert [(name, part["figure"]) for name, part in written.items()] == [("coverage", "all of it"), ("mutation", "old")]


def test_an_unknown_part_is_rejected(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["miracles"], tmp_path / "campaign.json")
    assert left.value.code == 2
    assert "there is no part 'miracles'" in capsys.readouterr().err
