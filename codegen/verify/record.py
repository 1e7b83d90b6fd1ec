"""Write the record of a verification into the build folder: `verify.json` and `verify.md`, which the manifest does not list."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import Any

from codegen import __version__
from codegen.emit.folder import VERIFICATION_FILES
from codegen.errors import CodegenError
from codegen.files import write_atomically
from codegen.plausibility.build import read_record
from codegen.verify import requirements
from codegen.verify.check import Outcome, Verdict
from codegen.verify.manual import manual
from codegen.verify.runner import VerificationReport

SCHEMA_VERSION = 1
JSON, MANUAL = VERIFICATION_FILES


def to_dict(report: VerificationReport) -> dict[str, Any]:
    """Return the report as JSON values, without times; tool versions are its only data of the machine."""
    subject = report.subject
    options = subject.manifest["options"]
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
        "requirements": requirements.entries(report.outcomes, subject.prefix),
        "checks": {name: _outcome(outcome) for name, outcome in report.outcomes.items()},
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


def render(report: VerificationReport) -> bytes:
    """Return the content of `verify.json` and of `--json`."""
    return (json.dumps(to_dict(report), indent=1, allow_nan=False) + "\n").encode()


def write(report: VerificationReport, folder: Path) -> bool:
    """Write both files into the build folder.

    Return False if this run was quick and the folder has the record of a full run of the same files, which is then kept.

    Raises:
        CodegenError: one cannot be written.
    """
    if report.effort.quick and _has_full_record(folder, report.subject.manifest_sha256, report.subject.edited):
        return False
    written = {JSON: render(report), MANUAL: manual(report).encode()}
    for name, content in written.items():
        write_atomically(folder / name, content)
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
