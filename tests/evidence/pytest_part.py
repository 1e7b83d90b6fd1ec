"""A part that is a folder of pytest files: run by pytest in its own process, with this module as a plugin for the results.

That process ends with its parent, so that a second run does not overlap the tests of a killed first one.
"""

import ctypes
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from codegen.verify.outcomes import Effort, Outcome, Verdict
from tests.evidence.parts import ROOT, Part
from tests.evidence.progress import Progress

RESULTS = "ARS_EVIDENCE_RESULTS"
"""Environment variable with the file of results: "" for a test that passed."""
FAILED, SKIPPED = "failed: ", "skipped: "
PR_SET_PDEATHSIG = 1  # linux/prctl.h


def run(part: Part, effort: Effort, results: Path) -> Outcome:
    """Run the tests of a part, except those that passed according to the file of results.

    The quick form runs in one process, and its output is printed if it fails.
    """
    options = ["-q", "-p", __name__, *(["-n0", "-m", "not long"] if effort.quick else ["-n2"]), str(part.folder)]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_XDIST")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options],
        cwd=ROOT,
        env=environment | {RESULTS: str(results)},
        stdout=subprocess.PIPE if effort.quick else None,
        stderr=subprocess.STDOUT if effort.quick else None,
        check=False,
        preexec_fn=end_with_parent,
    )
    is_good, found = done.returncode in (0, 5), Progress(results).done
    if effort.quick and not is_good:
        print(done.stdout.decode(errors="replace"), flush=True)
    failed = [f"{name}: {text.removeprefix(FAILED)}" for name, text in found.items() if text.startswith(FAILED)]
    skipped = sorted({text.removeprefix(SKIPPED) for text in found.values() if text.startswith(SKIPPED)})
    figures = {"passed": sum(not text for text in found.values()), "failed": len(failed)}
    figure = f"{figures['passed']} tests passed" + (f", {len(failed)} failed" if failed else "")
    findings = failed or ([] if is_good else [f"pytest ended with exit code {done.returncode}"])
    verdict = Verdict.FAILED if findings else Verdict.NOT_RUN if skipped or not found else Verdict.PASSED
    findings = findings or skipped or ([] if found else ["no test was run"])
    return Outcome(f"the tests of {part.folder.name} pass", figure, verdict, tuple(findings), figures)


def end_with_parent() -> None:
    """Request that the kernel kills this process when its parent ends for any reason."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Keep the result of a test, in the process that starts the workers."""
    if "PYTEST_XDIST_WORKER" not in os.environ and (report.when == "call" or not report.passed):
        crash = getattr(report.longrepr, "reprcrash", None)
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else crash.message if crash else report.longreprtext
        text = "" if report.passed else f"{FAILED if report.failed else SKIPPED}{reason}".partition("\n")[0]
        Progress(Path(os.environ[RESULTS])).keep(report.nodeid, text)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests that passed in an interrupted run."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        end_with_parent()  # otherwise a worker continues for up to 15 s
    results = Progress(Path(os.environ[RESULTS])).done
    passed = [item for item in items if results.get(item.nodeid) == ""]
    config.hook.pytest_deselected(items=passed)
    items[:] = [item for item in items if item not in passed]
