"""Records of the evidence: one committed JSON file for each part, with its last full run."""

import json
import platform
import subprocess
from pathlib import Path
from typing import Any

from codegen.errors import CodegenError
from codegen.sil.toolchain import compiler_command
from codegen.verify.outcomes import Outcome, Verdict
from tests.evidence.parts import RECORDS, Part

Record = dict[str, Any]
"""A run of a part as JSON values: its name, `Part.hash` at its start, its outcome and its duration."""
KEYS = {"part", "hash", "verdict", "figure", "findings", "figures", "tools", "duration_s"}


def of(part: Part, digest: str, outcome: Outcome, seconds: float | None) -> Record:
    """Return the record of a run; the duration of one that was interrupted is unknown."""
    version = subprocess.run([*compiler_command(), "--version"], capture_output=True, text=True, check=False).stdout
    common = {"Python": platform.python_version(), "C compiler": version.partition("\n")[0]}
    return {
        **{"part": part.name, "hash": digest, "verdict": str(outcome.verdict), "figure": outcome.figure},
        **{"findings": [*outcome.findings], "figures": {**outcome.figures}, "tools": {**common, **outcome.tools}},
        "duration_s": None if seconds is None else round(seconds),
    }


def read(part: Part, folder: Path = RECORDS) -> Record | None:
    """Return the record of a part, None without a file. Raises CodegenError: the file is not a record of the part."""
    path = folder / f"{part.name}.json"
    try:
        record: Record | None = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None
        if record is None or (record.keys() == KEYS and record["part"] == part.name and record["verdict"] in [*Verdict]):
            return record
    except (ValueError, AttributeError):
        pass
    raise CodegenError(f"it is not a record of part {part.name}", where=path, remedy="delete it and run the part again")


def state(part: Part, record: Record | None) -> str:
    """Return the state of the full run: current, changed since, failed, both, or no full run yet."""
    if record is None:
        return "no full run yet"
    facts = {"failed": record["verdict"] != Verdict.PASSED, "changed since": record["hash"] != part.hash()}
    return ", ".join(name for name, is_true in facts.items() if is_true) or "current"
