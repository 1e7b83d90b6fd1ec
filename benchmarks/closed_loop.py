"""The closed loop in C, plant made by CasADi, against the same equations written by hand.

Both are compiled into one library, with the same compiler and flags, and call the same generated controller.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.paper_build import CONFIG, paper_folder
from benchmarks.timing import Comparison, Report, interleaved
from codegen.arrays import FloatArray
from codegen.sil.closed_loop import INPUT_COLUMNS, ClosedLoop
from codegen.sil.compile import DEFAULT_FLAGS, compile_library
from codegen.sil.software import RECORD_COLUMNS, Software, bench_sources

Run = tuple[FloatArray, Any]
"""Record (n, 12), columns RECORD_COLUMNS, and the C struct of the plant's last state, fields PLANT_STATES."""

REQUIRED = 0.8
REPEATS, QUICK_REPEATS = 60, 15
DURATION = 15.0
PEER = Path(__file__).parent / "peer"
YAW_RATE = RECORD_COLUMNS.index("yaw_rate_rad_s")


@dataclass(frozen=True)
class Loops:
    """Both loops in one library."""

    software: Software

    @classmethod
    def compile(cls) -> Loops:
        """Compile generated and hand-written C together."""
        folder = paper_folder()
        sources = {path: content for path, content in folder.files.items() if path.startswith(("include/", "src/"))}
        sources |= bench_sources(CONFIG, "ars", "single")
        sources |= {f"peer/{path.name}": path.read_bytes() for path in sorted(PEER.glob("hand_loop.[ch]"))}
        headers = [f"include/ars_{name}.h" for name in ("map", "controller", "dynamics", "e2e", "can", "task")]
        headers += ["bench/plant.h", "bench/loop.h", "peer/hand_loop.h"]
        library = compile_library("ars_peer", sources, headers, include_folders=("include", "bench", "peer"))
        return cls(Software(library, "ars", "single", CONFIG))

    def generated(self, inputs: FloatArray) -> Run:
        """Run the project's loop from zero; inputs (10 n, 7), columns INPUT_COLUMNS."""
        self._loop.reset()
        record = self._loop.run(inputs)
        return record, self._loop.state.plant

    @functools.cached_property
    def _loop(self) -> ClosedLoop:
        return ClosedLoop(self.software)

    def by_hand(self, inputs: FloatArray) -> Run:
        """Run the hand-written loop, likewise."""
        ffi, lib = self.software.ffi, self.software.compiled.lib
        inputs = np.ascontiguousarray(inputs, dtype=np.float64)
        record = np.empty((inputs.shape[0] // lib.HAND_STEPS_PER_SAMPLE, len(RECORD_COLUMNS)))
        state = ffi.new("hand_state_t *")
        lib.hand_run(
            state,
            record.shape[0],
            ffi.cast("hand_input_t *", ffi.from_buffer(inputs)),
            ffi.cast("hand_record_t *", ffi.from_buffer(record, require_writable=True)),
        )
        return record, state


def step_steer(duration: float, steer_time: float) -> FloatArray:
    """Return the inputs of the paper's manoeuvre, a row each millisecond: 42.5 km/h, the steering wheel to 90 deg at
    `steer_time` (s)."""
    return _inputs(duration, lambda time: math.radians(90.0) * (time >= steer_time).astype(np.float64))


def slalom(duration: float) -> FloatArray:
    """Return inputs with the steering wheel moving by 60 deg to and fro every 2 s, so that no state rests."""
    return _inputs(duration, lambda time: np.radians(60.0 * np.sin(math.pi * time)))


def _inputs(duration: float, wheel_angle: Callable[[FloatArray], FloatArray]) -> FloatArray:
    time = np.arange(round(duration / CONFIG.plant.sampling_time_s), dtype=np.float64) * CONFIG.plant.sampling_time_s
    inputs = np.zeros((time.size, len(INPUT_COLUMNS)))
    inputs[:, INPUT_COLUMNS.index("speed")] = 42.5 / 3.6
    inputs[:, INPUT_COLUMNS.index("steering_wheel_command")] = wheel_angle(time)
    inputs[:, INPUT_COLUMNS.index("friction")] = CONFIG.road.friction
    inputs[:, INPUT_COLUMNS.index("friction_estimate")] = math.nan
    return inputs


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Measure both loops in turns."""
    say("compiling both closed loops")
    loops = Loops.compile()
    comparisons, notes = [], []
    manoeuvres = {"step steer": step_steer(DURATION, DURATION * 2.0 / 3.0), "slalom": slalom(DURATION)}
    for name, inputs in manoeuvres.items():
        say(f"closed loop, {name}")
        comparison, note = _manoeuvre(loops, name, inputs, QUICK_REPEATS if quick else REPEATS)
        comparisons.append(comparison)
        notes.append(note)
    notes.append(f"same compiler, flags and library: {' '.join(DEFAULT_FLAGS)}")
    title = f"Closed loop in C, {DURATION:g} s of driving: two-track plant, RK4 at 1 ms, controller at 10 ms"
    return Report(title, tuple(comparisons), tuple(notes))


def _manoeuvre(loops: Loops, name: str, inputs: FloatArray, repeats: int) -> tuple[Comparison, str]:
    times = interleaved({"by hand": lambda: loops.by_hand(inputs), "generated": lambda: loops.generated(inputs)}, repeats)
    difference = np.abs(loops.generated(inputs)[0] - loops.by_hand(inputs)[0])[:, YAW_RATE].max()
    real_time = DURATION / times["generated"].median
    note = f"{name}: {real_time:,.0f} times real time; yaw rates differ by at most {difference:.1e} rad/s"
    return Comparison(name, times["by hand"], times["generated"], REQUIRED), note
