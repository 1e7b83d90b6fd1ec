"""The Makefile: what `make help` tells, and what `make clean` leaves."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
WITHOUT_HELP = {"preflight"}
"""Targets that only other targets ask for."""

pytestmark = pytest.mark.skipif(shutil.which("make") is None or shutil.which("git") is None, reason="needs make and git")


def phony() -> set[str]:
    return {name for line in re.findall(r"^\.PHONY: (.+)$", MAKEFILE, re.MULTILINE) for name in line.split()}


def run(*command: str, folder: Path) -> str:
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_help_lists_every_target_with_a_word_on_it() -> None:
    assert len(phony()) > 10
    listed = {}
    for line in run("make", "--no-print-directory", "help", folder=ROOT).splitlines():
        match = re.fullmatch(r"make (\S+) +(\S.*)", line)
        assert match is not None, line
        listed[match[1]] = match[2]
    assert listed.keys() == phony() - WITHOUT_HELP
    assert all(len(text) > 5 for text in listed.values())


def test_help_is_what_make_alone_says() -> None:
    assert run("make", "--no-print-directory", folder=ROOT) == run("make", "--no-print-directory", "help", folder=ROOT)


def test_every_target_with_help_is_phony_or_a_file_would_hide_it() -> None:
    assert set(re.findall(r"^([a-z0-9-]+):[^=].*## ", MAKEFILE, re.MULTILINE)) == phony() - WITHOUT_HELP


@pytest.mark.parametrize("quick", [False, True])
def test_quick_reaches_every_part_of_verify(quick: bool) -> None:
    asked = ["QUICK=1"] if quick else []
    told = run("make", "--no-print-directory", "-n", "-o", ".venv/.ready", "verify", *asked, folder=ROOT).splitlines()
    parts = [line for line in told if "codegen verify" in line or "tests.evidence" in line]
    assert len(parts) == 3
    assert [line.endswith(" --quick") for line in parts] == [quick] * 3


LEFT_BY_WORK = (
    "build/run.png",
    "dist/ars_codegen-0.1.0-py3-none-any.whl",
    "codegen/__pycache__/config.cpython-311.pyc",
    "tests/can/__pycache__/x.pyc",
    ".mypy_cache/3.11/x.json",
    ".pytest_cache/v/x",
    ".ruff_cache/x",
    ".hypothesis/examples/x",
    "docs/_figures/map.png",
    ".coverage",
    "ars_codegen.egg-info/PKG-INFO",
)
"""One of each that .gitignore knows."""


def test_clean_leaves_what_git_knows_and_the_environment(tmp_path: Path) -> None:
    for name in ("Makefile", ".gitignore"):
        shutil.copy(ROOT / name, tmp_path / name)
    for name in (*LEFT_BY_WORK, ".venv/bin/python", ".venv/lib/__pycache__/x.pyc", "codegen/config.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    run("git", "init", "-q", folder=tmp_path)
    run("git", "add", ".", folder=tmp_path)
    for pattern in (ROOT / ".gitignore").read_text(encoding="utf-8").split():  # each is seen in the list above
        seen = run("git", "ls-files", "--others", "--ignored", f"--exclude={pattern}", folder=tmp_path)
        assert seen.strip(), f"{pattern}: add an example of it to LEFT_BY_WORK, and to make clean"
    run("make", "clean", folder=tmp_path)
    left = run("git", "status", "--porcelain", "--ignored", folder=tmp_path).splitlines()
    assert [line for line in left if line.startswith("!!")] == ["!! .venv/"]
    assert (tmp_path / ".venv/lib/__pycache__/x.pyc").is_file()
    assert (tmp_path / "codegen/config.py").is_file()
