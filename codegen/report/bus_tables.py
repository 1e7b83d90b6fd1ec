"""Events on the bus during a run, and outcomes of injected faults, as rows of text and as plain data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from codegen.sil.software import RECORD_COLUMNS, Status

if TYPE_CHECKING:
    from hil_sim.bench import BenchResult
    from hil_sim.fault_catalogue import FaultOutcome


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


def fault_rows(outcomes: Sequence[FaultOutcome]) -> list[tuple[str, ...]]:
    """Return the rows under HEADER for a terminal; the last column is flush left."""
    rows = [fault_cells(entry) for entry in fault_data(outcomes)]
    width = max((len(row[-1]) for row in rows), default=0)
    return [(*row[:-1], row[-1].ljust(width)) for row in rows]


def fault_cells(entry: FaultEntry) -> tuple[str, ...]:
    """Return the row of one entry of `fault_data`, under HEADER."""
    return tuple(text(entry) for text in _COLUMNS.values())


Finite = Annotated[float, Field(allow_inf_nan=False)]


class FaultEntry(TypedDict):
    """Entry for one fault in the output of `codegen faults --json`; times in s."""

    name: str
    injected: str
    seen: list[str]
    reached: str
    defined: str
    held_after_s: Finite | None
    fail_safe_after_s: Finite | None
    rear_angle_max_deg: Finite
    rear_rate_max_deg_s: Finite
    command_step_max_deg: Finite
    recovered_after_s: Finite | None
    violations: list[str]


class FaultFile(TypedDict):
    """The part of that output that a report needs."""

    faults: Annotated[list[FaultEntry], Field(min_length=1)]


_COLUMNS: dict[str, Callable[[FaultEntry], str]] = {
    "injected": lambda entry: entry["injected"],
    "reached": lambda entry: entry["reached"],
    "fail-safe after": lambda entry: _milliseconds(entry["fail_safe_after_s"]),
    "|rear angle| up to": lambda entry: f"{entry['rear_angle_max_deg']:.2f} deg",
    "its rate up to": lambda entry: f"{entry['rear_rate_max_deg_s']:.1f} deg/s",
    "command step": lambda entry: f"{entry['command_step_max_deg']:.2f} deg",
    "back after": lambda entry: _milliseconds(entry["recovered_after_s"]),
    "as defined": lambda entry: "yes" if not entry["violations"] else "; ".join(entry["violations"]),
    "seen": lambda entry: ", ".join(_condensed(entry["seen"])) or "nothing",
}
FAULT_HEADER = tuple(_COLUMNS)


def fault_data(outcomes: Sequence[FaultOutcome]) -> list[FaultEntry]:
    """Return the outcomes for JSON; times in s."""
    return [
        {
            "name": outcome.case.name,
            "injected": outcome.case.what,
            "seen": list(outcome.seen),
            "reached": outcome.worst.name,
            "defined": outcome.case.worst.name,
            "held_after_s": outcome.held_after,
            "fail_safe_after_s": outcome.fail_safe_after,
            "rear_angle_max_deg": outcome.rear_angle_max_deg,
            "rear_rate_max_deg_s": outcome.rear_rate_max_deg_s,
            "command_step_max_deg": outcome.command_step_max_deg,
            "recovered_after_s": outcome.recovered_after,
            "violations": list(outcome.violations),
        }
        for outcome in outcomes
    ]


def _milliseconds(seconds: float | None) -> str:
    return "-" if seconds is None else f"{1e3 * seconds + 0.0:.0f} ms"


def _condensed(seen: Sequence[str]) -> list[str]:
    """Merge entries that hold for both of the car's messages into one without a name."""
    both = {text.removeprefix("motion ") for text in seen if f"conditions {text.removeprefix('motion ')}" in seen}
    texts = [text.removeprefix("motion ") if text.removeprefix("motion ") in both else text for text in seen]
    return [text for text in texts if text.removeprefix("conditions ") not in both or not text.startswith("conditions ")]
