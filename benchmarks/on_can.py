"""The bench on a real vcan0: how much faster than real time in lock-step, and how punctual by the clock.

Needs an interface called vcan0: `make bench-can` brings one along where the system has none.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import numpy.typing as npt

from benchmarks.paper_build import CONFIG, paper_folder
from benchmarks.timing import Comparison, Report, Times, once
from codegen.emit.write import write_folder
from codegen.errors import CodegenError
from hil_sim.bench import BenchResult
from hil_sim.bus import Bus, BusAddress
from hil_sim.scenario_files import find
from hil_sim.session import EcuKind, Setup, run_hil

ADDRESS = BusAddress("socketcan", "vcan0")
REQUIRED = 5.0
REPEATS, QUICK_REPEATS = 5, 2
DURATION, QUICK_DURATION = 60.0, 10.0
"""s of real time."""

EDGES_MS = (0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Bounds of the histogram of how late cycles begin, and of how far answers are from their median."""
BAR = 40


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Measure on vcan0. Raises CodegenError where there is none."""
    Bus(ADDRESS).close()
    with tempfile.TemporaryDirectory(prefix="ars-bench-") as scratch:
        build = Path(scratch) / "4ws2"
        write_folder(paper_folder(), build)
        comparisons = [_lock_step(build, kind, QUICK_REPEATS if quick else REPEATS, say) for kind in _KINDS]
        duration = QUICK_DURATION if quick else DURATION
        say(f"real time, {duration:g} s")
        scenario = replace(find("step-steer"), duration=duration)
        ran = run_hil(Setup(CONFIG, scenario, ADDRESS), build, "native")
    notes = [*_punctuality(ran.result), f"ECU: {ran.ecu_counters}"]
    return Report(
        "Bench on vcan0: the paper's run of 15 s in lock-step against the clock; native ECU", tuple(comparisons), tuple(notes)
    )


_KINDS: tuple[EcuKind, ...] = ("native", "cffi")


def _lock_step(build: Path, kind: EcuKind, repeats: int, say: Callable[[str], None]) -> Comparison:
    scenario = find("step-steer")
    walls = []
    for number in range(repeats):
        say(f"lock-step, {kind} ECU, {number + 1} of {repeats}")
        seconds = [0.0]

        def work(seconds: list[float] = seconds) -> None:
            seconds[0] = run_hil(Setup(CONFIG, scenario, ADDRESS, lock_step=True), build, kind).result.wall_time

        once(work)
        walls.append(seconds[0])
    real_time = Times("real time", (scenario.duration,))
    # The cffi ECU is for comparison; the requirement is for the native one.
    return Comparison(
        f"lock-step, {kind} ECU", real_time, Times("bench", tuple(walls)), REQUIRED if kind == "native" else None, paired=False
    )


def _punctuality(result: BenchResult) -> list[str]:
    cycles = len(result.record)
    inside = int(np.isfinite(result.response).sum())
    answered = result.response[np.isfinite(result.response)]
    if not answered.size:
        raise CodegenError("no command came within its own cycle", where=str(ADDRESS), remedy="try on a machine with less load")
    median = float(np.median(answered))
    return [
        f"real time: {cycles} cycles, {inside} commands inside their own cycle ({100.0 * inside / cycles:.2f} %), "
        f"{result.received['lost']} gaps in their counter, {result.late_cycles} late cycles; "
        f"command {1e3 * median:.2f} ms after the sample (median)",
        *_histogram("cycles that began late by", result.lateness),
        *_histogram("commands away from their median by", np.abs(answered - median)),
    ]


def _histogram(title: str, values: npt.NDArray[np.float64]) -> list[str]:
    counts, _ = np.histogram(1e3 * values, (*EDGES_MS, np.inf))
    bounds = [
        *(f"{low:g} to {high:g} ms" for low, high in pairwise(EDGES_MS)),
        f"over {EDGES_MS[-1]:g} ms",
    ]
    width = max(counts.max(), 1)
    return [
        f"{title}:",
        *(f"  {bound:>14} {count:6d} {'#' * round(BAR * count / width)}" for bound, count in zip(bounds, counts, strict=True)),
    ]
