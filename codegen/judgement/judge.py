"""One function judges a car: is it better with the controller than without, and where is it not?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.lead import compile_controller
from codegen.design.tune import Tuned, tuned_parameters
from codegen.emit.laws import is_untuned
from codegen.errors import CodegenError
from codegen.judgement.bench import Bench
from codegen.judgement.drives import DWELL_KM_H, drive_dwells, drive_sines, drive_steps, drive_sweep
from codegen.judgement.lane_change import lane_change_figures
from codegen.judgement.model import Judgement, Row
from codegen.judgement.rows import (
    dwell_rows,
    lane_change_rows,
    peak_rows,
    sine_rows,
    steady_rows,
    step_rows,
    sweep_row,
)
from codegen.judgement.steady import steady_figures
from codegen.map_file import judged
from codegen.map_file.map import ReferenceMap
from codegen.sil.batch import BatchSoftware
from codegen.units import KM_H
from hil_sim.scenarios import DEFAULT_SCENARIO, SCENARIOS

NO_MAP = "the map is not in the build, so only its drives are judged"
UNTUNED = "the controller has no gains yet, so only the map is judged; next: `codegen tune`"


def judge(
    reference_map: ReferenceMap,
    config: Config,
    software: BatchSoftware | None = None,
    parameters: Any = None,
    progress: Callable[[int, int], None] | None = None,
) -> Judgement:
    """Judge a car on a dry road: its map against the passive car's steady turns, and drives with and without the controller.

    The same input gives the same figures. Nothing is written.

    Args:
        reference_map: the map of the controller.
        config: the car, and the controller with its gains. Without gains only the map is judged.
        software: the build, compiled for batches; None compiles it.
        parameters: parameters of the controller; None uses the build's.
        progress: called with (done, in all).

    Raises:
        CodegenError: the build fails, or the car has no steady turns at the speeds of the map.
    """
    steady = steady_figures(reference_map, config)
    rows, notes = [*steady_rows(steady)], [UNTUNED]
    if not is_untuned(config):
        if software is None:
            software = compile_controller(reference_map, config)
        driven, notes = drive(Bench(software, config, parameters), reference_map.speed, progress, reference_map)
        rows += driven
    return Judgement(
        inputs_sha256=judged.inputs_sha256(reference_map, config),
        sentence=sentence(rows),
        rows=tuple(rows),
        binding_percent={name: round(share, 2) for name, share in steady.binding_percent.items()},
        notes=tuple(notes),
    )


def judge_tuned(reference_map: ReferenceMap, tuned: Tuned, progress: Callable[[int, int], None] | None = None) -> Judgement:
    """Judge a map with its tuned controller as `judge`, with the build that was tuned."""
    config, software = tuned.config, tuned.software
    if software is None:
        return judge(reference_map, config, progress=progress)
    return judge(reference_map, config, software, tuned_parameters(software, config), progress)


def judge_build(
    software: BatchSoftware,
    map_speed: FloatArray,
    reference_map: ReferenceMap | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Judgement:
    """Judge the C of a build as `judge`; without its map only by drives, within the speeds (n,) in m/s of its table."""
    if reference_map is not None:
        return judge(reference_map, software.config, software, None, progress)
    rows, notes = drive(Bench(software, software.config), map_speed, progress)
    return Judgement(sentence=sentence(rows), rows=tuple(rows), notes=(NO_MAP, *notes))


PARTS = 5
"""Steps of the progress."""
FAULTS_NAMED, GAINS_NAMED = 4, 3
"""Figures that the sentence names; the others are in the table."""


def drive(
    bench: Bench,
    map_speed: FloatArray,
    progress: Callable[[int, int], None] | None = None,
    reference_map: ReferenceMap | None = None,
) -> tuple[list[Row], list[str]]:
    """Return the rows of all drives within the speeds (n,) in m/s of a map, and what could not be driven.

    With the map, steps go to its limit too."""
    rows: list[Row] = []
    notes: list[str] = []
    tell = _nothing if progress is None else progress
    speed = map_speed[map_speed > 0.0]
    step = drive_steps(bench, speed, reference_map)
    tell(1, PARTS)
    if step is not None:
        base = SCENARIOS[DEFAULT_SCENARIO].settings.speed_km_h
        assert base is not None  # the default scenario has one
        rows += step_rows(step, base)
    sine = drive_sines(bench, speed)
    tell(2, PARTS)
    if sine is not None:
        rows += sine_rows(sine)
    dwell = None
    try:
        if speed[-1] < DWELL_KM_H * KM_H * (1.0 - 1e-9):
            raise CodegenError(f"the map ends below {DWELL_KM_H:g} km/h")
        dwell = drive_dwells(bench)
        rows += dwell_rows(dwell)
        tell(3, PARTS)
        rows.append(sweep_row(drive_sweep(bench)))
    except CodegenError as error:
        notes.append(f"the sine with dwell was not driven: {error.what}")
    tell(4, PARTS)
    lane_change = lane_change_figures(bench, last_km_h=float(speed[-1]) / KM_H * (1.0 + 1e-9))
    rows += lane_change_rows(lane_change)
    rows += peak_rows(bench.config, step, dwell, lane_change)
    tell(PARTS, PARTS)
    return rows, notes


def _nothing(done: int, total: int) -> None:
    """Report no progress."""
    del done, total


def sentence(rows: Sequence[Row]) -> str:
    """Return one sentence about the whole car."""
    worse, missed, better = (
        _list([row for row in rows if row.verdict == verdict], named)
        for verdict, named in (("worse", FAULTS_NAMED), ("missed", FAULTS_NAMED), ("better", GAINS_NAMED))
    )
    faults = " and ".join(
        text for found, text in ((worse, f"is worse in {worse}"), (missed, f"misses a criterion in {missed}")) if found
    )
    if faults and better:
        return f"With the controller, this car {faults}; it is better in {better}."
    if faults:
        return f"This car is not better with the controller than without: it {faults}."
    if better:
        return f"This car is better with the controller than without: in {better}. It is nowhere worse beyond the tolerances."
    return "This car is as good with the controller as without, and not better."


def _list(rows: Sequence[Row], count: int) -> str:
    named = ", ".join(row.short for row in rows[:count])
    return f"{named} and {len(rows) - count} more" if len(rows) > count else named
