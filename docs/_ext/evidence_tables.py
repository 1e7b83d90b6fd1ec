"""The page on the evidence as Markdown, from the committed records of its parts."""

from __future__ import annotations

from collections import Counter
from typing import Any

from codegen.verify.runner import CHECKS
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


def planted_faults() -> str:
    """Return a table of the planted faults that each check finds, by kind, and a list of those that it misses."""
    (record,) = (Record.read(part) for part in PARTS if part.name == "faults")
    form = "full" if "full" in record.runs else record.best
    run = record.runs.get(form or "", {"figure": "no record", "figures": {}})
    kinds: dict[str, dict[str, set[str]]] = {}
    for name, fault in run["figures"].items():
        kinds.setdefault(fault["kind"], {})[name] = set(fault["found by"])
    engines = {check.title: {check.name} for check in CHECKS}
    engines |= {
        "contracts and abstract interpretation": {"contracts", "memory"},
        "all checks": {check.name for check in CHECKS},
    }
    rows = [
        [kind, len(faults), *(sum(map(bool, map(names.__and__, faults.values()))) for names in engines.values())]
        for kind, faults in kinds.items()
    ]
    rows.append(["all kinds", *map(sum, list(zip(*rows, strict=True))[1:])])
    table = _table(["kind", "faults", *engines], [list(map(str, row)) for row in rows])
    state = f" ({record.fault(form)})" if form and record.fault(form) else ""
    head = f"The last {form} run{state}: {run['figure']}."
    return (
        "\n".join([head, "", table, *(f"- **{title}**: {_missed(kinds, names)}." for title, names in engines.items())]) + "\n"
    )


def _missed(kinds: dict[str, dict[str, set[str]]], checks: set[str]) -> str:
    """Return the faults that none of some checks finds: the kinds of which they find none, then single faults."""
    missed = {kind: [name for name, found in faults.items() if not found & checks] for kind, faults in kinds.items()}
    whole = [kind for kind, names in missed.items() if len(names) == len(kinds[kind])]
    single = [name for kind, names in missed.items() if kind not in whole for name in names]
    texts = [f"every fault of the kinds {'; '.join(whole)}"] * bool(whole) + single
    return "; ".join(texts) or "none"
