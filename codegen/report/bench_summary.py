"""Events on the bus during a run, as rows of text and as plain data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.sil.software import RECORD_COLUMNS, Status

if TYPE_CHECKING:
    from hil_sim.bench import BenchResult


def bus_facts(result: BenchResult, sampling_time: float) -> dict[str, Any]:
    """Return counts and times of a run, for JSON. Times are in ms, None in simulated time."""
    answered = result.response[np.isfinite(result.response)]
    times = None
    if answered.size:
        times = {f"response_{name}_ms": 1e3 * float(np.percentile(answered, share)) for name, share in _SHARES.items()}
        times["cycle_start_late_max_ms"] = 1e3 * float(result.lateness.max())
    cycles = len(result.record)
    return {
        "cycles": cycles,
        "simulated_s": cycles * sampling_time,
        "wall_s": result.wall_time,
        **result.received,
        "late_cycles": result.late_cycles,
        "send_errors": result.send_errors,
        "times": times,
        "cycles_in_status": status_counts(result),
        "cycles_with_diagnostics": diagnostics_counts(result),
    }


_SHARES = {"median": 50.0, "99_percent": 99.0, "max": 100.0}


def status_counts(result: BenchResult) -> dict[str, int]:
    """Return the number of cycles in each status that occurred."""
    column = result.record[:, RECORD_COLUMNS.index("status")]
    return {status.name: int(count) for status in Status if (count := np.count_nonzero(column == status))}


def diagnostics_counts(result: BenchResult) -> dict[str, int]:
    """Return the number of cycles in which each bit of `Diagnostics` was set; bits that never were are omitted."""
    from hil_sim.codec import DIAGNOSTICS

    bits = {name: 1 << bit for bit, (name, _) in DIAGNOSTICS.items()}
    return {name: int(count) for name, mask in bits.items() if (count := np.count_nonzero(result.diagnostics & mask))}


def bus_lines(result: BenchResult, sampling_time: float) -> list[str]:
    """Return a few lines for the console."""
    facts = bus_facts(result, sampling_time)
    speed = facts["simulated_s"] / facts["wall_s"] if facts["wall_s"] > 0.0 else 0.0
    lines = [
        f"bus: {facts['cycles']} cycles, {facts['simulated_s']:g} s in {facts['wall_s']:.2f} s ({speed:.1f} x real time), "
        f"{facts['late_cycles']} of them late",
        f"commands: {facts['commands']}, {facts['lost']} gaps in their counter, {facts['refused']} refused, "
        f"{facts['cycles_without']} cycles without one",
    ]
    if facts["times"]:
        times = facts["times"]
        lines += [
            f"command after the sample: {times['response_median_ms']:.2f} ms (median), "
            f"{times['response_99_percent_ms']:.2f} ms (99 %), {times['response_max_ms']:.2f} ms (largest)",
            f"cycles began up to {times['cycle_start_late_max_ms']:.2f} ms after their deadline",
        ]
    lines.append("status: " + ", ".join(f"{name} {count} cycles" for name, count in facts["cycles_in_status"].items()))
    seen = facts["cycles_with_diagnostics"]
    lines.append("diagnostics: " + (", ".join(f"{name} {count}" for name, count in seen.items()) or "none"))
    if facts["send_errors"]:
        lines.append(f"{facts['send_errors']} frames were rejected by the interface")
    return lines
