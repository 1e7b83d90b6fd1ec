"""Survivors once more, with sanitizers: an address out of bounds may give the right numbers, and is a fault all the same.

AddressSanitizer must be there before Python is, so this is a process of its own:
`python -m tests.campaign.sanitized FOLDER NAMES RESULT`, both files JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from codegen.errors import BuildError
from codegen.sil.toolchain import compiler_command
from codegen.verify.packages import MissingTool
from tests.campaign.case import case_of
from tests.campaign.fates import Bench, Fate, fate_of
from tests.campaign.library import FLAGS, Compiler
from tests.campaign.mutants import Key, mutants_of
from tests.campaign.part import ROOT
from tests.campaign.suite import judges_of

SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
OPTIONS = {"ASAN_OPTIONS": "detect_leaks=0:abort_on_error=1", "UBSAN_OPTIONS": "abort_on_error=1", "PYTHONMALLOC": "malloc"}
"""Python's own allocator would put the buffers of the tests side by side, without a gap between them."""


def runtime() -> Path:
    """The library that has to be loaded first. Raises MissingTool where the compiler has none."""
    name = "libasan.so"
    done = subprocess.run([*compiler_command(), f"-print-file-name={name}"], capture_output=True, text=True, check=False)
    path = Path(done.stdout.strip())
    if not path.is_absolute() or not path.exists():
        raise MissingTool("the compiler has no AddressSanitizer", where=name, remedy="apt install gcc libasan8")
    return path


def fates_of(folder: Path, keys: Sequence[Key]) -> list[tuple[Fate, str]]:
    """What becomes of mutants of a build, sanitized. Raises MissingTool: see `runtime`; BuildError: it could not be done."""
    if not keys:
        return []
    preload = runtime()
    with tempfile.TemporaryDirectory(prefix="ars-sanitized-") as name:
        names, result = Path(name) / "names.json", Path(name) / "result.json"
        names.write_text(json.dumps([asdict(key) for key in keys]), encoding="utf-8")
        command = [sys.executable, "-m", "tests.campaign.sanitized", str(folder), str(names), str(result)]
        environment = {**os.environ, **OPTIONS, "LD_PRELOAD": str(preload)}
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise BuildError(done.stderr.strip().rpartition("\n")[2] or "it failed", where="mutants with sanitizers")
        return [(Fate(fate), by) for fate, by in json.loads(result.read_text(encoding="utf-8"))]


def main(folder: Path, names: Path, result: Path) -> None:
    """Judge the named mutants, one after the other."""
    keys = [Key(**entry) for entry in json.loads(names.read_text(encoding="utf-8"))]
    paths = sorted({key.path for key in keys})
    with tempfile.TemporaryDirectory(prefix="ars-sanitized-") as scratch:
        case = case_of(folder, Path(scratch), Compiler(compiler_command(), FLAGS, SANITIZED))
        bench = Bench.of(case, judges_of, paths)
        if bench.faults:
            raise SystemExit(f"unaltered, it fails {bench.faults}")
        known = {mutant.key: mutant for path in paths for mutant in mutants_of(bench.units[path])}
        found = [fate_of(bench, known[key]) for key in keys]
    result.write_text(json.dumps([(one.fate.value, one.by) for one in found]), encoding="utf-8")


if __name__ == "__main__":
    main(*(Path(argument) for argument in sys.argv[1:4]))
