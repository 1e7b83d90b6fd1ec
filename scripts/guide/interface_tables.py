"""CAN matrix, diagnostics, columns of a run and C functions as Markdown, from the files and the code that define them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from scripts.guide.markdown import table

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "generated/4ws2"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _range(signal: Any) -> str:
    choices = {code: name for code, name in (signal.choices or {}).items() if str(name) != "not available"}
    if choices:
        return ", ".join(f"{code} {name}" for code, name in sorted(choices.items()))
    if signal.minimum is None or signal.maximum is None:
        return ""
    return f"{_figure(signal.minimum)} to {_figure(signal.maximum)}{' ' + signal.unit if signal.unit else ''}"


def _not_available(signal: Any) -> str:
    lowest, highest = -(2 ** (signal.length - 1)), 2**signal.length - 1
    is_value = (signal.scale, signal.offset) != (1, 0)
    return "" if not is_value else str(lowest if signal.is_signed else highest)


def can_matrix() -> str:
    """Every message and signal of the committed build's DBC, as cantools reads it."""
    import cantools

    database = cantools.database.load_file(BUILD / "ars.dbc")
    parts = []
    for message in database.messages:
        cycle = f", every {message.cycle_time} ms" if message.cycle_time else ""
        parts.append(f"## `{message.name}`, 0x{message.frame_id:X}\n")
        parts.append(f"{message.length} bytes from `{message.senders[0]}`{cycle}. {message.comment or ''}\n")
        rows = [
            (
                f"`{signal.name}`",
                f"{signal.start}",
                f"{signal.length}",
                "Intel" if signal.byte_order == "little_endian" else "Motorola",
                "signed" if signal.is_signed else "unsigned",
                _figure(signal.scale) + (f", offset {_figure(signal.offset)}" if signal.offset else ""),
                _range(signal),
                _not_available(signal),
            )
            for signal in sorted(message.signals, key=lambda one: one.start)
        ]
        parts.append(table(("signal", "start bit", "bits", "order", "code", "factor", "range", "not available"), rows))
    return "\n".join(parts)


def diagnostics() -> str:
    """The bits of `Diagnostics`."""
    from codegen.emit.can_view import DIAGNOSTIC_CAUSES
    from codegen.emit.supervision import causes_of_bit

    rows = [
        (f"{one.bit}", f"`{one.name}`", one.text, ", ".join(cause.name for cause in causes_of_bit(one.name)))
        for one in DIAGNOSTIC_CAUSES
    ]
    return table(("bit", "name", "set where", "causes of the supervision"), rows)


def supervision() -> str:
    """The table of the supervision, by cause."""
    from codegen.emit.supervision import CAUSES, reaction_of, status_text

    rows = [
        (f"`{cause.name}`", row.text, row.leads_to.name, status_text(row.leads_to), reaction_of(cause))
        for cause, row in CAUSES.items()
    ]
    return table(("cause", "meaning", "next state", "status", "reaction"), rows)


def run_columns() -> str:
    """The columns of a run, in their order."""
    from codegen.export.runs import EXPORT_COLUMNS

    return table(("column", "unit", "meaning"), [(f"`{one.name}`", one.unit, one.meaning) for one in EXPORT_COLUMNS])


def exit_codes() -> str:
    """The table of exit codes of `interface.md`, which outside readers go by."""
    return _of_interface(r"(?m)^\| exit code \|.*\n(?:\|.*\n)+")


def map_file() -> str:
    """The section on the map file of `interface.md`."""
    return _of_interface(r"(?s)(?<=## Reference map, `\.npz`\n).*?(?=\n## )")


def _of_interface(pattern: str) -> str:
    found = re.search(pattern, (ROOT / "docs/interface.md").read_text(encoding="utf-8"))
    assert found is not None
    return found[0]


_COMMENT_AND_FUNCTION = re.compile(
    r"/\*(?P<comment>(?:(?!\*/).)*)\*/\n(?P<prototype>(?:[a-z][\w \*]*?)\b(?P<name>ars_\w+)\((?P<rest>[^;]*)\);)", re.S
)


