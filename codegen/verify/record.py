"""Results of a verification: a table for the terminal, and the record in the build folder.

The record is `verify.json` and `verify.md`, which the manifest does not list.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

from codegen import __version__
from codegen.emit.can_view import task_view
from codegen.emit.folder import VERIFICATION_FILES
from codegen.errors import CodegenError
from codegen.files import write_together
from codegen.judgement.build_warnings import read_record
from codegen.verify import requirements
from codegen.verify.manual import manual
from codegen.verify.outcomes import Outcome, Verdict
from codegen.verify.runner import CHECKS, LEFT_OUT, VerificationReport

SCHEMA_VERSION = 1
JSON, MANUAL = VERIFICATION_FILES


def to_dict(report: VerificationReport) -> dict[str, Any]:
    """Return the report as JSON values, without times; tool versions are its only data of the machine."""
    subject = report.subject
    options = subject.manifest["options"]
    checks = {name: _outcome(outcome) for name, outcome in report.outcomes.items()}
    return {
        "schema_version": SCHEMA_VERSION,
        "codegen": __version__,
        "build": {
            "name": subject.manifest["name"],
            "build_id": subject.manifest["build_id"],
            "manifest_sha256": subject.manifest_sha256,
            **{key: options[key] for key in ("prefix", "kind", "precision")},
        },
        "effort": "quick" if report.effort.quick else "whole",
        "edited": list(subject.edited),
        "files": {path: hashlib.sha256(content).hexdigest() for path, content in sorted(subject.files.items())},
        "counts": {str(verdict): report.count(verdict) for verdict in Verdict},
        "requirements": requirements.entries(checks, subject.prefix, task_view(subject.config).function),
        "checks": checks,
    }


def _outcome(outcome: Outcome) -> dict[str, Any]:
    return {
        "shows": outcome.shows,
        "verdict": str(outcome.verdict),
        "figure": outcome.figure,
        "findings": list(outcome.findings),
        "figures": dict(outcome.figures),
        "limits": list(outcome.limits),
        "tools": dict(outcome.tools),
    }


def render(record: dict[str, Any]) -> bytes:
    """Return the content of `verify.json` and of `--json`."""
    return (json.dumps(record, indent=1, allow_nan=False) + "\n").encode()


def write(report: VerificationReport, folder: Path) -> bool:
    """Write both files into the build folder.

    Return False if this run was quick and the folder has the record of a full run of the same files, which is then kept.

    Raises:
        CodegenError: one cannot be written.
    """
    if report.effort.quick and _has_full_record(folder, report.subject.manifest_sha256, report.subject.edited):
        return False
    record = to_dict(report)
    text = manual(record, report.subject.manifest, CHECK_TITLES).encode()
    write_together({folder / JSON: render(record), folder / MANUAL: text})
    return True


def require_place(folder: Path) -> None:
    """Raise CodegenError before the checks run if the record could not be written after them."""
    for name in VERIFICATION_FILES:
        path = folder / name
        if os.path.lexists(path) and not path.is_file():
            raise CodegenError("not a regular file: the result goes there", where=path, remedy="move it away")
    if not os.access(folder, os.W_OK):
        raise CodegenError("cannot be written: the result goes there", where=folder, remedy="check its permissions")


def _has_full_record(folder: Path, manifest_sha256: str, edited: tuple[str, ...]) -> bool:
    """Return whether a full run of exactly these files is recorded."""
    found = read_record(folder)
    if found is None or edited:
        return False
    same = found["build"]["manifest_sha256"] == manifest_sha256
    return same and found.get("effort") == "whole" and found.get("edited") == []


WIDTH_MIN, WIDTH_USUAL, WIDTH_MAX = 80, 120, 160
"""Columns; as wide as the terminal, the usual where there is none."""
WIDTH_FOR_ALL = 100
"""Minimum width for the column with the property that a check shows."""

FINDINGS_PRINTED_MAX = 10
"""Maximum findings printed for a check; the JSON has all."""

CHECK_TITLES = {check.name: check.title for check in CHECKS}


def table(report: VerificationReport, columns: int | None = None) -> str:
    """Return rows of check, property, figure and verdict, limited to a number of columns (default: the terminal's)."""
    width = min(max(columns or shutil.get_terminal_size((WIDTH_USUAL, 0)).columns, WIDTH_MIN), WIDTH_MAX)
    is_wide = width >= WIDTH_FOR_ALL
    drawn = Table(box=box.SIMPLE_HEAD, pad_edge=False, width=width, show_edge=False)
    drawn.add_column("check", ratio=2)
    if is_wide:
        drawn.add_column("what it shows", ratio=6)
    drawn.add_column("figure", ratio=5)
    drawn.add_column("verdict", no_wrap=True, min_width=8)
    for name, outcome in report.outcomes.items():
        shows = (outcome.shows,) if is_wide else ()
        # A partial result is not a figure of the check.
        figure = "" if outcome.verdict is Verdict.NOT_RUN else outcome.figure
        drawn.add_row(CHECK_TITLES.get(name, name), *shows, figure or "-", str(outcome.verdict))
    page = io.StringIO()
    Console(file=page, width=width, force_terminal=False, no_color=True, highlight=False, markup=False, emoji=False).print(
        drawn
    )
    return "\n".join(line.rstrip() for line in page.getvalue().rstrip("\n").split("\n"))


def findings(report: VerificationReport) -> Iterator[str]:
    """Return one line for each check that failed or lacks a tool. Checks that `--quick` skips are omitted."""
    for name, outcome in report.outcomes.items():
        if outcome.verdict is not Verdict.PASSED and outcome.findings != (LEFT_OUT,):
            for finding in outcome.findings[:FINDINGS_PRINTED_MAX]:
                yield f"{CHECK_TITLES.get(name, name)}: {finding}"
            if len(outcome.findings) > FINDINGS_PRINTED_MAX:
                yield f"{CHECK_TITLES.get(name, name)}: and {len(outcome.findings) - FINDINGS_PRINTED_MAX} more"
