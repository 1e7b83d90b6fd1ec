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
    from codegen.emit.can_view import DIAGNOSTICS

    return table(("bit", "name", "set where"), [(f"{one.bit}", f"`{one.name}`", one.text) for one in DIAGNOSTICS])


def run_columns() -> str:
    """The columns of a run, in their order."""
    from codegen.export.runs import COLUMNS

    return table(("column", "unit", "meaning"), [(f"`{one.name}`", one.unit, one.meaning) for one in COLUMNS])


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
