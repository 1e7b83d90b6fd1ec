"""Run the whole suite: the candidate and its baselines in every cell, on the third party's plant, and the instructions of a
step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from multiprocessing.pool import AsyncResult
from typing import Any

from codegen.errors import CodegenError
from hil_sim.suite import third_party
from hil_sim.suite.background import Background
from hil_sim.suite.requirements import Limits
from hil_sim.suite.runs import CellResult
from hil_sim.suite.subjects import Candidate, Steps
from hil_sim.suite.tracking import ExternalFigures, SuiteResult, run_suite

Stage = Callable[[str], AbstractContextManager[Steps]]
"""Function from the title of a stage to a context with its progress callback."""

Count = Callable[[Mapping[str, bytes], Mapping[str, Any]], int]
"""Function from files and manifest of a build to the worst-case instructions of a step; called in another process."""

THIRD_PARTY_MISSING = (
    'the third party\'s plant is not installed: pip install "ars-codegen[crosscheck]"; its rows are not measured'
)


@contextmanager
def unseen(title: str) -> Iterator[Steps]:
    """Return a stage without progress display."""

    def step(done: int, total: int) -> None:
        del done, total

    del title
    yield step


@dataclass(frozen=True)
class FullSuite:
    """Result of the suite, files of the tested build that were edited, and notes for the user."""

    result: SuiteResult
    edited: tuple[str, ...]
    notes: tuple[str, ...]


def run_full_suite(
    candidate: Candidate, count: Count | None = None, stage: Stage = unseen, limits: Limits | None = None
) -> FullSuite:
    """Run the whole suite. Missing external tools leave a note, and their rows unmeasured.

    Args:
        count: counts the instructions of a step; None omits them.
        stage: progress display, such as `codegen.console.progress`.
        limits: limits; None uses the defaults.

    Raises:
        CodegenError: solving, tuning, building or compiling fails.
    """
    with Background() as background:
        jobs = third_party.jobs(candidate.contenders(), candidate.case) if third_party.available() else {}
        driven = {name: background.call(job) for name, job in jobs.items()}
        with stage("tuning") as steps:
            comparison = candidate.comparison(steps)
        generated = comparison.build.generated
        counted = background.call(count, generated.files, generated.manifest) if count is not None else None
        with stage("driving") as steps:
            result = run_suite(
                comparison.tested, comparison.baselines, comparison.case, progress=lambda _, done, total: steps(done + 1, total)
            )
        outside, notes = _collect(driven, counted, stage)
    return FullSuite(result.with_outside(outside, limits), generated.edited, (*comparison.notes, *notes))


def _collect(
    driven: Mapping[str, AsyncResult[tuple[CellResult, ...]]], counted: AsyncResult[int] | None, stage: Stage
) -> tuple[ExternalFigures, list[str]]:
    cells, instructions, notes = {}, None, [] if driven else [THIRD_PARTY_MISSING]
    with stage("third party's plant and instructions") as steps:
        for done, (name, found) in enumerate(driven.items(), start=1):
            try:
                cells[name] = found.get()
            except CodegenError as error:
                notes.append(f"{name} was not simulated on the third party's plant: {error}")
            steps(done, len(driven) + 1)
        if counted is not None:
            try:
                instructions = counted.get()
            except CodegenError as error:
                notes.append(f"the instructions of a step were not counted: {error}")
        steps(len(driven) + 1, len(driven) + 1)
    return ExternalFigures(cells, instructions), notes
