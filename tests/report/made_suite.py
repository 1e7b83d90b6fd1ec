"""A synthetic result of the test suite: no simulation, every figure is known."""

from dataclasses import replace
from typing import Any

import numpy as np

from hil_sim.scenarios import PATH_SCENARIOS
from hil_sim.suite.cells import (
    CELL_ANGLE_SHARES,
    CELL_DURATION,
    CELL_SPEEDS_KM_H,
    CELL_STEER_TIME,
    NOMINAL,
    Cell,
    conditions,
    lags,
)
from hil_sim.suite.controller_properties import (
    SINE_FREQUENCIES_HZ,
    TIMINGS,
    FamilyMargins,
    MarginPoint,
    SineTracking,
    TimingError,
    rise_times,
)
from hil_sim.suite.runs import CellResult
from hil_sim.suite.tracking import CellRuns, ExternalFigures, SuiteResult
from tests import builds
from tests.hil_sim import made as recordings

SUBJECTS = ("tracking", "pi", "feedforward", "proportional", "passive")
LAGS, CONDITIONS = lags(builds.CONFIG.rear_actuator.lag_s), conditions(builds.CONFIG)
CELLS = tuple(Cell(speed, share * 200.0 / speed, share) for speed in CELL_SPEEDS_KM_H for share in CELL_ANGLE_SHARES)
OVERSHOOT = {"tracking": 1.0, "pi": 20.0, "feedforward": 4.0, "proportional": 5.0, "passive": 8.0}
"""% at the smallest share, and in proportion to the share elsewhere."""
RISE = {"tracking": 0.3, "pi": 0.25, "feedforward": 0.28, "proportional": 0.31, "passive": 0.33}


def cell_result(subject: str, cell: Cell, condition: str, **figures: Any) -> CellResult:
    """Return a result with every figure; the controller under test meets all requirements."""
    values = {
        "spun_at_s": None,
        "settled": True,
        "overshoot_percent": OVERSHOOT[subject]
        * (cell.share or 1.0)
        / CELL_ANGLE_SHARES[0]
        * (0.5 if subject == "tracking" else 1.0),
        "rise_time_s": RISE[subject],
        "settling_time_s": 0.5,
        "sideslip_max_deg": 2.5,
        "yaw_rate_steady_deg_s": 20.0,
        "map_error_percent": -1.0,
        "map_overshoot_percent": 0.5,
        "slip_percent": 90.0,
        "sideslip_excess_deg": 0.1,
    }
    return CellResult(cell=cell, condition=condition, **{**values, **figures})


def spun(subject: str, cell: Cell, condition: str) -> CellResult:
    """Return the result of a car that spins after 1.5 s."""
    names = ("overshoot_percent", "rise_time_s", "settling_time_s", "sideslip_max_deg", "yaw_rate_steady_deg_s")
    names += ("map_error_percent", "map_overshoot_percent", "slip_percent", "sideslip_excess_deg")
    return cell_result(subject, cell, condition, spun_at_s=1.5, settled=False, **dict.fromkeys(names))


def table(subject: str, condition: str) -> tuple[CellResult, ...]:
    """Return a table of results.

    The passive car spins in the last three cells. On slippery roads the PI does too, and never settles in the fourth cell.
    """
    results = [cell_result(subject, cell, condition) for cell in CELLS]
    slippery = condition.startswith("friction")
    if subject == "passive" or (subject == "pi" and slippery):
        results[-3:] = [spun(subject, cell, condition) for cell in CELLS[-3:]]
    if subject == "pi" and slippery:
        results[3] = replace(results[3], settled=False, settling_time_s=None)
    return tuple(results)


