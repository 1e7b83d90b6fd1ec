"""Run the whole test set for a controller and its baselines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

from codegen.arrays import FloatArray
from codegen.configuration import Case, Config
from codegen.design.family import members
from codegen.design.gains import breakpoints
from hil_sim.suite.cells import NOMINAL, Cell, Condition, c1, cells, conditions, lags
from hil_sim.suite.controller_properties import (
    FamilyMargins,
    RiseTime,
    SineTracking,
    TimingError,
    margins_of,
    rise_times,
    sine_tracking,
    timing_errors,
)
from hil_sim.suite.requirements import Limits, Measured, Requirement, all_passed, requirements
from hil_sim.suite.runs import (
    FEEDFORWARD,
    THIRD_PARTY,
    CellResult,
    Summary,
    drive,
    map_yaw_rate,
    path_errors,
    run_table,
    summarise,
)
from hil_sim.suite.subjects import PASSIVE, Subject, passive_of

SHOWN = ((60.0, 0.75), (100.0, 0.75))
"""Speed (km/h) and share of the cells that are kept for pictures, beside the last one."""

STRUCTURE_SET = (
    "the structure of the law and its other parameters were chosen on step steers of the nonlinear plant at 30, 50, 70, 90 and "
    "110 km/h with 35, 65 and 95 % of the largest feasible front angle; one was last set with the test in view, the margin of "
    "the model over the road's lateral acceleration (friction 0.6)"
)
"""Description of the cars and cells used in the design."""

Results = Mapping[str, Mapping[str, tuple[CellResult, ...]]]
"""Name of the subject to name of the condition to a result for each cell."""

Progress = Callable[[str, int, int], None]
"""Progress callback: current subject, finished subjects, all subjects."""


@dataclass(frozen=True)
class ExternalFigures:
    """Figures measured elsewhere; missing ones leave their rows unmeasured.

    Attributes:
        third_party: name of the subject to its cells on the third party's plant.
        instructions: worst-case instructions of a step of the subject under test.
    """

    third_party: Mapping[str, Sequence[CellResult]] = field(default_factory=dict)
    instructions: int | None = None


@dataclass(frozen=True)
class CellRuns:
    """Recordings for a plot.

    Attributes:
        cell: cell of the recordings.
        map_yaw_rate: yaw rate of the map in rad/s.
        records: name of the subject to recording (samples, 12), columns RECORD_COLUMNS.
    """

    cell: Cell
    map_yaw_rate: float
    records: Mapping[str, FloatArray]


@dataclass(frozen=True)
class SuiteResult:
    """Results of the test set.

    Attributes:
        tested: name of the subject under test; `subjects` are all, it first, the passive car last.
        cells, conditions: the test set.
        design_set: description of the cars used in the design.
        results, c1: each subject in each cell under each condition; the paper's step for each lag.
        shown: recordings as configured: the paper's step first, then some of the cells.
        margins: margins of the subjects with feedback.
        rise_times, sine: rise times over speed, and tracking of a sine.
        timing: errors of each controlled subject under a yaw moment, by timing of its frames.
        path_errors: rms error in m of each subject in each scenario with a driver; None for a car that spins.
        third_party: each subject on the third party's plant.
        instructions: worst-case instructions of a step of the subject under test; None if not counted.
        requirements: required and measured figures. limits: required values.
        actuator_lag_s, delay_samples: lag of the actuator, and delay of the commands, of the configured car.
    """

    tested: str
    subjects: tuple[str, ...]
    cells: tuple[Cell, ...]
    conditions: tuple[Condition, ...]
    design_set: str
    results: Results
    c1: Mapping[str, Mapping[str, CellResult]]
    shown: tuple[CellRuns, ...]
    margins: Mapping[str, FamilyMargins]
    rise_times: Mapping[str, tuple[RiseTime, ...]]
    sine: Mapping[str, tuple[SineTracking, ...]]
    timing: Mapping[str, Mapping[str, TimingError]] = field(default_factory=dict)
    path_errors: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    third_party: Mapping[str, tuple[CellResult, ...]] = field(default_factory=dict)
    instructions: int | None = None
    requirements: tuple[Requirement, ...] = ()
    limits: Limits = field(default_factory=Limits)
    actuator_lag_s: float = 0.05
    delay_samples: int = 1

    @property
    def delay_text(self) -> str:
        """Delay of the commands in words."""
        return "one sample of delay" if self.delay_samples == 1 else f"{self.delay_samples} samples of delay"

    @property
    def passed(self) -> bool:
        """Whether the subject under test meets all that was measured, stretch goals aside."""
        return all_passed(self.requirements)

    def summary(self, subject: str, condition: str) -> Summary:
        """Return the figures over all cells. Raises KeyError for an unknown subject or condition."""
        return summarise(subject, condition, self.results[subject][condition])

    def third_party_summary(self, subject: str) -> Summary:
        """Return the figures over the third party's cells. Raises KeyError if they were not run."""
        return summarise(subject, THIRD_PARTY, self.third_party[subject])

    def with_outside(self, outside: ExternalFigures, limits: Limits | None = None) -> SuiteResult:
        """Return the result with external figures and the requirements evaluated on all; `limits` None keeps its own."""
        limits = limits or self.limits
        third_party = {name: tuple(rows) for name, rows in outside.third_party.items()}
        full = replace(self, third_party=third_party, instructions=outside.instructions, limits=limits)
        measured = Measured(
            summaries={name: summarise(self.tested, name, rows) for name, rows in self.results[self.tested].items()},
            c1=self.c1[self.tested],
            margins=self.margins.get(self.tested),
            third_party=full.third_party_summary(self.tested) if self.tested in third_party else None,
            instructions=outside.instructions,
            timing=self.timing.get(self.tested, {}),
            path_errors=self._beside_feedforward(),
            actuator_lag_s=self.actuator_lag_s,
            results=self.results[self.tested],
            feedforward=self.results.get(FEEDFORWARD, {}),
            feedforward_c1=self.c1.get(FEEDFORWARD, {}),
            limits=limits,
        )
        return replace(full, requirements=requirements(measured))

    def _beside_feedforward(self) -> dict[str, tuple[float | None, float | None]]:
        """Return the path errors of the subject under test and of the feedforward; empty if that was not run."""
        own, beside = self.path_errors.get(self.tested, {}), self.path_errors.get(FEEDFORWARD)
        return {} if beside is None else {name: (error, beside[name]) for name, error in own.items()}

    def summaries(self) -> tuple[Summary, ...]:
        """Return the summaries by condition, then by subject."""
        return tuple(self.summary(subject, condition.name) for condition in self.conditions for subject in self.subjects)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values, without the recordings."""
        return {
            "tested": self.tested,
            "passed": self.passed,
            "subjects": list(self.subjects),
            "delay_samples": self.delay_samples,
            "cells": [cell.to_dict() for cell in self.cells],
            "conditions": [condition.to_dict() for condition in self.conditions],
            "design_set": self.design_set,
            "structure_set": STRUCTURE_SET,
            "instructions": self.instructions,
            "actuator_lag_s": self.actuator_lag_s,
            "limits": self.limits.model_dump(),
            "requirements": [row.to_dict() for row in self.requirements],
            "summaries": [summary.to_dict() for summary in self.summaries()],
            "c1": {name: {key: found.to_dict() for key, found in runs.items()} for name, runs in self.c1.items()},
            "margins": {name: found.to_dict() for name, found in self.margins.items()},
            "rise_times": {name: [row.to_dict() for row in rows] for name, rows in self.rise_times.items()},
            "sine": {name: [row.to_dict() for row in rows] for name, rows in self.sine.items()},
            "timing": {name: {key: found.to_dict() for key, found in runs.items()} for name, runs in self.timing.items()},
            "path_errors": {name: dict(errors) for name, errors in self.path_errors.items()},
            "third_party": {name: [found.to_dict() for found in rows] for name, rows in self.third_party.items()},
            "results": {
                subject: {name: [found.to_dict() for found in rows] for name, rows in tables.items()}
                for subject, tables in self.results.items()
            },
        }


def design_set(config: Config) -> str:
    """Describe the cars on which `codegen tune` designs the gains; no cell of the test set is among them."""
    speeds = [point.speed_km_h for point in breakpoints(config)]
    return (
        f"{len(members(config))} linear single-track cars at {len(speeds)} speeds from {speeds[0]:g} to {speeds[-1]:g} km/h: "
        "margins of the loop, no step steer and no nonlinear plant"
    )


def run_suite(
    tested: Subject,
    baselines: Sequence[Subject],
    case: Case,
    *,
    chosen: Sequence[Condition] | None = None,
    outside: ExternalFigures | None = None,
    progress: Progress | None = None,
) -> SuiteResult:
    """Run every subject and the passive car in every cell under every condition.

    Args:
        tested: subject of the requirements.
        baselines: other subjects, with unique names. The passive car is added if missing.
        case: case of the map, which determines the largest feasible front angles.
        chosen: conditions; default: all that apply to the configuration.
        progress: called for a progress bar.

    Raises:
        CodegenError: the C does not compile, or the configuration has no such cells.
    """
    subjects = [tested, *baselines]
    if all(subject.controlled for subject in subjects):
        subjects.append(passive_of(tested))
    names = tuple(subject.name for subject in subjects)
    if len(set(names)) != len(names):
        raise ValueError(f"two subjects have one name: {', '.join(names)}")
    config, nominal = tested.config, NOMINAL.name
    points, under = cells(config, case), conditions(config) if chosen is None else tuple(chosen)
    results = _all_tables(subjects, under, points, progress)
    step, driven = c1(config), lags(config.rear_actuator.lag_s)
    measured = SuiteResult(
        tested=tested.name,
        subjects=names,
        cells=points,
        conditions=under,
        design_set=design_set(config),
        results=results,
        c1={subject.name: {name: row[0] for name, row in run_table(subject, driven, [step]).items()} for subject in subjects},
        shown=tuple(
            CellRuns(cell, map_yaw_rate(tested, NOMINAL, cell), {each.name: drive(each, NOMINAL, cell) for each in subjects})
            for cell in (step, *_some(points))
        ),
        margins={subject.name: found for subject in subjects if subject.controlled and (found := margins_of(subject.config))},
        rise_times={name: rise_times(name, tables[nominal]) for name, tables in results.items() if nominal in tables},
        sine={subject.name: sine_tracking(subject, points) for subject in subjects},
        path_errors={subject.name: path_errors(subject) for subject in subjects},
        timing={subject.name: timing_errors(subject) for subject in subjects if subject.controlled},
        actuator_lag_s=config.rear_actuator.lag_s,
        delay_samples=config.driven_delay_samples,
    )
    return measured.with_outside(ExternalFigures() if outside is None else outside)


def _some(points: Sequence[Cell]) -> tuple[Cell, ...]:
    """Return the cells of SHOWN that the test set has, and its last one."""
    return (*(cell for cell in points[:-1] if (cell.speed_km_h, cell.share) in SHOWN), points[-1])


def _all_tables(
    subjects: Sequence[Subject], under: Sequence[Condition], points: Sequence[Cell], progress: Progress | None
) -> dict[str, dict[str, tuple[CellResult, ...]]]:
    results = {}
    with ThreadPoolExecutor() as pool:  # compiler and C run without the interpreter's lock
        tables = [(subject, pool.submit(run_table, subject, under, points)) for subject in subjects]
        for done, (subject, table) in enumerate(tables):
            if progress is not None:
                progress(subject.name, done, len(tables))
            results[subject.name] = table.result()
    return results


__all__ = ["PASSIVE", "ExternalFigures", "Progress", "Results", "SuiteResult", "design_set", "run_suite"]
