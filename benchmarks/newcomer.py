"""A newcomer's first command: `make sil` in a fresh clone with an empty environment, by pip and by uv."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.timing import Comparison, Report, Times
from codegen.errors import CodegenError

ROOT = Path(__file__).resolve().parents[1]
LIMITS_S = {"pip": 40.0, "uv": 25.0}
"""Longest wall time of `make sil` on two idle cores, by installer, in s."""


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Download the packages, then time `make sil` in a fresh clone, once for each installer.

    Raises:
        CodegenError: no package index, no git, or a command that fails.
    """
    del quick
    comparisons, notes = [], ["the packages are downloaded before; no other file of the user is used, and no cache"]
    with tempfile.TemporaryDirectory(prefix="ars-newcomer-") as scratch:
        packages = Path(scratch, "packages")
        say("downloading the packages of requirements-run.lock, which does not count")
        lock = ("--require-hashes", "-r", str(ROOT / "requirements-run.lock"))
        _done([sys.executable, "-m", "pip", "download", "-q", "--no-deps", *lock, "-d", str(packages)])
        for installer, limit in LIMITS_S.items():
            program = shutil.which("uv") if installer == "uv" else ""
            if program is None:
                notes.append("uv is not installed")
                continue
            say(f"make sil, by {installer}")
            wall, cpu, installed = _make_sil(Path(scratch, installer), packages, program)
            peer = Times("at most", (limit,))
            comparisons.append(Comparison(f"by {installer}", peer, Times("make sil", (wall,)), required=1.0, paired=False))
            notes.append(f"by {installer}: {cpu:.1f} CPU-s; {installed:.1f} s until everything is installed")
    return Report("`make sil` in a fresh clone, wall time", tuple(comparisons), tuple(notes))


def _make_sil(folder: Path, packages: Path, uv: str) -> tuple[float, float, float]:
    """Return the wall time, the CPU time and the time until the end of the installation of one `make sil`, in s."""
    checkout, home = folder / "checkout", folder / "home"
    home.mkdir(parents=True)
    _done(["git", "clone", "-q", str(ROOT), str(checkout)])
    offline = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": packages.as_uri(), "PIP_CONFIG_FILE": os.devnull}
    offline |= {"UV_OFFLINE": "1", "UV_FIND_LINKS": str(packages), "UV_NO_CONFIG": "1"}
    environment = {"PATH": os.environ["PATH"], "HOME": str(home), **offline}
    before, begun, start = _cpu_time(), time.time(), time.perf_counter()
    _done(["make", "sil", f"PYTHON={sys.executable}", f"UV={uv}"], cwd=checkout, environment=environment)
    wall, cpu = time.perf_counter() - start, _cpu_time() - before
    if not (checkout / "build" / "report.html").is_file():
        raise CodegenError("no report came out", where="make sil", remedy="see what it prints")
    return wall, cpu, (checkout / ".venv" / ".run").stat().st_mtime - begun


def _cpu_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _done(words: list[str], cwd: Path | None = None, environment: dict[str, str] | None = None) -> None:
    try:
        result = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    except OSError as error:
        raise CodegenError(f"cannot be run ({error.strerror})", where=words[0], remedy="install it") from None
    if result.returncode:
        said = (result.stderr.strip() or result.stdout.strip() or "nothing was said").splitlines()[-1]
        raise CodegenError(f"exit code {result.returncode}: {said}", where=" ".join(words[:4]), remedy="run it by hand")