def c_functions(header: str) -> str:
    """The functions of a header with the first sentence of what it says of them."""
    text = (BUILD / "include" / header).read_text(encoding="utf-8")
    rows = []
    for found in _COMMENT_AND_FUNCTION.finditer(text):
        words = " ".join(re.sub(r"^\s*\*", "", line).strip() for line in found["comment"].strip().splitlines()).strip()
        sentence = re.split(r"(?<=[.;])\s|\.\s*$", words, maxsplit=1)[0].rstrip(".:;")
        rows.append((f"`{found['name']}`", sentence))
    if not rows:
        raise LookupError(f"{header}: no function with a comment")
    return table(("function", "what it does"), rows)


def judgement() -> str:
    """Every figure of the judgement of a car with its requirement."""
    from codegen.judgement import rows, steady
    from codegen.metrics.sine import DISPLACEMENT_MIN, DISPLACEMENT_MIN_HEAVY, HEAVY_MASS, RATIOS
    from codegen.units import KM_H

    speed = f"{steady.CHARACTERISTIC_SPEED / KM_H:.0f} km/h"
    (low, low_to), (high, high_to) = steady.LOW_KM_H, steady.HIGH_KM_H
    displacement = f"{DISPLACEMENT_MIN:g} m ({DISPLACEMENT_MIN_HEAVY:g} m above {HEAVY_MASS:,.0f} kg)"
    enough = f"{rows.DISPLACEMENT_ENOUGH_M:g} m or {100.0 * rows.DISPLACEMENT_SHARE_MIN:g} % of passive"
    required = (
        ("largest lateral acceleration of the map", f"at least {100.0 * rows.GRIP_MIN:g} % of what the car can use"),
        ("dead steering in the map and in the table of the ECU", f"no falling step, at most {rows.FLAT_MAX_PERCENT:g} % flat"),
        (
            f"yaw rate at {low:g} to {low_to:g} km/h, up to 95 % of what the car can use",
            f"at least {100.0 * rows.LOW_MIN:g} % of passive",
        ),
        (
            f"yaw rate at {high:g} to {high_to:g} km/h, up to {steady.HIGH_LATERAL_ACCELERATION_G:g} g",
            f"at least {100.0 * rows.HIGH_MIN:g} % of the smaller of passive and a car with a characteristic speed of {speed}",
        ),
        (
            f"yaw gain at 60, 80 and 120 km/h and the last speed, smallest up to {steady.HIGH_LATERAL_ACCELERATION_G:g} g",
            "stated only",
        ),
        ("steady yaw rate after the paper's step", f"at least {100.0 * rows.LOW_MIN:g} % of passive"),
        ("steady sideslip after it", f"at most {rows.STEP_SIDESLIP_TOLERANCE_DEG:g} deg more than passive"),
        (
            "overshoot of yaw rate and of lateral acceleration",
            f"at most {rows.OVERSHOOT_TOLERANCE_PERCENT:g} points more than passive",
        ),
        ("rise to 90 % of both", f"at most {rows.RISE_TOLERANCE_S:g} s more than passive"),
        ("phase delay of both", f"at most {1e3 * rows.DELAY_TOLERANCE_S:g} ms more than passive"),
        ("sine with dwell, lateral displacement", f"at least {displacement}, and {enough}"),
        *((f"yaw-rate ratio {after:g} s after it", f"at most {limit:g} %") for after, limit in RATIOS.values()),
        ("sines with dwell, over load and road, that only passive meets", "none"),
        ("entry speed into the lane change", "not below passive"),
        ("peak sideslip in the lane change", f"at most {100.0 * rows.SIDESLIP_SHARE_MAX:g} % of passive"),
        ("peak sideslip of all drives", f"at most {rows.PEAK_SIDESLIP_TOLERANCE_DEG:g} deg more than passive"),
        (
            "largest slip of each axle in all drives",
            f"at most {rows.SLIP_MAX_PERCENT:g} % of that of peak force, or as passive",
        ),
    )
    return table(("figure", "required"), required)
