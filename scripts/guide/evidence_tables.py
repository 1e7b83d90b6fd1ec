"""The page on the evidence as Markdown, from the committed records of full runs."""

from __future__ import annotations

from collections import Counter
from typing import Any

from codegen.verify.requirements import ENGINES as CHECKS
from scripts.guide.markdown import table
from tests.evidence import record
from tests.evidence.parts import PARTS, Part
from tests.evidence.record import Record

LABEL = "<!-- full runs whose files have changed since -->\n"
"""Place of the label on the page. The label depends on the code of the moment, so it is not part of the file."""


def label() -> str:
    """Return which parts have changed since their full run, have none, or failed, as a sentence."""
    states: dict[str, list[str]] = {}
    for part in PARTS:
        states.setdefault(record.state(part, record.read(part)), []).append(f"`{part.name}`")
    named = [f"**{state}**: {', '.join(names)}" for state, names in states.items() if state != "current"]
    return f"{'; '.join(named)}.\n" if named else "All are current.\n"


def summary() -> str:
    """Return one row for each part: verdict, figure and duration of its full run."""
    rows = []
    for part in PARTS:
        run = record.read(part) or {"verdict": "no full run yet", "figure": "", "duration_s": None}
        seconds = run["duration_s"]
        duration = "" if seconds is None else f"{seconds} s" if seconds < 120 else f"{round(seconds / 60)} min"
        rows.append((f"`{part.name}`", run["verdict"], run["figure"], duration))
    return table(("part", "verdict", "figure", "took"), rows)


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_cell, value))
    return f"{value:,}" if isinstance(value, int) else str(value).replace("\n", " ")


def _section(part: Part, run: Record) -> str:
    rows: list[tuple[str, ...]] = [("subject and own code, SHA-256", f"`{run['hash']}`"), *sorted(run["tools"].items())]
    tables: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    entries = {name: value for name, value in run["figures"].items() if isinstance(value, dict)}
    alike = Counter(map(tuple, entries.values()))
    for name, value in run["figures"].items():
        if name not in entries:
            rows.append((name, _cell(value)))
        elif alike[tuple(value)] > 1:  # such as one for each file: a row of a table
            tables.setdefault(tuple(value), []).append((name, *map(_cell, value.values())))
        else:
            rows += [(f"{name}: {inner}", _cell(figure)) for inner, figure in value.items()]
    text = [f"## {part.name}\n", f"{run['figure'][:1].upper()}{run['figure'][1:]}.\n"]
    text += [f"- {_cell(finding)}" for finding in run["findings"]] + [""] * bool(run["findings"])
    text += [
        table(("", ""), rows),
        *(table(("", *(name.replace("_", " ") for name in names)), lines) for names, lines in tables.items()),
    ]
    return "\n".join(text)


def details() -> str:
    """Return a section for each full run with its findings, all its figures, the tools and the hash of what it ran on."""
    return "\n".join(_section(part, run) for part in PARTS if (run := record.read(part)))


HEADS = dict(
    zip(
        CHECKS,
        ("CBMC", "EVA", "gen\u00aderator", "sani\u00adtizers", "PIL", "bud\u00adgets", "com\u00adpilers", "static"),
        strict=True,
    )
)
"""Check -> head of its column in the table of planted faults, short and with soft hyphens."""


def planted_faults() -> str:
    """Return a table of the planted faults and the checks that find each of them."""
    (part,) = (part for part in PARTS if part.name == "faults")
    run = record.read(part)
    figures = run["figures"] if run else {}
    rows: list[tuple[str, ...]] = []
    kind = ""
    for name, fault in figures.items():
        if fault["kind"] != kind:
            kind = fault["kind"]
            rows.append((f"**{kind}**", *[""] * len(HEADS)))
        rows.append((name, *("●" if check in fault["found by"] else "" for check in HEADS)))
    found = [fault["found by"] for fault in figures.values()]
    rows.append(("**found**", *(str(sum(check in names for names in found)) for check in HEADS)))
    both = sum(bool({"contracts", "memory"} & set(names)) for names in found)
    head = f"The full run: {run['figure'] if run else ''}. CBMC and EVA together find {both}."
    return "\n".join([head, "", table(("fault", *HEADS.values()), rows)]) + "\n"
