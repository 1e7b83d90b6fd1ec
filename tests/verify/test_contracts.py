"""The runner of the contracts: how it judges the answers of a model checker. tests/evidence/verify runs the real one."""

import json
import os
import re
import select
from pathlib import Path

import pytest
from pydantic import ValidationError

from codegen.emit.contracts.proof import Proof
from codegen.verify import cbmc
from codegen.verify.contracts import prove
from codegen.verify.tools import MissingTool

PROOF = Proof(name="x")
SUCCESS = [{"result": [{"property": "p.1", "status": "SUCCESS", "description": "d"}]}, {"cProverStatus": "success"}]
END = [{"result": [{"property": "check_end.assertion.1", "status": "FAILURE", "description": "the end is reached"}]}]
UNREACHED = [{"result": [{"property": "check_end.assertion.1", "status": "SUCCESS", "description": "the end is reached"}]}]
ERROR = [SUCCESS[0], {"messageType": "ERROR", "messageText": "SMT2 solver returned error"}, {"cProverStatus": "error"}]
FAILURE = [
    {"result": [{"property": "p.1", "status": "FAILURE", "description": "d", "sourceLocation": {"file": "f.c", "line": "7"}}]},
    {"cProverStatus": "failure"},
]


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a build; `answer` and `end` beside it are what the model checker prints."""
    programs = tmp_path / "cache" / "cbmc" / "bin"
    programs.mkdir(parents=True)
    script = f'#!/bin/sh\ncase "$*" in *CHECK_END*) cat {tmp_path}/end;; *) cat {tmp_path}/answer; . {tmp_path}/more;; esac\n'
    for name in (*cbmc.CBMC_PROGRAMS, "bitwuzla"):
        (programs / name).write_text(script)
        (programs / name).chmod(0o755)
    (tmp_path / "more").write_text("")
    (tmp_path / "end").write_text(json.dumps(END))
    monkeypatch.setenv("ARS_CACHE", str(tmp_path / "cache"))
    return tmp_path


@pytest.mark.parametrize(
    ("answer", "end", "verdict", "detail"),
    [
        (SUCCESS, END, "proved", ""),
        (SUCCESS, UNREACHED, "open", "end of the harness"),
        (ERROR, END, "open", "solver returned error"),
        (FAILURE, END, "failed", "d (f.c:7"),
    ],
)
def test_verdicts(stand_in: Path, answer: object, end: object, verdict: str, detail: str) -> None:
    (stand_in / "answer").write_text(json.dumps(answer))
    (stand_in / "end").write_text(json.dumps(end))
    (result,) = prove(stand_in, [PROOF], cbmc.installed())
    assert result.verdict == verdict and detail in result.detail


def test_a_contract_that_is_named_as_open_is_not_run(stand_in: Path) -> None:
    (result,) = prove(stand_in, [Proof(name="x", open="no lemma")], cbmc.installed())
    assert (result.verdict, result.detail) == ("open", "no lemma")


def test_an_answer_that_is_cut_off_proves_nothing(stand_in: Path) -> None:
    (stand_in / "answer").write_text(json.dumps(SUCCESS)[:-1])
    (stand_in / "more").write_text("exit 6")
    (result,) = prove(stand_in, [PROOF], cbmc.installed())
    assert (result.verdict, result.detail) == ("open", "CBMC ended early, with exit code 6")


def test_the_time_limit_ends_the_solver_too(stand_in: Path) -> None:
    (stand_in / "answer").write_text("")
    (stand_in / "more").write_text(f"sleep 60 & echo $! > {stand_in}/child; wait")
    (result,) = prove(stand_in, [PROOF], cbmc.installed(), limit_s=0.5)
    assert (result.verdict, result.detail) == ("open", "time limit")
    try:
        solver = os.pidfd_open(int((stand_in / "child").read_text()))
    except ProcessLookupError:
        return
    ended, _, _ = select.select([solver], [], [], 10.0)
    os.close(solver)
    assert ended, "the solver goes on"


@pytest.mark.parametrize("word", ["x; touch x", "x $(touch x)", "x>x", "x&touch", "x|sh", "x\n", "--external-smt2-solver"])
@pytest.mark.parametrize("entry", ["name", "files", "replaced"])
def test_a_proof_runs_nothing_but_the_model_checker(entry: str, word: str) -> None:
    with pytest.raises(ValidationError, match=f"(?s){entry}.*string_pattern_mismatch"):
        Proof.model_validate({"name": "x", entry: word if entry == "name" else ["x", word]})


def test_missing_programs_are_reported(stand_in: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ARS_CACHE", str(stand_in / "empty"))
    monkeypatch.setenv("PATH", str(stand_in))
    with pytest.raises(MissingTool, match=re.escape(cbmc.INSTALL)):
        cbmc.installed()


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert cbmc.main([str(tmp_path / "file")]) == 2
    assert re.fullmatch(r"error: .*Not a directory.*\n", capsys.readouterr().err)


@pytest.mark.parametrize("arguments", [["--help"], ["a", "b"]])
def test_a_request_for_help_installs_nothing(arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ARS_CACHE", str(tmp_path))
    with pytest.raises(SystemExit):
        cbmc.main(arguments)
    assert not list(tmp_path.iterdir())
