"""Records of the evidence: one JSON file for each part, committed, with the last full run and the last quick one."""

from __future__ import annotations

import json
import platform
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from codegen.sil.toolchain import compiler_command
from codegen.verify.check import Outcome, Verdict
from tests.evidence.parts import RECORDS, Part

Form = Literal["full", "quick"]


def common_tools() -> dict[str, str]:
    """Return the versions of what every part runs with."""
    compiler = compiler_command()
    answer = subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=False).stdout.partition("\n")[0]
    return {"Python": platform.python_version(), "C compiler": answer}


@dataclass(frozen=True)
class Record:
    """The record of a part. `runs` holds a run by its form, as JSON values."""

    part: Part
    runs: dict[str, dict[str, Any]]

    @classmethod
    def read(cls, part: Part, folder: Path = RECORDS) -> Record:
        """Read the record of a part; without a file it has no runs. Raises ValueError: the file is not a record."""
        path = folder / f"{part.name}.json"
        if not path.is_file():
            return cls(part, {})
        content = json.loads(path.read_text(encoding="utf-8"))
        if content.get("part") != part.name or not isinstance(content.get("runs"), dict):
            raise ValueError(f"{path.name} is not a record of part {part.name}")
        return cls(part, content["runs"])

    def is_current(self, form: Form) -> bool:
        """Whether a run of this form passed on what is there now."""
        run = self.runs.get(form)
        return run is not None and run["hashes"] == self.part.hashes() and run["verdict"] == Verdict.PASSED

    @property
    def matches(self) -> bool:
        """Whether a full or a quick run passed on what is there now, so that the record speaks of it."""
        return self.is_current("full") or self.is_current("quick")

    def keep(self, form: Form, outcome: Outcome, hashes: dict[str, str], seconds: float, folder: Path = RECORDS) -> None:
        """Write a run, with `Part.hashes` when it began, into the record; the run of the other form stays."""
        self.runs[form] = {
            "hashes": hashes,
            "verdict": str(outcome.verdict),
            "figure": outcome.figure,
            "findings": list(outcome.findings),
            "figures": dict(outcome.figures),
            "tools": common_tools() | dict(outcome.tools),
            "duration_s": round(seconds),
        }
        content = {"part": self.part.name, "shows": self.part.shows, "runs": dict(sorted(self.runs.items()))}
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.part.name}.json"
        temporary = path.with_suffix(".part")
        temporary.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        temporary.replace(path)
