"""Runs the checks of `codegen verify` on a build, each in a process of its own, and collects their outcomes."""

from __future__ import annotations

import contextlib
import importlib
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import FrameType

from codegen.errors import CodegenError, one_line
from codegen.verify.outcomes import Effort, Outcome, Subject, Verdict
from codegen.verify.tools import MissingTool

LEFT_OUT = "left out by --quick"
PARALLEL_CHECKS = 2
"""Number of checks that run at the same time."""
CRASHED = "its process ended: the C that it runs on this machine crashed (see the sanitizers), or memory ran out"
CLEANUP_TIME_S = 2.0
"""Time in s for a terminated process to clean up."""


@dataclass(frozen=True)
class Registered:
    """A check: its name in JSON, its name in tables, the module with its function `check`, and whether `--quick` runs it.

    `shows` is the property that it shows, printed if it is not run.
    """

    name: str
    title: str
    module: str
    shows: str
    quick: bool = False


CHECKS = (
    Registered(
        "compiles",
        "compiles",
        "codegen.verify.compilers",
        "The C compiles without a warning for every core, as C99, C11 and C++, and calls no forbidden function",
        quick=True,
    ),
    Registered(
        "static-analysis",
        "static analysis",
        "codegen.verify.static_analysis",
        "Every finding of MISRA C:2012, cppcheck and gcc's analyser is a line of deviations.md",
        quick=True,
    ),
    Registered(
        "processor-in-the-loop",
        "processor in the loop",
        "codegen.verify.emulated_runs",
        "Code for other processors gives the same results as on the host, bit for bit",
        quick=True,
    ),
    Registered(
        "budgets",
        "budgets",
        "codegen.verify.budgets",
        "Instructions, stack, flash and RAM on a Cortex-M4F are within budget",
        quick=True,
    ),
    Registered(
        "generator",
        "generator",
        "codegen.verify.generator",
        "The C is the generator's own, or every result of the edited C equals that of the generator's C, bit for bit",
        quick=True,
    ),
    Registered(
        "sanitizers",
        "sanitizers",
        "codegen.verify.sanitizer_runs",
        "Drives and bus faults have the specified outcome, and no input causes undefined behaviour or exceeds a bound",
    ),
    Registered(
        "contracts",
        "contracts",
        "codegen.verify.contracts",
        "For every input, state and valid parameter set each function keeps its contract, and nothing is undefined",
    ),
    Registered(
        "memory",
        "abstract interpretation",
        "codegen.verify.memory",
        "No public function accesses memory outside an object or through a dangling pointer, and nothing else is undefined",
    ),
)
SLOWEST_FIRST = (
    *("contracts", "sanitizers", "compiles", "static-analysis"),
    *("generator", "processor-in-the-loop", "memory", "budgets"),
)
"""Order in which checks start. In every effort, the first PARALLEL_CHECKS of them do not use `Subject.unbounded`."""


@dataclass(frozen=True)
class VerificationReport:
    """Outcomes of all checks by name, in the order of `CHECKS`."""

    subject: Subject
    effort: Effort
    outcomes: Mapping[str, Outcome]

    def count(self, verdict: Verdict) -> int:
        """Count the checks with a verdict."""
        return sum(outcome.verdict is verdict for outcome in self.outcomes.values())

    @property
    def failed(self) -> tuple[str, ...]:
        """Names of the checks that failed."""
        return tuple(name for name, outcome in self.outcomes.items() if outcome.verdict is Verdict.FAILED)


def run(
    subject: Subject,
    effort: Effort,
    done: Callable[[int, int], None] | None = None,
    checks: Sequence[Registered] = CHECKS,
) -> VerificationReport:
    """Run the checks of an effort.

    Args:
        done: called after each check with the number of finished checks and of all.
    """
    outcomes = {
        check.name: Outcome(check.shows, "", Verdict.NOT_RUN, (LEFT_OUT,))
        for check in checks
        if effort.quick and not check.quick
    }
    chosen = sorted(
        (check for check in checks if check.name not in outcomes),
        key=lambda check: SLOWEST_FIRST.index(check.name) if check.name in SLOWEST_FIRST else len(SLOWEST_FIRST),
    )
    total = len(chosen)

    def keep(check: Registered, outcome: Outcome) -> None:
        outcomes[check.name] = outcome
        if done is not None:
            done(len(outcomes) - len(checks) + total, total)

    with tempfile.TemporaryDirectory(prefix="ars-verify-", ignore_cleanup_errors=True) as scratch:
        crashed: list[Registered] = []
        with _processes(PARALLEL_CHECKS, scratch) as pool:
            running: dict[Future[Outcome], Registered] = {}
            saved = _saved(subject, scratch)
            for number, check in enumerate(chosen):
                if number == PARALLEL_CHECKS:  # for the others, while the first ones run
                    with contextlib.suppress(Exception):  # raised again in each check that needs it
                        _ = subject.unbounded
                    saved = _saved(subject, scratch)
                try:
                    running[pool.submit(_outcome_in_worker, check, saved, effort)] = check
                except BrokenProcessPool:
                    crashed.append(check)
            for future in as_completed(running):
                try:
                    keep(running[future], future.result())
                except BrokenProcessPool:  # a process crashed, which ends the pool
                    crashed.append(running[future])
        for check in crashed:
            keep(check, _alone(check, subject, effort, scratch))
    return VerificationReport(subject, effort, {check.name: outcomes[check.name] for check in checks})


