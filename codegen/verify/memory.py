"""Abstract interpretation of a build with Frama-C's EVA: invalid memory accesses and other undefined behaviour.

EVA analyses `verify/every_function.c` with all sources. It covers what CBMC does not: indices inside structs, pointers to
objects whose block has ended, overlapping copies, and objects that several units define differently. It keeps NaN as a possible
value after a comparison, so most claims about numbers are left to the proofs of the contracts.
"""

from __future__ import annotations

import csv
import io
import os
import re
import shlex
import shutil
import subprocess
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from codegen.emit.contracts.files import frama_c_command
from codegen.emit.contracts.proof import FOLDER
from codegen.programs import run_program
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.tools import MissingTool, stored

SHOWS = (
    "No public function reads or writes outside an object, uses an uninitialised or dangling pointer, or is otherwise undefined"
)
LIMITS = (
    "EVA keeps NaN as a possible value after a comparison. Its alarms about the conversion of a float to an integer are left "
    "to the contracts, which cover each conversion.",
    "Types have the sizes of a 32-bit little-endian target. The tables of the map have the values of this build.",
)
EXPLAINED = {"is_nan_or_infinite": "a float converted to an integer may be NaN for EVA; the contracts show that it is not"}
"""Kinds of alarms that another check decides, with the reason."""
INSTALL = "apt install frama-c-base"
REPORT = "alarms.csv"
TIME_LIMIT_S = 600.0
_FAULT = re.compile(r"^\[kernel\] (\S+:\d+):\s+(?=User Error|syntax error)((?:[\w ]+:\s+)?.*)", re.MULTILINE)
"""Message about C that Frama-C cannot read."""
_VERSION = re.compile(r"\d+\.\d+\S*(?: \(\w+\))?")


@dataclass(frozen=True)
class Property:
    """A property with EVA's verdict: location, kind, verdict and property in EVA's words."""

    file: str
    line: int
    function: str
    kind: str
    status: str
    text: str

    @property
    def is_alarm(self) -> bool:
        """Whether it is undefined behaviour of the build that EVA could not exclude."""
        return self.file.startswith(("src/", "include/")) and self.status not in ("Valid", "Considered valid")

    def __str__(self) -> str:
        """Format as one line."""
        return f"{self.file}:{self.line}: {self.kind.replace('_', ' ')} in {self.function}: {self.text}"


def check(subject: Subject, effort: Effort) -> Outcome:
    """Run EVA on a build, in full also in a quick run. Raises MissingTool: Frama-C is not installed."""
    del effort
    program = shutil.which("frama-c")
    if program is None:
        raise MissingTool("it is not installed", where="frama-c", remedy=INSTALL)
    version = _VERSION.search(run_program([program, "-version"]).stdout)
    tools = {"Frama-C": version[0] if version else "?"}
    report, log = _analyse(subject.sources("include", "src", FOLDER), subject.prefix)
    if report is None:
        return Outcome(SHOWS, "not analysed", Verdict.FAILED, (log,), limits=LIMITS, tools=tools)
    alarms = [each for each in _properties(report) if each.is_alarm]
    findings = tuple(str(alarm) for alarm in alarms if alarm.kind not in EXPLAINED)
    return Outcome(
        shows=SHOWS,
        figure=f"{len(findings)} alarms, and {len(alarms) - len(findings)} explained",
        verdict=Verdict.FAILED if findings else Verdict.PASSED,
        findings=findings,
        figures={"alarms": dict(Counter(alarm.kind for alarm in alarms)), "explained": EXPLAINED},
        limits=LIMITS,
        tools=tools,
    )


def _analyse(files: Mapping[str, bytes], prefix: str) -> tuple[str | None, str]:
    """Return EVA's report as CSV, or None and the first line of its log that explains why there is none."""
    sources = sorted(path for path in files if path.startswith("src/") and path.endswith(".c"))
    command = shlex.split(frama_c_command(prefix, sources, REPORT))
    with stored(files) as folder:
        try:
            # Frama-C takes the current folder from PWD.
            result = run_program(command, folder, timeout=TIME_LIMIT_S, environment={**os.environ, "PWD": str(folder)})
        except subprocess.TimeoutExpired:
            return None, f"Frama-C did not end within {TIME_LIMIT_S:.0f} s"
        if result.returncode and (fault := _FAULT.search(result.stdout)):
            return None, f"{fault[1]}: {' '.join(fault[2].split())}"
        if result.returncode:
            return None, f"Frama-C ended with exit code {result.returncode}"
        return (folder / REPORT).read_text(encoding="utf-8"), ""


def _properties(report: str) -> Iterator[Property]:
    """Yield the properties of a report."""
    for row in csv.DictReader(io.StringIO(report), delimiter="\t", quoting=csv.QUOTE_NONE):
        file = f"{row['directory']}/{row['file']}"
        yield Property(file, int(row["line"]), row["function"], row["property kind"], row["status"], row["property"])
