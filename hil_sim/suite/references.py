"""`codegen suite references`: the same controller on the maps of several references, in the cells of the test set.

`codegen tune` determines the controller for the map under test, and all maps get the same one: tuned for a map of its own, it
would differ, because tuning drives only turns that the map has. The cells are those of the map under test too, so that all cars
get the same steering. The passive car is driven as well. A reference whose map is that of another one is not driven again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import BoolArray
from codegen.configuration import REFERENCE_CASES, Config
from codegen.emit.laws import LAWS
from codegen.map_file.map import ReferenceMap
from codegen.optimum.solve import solve_case
from codegen.optimum.turns import turns_behind
from codegen.units import KM_H
from hil_sim.suite.cells import Cell, Condition, front_angle
from hil_sim.suite.full_suite import Stage, unseen
from hil_sim.suite.subjects import PASSIVE, Candidate, of_config, tuned
from hil_sim.suite.tracking import SuiteResult, run_suite

INSIDE = 1.0 - 1e-9
"""Fraction of a front angle at which a cell is asked for, because rounding decides whether an edge is feasible."""


@dataclass(frozen=True)
class ReferencesResult:
    """Results of the comparison.

    Attributes:
        suite: results of the test set; its subjects are the cases, the one under test first, and the passive car.
        maps: the map of each driven case.
        same_as: case that was not driven, and the driven one with the same map.
        feasible_percent: feasible part of the grid, for each subject.
        inside: (cells,) for each subject, whether the reference itself has a turn in that cell.
    """

    suite: SuiteResult
    maps: Mapping[str, ReferenceMap]
    same_as: Mapping[str, str]
    feasible_percent: Mapping[str, float]
    inside: Mapping[str, BoolArray]

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        inside = {name: [bool(one) for one in values] for name, values in self.inside.items()}
        facts = {"same_as": dict(self.same_as), "feasible_percent": dict(self.feasible_percent), "inside": inside}
        skipped = ("passed", "limits", "requirements", "instructions", "third_party")  # of a controller, not of a reference
        return {**facts, **{key: value for key, value in self.suite.to_dict().items() if key not in skipped}}


def compared_cases(config: Config, tested: str) -> tuple[str, ...]:
    """Return the case under test, the other cases of the configuration with rear steering, and REFERENCE_CASES."""
    own = (name for name, case in config.cases.items() if case.rear_steering)
    return tuple(dict.fromkeys((tested, *own, *REFERENCE_CASES)))


def run_references(candidate: Candidate, stage: Stage = unseen, chosen: Sequence[Condition] | None = None) -> ReferencesResult:
    """Solve and build all cases of a candidate's configuration, tune the controller for the first one, and drive them.

    Args:
        stage: progress display, such as `codegen.console.progress`.
        chosen: conditions; by default all that apply.

    Raises:
        CodegenError: solving, tuning, building or compiling fails.
    """
    config = candidate.config
    maps: dict[str, ReferenceMap] = {}
    same_as: dict[str, str] = {}
    for name in compared_cases(config, candidate.case):
        solved = solve_case(config, name)
        twin = next((other for other, known in maps.items() if _is_same(solved, known)), None)
        if twin is None:
            maps[name] = solved
        else:
            same_as[name] = twin
    if LAWS[config.controller.kind].scheduled:
        with stage("tuning") as steps:
            config = tuned(maps[candidate.case], config, steps)
    subjects = [of_config(name, solved, config, candidate.precision) for name, solved in maps.items()]
    with stage("driving") as steps:
        suite = run_suite(
            subjects[0],
            subjects[1:],
            config.case(candidate.case),
            chosen=chosen,
            progress=lambda _, done, total: steps(done + 1, total),
        )
    feasible = {name: 100.0 * float(one.feasible.mean()) for name, one in maps.items()}
    inside = {name: _inside(one, suite.cells) for name, one in maps.items()}
    passive = turns_behind(maps[candidate.case])
    assert passive is not None  # it was solved here
    straight = passive.without_rear_steering()
    first = maps[candidate.case]
    feasible[PASSIVE] = 100.0 * float(straight.solve(first.speed, first.front_angle).feasible.mean())
    inside[PASSIVE] = straight.at(*_axes(suite.cells)).feasible
    return ReferencesResult(suite, maps, same_as, feasible, inside)


def _is_same(one: ReferenceMap, other: ReferenceMap) -> bool:
    """Return whether two maps on one grid have the same yaw rates and rear angles."""
    pairs = ((one.yaw_rate, other.yaw_rate), (one.rear_angle, other.rear_angle))
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs if a is not None and b is not None)


def _axes(cells: Sequence[Cell]) -> tuple[Any, Any]:
    """Return speeds in m/s and front angles in rad, (cells,) each."""
    return np.array([cell.speed_km_h * KM_H for cell in cells]), INSIDE * np.array([front_angle(cell) for cell in cells])


def _inside(reference_map: ReferenceMap, cells: Sequence[Cell]) -> BoolArray:
    turns = turns_behind(reference_map)
    assert turns is not None  # it was solved here
    return turns.at(*_axes(cells)).feasible
