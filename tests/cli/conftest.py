"""Fixtures of the command line: run commands and inspect output, exit code and files."""

import hashlib
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from codegen import cli
from codegen.cli.base import ARGUMENT

ROOT = Path(__file__).resolve().parents[2]
BUILD, TRACKING = ROOT / "generated" / "4ws2-paper", ROOT / "generated" / "4ws2"
MAP = BUILD.with_suffix(".npz")


@dataclass(frozen=True)
class Answer:
    """Result of a command."""

    code: int
    out: str
    err: str


Run = Callable[..., Answer]
Refused = Callable[..., str]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return `run("build", "--map", path)`, which executes a whole command in this process."""

    def command(*arguments: object) -> Answer:
        monkeypatch.setattr(sys, "argv", ["codegen", *(str(argument) for argument in arguments)])
        capsys.readouterr()
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        assert isinstance(stopped.value.code, int)
        answer = Answer(stopped.value.code, *capsys.readouterr())
        assert not ARGUMENT.search(answer.out + answer.err), "an argument of the library instead of an option"
        return answer

    return command


def everything_in(folder: Path) -> dict[str, str]:
    """Map each relative path to a hash of the file, or to its kind if it is something else."""

    def content(path: Path) -> str:
        if path.is_symlink() or not path.is_file():
            return f"link to {path.readlink()}" if path.is_symlink() else "folder" if path.is_dir() else "special"
        return hashlib.sha256(path.read_bytes()).hexdigest()

    return {path.relative_to(folder).as_posix(): content(path) for path in sorted(folder.rglob("*"))}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, which is empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def refused(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Refused:
    """Return `refused("build", ...)`, which checks that a command is rejected and returns its one line of error.

    The exit code must be 2, and neither standard output nor the disk may change.
    """
    monkeypatch.chdir(tmp_path)

    def command(*arguments: object) -> str:
        before = everything_in(tmp_path)
        answer = run(*arguments)
        assert (answer.code, answer.out, answer.err.count("\n")) == (2, "", 1), answer
        assert answer.err.startswith("error: ")
        assert everything_in(tmp_path) == before
        return answer.err.rstrip("\n")

    return command


def edit(path: Path, *changes: tuple[str, str]) -> Path:
    """Replace the first occurrence of each text in a file. Raises AssertionError if a text is missing."""
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new, 1)
    path.write_text(text, encoding="utf-8")
    return path


MAIN = "from codegen.cli import main\nmain()\n"


def program(script: str, *arguments: object) -> list[str]:
    """Return the command line of a process that runs a script and then `codegen ARGUMENTS` through MAIN."""
    # Background jobs of a shell ignore SIGINT.
    start = "import os, signal, sys\nsignal.signal(signal.SIGINT, signal.default_int_handler)\nsys.argv[0] = 'codegen'\n"
    return [sys.executable, "-B", "-c", start + script, *map(str, arguments)]


def python(script: str, *arguments: object, folder: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a `program` to its end, in its own session."""
    return subprocess.run(
        program(script, *arguments),
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        check=False,
        start_new_session=True,
    )