def record(subject: str) -> np.ndarray:
    """Return the record of a step; the passive car spins one second after it."""
    late = np.clip(np.arange(round(CELL_DURATION / 0.01)) * 0.01 - CELL_STEER_TIME, 0.0, None)
    place = SUBJECTS.index(subject)
    step = recordings.record(
        CELL_DURATION,
        speed_m_s=30.0,
        front_angle_rad=0.05 * (late > 0.0),
        yaw_rate_rad_s=0.3 * (1.0 - np.exp(-late * (5.0 + place))) * (1.0 + 0.1 * place),
        yaw_rate_reference_rad_s=0.3 * (1.0 - np.exp(-6.0 * late)),
        sideslip_rad=0.01 * place * (1.0 - np.exp(-3.0 * late)),
        rear_angle_rad=0.02 * (1.0 - np.exp(-6.0 * late)) * (subject != "passive"),
    )
    return recordings.spun(step, CELL_STEER_TIME + 1.0) if subject == "passive" else step


def margins(*, stable: bool) -> FamilyMargins:
    """Return good margins, or those of a loop that is unstable at the highest of three speeds."""
    own = tuple(MarginPoint(speed, 20.0, 80.0, 1.2, True) for speed in (20.0, 60.0, 120.0))
    worst = (MarginPoint(20.0, 8.5, 60.0, 1.6, True), MarginPoint(60.0, 8.5, 46.0, 1.7, True))
    last = MarginPoint(120.0, 9.0, 47.0, 1.75, True) if stable else MarginPoint(120.0, 0.0, 0.0, None, False)
    return FamilyMargins((*worst, last), own)


def sines(subject: str) -> tuple[SineTracking, ...]:
    """Return the figures of a car that lags by its rise time; the passive one spins at the last speed."""

    def one(speed: float, frequency: float) -> SineTracking:
        if subject == "passive" and speed == 120.0:
            return SineTracking(subject, speed, frequency, None, None, None)
        return SineTracking(subject, speed, frequency, 0.9, 0.9, -100.0 * RISE[subject] * frequency)

    return tuple(one(speed, frequency) for speed in (100.0, 120.0) for frequency in SINE_FREQUENCIES_HZ)


def third_party() -> dict[str, tuple[CellResult, ...]]:
    """Return results in nine cells; the PI spins in the last."""
    nine = tuple(Cell(speed, 300.0 * share / speed, share) for speed in (40.0, 70.0, 100.0) for share in (0.3, 0.6, 0.9))
    driven = {name: tuple(cell_result(name, cell, "third-party") for cell in nine) for name in SUBJECTS}
    return {**driven, "pi": (*driven["pi"][:-1], spun("pi", nine[-1], "third-party"))}


def made(**changes: Any) -> SuiteResult:
    """Return the result of a controller that meets every requirement, with baselines that do not; fields may be changed."""
    results = {name: {condition.name: table(name, condition.name) for condition in CONDITIONS} for name in SUBJECTS}
    step = Cell(42.5, 6.75)
    values: dict[str, Any] = {
        "timing": {name: {timing: TimingError(1e-4, 0.01) for timing in TIMINGS} for name in SUBJECTS if name != "passive"},
        "path_errors": {name: dict.fromkeys(PATH_SCENARIOS, 0.1) for name in SUBJECTS},
        "tested": "tracking",
        "subjects": SUBJECTS,
        "cells": CELLS,
        "conditions": CONDITIONS,
        "design_set": "243 linear cars",
        "results": results,
        "c1": {name: {lag.name: cell_result(name, step, lag.name) for lag in LAGS} for name in SUBJECTS},
        "shown": tuple(
            CellRuns(cell, 0.3, {name: record(name) for name in SUBJECTS}) for cell in (step, CELLS[10], CELLS[18], CELLS[-1])
        ),
        "margins": {"tracking": margins(stable=True), "pi": margins(stable=False)},
        "rise_times": {name: rise_times(name, results[name][NOMINAL.name]) for name in SUBJECTS},
        "sine": {name: sines(name) for name in SUBJECTS},
    }
    return SuiteResult(**{**values, **changes}).with_outside(ExternalFigures(third_party(), 1040))


def with_table(result: SuiteResult, subject: str, condition: str, rows: tuple[CellResult, ...]) -> SuiteResult:
    """Replace a table and evaluate the requirements again."""
    tables = {**result.results[subject], condition: rows}
    changed = replace(result, results={**result.results, subject: tables})
    return changed.with_outside(ExternalFigures(result.third_party, result.instructions))
