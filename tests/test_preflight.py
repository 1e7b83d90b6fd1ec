"""What `make` says on a machine that lacks something: `scripts/preflight.sh` with a PATH made for the test."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "preflight.sh"
SHELL = shutil.which("sh") or "/bin/sh"

OLD_PYTHON = 'case "$2" in *version_info*) exit 1;; esac'
PYTHON_WITHOUT_VENV = 'case "$2" in *ensurepip*) exit 1;; esac'
WORKS = "exit 0"
FAILS = "exit 1"


def preflight(tmp_path: Path, programs: dict[str, str], *arguments: str, cc: str = "") -> subprocess.CompletedProcess[str]:
    """Run the script where only `programs` (name -> shell text) exist."""
    place = tmp_path / "bin"
    place.mkdir()
    for name, text in programs.items():
        (place / name).write_text(f"#!{SHELL}\n{text}\n", encoding="utf-8")
        (place / name).chmod(0o755)
    environment = {"PATH": str(place), "CC": cc}
    return subprocess.run([SHELL, SCRIPT, *arguments], env=environment, capture_output=True, text=True)


def test_a_machine_with_all_passes_in_silence(tmp_path: Path) -> None:
    result = preflight(tmp_path, {"python3": WORKS, "gcc": WORKS})
    assert (result.returncode, result.stdout, result.stderr) == (0, "", "")


@pytest.mark.parametrize(
    ("programs", "needed"),
    [
        ({"cc": WORKS}, "python3 is missing: install Python 3.11 or newer (Debian, Ubuntu: apt install python3 python3-venv)"),
        ({"cc": WORKS, "python3": OLD_PYTHON}, "python3 is older than 3.11: install"),
        (
            {"cc": WORKS, "python3": PYTHON_WITHOUT_VENV},
            "python3 has no venv: install it (Debian, Ubuntu: apt install python3-venv",
        ),
        ({"python3": WORKS}, "a C compiler is missing: install one (Debian, Ubuntu: apt install gcc libc6-dev"),
        ({"python3": WORKS, "cc": FAILS}, "the C compiler 'cc' cannot be run or has no C library headers: install them"),
    ],
)
def test_one_line_says_what_to_install(tmp_path: Path, programs: dict[str, str], needed: str) -> None:
    result = preflight(tmp_path, programs)
    assert result.returncode == 2
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith(needed)


def test_all_that_is_missing_is_told_at_once(tmp_path: Path) -> None:
    result = preflight(tmp_path, {})
    assert result.returncode == 2
    assert [line.split(":")[0] for line in result.stderr.splitlines()] == ["python3 is missing", "a C compiler is missing"]


def test_the_named_python_is_the_one_looked_at(tmp_path: Path) -> None:
    assert preflight(tmp_path, {"python3": OLD_PYTHON, "cc": WORKS}, sys.executable).returncode == 0


def test_cc_is_taken_with_its_arguments(tmp_path: Path) -> None:
    programs = {"python3": WORKS, "cc": FAILS, "wrap": '[ "$1" = inner ]'}
    assert preflight(tmp_path, programs, cc="wrap inner").returncode == 0


def test_a_cc_that_does_not_exist_is_named(tmp_path: Path) -> None:
    result = preflight(tmp_path, {"python3": WORKS, "cc": WORKS}, cc="no-such-compiler")
    assert result.returncode == 2
    assert "'no-such-compiler'" in result.stderr
