"""Many closed loops at once against the single run, plant and controller in C in both.

Each batch drives cars that differ, for the time of a vector is that of its slowest lane; the single run drives the car in the
middle of them. One core, processor time.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.closed_loop import DURATION, slalom, step_steer
from benchmarks.timing import Comparison, Report, Times, interleaved
from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.sil.batch import BatchSoftware, Lanes, load_batch
from codegen.sil.closed_loop import ClosedLoop
from codegen.sil.compile import DEFAULT_FLAGS
from codegen.sil.software import load
from codegen.sil.vector import ISAS, VECTOR_FLAGS, Isa, compiler_offers, machine_runs
from codegen.vehicle.plant_car import plant_parameters

REQUIRED: dict[Isa, float | None] = {"x86-64-v4": 5000.0, "x86-64-v3": 2500.0, "none": None}
"""Required multiple of real time on one core, for the whole loop with the PI controller."""

NAMES: dict[Isa, str] = {"x86-64-v4": "AVX-512", "x86-64-v3": "AVX2", "none": "no vectors"}
GENERATED = Path(__file__).resolve().parents[1] / "generated"
BUILDS = {"PI": GENERATED / "4ws2-paper", "tracking": GENERATED / "4ws2"}
RUNS = 256
REPEATS, QUICK_REPEATS = 15, 5


@dataclass(frozen=True)
class _Bench:
    """One controller: the single run, and the batch at each level that is to be had here."""

    single: ClosedLoop
    batches: Mapping[Isa, BatchSoftware]
    lanes: Lanes

    @classmethod
    def compile(cls, build: Path) -> _Bench:
        """Compile all of them."""
        levels = [isa for isa in ISAS if machine_runs(isa) and compiler_offers(isa)]
        software = load(build)
        batches = {isa: load_batch(build, isa) for isa in levels}
        return cls(ClosedLoop(software), batches, _lanes(software.config))

    def single_run(self, inputs: FloatArray) -> None:
        """Run once from rest."""
        self.single.reset()
        self.single.run(inputs)

    def works(self, inputs: FloatArray) -> dict[str, Callable[[], object]]:
        """Return the timed functions by name."""
        works: dict[str, Callable[[], object]] = {"single run": lambda: self.single_run(inputs)}
        for isa, batch in self.batches.items():
            works[NAMES[isa]] = partial(batch.run, inputs, self.lanes)
        return works


def _lanes(config: Config) -> Lanes:
    """Draw cars with up to 10 % deviation of mass, inertia and stiffness, friction 0.7 to 1, and a delay of up to two
    samples."""
    generator = np.random.default_rng(1)
    data = config.model_dump()
    cars = []
    for _ in range(RUNS):
        car = copy.deepcopy(data)
        for key in ("mass_kg", "yaw_inertia_kg_m2"):
            car["vehicle"][key] *= generator.uniform(0.9, 1.1)
        for axle in ("front", "rear"):
            car["tyre"][axle]["cornering_stiffness_n_per_rad"] *= generator.uniform(0.9, 1.1)
        cars.append(plant_parameters(Config.model_validate(car)))
    return Lanes(np.array(cars), friction=generator.uniform(0.7, 1.0, RUNS), delay_samples=generator.integers(0, 3, RUNS))


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Measure all of them in turns, for the PI and the tracking controller."""
    comparisons, notes = [], []
    for controller, build in BUILDS.items():
        say(f"compiling the batch, {controller}")
        bench = _Bench.compile(build)
        for name, inputs in {"step steer": step_steer(DURATION, DURATION * 2.0 / 3.0), "slalom": slalom(DURATION)}.items():
            say(f"batch, {controller}, {name}")
            lines, figures = _manoeuvre(bench, f"{controller}, {name}", inputs, QUICK_REPEATS if quick else REPEATS)
            comparisons += lines
            notes.append(figures)
    notes.append(f"single run and all controllers: {' '.join(DEFAULT_FLAGS)}")
    notes.append(f"plants of the batch, for AVX-512, also: {' '.join(VECTOR_FLAGS['x86-64-v4'])}")
    title = f"{RUNS} closed loops at once, {DURATION:g} s of driving each: time of one run, all columns recorded"
    return Report(title, tuple(comparisons), tuple(notes))


def _manoeuvre(bench: _Bench, name: str, inputs: FloatArray, repeats: int) -> tuple[list[Comparison], str]:
    times = interleaved(bench.works(inputs), repeats, time.process_time)
    single = times["single run"]
    lines, figures = [], [f"single run {DURATION / single.median:,.0f}"]
    for isa in bench.batches:
        each = times[NAMES[isa]].each(RUNS)
        times_real = DURATION / each.median
        figures.append(f"{NAMES[isa]} {times_real:,.0f}")
        lines.append(Comparison(f"{name}, {NAMES[isa]}", single, each, _required(isa, name, single)))
    return lines, f"{name}, times real time on one core: {', '.join(figures)}"


def _required(isa: Isa, name: str, single: Times) -> float | None:
    """Return the speed-up over the single run with which a batch reaches its required multiple of real time."""
    wanted = REQUIRED[isa]
    return None if wanted is None or not name.startswith("PI") else wanted * single.median / DURATION
