"""Outcomes of the faults on the bus, as rows of text and as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from pydantic import Field
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

if TYPE_CHECKING:
    from hil_sim.fault_catalogue import FaultOutcome

HEADER = (
    *(
        "injected",
        "reached",
        "fail-safe after",
        "|rear angle| up to",
        "its rate up to",
        "command step",
        "back after",
        "as defined",
    ),
    "seen",
)


def fault_rows(outcomes: Sequence[FaultOutcome]) -> list[tuple[str, ...]]:
    """Return the rows under HEADER for a terminal; the last column is flush left."""
    rows = [fault_cells(entry) for entry in fault_data(outcomes)]
    width = max((len(row[-1]) for row in rows), default=0)
    return [(*row[:-1], row[-1].ljust(width)) for row in rows]


def fault_cells(entry: FaultEntry) -> tuple[str, ...]:
    """Return the row of one entry of `fault_data`, under HEADER."""
    return (
        entry["injected"],
        entry["reached"],
        _milliseconds(entry["fail_safe_after_s"]),
        f"{entry['rear_angle_max_deg']:.2f} deg",
        f"{entry['rear_rate_max_deg_s']:.1f} deg/s",
        f"{entry['command_step_max_deg']:.2f} deg",
        _milliseconds(entry["recovered_after_s"]),
        "yes" if not entry["violations"] else "; ".join(entry["violations"]),
        ", ".join(_condensed(entry["seen"])) or "nothing",
    )


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
