"""The targets of the Makefile, and `scripts/preflight.sh` on machines that lack something."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
SHELL = shutil.which("sh") or "/bin/sh"
OLD_PYTHON = 'case "$2" in *version_info*) exit 1;; esac'
WITHOUT_VENV = 'case "$2" in *ensurepip*) exit 1;; esac'
WORKS, FAILS = "exit 0", "exit 1"


def make(*arguments: str) -> list[str]:
    return subprocess.check_output(["make", "--no-print-directory", *arguments], cwd=ROOT, text=True).splitlines()


def test_help_lists_every_target_that_is_no_file() -> None:
    phony = {name for line in re.findall(r"^\.PHONY: (.+)$", MAKEFILE, re.MULTILINE) for name in line.split()}
    assert {re.fullmatch(r"make (\S+) +\S.{5,}", line)[1] for line in make("help")} == phony - {"preflight"}  # a part of others
    assert make() == make("help")


def preflight(folder: Path, programs: dict[str, str], *arguments: str, cc: str = "") -> subprocess.CompletedProcess[str]:
    """Run the script where only `programs` (name -> shell text) exist."""
    for name, text in programs.items():
        (folder / name).write_text(f"#!{SHELL}\n{text}\n", encoding="utf-8")
        (folder / name).chmod(0o755)
    command = [SHELL, ROOT / "scripts" / "preflight.sh", *arguments]
    return subprocess.run(command, env={"PATH": str(folder), "CC": cc}, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("programs", "lines"),
    [
        ({"python3": WORKS, "gcc": WORKS}, []),
        ({"cc": WORKS, "python3": OLD_PYTHON}, ["python3 is older than 3.11: install"]),
        ({"cc": WORKS, "python3": WITHOUT_VENV}, ["python3 has no venv: install it (Debian, Ubuntu: apt install python3-venv"]),
        ({"python3": WORKS}, ["a C compiler is missing: install one (Debian, Ubuntu: apt install gcc libc6-dev"]),
        ({"python3": WORKS, "cc": FAILS}, ["the C compiler 'cc' cannot be run or has no C library headers: install them"]),
        (
            {},
            [
                "python3 is missing: install Python 3.11 or newer (Debian, Ubuntu: apt install python3 python3-venv)",
                "a C compiler is missing: ",
            ],
        ),
    ],
)
def test_a_line_for_each_thing_to_install(tmp_path: Path, programs: dict[str, str], lines: list[str]) -> None:
    result = preflight(tmp_path, programs)
    assert (result.returncode, result.stdout) == (2 if lines else 0, "")
    found = result.stderr.splitlines()
    assert [line[: len(start)] for line, start in zip(found, lines, strict=True)] == lines


def test_python_and_cc_can_be_named(tmp_path: Path) -> None:
    assert preflight(tmp_path, {"python3": OLD_PYTHON, "cc": WORKS}, sys.executable).returncode == 0
    programs = {"python3": WORKS, "cc": FAILS, "wrap": '[ "$1" = inner ]'}
    assert preflight(tmp_path, programs, cc="wrap inner").returncode == 0
    result = preflight(tmp_path, programs, cc="no-such-compiler")
    assert result.returncode == 2
    assert "'no-such-compiler'" in result.stderr
