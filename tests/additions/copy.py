"""A copy of the source tree to which something is added: how many files that touches, and what the copy then does."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).parents[2]
PARTS = (
    ".ci",
    "ars_codegen",
    "codegen",
    "hil_sim",
    "templates",
    "tests",
    "benchmarks",
    "docs",
    "scripts",
    "pyproject.toml",
    "README.md",
)


COMMANDS = """
import shlex
import sys

from codegen.cli import main

for line in sys.argv[1:]:
    sys.argv = ["codegen", *shlex.split(line)]
    try:
        main()
    except SystemExit as ended:
        assert ended.code in (None, 0, 1), (line, ended.code)  # 1: warnings, or a missed limit
"""


@dataclass
class Copy:
    """A source tree of its own.

    Attributes:
        root: the folder of the copy.
        touched: files that were changed or made, relative to it.
    """

    root: Path
    touched: set[str] = field(default_factory=set)

    @classmethod
    def into(cls, folder: Path) -> Copy:
        """Copy the tree, without what `make` leaves in it."""
        for part in PARTS:
            source = ROOT / part
            if source.is_dir():
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__", "build"))
            else:
                shutil.copy(source, folder / part)
        return cls(folder)

    def replace(self, path: str, old: str, new: str) -> None:
        """Replace a text that occurs once in a file."""
        text = (self.root / path).read_text()
        assert text.count(old) == 1, f"{path}: {text.count(old)} times {old!r}"
        (self.root / path).write_text(text.replace(old, new))
        self.touched.add(path)

    def after(self, path: str, old: str, more: str) -> None:
        """Insert a text behind one that occurs once in a file."""
        self.replace(path, old, old + more)

    def add(self, path: str, text: str) -> None:
        """Write a new file."""
        (self.root / path).parent.mkdir(parents=True, exist_ok=True)
        (self.root / path).write_text(text)
        self.touched.add(path)

    def commands(self, *lines: str) -> str:
        """Run lines of `codegen` in the copy, one after the other, and return what they print."""
        return self.run("-c", COMMANDS, *lines)

    def run(self, *arguments: str, more: Mapping[str, str] | None = None) -> str:
        """Run the Python of this environment in the copy and return what it prints; it must end with 0."""
        environment = {**os.environ, "PYTHONPATH": str(self.root), **(more or {})}
        command: Sequence[str] = (sys.executable, *arguments)
        found = subprocess.run(command, cwd=self.root, env=environment, capture_output=True, text=True, check=False)
        assert found.returncode == 0, found.stdout + found.stderr
        return found.stdout
