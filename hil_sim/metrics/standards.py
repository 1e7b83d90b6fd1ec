"""Rows of the scenarios whose figures a standard defines: step steer and sine with dwell. `codegen.metrics` computes them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.metrics.runs import Runs
from codegen.metrics.sine import DISPLACEMENT, RATIOS, SineWithDwell, displacement_min
from codegen.metrics.step import SlipOfBound, StepResponse
from codegen.text import distinct
from hil_sim.metrics.run import Metric, Run, common, rows_of


def step_metrics(
    record: FloatArray, steer_time: float, steering_ratio: float = 1.0, map_yaw_rate: float | None = None
) -> dict[str, Any]:
    """Return the figures of a recording (samples, 12), see `StepResponse`; None for those that the run does not have.

    Args:
        steer_time: time in s at which the driver starts to steer.
        steering_ratio: ratio of steering wheel to road wheel; 1 gives the gain of the front angle.
        map_yaw_rate: steady yaw rate of the map at the end of the run, in rad/s; None where it is not known.
    """
    runs = Runs.of_record(record, steer_time, steering_ratio=steering_ratio, map_yaw_rate=map_yaw_rate)
    return StepResponse(runs).of_one()


def measure_step(run: Run) -> list[Metric]:
    """Return the step response."""
    return [*rows_of(StepResponse(run.runs)), *rows_of(SlipOfBound(run.runs))]


def measure_sine_with_dwell(run: Run) -> list[Metric]:
    """Return the yaw-rate ratios, the lateral displacement, and whether they meet the criteria."""
    rows = rows_of(SineWithDwell(run.runs))
    needed = f" (at least {displacement_min(run.config.vehicle.mass_kg):g})"
    return [*(replace(row, title=row.title + needed) if row.key == DISPLACEMENT else row for row in rows), *common(run)]


def missed_criteria(values: Mapping[str, float | bool | None], config: Config) -> Iterator[str]:
    """Yield each criterion that figures of a sine with dwell, by key, miss: the measured value and its limit."""
    displacement, needed = values.get(DISPLACEMENT), float(displacement_min(config.vehicle.mass_kg))
    if displacement is not None and displacement < needed:
        yield f"displacement {distinct(displacement, needed, 3)} m (at least {needed:g} m)"
    for key, (after, limit) in RATIOS.items():
        ratio = values.get(key)
        if ratio is not None and ratio > limit:
            yield f"yaw-rate ratio {distinct(ratio, limit, 3)} % after {after:g} s (at most {limit:g} %)"
