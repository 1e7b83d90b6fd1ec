"""The page on the evidence as Markdown, from the committed records of its parts."""

from __future__ import annotations

from collections import Counter
from typing import Any

from codegen.emit.requirements import ENGINES as CHECKS
from tests.evidence import record
from tests.evidence.parts import PARTS, Part
from tests.evidence.record import Record


def summary() -> str:
    """Return one row for each part: the figure of its last full run, the run's state and its duration."""
    rows = []
    for part in PARTS:
        run = record.read(part)
        state, figure, seconds = record.state(part, run), run["figure"] if run else "", run["duration_s"] if run else None
        duration = "" if seconds is None else f"{seconds} s" if seconds < 120 else f"{round(seconds / 60)} min"
        rows.append([f"`{part.name}`", figure, state if state == "current" else f"**{state}**", duration])
    return _table(["part", "figure", "full run", "took"], rows)


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_cell, value))
    return f"{value:,}" if isinstance(value, int) else str(value).replace("\n", " ")


def _table(head: list[str], rows: list[list[str]]) -> str:
    escaped = [[cell.replace("|", "\\|") for cell in row] for row in (head, ["---"] * len(head), *rows)]
    return "".join(f"| {' | '.join(row)} |\n" for row in escaped)


def _section(part: Part, run: Record) -> str:
    rows = [["subject and own code, SHA-256", f"`{run['hash']}`"], *map(list, sorted(run["tools"].items()))]
    tables: dict[tuple[str, ...], list[list[str]]] = {}
    entries = {name: value for name, value in run["figures"].items() if isinstance(value, dict)}
    alike = Counter(map(tuple, entries.values()))
    for name, value in run["figures"].items():
        if name not in entries:
            rows.append([name, _cell(value)])
        elif alike[tuple(value)] > 1:  # such as one for each file: a row of a table
            tables.setdefault(tuple(value), []).append([name, *map(_cell, value.values())])
        else:
            rows += [[f"{name}: {inner}", _cell(figure)] for inner, figure in value.items()]
    text = [f"## {part.name}\n", f"The full run ({record.state(part, run)}): {run['figure']}.\n"]
    text += [f"- {_cell(finding)}" for finding in run["findings"]] + [""] * bool(run["findings"])
    text += [
        _table(["", ""], rows),
        *(_table(["", *(name.replace("_", " ") for name in names)], lines) for names, lines in tables.items()),
    ]
    return "\n".join(text)


def details() -> str:
    """Return a section for each full run with its findings, all its figures, the tools and the hash of what it ran on."""
    return "\n".join(_section(part, run) for part in PARTS if (run := record.read(part)))


HEADS = dict(
    zip(CHECKS, ("CBMC", "EVA", "law", "sani\u00adtizers", "PIL", "bud\u00adgets", "com\u00adpilers", "static"), strict=True)
)
"""Check -> head of its column in the table of planted faults, short and with soft hyphens."""


def planted_faults() -> str:
    """Return a table of the planted faults and the checks that find each of them."""
    (part,) = (part for part in PARTS if part.name == "faults")
    run = record.read(part)
    figures = run["figures"] if run else {}
    rows: list[list[str]] = []
    kind = ""
    for name, fault in figures.items():
        if fault["kind"] != kind:
            kind = fault["kind"]
            rows.append([f"**{kind}**"] + [""] * len(HEADS))
        rows.append([name, *("●" if check in fault["found by"] else "" for check in HEADS)])
    found = [fault["found by"] for fault in figures.values()]
    rows.append(["**found**", *(str(sum(check in names for names in found)) for check in HEADS)])
    both = sum(bool({"contracts", "memory"} & set(names)) for names in found)
    head = f"The full run ({record.state(part, run)}): {run['figure'] if run else ''}. CBMC and EVA together find {both}."
    return "\n".join([head, "", _table(["fault", *HEADS.values()], rows)]) + "\n"
