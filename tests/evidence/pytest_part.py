"""A part that is a folder of pytest files: run by pytest in its own process, resumed after a kill.

That process ends with its parent, so that a second run does not overlap the tests of a killed first one.
"""

import ctypes
import os
import signal
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from codegen.verify.check import Effort, Outcome, Verdict
from tests.evidence.parts import ROOT, Part

PROGRESS_VARIABLE = "ARS_EVIDENCE_PASSED"
"""Environment variable with the file of passed tests; `tests/evidence/conftest.py` reads and extends it."""

PR_SET_PDEATHSIG = 1
"""From the kernel's linux/prctl.h."""


def run(part: Part, effort: Effort, passed: Path) -> Outcome:
    """Run the tests of a part except those that passed in an earlier run of the same code, listed in the file `passed`."""
    passed.parent.mkdir(parents=True, exist_ok=True)
    result = passed.with_suffix(".xml")  # in the checkout, which a guest can write to
    result.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", "-q", f"--junitxml={result}", *(["-m", "not long"] if effort.quick else [])]
    command += ["-n", str(part.worker_count), str(part.folder)]
    environment = os.environ | {PROGRESS_VARIABLE: str(passed)}
    environment.pop("PYTEST_XDIST_WORKER", None)  # this pytest is no worker, even if a worker starts the part
    done = subprocess.run(command, cwd=ROOT, env=environment, check=False, preexec_fn=end_with_parent)
    if not result.is_file():
        return Outcome(part.shows, "no result", Verdict.FAILED, (f"pytest ended with exit code {done.returncode}",))
    failed, missing = _read(result)
    result.unlink()
    count = len(set(passed.read_text(encoding="utf-8").splitlines())) if passed.is_file() else 0
    figures = {"passed": count, "failed": len(failed), "skipped": len(missing)}
    figure = f"{count} tests passed" + (f", {len(failed)} failed" if failed else "")
    if failed or done.returncode not in (0, 5):
        return Outcome(part.shows, figure, Verdict.FAILED, tuple(failed) or ("pytest failed",), figures)
    if missing or not count:
        reasons = tuple(sorted(set(missing))) or ("no test was run",)
        return Outcome(part.shows, figure, Verdict.NOT_RUN, reasons, figures)
    return Outcome(part.shows, figure, Verdict.PASSED, (), figures)


def end_with_parent() -> None:
    """Request that the kernel kills this process when its parent ends for any reason."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def _read(result: Path) -> tuple[list[str], list[str]]:
    """Return the failed tests with the first line of their messages, and the reasons of skipped ones."""
    failed, skipped = [], []
    for case in ElementTree.parse(result).iter("testcase"):
        name = f"{case.get('classname')}.{case.get('name')}"
        for problem in (*case.findall("failure"), *case.findall("error")):
            failed.append(f"{name}: {(problem.get('message') or '').partition(chr(10))[0]}")
        skipped += [(one.get("message") or "").partition("\n")[0] for one in case.findall("skipped")]
    return failed, skipped
