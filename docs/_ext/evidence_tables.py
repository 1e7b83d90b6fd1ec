"""The page on the evidence as Markdown, from the committed records of its parts."""

from __future__ import annotations

from collections import Counter
from typing import Any

from codegen.emit.requirements import ENGINES as CHECKS
from tests.evidence.parts import PARTS
from tests.evidence.record import Record


def _summary_row(record: Record) -> str:
    """Return the row of a part: what it shows, then figure, form, state and duration of the run that speaks best for it."""
    form = record.best
    if form is None:
        return f"| `{record.part.name}` | {record.part.shows} | no record | | |"
    run = record.runs[form]
    fault = record.fault(form)
    return (
        f"| `{record.part.name}` | {record.part.shows} | {run['figure']}{f' (**{fault}**)' if fault else ''} | {form} "
        f"| {_duration(run['duration_s'])} |"
    )


def _duration(seconds: int) -> str:
    return f"{seconds} s" if seconds < 120 else f"{round(seconds / 60)} min"


def summary() -> str:
    """Return one row for each part: what it shows, the figure, the form and duration of the run."""
    lines = ["| part | a full run shows that | figure | run | took |", "| --- | --- | --- | --- | --- |"]
    return "\n".join([*lines, *(_summary_row(Record.read(part)) for part in PARTS)]) + "\n"


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_cell, value))
    return f"{value:,}" if isinstance(value, int) else str(value).replace("\n", " ")


def _table(head: list[str], rows: list[list[str]]) -> str:
    escaped = [[cell.replace("|", "\\|") for cell in row] for row in (head, ["---"] * len(head), *rows)]
    return "".join(f"| {' | '.join(row)} |\n" for row in escaped)


def _section(record: Record, form: str) -> str:
    run = record.runs[form]
    rows = [["subject, SHA-256", f"`{run['hashes']['subject']}`"], ["own code, SHA-256", f"`{run['hashes']['own_code']}`"]]
    rows += [[name, version] for name, version in sorted(run["tools"].items())]
    tables: dict[tuple[str, ...], list[list[str]]] = {}
    entries = {name: value for name, value in run["figures"].items() if isinstance(value, dict)}
    shared = Counter(map(tuple, entries.values()))
    for name, value in run["figures"].items():
        if name not in entries:
            rows.append([name, _cell(value)])
        elif shared[tuple(value)] > 1:  # such as one for each file: a row of a table
            tables.setdefault(tuple(value), []).append([name, *map(_cell, value.values())])
        else:
            rows += [[f"{name}: {inner}", _cell(figure)] for inner, figure in value.items()]
    text = [f"## {record.part.name}\n", f"The {form} run ({record.fault(form) or 'passed'}): {run['figure']}.\n"]
    text += [f"- {_cell(finding)}" for finding in run["findings"]] + [""] * bool(run["findings"])
    text += [
        _table(["", ""], rows),
        *(_table(["", *(name.replace("_", " ") for name in names)], lines) for names, lines in tables.items()),
    ]
    return "\n".join(text)


def details() -> str:
    """Return a section for each part with its findings, all figures of its run, the tools and the hashes of what it ran on."""
    records = map(Record.read, PARTS)
    return "\n".join(_section(record, form) for record in records if (form := record.best))


HEADS = dict(
    zip(CHECKS, ("CBMC", "EVA", "law", "sani\u00adtizers", "PIL", "bud\u00adgets", "com\u00adpilers", "static"), strict=True)
)
"""Check -> head of its column in the table of planted faults, short and with soft hyphens."""


def planted_faults() -> str:
    """Return a table of the planted faults and the checks that find each of them."""
    (record,) = (Record.read(part) for part in PARTS if part.name == "faults")
    form = "full" if "full" in record.runs else record.best
    run = record.runs.get(form or "", {"figure": "no record", "figures": {}})
    state = f" ({record.fault(form)})" if form and record.fault(form) else ""
    rows: list[list[str]] = []
    kind = ""
    for name, fault in run["figures"].items():
        if fault["kind"] != kind:
            kind = fault["kind"]
            rows.append([f"**{kind}**"] + [""] * len(HEADS))
        rows.append([name, *("●" if check in fault["found by"] else "" for check in HEADS)])
    found = [fault["found by"] for fault in run["figures"].values()]
    rows.append(["**found**", *(str(sum(check in names for names in found)) for check in HEADS)])
    both = sum(bool({"contracts", "memory"} & set(names)) for names in found)
    head = f"The last {form} run{state}: {run['figure']}. CBMC and EVA together find {both}."
    return "\n".join([head, "", _table(["fault", *HEADS.values()], rows)]) + "\n"
