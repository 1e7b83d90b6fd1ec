"""The whole suite: a candidate and its baselines in every cell, on the third party's plant, and the instructions of a step."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from multiprocessing.pool import AsyncResult
from typing import Any

from codegen.errors import CodegenError
from hil_sim.suite import third_party
from hil_sim.suite.background import Background
from hil_sim.suite.candidate import Candidate, Steps
from hil_sim.suite.limits import Limits
from hil_sim.suite.runs import CellResult
from hil_sim.suite.tracking import Outside, SuiteResult, run_suite

Stage = Callable[[str], AbstractContextManager[Steps]]
"""From the title of a stage of the work to where its steps are told."""

Count = Callable[[Mapping[str, bytes], Mapping[str, Any]], int]
"""From the files and the manifest of a build to the instructions of its worst step; called in a process of its own."""

THIRD_PARTY_MISSING = (
    'the third party\'s plant is not installed: pip install "ars-codegen[crosscheck]"; its rows are not measured'
)


@contextmanager
def unseen(title: str) -> Iterator[Steps]:
    """A stage that nobody watches."""

    def step(done: int, total: int) -> None:
        del done, total

    del title
    yield step


@dataclass(frozen=True)
class Whole:
    """The result, files of the tested build that were changed after it, and what the user should know beside them."""

    result: SuiteResult
    edited: tuple[str, ...]
    notes: tuple[str, ...]


def run_whole(candidate: Candidate, count: Count | None = None, stage: Stage = unseen, limits: Limits | None = None) -> Whole:
    """Everything in one call. What cannot be had from outside leaves a note, and its rows unmeasured.

    Args:
        count: instructions of a step; None leaves them out.
        stage: `codegen.console.progress`, or the like.
        limits: what is asked; None takes the defaults.

    Raises:
        CodegenError: what cannot be solved, tuned, built or compiled.
    """
    with Background() as background:
        jobs = third_party.jobs(candidate.contenders(), candidate.case) if third_party.available() else {}
        driven = {name: background.call(job) for name, job in jobs.items()}
        with stage("tuning") as steps:
            line_up = candidate.line_up(steps)
        generated = line_up.build.generated
        counted = background.call(count, generated.files, generated.manifest) if count is not None else None
        with stage("driving") as steps:
            result = run_suite(
                line_up.tested, line_up.baselines, line_up.case, progress=lambda _, done, total: steps(done + 1, total)
            )
        outside, notes = _collect(driven, counted, stage)
    return Whole(result.with_outside(outside, limits), generated.edited, (*line_up.notes, *notes))


def _collect(
    driven: Mapping[str, AsyncResult[tuple[CellResult, ...]]], counted: AsyncResult[int] | None, stage: Stage
) -> tuple[Outside, list[str]]:
    cells, instructions, notes = {}, None, [] if driven else [THIRD_PARTY_MISSING]
    with stage("third party's plant and instructions") as steps:
        for done, (name, found) in enumerate(driven.items(), start=1):
            try:
                cells[name] = found.get()
            except CodegenError as error:
                notes.append(f"{name} was not driven on the third party's plant: {error}")
            steps(done, len(driven) + 1)
        if counted is not None:
            try:
                instructions = counted.get()
            except CodegenError as error:
                notes.append(f"the instructions of a step were not counted: {error}")
        steps(len(driven) + 1, len(driven) + 1)
    return Outside(cells, instructions), notes
