"""Time whole commands compared with the start-up of Python and CasADi."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from benchmarks.timing import Comparison, Report, interleaved

REPEATS, QUICK_REPEATS = 15, 5
ROOT = Path(__file__).resolve().parents[1]
HEAVY = ("casadi", "matplotlib", "numpy", "scipy", "pydantic", "jinja2")

PEERS = {"python -c pass": ("-c", "pass"), "python -c 'import casadi'": ("-c", "import casadi")}


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Start everything in turns."""
    say("starting processes")
    with tempfile.TemporaryDirectory() as scratch:
        # Also where the wheel is not installed the commands are this checkout's.
        commands = {
            "codegen --help": ("--help",),
            "codegen solve": ("solve", "--case", "4ws-2", "-o", f"{scratch}/4ws2.npz"),
            "codegen build": ("build", "--map", f"{scratch}/4ws2.npz", "-o", f"{scratch}/4ws2"),
        }
        arguments = PEERS | {name: ("-m", "codegen", *words) for name, words in commands.items()}
        start = partial(_start, Path(scratch, "bytecode"))
        works: dict[str, Callable[[], object]] = {name: partial(start, words) for name, words in arguments.items()}
        works["codegen build"] = partial(_afresh, Path(scratch, "4ws2"), works["codegen build"])
        times = interleaved(works, QUICK_REPEATS if quick else REPEATS)
        notes = [f"{name} loads {_heavy(start(('-X', 'importtime', *arguments[name])))}" for name in commands]
    comparisons = [Comparison(name, times[peer], times[name]) for name in commands for peer in PEERS]
    return Report("Starting the command, whole processes", tuple(comparisons), tuple(notes))


def _start(bytecode: Path, arguments: tuple[str, ...]) -> str:
    """Run Python in the checkout; what it prints on standard error.

    With bytecode kept for all alike, as it is where packages are installed, whether or not the caller's Python may write it.
    """
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(bytecode)
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True).stderr


def _afresh(target: Path, build: Callable[[], object]) -> None:
    # A folder that is up to date is not written again.
    shutil.rmtree(target, ignore_errors=True)
    build()


def _heavy(import_times: str) -> str:
    """Return the heavy packages that were imported."""
    lines = import_times.splitlines()
    names = {line.rpartition("|")[2].strip().partition(".")[0] for line in lines if line.startswith("import time:")}
    return ", ".join(name for name in HEAVY if name in names) or f"none of {', '.join(HEAVY)}"
