"""Response times of commands: of this tree, and of an earlier release given by a git revision."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from benchmarks.tables import CountReport, Row
from benchmarks.timing import Times, interleaved
from codegen.errors import CodegenError

ROOT = Path(__file__).resolve().parents[1]
REPEATS, QUICK_REPEATS = 5, 1
TARGETS_S: Mapping[str, float | None] = {
    "--help": 0.1,
    "solve": 0.35,
    "solve, codegen init": None,
    "report": 4.0,
    "sil, new build": 2.0,
    "verify --quick": 15.0,
}
"""Command to the longest time that it should take on two idle cores, in s; None where no target is set."""
CPU_TARGETS_S: Mapping[str, float | None] = {"tune": 10.0, "check": 1.5, "build": 3.0}
"""The same for processor time, of commands that a campaign repeats for many cars."""
VERDICT = ("check", 1)
"""Command and exit code that is a verdict about the car, no failure."""
REVISION = "ARS_BENCH_REVISION"
"""Environment variable with the revision of the earlier release."""
HEADER = ("command", "earlier", "this tree", "target")


@dataclass(frozen=True)
class Tree:
    """A source tree with a scratch folder for its output, its bytecode and its cache."""

    root: Path
    scratch: Path

    def works(self) -> dict[str, Callable[[], object]]:
        """Return each command as a call that waits for its end."""
        build, generated = self.scratch / "4ws2", self.root / "generated"
        shutil.copytree(generated / "4ws2", build)
        self._run(("init", str(self.scratch / "car")))
        car = str(self.scratch / "car" / "ars.toml")  # with the nonlinear tyre; the preset has the paper's linear one
        of_map = ("--map", str(generated / "4ws2.npz"), "--build", str(build))
        commands: Mapping[str, Sequence[str]] = {
            "--help": ("--help",),
            "solve": ("solve", "--case", "4ws-2", "-o", str(self.scratch / "map.npz")),
            "solve, codegen init": ("solve", "--config", car, "--case", "4ws-2", "-o", str(self.scratch / "car.npz")),
            "report": ("report", *of_map, "-o", str(self.scratch / "report.html")),
            "sil, new build": ("sil", "--build", str(build)),
            "verify --quick": ("verify", "--quick", str(build)),
            "tune": ("tune", "--map", str(generated / "4ws2.npz"), "-o", str(self.scratch / "tuned.npz")),
            "check": ("check", str(generated / "4ws2.npz")),
            "build": ("build", "--map", str(generated / "4ws2.npz"), "-o", str(self.scratch / "built")),
        }
        works: dict[str, Callable[[], object]] = {name: partial(self._run, words) for name, words in commands.items()}
        works["sil, new build"] = partial(self._run_uncompiled, commands["sil, new build"])
        return works

    def _run(self, words: Sequence[str], cache: Path | None = None) -> None:
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        environment |= {"PYTHONPATH": str(self.root), "PYTHONPYCACHEPREFIX": str(self.scratch / "bytecode")}
        environment["ARS_CACHE"] = str(cache or self.scratch / "cache")
        command = [sys.executable, "-m", "codegen", *words]
        done = subprocess.run(command, cwd=self.root, env=environment, capture_output=True, text=True, check=False)
        if done.returncode and (words[0], done.returncode) != VERDICT:
            raise CodegenError(f"exit code {done.returncode}: {done.stderr.strip()}", where=f"codegen {' '.join(words)}")

    def _run_uncompiled(self, words: Sequence[str]) -> None:
        """Run with the templates cached and no compiled library, as after the first build on a machine."""
        with tempfile.TemporaryDirectory(dir=self.scratch) as folder:
            for templates in (self.scratch / "cache").glob("templates-*"):
                shutil.copytree(templates, Path(folder, templates.name))
            self._run(words, Path(folder))


def run(quick: bool, say: Callable[[str], None]) -> CountReport:
    """Time the commands of both trees in turns.

    Raises:
        CodegenError: a command fails, or git does not know the revision.
    """
    revision = os.environ.get(REVISION)
    with tempfile.TemporaryDirectory(prefix="ars-response-") as name, _checked_out(revision, Path(name)) as earlier:
        roots = {"this tree": ROOT, **({"earlier": earlier} if earlier else {})}
        trees = {label: Tree(root, Path(name, label.replace(" ", "-"))) for label, root in roots.items()}
        for tree in trees.values():
            tree.scratch.mkdir()
        works = {label: tree.works() for label, tree in trees.items()}
        repeats = QUICK_REPEATS if quick else REPEATS
        tables = []
        for title, targets, clock in (
            ("Response times", TARGETS_S, time.perf_counter),
            ("Processor time, of all threads and processes", CPU_TARGETS_S, _processor_time),
        ):
            rows = []
            for command, target in targets.items():
                say(command)
                times = interleaved({label: each[command] for label, each in works.items()}, repeats, clock)
                limit = "-" if target is None else f"{target:g} s"
                rows.append(Row((command, *(_shown(times.get(label)) for label in HEADER[1:3]), limit)))
            tables.append((title, HEADER, tuple(rows)))
    compared = f"Earlier: {revision}." if revision else f"Set {REVISION} to a git revision to compare with an earlier release."
    notes = (compared, "Best (median) of whole processes. The targets of response times hold for two idle cores.")
    return CountReport(tuple(tables), notes)


def _processor_time() -> float:
    """Return the processor time in s of all processes that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def _shown(times: Times | None) -> str:
    return "-" if times is None else f"{min(times.seconds):.2f} s ({times.median:.2f} s)"


@contextmanager
def _checked_out(revision: str | None, scratch: Path) -> Iterator[Path | None]:
    """Yield a temporary worktree of a revision; None without a revision."""
    if revision is None:
        yield None
        return
    tree = scratch / "worktree"
    _git("worktree", "add", "--detach", str(tree), revision)
    try:
        yield tree
    finally:
        _git("worktree", "remove", "--force", str(tree))


def _git(*words: str) -> None:
    done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CodegenError(done.stderr.strip(), where=f"git {' '.join(words)}", remedy=f"check {REVISION}")
