"""The generated lookup, against what one would use in Python."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from benchmarks.paper_build import CONFIG, paper_folder, paper_map
from benchmarks.timing import Comparison, Report, interleaved
from codegen.ecu_map.extend import extend
from codegen.ecu_map.lookup import Lookup
from codegen.sil.software import compile_build

POINTS, QUICK_POINTS = 1_000_000, 100_000
REPEATS = 9


def run(quick: bool, say: Callable[[str], None]) -> Report:
    """Look random points of the whole table up, all at once."""
    say("looking points up")
    folder = paper_folder()
    software = compile_build(folder.files, folder.manifest)
    total = extend(paper_map(), CONFIG)
    count = QUICK_POINTS if quick else POINTS
    generator = np.random.default_rng(0)
    speed = generator.uniform(0.0, total.speed[-1], count).astype(np.float32)
    front_angle = generator.uniform(0.0, total.front_angle[-1], count).astype(np.float32)
    friction, acceleration = np.full(count, np.nan, dtype=np.float32), np.zeros(count, dtype=np.float32)
    result = np.empty(count, dtype=np.float32)
    ffi, lib = software.ffi, software.compiled.lib
    buffers = [ffi.cast("float *", ffi.from_buffer(array)) for array in (speed, front_angle, friction, acceleration, result)]
    reference = Lookup.from_map(total)
    interpolator = RegularGridInterpolator((total.speed, total.front_angle), total.yaw_rate)
    points = np.column_stack([speed, front_angle]).astype(np.float64)

    works: dict[str, Callable[[], object]] = {
        "SciPy": lambda: interpolator(points),
        "NumPy": lambda: reference(speed, front_angle),
        "C": lambda: lib.loop_map(*buffers, count),
        "C from Python": lambda: software.map_yaw_rate(speed, front_angle),
    }
    times = {name: taken.each(count) for name, taken in interleaved(works, REPEATS).items()}
    ours = {"one point, loop in C": "C", "one point, arrays from Python": "C from Python"}
    comparisons = [Comparison(what, times[peer], times[own]) for what, own in ours.items() for peer in ("SciPy", "NumPy")]
    same = bool(np.array_equal(result.view(np.uint32), reference(speed, front_angle).view(np.uint32)))
    notes = (
        "SciPy: RegularGridInterpolator in float64, which interpolates and no more.",
        "NumPy: the reference in float32; like the C it also cleans its input and caps the lateral acceleration.",
        f"C and NumPy gave {'the same bits' if same else 'DIFFERENT BITS'} in all points.",
    )
    title = f"Lookup, {count:,} random points over the whole table, {total.speed.size} x {total.front_angle.size}"
    return Report(title, tuple(comparisons), notes)
