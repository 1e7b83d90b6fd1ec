"""`make clean` in a repository of its own."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]


def run(*command: str, folder: Path) -> str:
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    return result.stdout


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
"""One example of each pattern in .gitignore."""


def test_clean_leaves_the_environment_and_the_files_that_git_tracks(tmp_path: Path) -> None:
    if shutil.which("git") is None:
        pytest.skip("needs git")
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
