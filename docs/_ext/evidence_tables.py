"""The page on the evidence as Markdown, from the committed records of its parts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

RECORDS = Path(__file__).resolve().parents[1] / "evidence"


def _runs() -> list[tuple[dict[str, Any], str, dict[str, Any]]]:
    """Return record, form and run: of each record the full run, else the quick one."""
    found = []
    for path in sorted(RECORDS.glob("*.json")):
        record = json.loads(path.read_text(encoding="utf-8"))
        form = "full" if "full" in record["runs"] else "quick"
        found.append((record, form, record["runs"][form]))
    return found


def _duration(seconds: int) -> str:
    return f"{seconds} s" if seconds < 120 else f"{round(seconds / 60)} min"


def summary() -> str:
    """Return one row for each part: what it shows, the figure, the form and duration of the run."""
    lines = ["| part | shows that | figure | run | took |", "| --- | --- | --- | --- | --- |"]
    for record, form, run in _runs():
        verdict = "" if run["verdict"] == "passed" else f" (**{run['verdict']}**)"
        shows = record["shows"]
        lines.append(f"| `{record['part']}` | {shows} | {run['figure']}{verdict} | {form} | {_duration(run['duration_s'])} |")
    return "\n".join(lines) + "\n"


def details() -> str:
    """Return a section for each part with all figures of its run, the tools and the hashes of what it ran on."""
    parts = []
    for record, form, run in _runs():
        rows = [("subject, SHA-256", f"`{run['hashes']['subject']}`"), ("own code, SHA-256", f"`{run['hashes']['own_code']}`")]
        rows += [(name, version) for name, version in sorted(run["tools"].items())]
        for name, value in run["figures"].items():
            if isinstance(value, dict):
                rows += [(f"{name}: {inner}", str(figure)) for inner, figure in value.items()]
            else:
                rows.append((name, str(value)))
        table = ["| | |", "| --- | --- |", *(f"| {name} | {value} |".replace("\n", " ") for name, value in rows)]
        parts.append(f"## {record['part']}\n\nThe {form} run {run['verdict']}: {run['figure']}.\n\n" + "\n".join(table) + "\n")
    return "\n".join(parts)
