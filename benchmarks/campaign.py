"""Time a campaign: two cores and one, Dask and threads, and the growth of time and memory with the number of runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.timing import Comparison, Report, Times
from codegen.errors import BuildError
from codegen.sweep import store

ROOT = Path(__file__).resolve().parents[1]
REQUIRED_TWO = 1.9
CORES = 2
RUNS, QUICK_RUNS = 61_440, 4_096
"""Runs in the comparison of engines: whole chunks (of 512), as many for each core, and so many that the last chunk, when
one core idles, is about a hundredth."""
GROWTH, QUICK_GROWTH = (1_000, 10_000, 100_000, 1_000_000), (1_000, 10_000)
REPEATS, QUICK_REPEATS = 7, 3

SPEC = """
samples = {samples}
seed = 1
scenarios = ["step-steer"]
lead_s = 0.1
length_s = 3.0

[controllers]
pi = "{root}/generated/4ws2-paper"

[factors]
mass_percent = {{ uniform = [-15, 25] }}
friction = {{ uniform = [0.5, 1.0] }}
speed_km_h = {{ uniform = [40, 110] }}
rear_stiffness_percent = {{ normal = [0, 10], within = [-25, 25] }}
"""

CHILD = """
import json, os, sys, tempfile, time
from pathlib import Path
spec, kind, first, workers = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
# One core means one: without this the thread that writes the file would have the other to itself.
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[first : first + workers])
from codegen.sweep.plan import read
from codegen.sweep.engine import run_campaign
from codegen.sweep.chunk import Work, software
from codegen.sweep.engine import Dask, Threads
from codegen.sweep.store import to_arrow

def warm_up(plan, engine, workers):
    # Workers compile, and what writes the file is loaded, before the clock runs.
    for _, table in engine.run(Work(plan), range(min(2 * workers, plan.chunk_count))):
        to_arrow(table, plan)

def drive(plan, folder, kind, workers):
    if kind == "threads":
        warm_up(plan, Threads(workers), workers)
        start = time.perf_counter()
        run_campaign(plan, folder, Threads(workers))
        return time.perf_counter() - start
    from distributed import LocalCluster
    with LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        engine = Dask(cluster.scheduler_address)
        warm_up(plan, engine, workers)
        start = time.perf_counter()
        run_campaign(plan, folder, engine)
        seconds = time.perf_counter() - start
        engine.close()
    return seconds

if __name__ == "__main__":
    plan = read(Path(spec))
    software(plan, plan.controllers[0])
    with tempfile.TemporaryDirectory() as scratch:
        seconds = drive(plan, Path(scratch, "out"), kind, workers)
    print(json.dumps({"seconds": seconds}))
"""

COMMAND = """
import os, sys
from pathlib import Path
cores = int(sys.argv.pop(1))
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
from codegen.cli.entry import main
try:
    main()
finally:
    # Not getrusage, which includes the parent's memory at the start of this process.
    status = Path("/proc/self/status").read_text(encoding="ascii")
    sys.stdout.write(next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM")) + "\\n")
"""
"""`codegen sweep`, whose last line is the most memory that it had, in KiB."""


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Time each campaign in a process of its own, in turns; compile before."""
    with tempfile.TemporaryDirectory() as scratch:
        return _report(Path(scratch), quick, say)


def _report(scratch: Path, quick: bool, say: Callable[[str], None]) -> Report:
    runs = QUICK_RUNS if quick else RUNS
    spec, half = _spec(scratch, runs), _spec(scratch, runs // CORES)
    kinds = {
        "1 core": [(spec, "threads", 0, 1)],
        "2 cores": [(spec, "threads", 0, CORES)],
        "2 processes": [(half, "threads", core, 1) for core in range(CORES)],
        "Dask, 2 workers": [(spec, "dask", 0, CORES)],
    }
    seconds: dict[str, list[float]] = {name: [] for name in kinds}
    for turn in range(QUICK_REPEATS if quick else REPEATS):
        for name, campaigns in kinds.items():
            say(f"campaign of {runs} runs, {name}, {turn + 1}")
            seconds[name].append(_together(scratch, campaigns))
    times = {name: Times(name, tuple(values)) for name, values in seconds.items()}
    comparisons = [
        Comparison("2 cores against 1", times["1 core"], times["2 cores"], REQUIRED_TWO),
        Comparison("2 processes against 1 core", times["1 core"], times["2 processes"]),
        Comparison("Dask beside threads", times["2 cores"], times["Dask, 2 workers"]),
    ]
    notes = [
        f"{runs:,} runs of 3.1 s, PI controller, figures and Parquet included; compiling and starting not.",
        "2 cores: a thread for each, in one process, which may use no other.",
        "2 processes: half of the runs each, on a core of its own: what two cores of this machine are worth.",
    ]
    notes.append(f"`codegen sweep --workers {CORES}`, from its start, compiling included, to its last picture:")
    for count in QUICK_GROWTH if quick else GROWTH:
        say(f"codegen sweep of {count} runs")
        start = time.perf_counter()
        memory, size = _command(scratch, count)
        took = time.perf_counter() - start
        notes.append(f"{count:>9,} runs: {took:.1f} s; largest memory of the process {memory:.0f} MB; file {size / 1e6:.1f} MB")
    return Report(f"Campaigns, {CORES} of {os.cpu_count()} cores", tuple(comparisons), tuple(notes))


def _together(scratch: Path, campaigns: Sequence[tuple[Path, str, int, int]]) -> float:
    """Return the time in s of the slowest of several campaigns (spec, engine, first core, cores) started at once."""
    with ThreadPoolExecutor(len(campaigns)) as pool:
        printed = pool.map(lambda campaign: _python(scratch, CHILD, *map(str, campaign)), campaigns)
        return max(float(json.loads(text.splitlines()[-1])["seconds"]) for text in printed)


def _command(scratch: Path, samples: int) -> tuple[float, int]:
    """Return the largest memory of the command in MB (2^20 bytes) and the size of the campaign's file in bytes."""
    with tempfile.TemporaryDirectory(dir=scratch) as folder:
        arguments = ("sweep", "--spec", str(_spec(scratch, samples)), "-o", folder, "--workers", str(CORES))
        done = _python(scratch, COMMAND, str(CORES), *arguments)
        return int(done.splitlines()[-1]) / 1024.0, Path(folder, store.RUNS_FILE).stat().st_size


def _spec(scratch: Path, samples: int) -> Path:
    spec = scratch / f"sweep-{samples}.toml"
    spec.write_text(SPEC.format(samples=samples, root=ROOT), encoding="utf-8")
    return spec


def _python(scratch: Path, program: str, *arguments: str) -> str:
    """Run a program with this package and return its output. Raises BuildError if it fails."""
    script = scratch / f"{uuid.uuid4().hex}.py"
    script.write_text(program, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(script), *arguments], env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise BuildError(f"a campaign ended with {done.returncode}: {done.stderr.strip().splitlines()[-1]}")
    return done.stdout
