"""Run the whole suite: the candidate and its baselines in every cell, the nine cells on the third party's multi-body car, and
the instructions of a step."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from multiprocessing.pool import AsyncResult
from typing import Any

from codegen.configuration import Config
from codegen.emit.laws import LAWS
from codegen.errors import CodegenError
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.requirements import pip_install
from codegen.sil.software import Software
from codegen.units import KM_H
from hil_sim.suite.background import Background
from hil_sim.suite.cells import Cell
from hil_sim.suite.requirements import Limits
from hil_sim.suite.runs import THIRD_PARTY, CellResult, judge
from hil_sim.suite.subjects import PASSIVE, Candidate, Steps, baseline_configs, of_config, tuned
from hil_sim.suite.tracking import ExternalFigures, SuiteResult, run_suite


def has_third_party() -> bool:
    """Return whether the package of the third party's plant is installed."""
    return importlib.util.find_spec("vehiclemodels") is not None


def third_party_cells(
    reference_map: ReferenceMap,
    config: Config,
    software: Software,
    *,
    controlled: bool = True,
) -> tuple[CellResult, ...]:
    """Run and evaluate the cells.

    Args:
        reference_map, config: map and configuration of that car (`hil_sim.second_plant.car_of`), solved and tuned for it.
        software: build of both.
        controlled: False for the passive car.

    Raises:
        CodegenError: the third party's package is missing.
    """
    from hil_sim import second_plant
    from hil_sim.second_plant.run import STEER_TIME

    results = []
    for driven in second_plant.cells(reference_map):
        cell = Cell(driven.speed_km_h, math.degrees(driven.front_angle), driven.share)
        record = second_plant.run(software if controlled else None, config, driven.scenario)
        asked = float(software.map_yaw_rate(cell.speed_km_h * KM_H, driven.front_angle))
        results.append(judge(record, cell, THIRD_PARTY, asked, STEER_TIME))
    return tuple(results)


@dataclass(frozen=True)
class Job:
    """A subject to drive on the third party's plant: its configuration, for a car of its own, and the case of its map."""

    config: Config
    case: str
    controlled: bool = True

    def __call__(self) -> tuple[CellResult, ...]:
        """Solve, tune and build for the third party's car, and simulate it.

        Raises:
            CodegenError: the package is missing, the map does not reach the cells, or solving, tuning or building fails.
        """
        from hil_sim import second_plant

        config = second_plant.car_of(second_plant.published(), self.config)
        reference_map = solve_case(config, self.case)
        if not self.controlled:
            config = baseline_configs(config)["pi"]  # any controller; only its map is used
        elif LAWS[config.controller.kind].scheduled:
            config = tuned(reference_map, config)
        software = of_config(THIRD_PARTY, reference_map, config).around(config)
        return third_party_cells(reference_map, config, software, controlled=self.controlled)


def third_party_jobs(contenders: Mapping[str, Config], case: str) -> dict[str, Job]:
    """Return the cells of each contender (name -> configuration) and of the passive car."""
    driven = {name: Job(config, case) for name, config in contenders.items()}
    return {**driven, PASSIVE: Job(next(iter(contenders.values())), case, controlled=False)}


Stage = Callable[[str], AbstractContextManager[Steps]]
"""Function from the title of a stage to a context with its progress callback."""

Count = Callable[[Mapping[str, bytes], Mapping[str, Any]], int]
"""Function from files and manifest of a build to the worst-case instructions of a step; called in another process."""


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
        jobs = third_party_jobs(candidate.contenders(), candidate.case) if has_third_party() else {}
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
    cells, instructions, notes = {}, None, []
    if not driven:
        remedy = pip_install("commonroad-vehicle-models")
        notes.append(f"the third party's plant is not installed, so its rows are not measured; {remedy}")
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
