"""The command of the campaign: table, file, exit code."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from codegen.errors import BuildError
from codegen.verify.check import Effort, Outcome, Verdict
from codegen.verify.packages import MissingTool
from tests.evidence.__main__ import FINDINGS_SHOWN, main
from tests.evidence.part import FOLDERS, MODULES, Run


def parts(**outcomes: Outcome | Exception) -> tuple[dict[str, list[bool]], object]:
    """Parts that give what is said; those that are not named pass. And with what effort each was run."""
    asked: dict[str, list[bool]] = {}

    def part_of(name: str) -> Run:
        def run(folders: Sequence[Path], effort: Effort) -> Outcome:
            assert folders == FOLDERS
            asked.setdefault(name, []).append(effort.quick)
            given = outcomes.get(name, Outcome(f"what {name} shows", "all of it", Verdict.PASSED))
            if isinstance(given, Exception):
                raise given
            return given

        return run

    return asked, part_of


def run(tmp_path: Path, *arguments: str, **outcomes: Outcome | Exception) -> tuple[int, dict[str, dict[str, object]]]:
    _, part_of = parts(**outcomes)
    code = main(arguments, tmp_path / "deep" / "campaign.json", part_of)  # type: ignore[arg-type]
    return code, json.loads((tmp_path / "deep" / "campaign.json").read_text())["parts"]


def test_all_parts_are_run_in_order(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked, part_of = parts()
    assert main(["--quick"], tmp_path / "campaign.json", part_of) == 0  # type: ignore[arg-type]
    assert asked == {name: [True] for name in MODULES}
    shown = capsys.readouterr().out
    assert [shown.index(f"{name} ") for name in MODULES] == sorted(shown.index(f"{name} ") for name in MODULES)
    assert shown.count("passed") == len(MODULES)


def test_a_part_that_fails_is_exit_1_with_its_findings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    findings = tuple(f"a.c:{line}: wrong" for line in range(30))
    code, written = run(tmp_path, "mcdc", "coverage", mcdc=Outcome("shows", "0 of 1", Verdict.FAILED, findings))
    assert code == 1
    assert list(written) == ["coverage", "mcdc"]
    assert written["mcdc"]["verdict"] == "failed"
    assert written["mcdc"]["findings"] == list(findings)
    told = capsys.readouterr().out
    assert told.count("mcdc: a.c:") == FINDINGS_SHOWN
    assert f"and {30 - FINDINGS_SHOWN} more" in told


def test_a_part_without_its_tool_is_not_run_and_not_passed(tmp_path: Path) -> None:
    missing = MissingTool("it is not installed", where="clang", remedy="apt install clang-19")
    code, written = run(tmp_path, "mcdc", mcdc=missing)
    assert code == 1
    assert written["mcdc"]["verdict"] == "not run"
    assert "clang" in str(written["mcdc"]["findings"])
    assert run(tmp_path, "mcdc", "--allow-missing", mcdc=missing)[0] == 0


def test_an_optional_part_may_lack_its_tool_but_not_fail(tmp_path: Path) -> None:
    missing = MissingTool("it is not installed", where="frama-c", remedy="apt install frama-c")
    code, written = run(tmp_path, "frama-c", **{"frama-c": missing})
    assert (code, written["frama-c"]["verdict"]) == (0, "not run")
    assert run(tmp_path, "frama-c", **{"frama-c": Outcome("shows", "1 alarm", Verdict.FAILED)})[0] == 1


def test_a_build_that_cannot_be_tested_fails(tmp_path: Path) -> None:
    code, written = run(tmp_path, "coverage", coverage=BuildError("it does not compile", where="a.c"))
    assert (code, written["coverage"]["verdict"]) == (1, "failed")


def test_parts_that_are_not_asked_for_stay_in_the_file(tmp_path: Path) -> None:
    run(tmp_path, "mutation", mutation=Outcome("shows", "old", Verdict.PASSED))
    _, written = run(tmp_path, "coverage")
    assert list(written) == ["coverage", "mutation"]
    assert written["mutation"]["figure"] == "old"


def test_an_unknown_part_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["miracles"], tmp_path / "campaign.json")
    assert left.value.code == 2
    assert "there is no part 'miracles'" in capsys.readouterr().err
