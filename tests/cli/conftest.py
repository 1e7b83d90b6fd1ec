"""A user at the command line: runs commands, and sees what they print, return and leave on disk."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from codegen import cli


@dataclass(frozen=True)
class Answer:
    """What a command gave back."""

    code: int
    out: str
    err: str


Run = Callable[..., Answer]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """`run("build", "--map", path)`: the whole command, in this process."""

    def command(*arguments: object) -> Answer:
        monkeypatch.setattr(sys, "argv", ["codegen", *(str(argument) for argument in arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        seen = capsys.readouterr()
        code = stopped.value.code
        assert isinstance(code, int)
        return Answer(code, seen.out, seen.err)

    return command


def everything_in(folder: Path) -> dict[str, str]:
    """Relative path -> hash of what stands there (folders and links too)."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = f"link to {path.readlink()}"
        elif path.is_dir():
            found[name] = "folder"
        else:
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


@pytest.fixture
def refused(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """`refused("build", ...)`: exit code 2, one line on standard error, nothing on standard output, nothing changed on disk.

    Returns the line.
    """
    monkeypatch.chdir(tmp_path)

    def command(*arguments: object) -> str:
        before = everything_in(tmp_path)
        answer = run(*arguments)
        assert answer.code == 2, answer
        lines = answer.err.splitlines()
        assert len(lines) == 1, answer.err
        assert lines[0].startswith("error: ")
        assert "Traceback" not in answer.err
        assert answer.out == ""
        assert everything_in(tmp_path) == before
        return lines[0]

    return command