@contextlib.contextmanager
def _processes(count: int, scratch: str) -> Iterator[ProcessPoolExecutor]:
    """Start a pool of processes; they and their children are terminated with this process."""
    # Not forked, so that a check does not depend on the state of this process.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(count, mp_context=context, initializer=_begin, initargs=(scratch,)) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            _end(multiprocessing.active_children())  # otherwise the pool waits for the running checks
            raise


def _alone(check: Registered, subject: Subject, effort: Effort, scratch: str) -> Outcome:
    """Run a check in a process of its own, which no other check can crash."""
    with _processes(1, scratch) as pool:
        try:
            return pool.submit(_outcome_in_worker, check, _saved(subject, scratch), effort).result()
        except BrokenProcessPool:
            return Outcome(check.shows, "could not be completed", Verdict.FAILED, (CRASHED,))


def outcome_of(check: Registered, subject: Subject, effort: Effort) -> Outcome:
    """Run one check. It is not run if a tool is missing, and failed if the build or the check itself raises an error."""
    try:
        outcome = importlib.import_module(check.module).check(subject, effort)
        if not isinstance(outcome, Outcome):
            raise TypeError(f"{check.module}.check gave {type(outcome).__name__}, not an Outcome")
    except MissingTool as error:
        return Outcome(check.shows, "", Verdict.NOT_RUN, (str(error),))
    except CodegenError as error:
        return Outcome(check.shows, "could not be completed", Verdict.FAILED, (str(error),))
    except Exception as error:  # an error of one check must not stop the others
        if "--debug" in sys.argv:
            traceback.print_exc()
        finding = f"could not be completed: {type(error).__name__}: {one_line(error)}"
        return Outcome(check.shows, "could not be completed", Verdict.FAILED, (finding,))
    return outcome


def _saved(subject: Subject, scratch: str) -> Path:
    """Write a subject for the workers. In the pipe to them, it would block the pool for ever after a crash (CPython 94777)."""
    content = {
        **{"name": subject.name, "manifest": subject.manifest, "edited": subject.edited},
        "files": {path: data.decode("latin-1") for path, data in subject.files.items()},
        "manifest_sha256": subject.manifest_sha256,
        "unbounded": vars(subject).get("unbounded"),  # None if nothing has used it yet
    }
    handle, name = tempfile.mkstemp(".json", dir=scratch)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        json.dump(content, file)
    return Path(name)


def _restored(saved: Path) -> Subject:
    """Return a subject that `_saved` wrote."""
    content = json.loads(saved.read_bytes())
    files = {path: text.encode("latin-1") for path, text in content["files"].items()}
    subject = Subject(content["name"], files, content["manifest"], tuple(content["edited"]), content["manifest_sha256"])
    if content["unbounded"] is not None:
        vars(subject)["unbounded"] = tuple(content["unbounded"])
    return subject


def _outcome_in_worker(check: Registered, saved: Path, effort: Effort) -> Outcome:
    """Run one check, which ends on SIGTERM together with its children."""
    subject = _restored(saved)
    signal.signal(signal.SIGTERM, _leave)
    try:
        return outcome_of(check, subject, effort)
    finally:  # between checks it ends at once: imports would turn the exception into another one
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _begin(scratch: str) -> None:
    """Initialise a worker."""
    tempfile.tempdir = os.environ["TMPDIR"] = scratch  # for this process, and for compilers
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a key pressed in the terminal reaches every process


def _leave(number: int, frame: FrameType | None) -> None:
    del frame
    signal.signal(number, signal.SIG_IGN)
    sys.unraisablehook = lambda _: None  # errors of half-initialised solver objects
    raise SystemExit(128 + number)


def _end(workers: Sequence[BaseProcess]) -> None:
    for worker in workers:
        worker.terminate()
    for worker in workers:
        worker.join(CLEANUP_TIME_S)
        worker.kill()  # for example inside a solver
