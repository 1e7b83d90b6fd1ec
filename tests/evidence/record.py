"""Records of the evidence: one committed JSON file for each part, with the last full run and the last quick one."""

from __future__ import annotations

import functools
import json
import platform
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from codegen.errors import CodegenError
from codegen.sil.toolchain import compiler_command
from codegen.verify.check import Outcome, Verdict
from tests.evidence.parts import RECORDS, Part

Form = Literal["full", "quick"]
FORMS: tuple[Form, ...] = ("full", "quick")
KEYS = {"hashes", "verdict", "figure", "findings", "figures", "tools", "duration_s"}
"""Keys of a run."""


def common_tools() -> dict[str, str]:
    """Return the versions of the tools of every part."""
    compiler = compiler_command()
    answer = subprocess.run([*compiler, "--version"], capture_output=True, text=True, check=False).stdout.partition("\n")[0]
    return {"Python": platform.python_version(), "C compiler": answer}


@dataclass(frozen=True)
class Record:
    """Record of a part. `runs` holds a run by its form, as JSON values."""

    part: Part
    runs: dict[str, dict[str, Any]]

    @classmethod
    def read(cls, part: Part, folder: Path = RECORDS) -> Record:
        """Read the record of a part; without a file it has no runs. Raises CodegenError: the file is not a record of the
        part."""
        path = folder / f"{part.name}.json"
        if not path.is_file():
            return cls(part, {})
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if content["part"] == part.name and all(run.keys() >= KEYS for run in content["runs"].values()):
                return cls(part, content["runs"])
        except (ValueError, KeyError, TypeError, AttributeError):
            pass
        raise CodegenError(f"it is not a record of part {part.name}", where=path, remedy="delete it and run the part again")

    @functools.cached_property
    def hashes(self) -> dict[str, str]:
        """Current hashes."""
        return self.part.hashes()

    def fault(self, form: str) -> str:
        """Return why a run of this form is no current evidence; empty if it passed on the current files."""
        if form not in self.runs:
            return "there is none"
        run = self.runs[form]
        changed = [name.replace("_", " ") for name, digest in self.hashes.items() if run["hashes"].get(name) != digest]
        verdict = "" if run["verdict"] == Verdict.PASSED else run["verdict"]
        return ", and ".join(filter(None, (verdict, f"{' and '.join(changed)} changed since" if changed else "")))

    def is_current(self, form: Form) -> bool:
        """Return whether a run of this form passed on the current files."""
        return not self.fault(form)

    @property
    def best(self) -> Form | None:
        """Return the form of the best run: current before outdated, full before quick."""
        forms: list[Form] = [form for form in FORMS if form in self.runs]
        return min(forms, key=lambda form: bool(self.fault(form)), default=None)

    @property
    def matches(self) -> bool:
        """Return whether a full or a quick run passed on the current files."""
        return any(map(self.is_current, FORMS))

    def keep(self, form: Form, outcome: Outcome, hashes: dict[str, str], seconds: float, folder: Path = RECORDS) -> None:
        """Store a run with the `Part.hashes` at its start; the run of the other form stays."""
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
