"""A campaign: two cores against one, Dask beside threads, and how time and memory grow with the runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.timing import Comparison, Report, Times
from codegen.errors import BuildError

ROOT = Path(__file__).resolve().parents[1]
REQUIRED_TWO = 1.9
CORES = 2
RUNS, QUICK_RUNS = 20_000, 4_000
"""Of the comparison of engines: so many that starting and compiling, which are left out, would not count anyway."""
GROWTH, QUICK_GROWTH = (1_000, 10_000, 100_000, 1_000_000), (1_000, 10_000)
REPEATS, QUICK_REPEATS = 5, 3

SPEC = """
samples = {samples}
seed = 1
scenarios = ["step-steer"]
lead_s = 0.1
length_s = 3.0

[controllers]
pi = "{root}/generated/4ws2"

[factors]
mass_percent = {{ uniform = [-15, 25] }}
friction = {{ uniform = [0.5, 1.0] }}
speed_km_h = {{ uniform = [40, 110] }}
rear_stiffness_percent = {{ normal = [0, 10], within = [-25, 25] }}
"""

CHILD = """
import json, os, resource, sys, tempfile, time
from pathlib import Path
spec, kind, workers = sys.argv[1], sys.argv[2], int(sys.argv[3])
# One core means one: without this the thread that writes the file would have the other to itself.
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:workers])
from codegen.sweep.plan import read
from codegen.sweep.campaign import run_campaign
from codegen.sweep.chunk import Work, software
from codegen.sweep.engine import Dask, Threads
from codegen.sweep.store import to_arrow
from codegen.sweep.summary import summarise

def warm_up(plan, engine, workers):
    # Workers compile, and what writes the file is loaded, before the clock runs.
    for _, table in engine.run(Work(plan), range(min(2 * workers, plan.chunk_count))):
        to_arrow(table, plan)

def drive(plan, folder, kind, workers):
    if kind == "threads":
        warm_up(plan, Threads(workers), workers)
        start = time.perf_counter()
        path = run_campaign(plan, folder, Threads(workers))
        return path, time.perf_counter() - start
    from distributed import LocalCluster
    with LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        engine = Dask(cluster.scheduler_address)
        warm_up(plan, engine, workers)
        start = time.perf_counter()
        path = run_campaign(plan, folder, engine)
        seconds = time.perf_counter() - start
        engine.close()
    return path, seconds

if __name__ == "__main__":
    plan = read(Path(spec))
    software(plan, plan.controllers[0])
    with tempfile.TemporaryDirectory() as scratch:
        path, seconds = drive(plan, Path(scratch, "out"), kind, workers)
        start = time.perf_counter()
        summarise(path, plan)
        counted = time.perf_counter() - start
        size = path.stat().st_size
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(json.dumps({"seconds": seconds, "counted": counted, "memory_mb": memory, "bytes": size}))
"""


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Each campaign in a process of its own, in turns; compiled before the clock runs."""
    with tempfile.TemporaryDirectory() as scratch:
        return _report(Path(scratch), quick, say)


def _report(scratch: Path, quick: bool, say: Callable[[str], None]) -> Report:
    runs = QUICK_RUNS if quick else RUNS
    kinds = {"1 core": ("threads", 1), "2 cores": ("threads", 2), "Dask, 2 workers": ("dask", 2)}
    seconds: dict[str, list[float]] = {name: [] for name in kinds}
    for turn in range(QUICK_REPEATS if quick else REPEATS):
        for name, (kind, workers) in kinds.items():
            say(f"campaign of {runs} runs, {name}, {turn + 1}")
            seconds[name].append(_child(scratch, runs, kind, workers)["seconds"])
    times = {name: Times(name, tuple(values)) for name, values in seconds.items()}
    comparisons = [
        Comparison("2 cores against 1", times["1 core"], times["2 cores"], REQUIRED_TWO),
        Comparison("Dask beside threads", times["2 cores"], times["Dask, 2 workers"]),
    ]
    notes = [
        f"{runs:,} runs of 3.1 s, PI controller, figures and Parquet included; compiling and starting not.",
        "a thread for each core; the process may use no other.",
    ]
    for count in QUICK_GROWTH if quick else GROWTH:
        say(f"campaign of {count} runs")
        found = _child(scratch, count, "threads", CORES)
        each = 1e3 * found["seconds"] / count
        notes.append(
            f"{count:>9,} runs: {found['seconds']:.1f} s, {each:.2f} ms a run; summary {found['counted']:.1f} s; "
            f"largest memory of the process {found['memory_mb']:.0f} MB; file {found['bytes'] / 1e6:.1f} MB"
        )
    return Report(f"Campaigns, {CORES} of {os.cpu_count()} cores", tuple(comparisons), tuple(notes))


def _child(scratch: Path, samples: int, kind: str, workers: int) -> dict[str, float]:
    spec, script = scratch / "sweep.toml", scratch / "child.py"
    spec.write_text(SPEC.format(samples=samples, root=ROOT), encoding="utf-8")
    script.write_text(CHILD, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(script), str(spec), kind, str(workers)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise BuildError(f"a campaign of {samples} runs ended with {done.returncode}: {done.stderr.strip().splitlines()[-1]}")
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found
