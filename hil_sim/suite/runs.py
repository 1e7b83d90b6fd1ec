"""Run step steers and compute their figures: of each run, and over all cells of one subject under one condition."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.design.lead import unit_step
from codegen.metrics import Runs, SlipOfBound, StepResponse
from codegen.metrics.runs import spin_times
from codegen.sil.batch import Lanes, sensor_errors
from codegen.sil.software import RECORD_COLUMNS, Software
from codegen.units import KM_H
from codegen.vehicle.plant_car import plant_parameters
from codegen.vehicle.tyre import slip_bounds
from hil_sim.metrics import evaluate
from hil_sim.metrics.run import Figures
from hil_sim.scenarios import PATH_SCENARIOS
from hil_sim.suite.cells import CELL_DURATION, CELL_STEER_TIME, Cell, Condition, front_angle
from hil_sim.suite.subjects import Subject

SENSOR_SEED = 1
"""Seed of the sensors' errors in a condition that has them."""


@dataclass(frozen=True)
class CellResult(Figures):
    """Figures of one run. A car that spins has only the time of the spin.

    Attributes:
        cell, condition: what was driven, and the name of the condition.
        spun_at_s: s after the driver begins; None for a car that stays on the road.
        settled: whether the yaw rate is steady at the end, within 1 %.
        overshoot_percent: of the steady yaw rate, zero or more.
        rise_time_s: t90, s from the beginning of the steering to 90 % of the steady yaw rate.
        settling_time_s: s to where the yaw rate stays within 2 % of it; None where it does not settle.
        sideslip_max_deg: the largest |beta|.
        yaw_rate_steady_deg_s: mean over the last second.
        map_error_percent: error of that to the map's value at this speed, front angle and estimate of the friction; below
            zero where the car turns less.
        map_overshoot_percent: the same of the peak.
        slip_percent: steady slip of the axle that is nearer to its bound in the map, of that bound; None for tyres without.
        sideslip_excess_deg: how far |beta| goes beyond its bound in the map, or beyond its steady value where that is larger.
    """

    cell: Cell
    condition: str
    spun_at_s: float | None
    settled: bool
    overshoot_percent: float | None
    rise_time_s: float | None
    settling_time_s: float | None
    sideslip_max_deg: float | None
    yaw_rate_steady_deg_s: float | None
    map_error_percent: float | None
    map_overshoot_percent: float | None
    slip_percent: float | None = None
    sideslip_excess_deg: float | None = None

    @property
    def spun(self) -> bool:
        """Whether the car left the road."""
        return self.spun_at_s is not None


@functools.lru_cache(maxsize=256)
def software_of(subject: Subject, condition: Condition) -> Software:
    """Return the subject's controller around the plant of a condition; its `config` is the plant's. Raises BuildError,
    ConfigError."""
    return subject.around(condition.plant(subject.config))


def drive(subject: Subject, condition: Condition, cell: Cell, delay_samples: int | None = None) -> FloatArray:
    """Return the recording (samples, 12), columns RECORD_COLUMNS, of a subject in a cell, its sensors without errors.

    Raises:
        BuildError, ConfigError: as `software_of`.
    """
    software = software_of(subject, condition)
    scenario = cell.scenario(software.config, condition.friction, condition.estimate)
    return subject.loop(software, delay_samples).run(scenario.inputs(software.config))


def judge(
    record: FloatArray,
    cell: Cell,
    condition: str,
    reference: float | None = None,
    steer_time: float = CELL_STEER_TIME,
    car: Config | None = None,
) -> CellResult:
    """Return the figures of a recording (samples, 12) of any plant.

    Args:
        reference: the map's yaw rate in rad/s; None if there is none.
        steer_time: time in s at which the driver begins.
        car: car with the bounds on slip and sideslip; None omits those figures.
    """
    bounds = None if car is None else slip_bounds(car)
    return _judge_all(Runs.of_record(record, steer_time, map_yaw_rate=reference, slip_bounds=bounds), [cell], condition, car)[0]


def _judge_all(runs: Runs, points: Sequence[Cell], condition: str, car: Config | None) -> tuple[CellResult, ...]:
    """Return the figures of runs, one for each cell; see `judge`."""
    step, spun_at = StepResponse(runs), spin_times(runs)
    columns = {
        "settled": step.settled,
        "overshoot_percent": np.maximum(step.overshoot_percent, 0.0),
        "rise_time_s": step.rise_time_s,
        "settling_time_s": step.settling_time_s,
        "sideslip_max_deg": step.sideslip_abs_max_deg,
        "yaw_rate_steady_deg_s": step.yaw_rate_steady_deg_s,
        "map_error_percent": step.map_error_percent,
        "map_overshoot_percent": step.map_overshoot_percent,
    }
    if car is not None:
        slip = SlipOfBound(runs)
        columns["slip_percent"] = np.maximum(slip.slip_front_steady_of_bound_percent, slip.slip_rear_steady_of_bound_percent)
        bound = np.maximum(np.abs(step.sideslip_steady_deg), car.limits.sideslip_max_deg)
        columns["sideslip_excess_deg"] = np.maximum(step.sideslip_abs_max_deg - bound, 0.0)
    results = []
    for place, (cell, spun) in enumerate(zip(points, spun_at.tolist(), strict=True)):
        if math.isnan(spun):
            values = {name: float(column[place]) for name, column in columns.items()}
            known: dict[str, Any] = {name: None if math.isnan(value) else value for name, value in values.items()}
            results.append(CellResult(cell, condition, None, **{**known, "settled": bool(known["settled"])}))
        else:
            results.append(CellResult(cell, condition, spun - runs.steer_time, False, *[None] * 7))
    return tuple(results)


def run_table(subject: Subject, under: Sequence[Condition], points: Sequence[Cell]) -> dict[str, tuple[CellResult, ...]]:
    """Return the results of a subject in all cells by name of the condition; the cells of a condition run at once.

    Each recording is that of `drive` but for rounding. Raises BuildError, ConfigError, and ValueError as `Subject.loop` does.
    """
    config, results = subject.config, {}
    speeds = np.array([cell.speed_km_h * KM_H for cell in points])
    angles = np.array([front_angle(cell) for cell in points])
    for condition in under:
        plant, estimate = condition.plant(config), condition.estimate_or_nan
        software = subject.around.batch(plant)
        profile = unit_step(config, CELL_STEER_TIME, CELL_DURATION)
        samples = profile.shape[0] // software.steps_per_sample
        lanes = Lanes(
            np.repeat([plant_parameters(plant)], len(points), axis=0),
            speed_factor=speeds,
            wheel_factor=angles * config.steering.ratio,
            friction=condition.friction,
            friction_estimate=estimate,
            delay_samples=plant.driven_delay_samples,
            controlled=subject.controlled,
            noise=sensor_errors(plant.sensors, samples, len(points), SENSOR_SEED) if condition.with_sensors else None,
        )
        records = software.run(profile, lanes, software.parameters(**subject.parameters))
        look_up = software.software.function("map_yaw_rate_on_road")
        runs = Runs(
            np.arange(records.shape[1], dtype=np.float64) * config.controller.sampling_time_s,
            dict(zip(RECORD_COLUMNS, records, strict=True)),
            CELL_STEER_TIME,
            slip_bounds=slip_bounds(plant),
            map_yaw_rate=np.array([look_up(*at, estimate) for at in zip(speeds.tolist(), angles.tolist(), strict=True)]),
        )
        results[condition.name] = _judge_all(runs, points, condition.name, plant)
    return results


def map_yaw_rate(subject: Subject, condition: Condition, cell: Cell) -> float:
    """Return the yaw rate in rad/s of the subject's map in a cell, with the controller's friction estimate."""
    software = software_of(subject, condition)
    return float(software.map_yaw_rate(cell.speed_km_h * KM_H, front_angle(cell), condition.estimate_or_nan))


FEEDFORWARD = "feedforward"
"""Baseline of controllers with feedback."""
THIRD_PARTY = "third-party"
"""Condition of the cells on the third party's plant."""


def path_errors(subject: Subject) -> dict[str, float | None]:
    """Return scenario name -> rms path error in m; None for a car that spins. Raises BuildError."""
    software, config = subject.around(subject.config), subject.config
    errors = {}
    for name, scenario in PATH_SCENARIOS.items():
        driver = scenario.driver(config)
        assert driver is not None  # every scenario of this table has a path
        record = subject.loop(software).run_stepped(scenario.inputs(config), driver.steer)
        found = evaluate(scenario, config, {name: record}).runs[name]["path_error_rms_m"]
        errors[name] = None if found is None else float(found)
    return errors


@dataclass(frozen=True)
class Extreme:
    """A figure and the cell that has it."""

    value: float
    cell: Cell


@dataclass(frozen=True)
class Summary(Figures):
    """Figures over the cells in which the car does not spin; None if there is none.

    Attributes:
        subject, condition: names.
        cells: number of cells.
        spins: number of cells in which the car spins.
        unsettled: number of cells in which the yaw rate is not steady at the end; they have no settling time.
        overshoot_mean_percent: mean over the cells; the others are the largest, in magnitude for the error to the map.
    """

    subject: str
    condition: str
    cells: int
    spins: tuple[Cell, ...]
    unsettled: tuple[Cell, ...]
    overshoot_mean_percent: float | None
    overshoot_percent: Extreme | None
    rise_time_s: Extreme | None
    settling_time_s: Extreme | None
    sideslip_max_deg: Extreme | None
    map_error_percent: Extreme | None
    map_overshoot_percent: Extreme | None
    slip_percent: Extreme | None
    sideslip_excess_deg: Extreme | None


LARGEST = (
    *("overshoot_percent", "rise_time_s", "settling_time_s", "sideslip_max_deg", "map_overshoot_percent", "slip_percent"),
    "sideslip_excess_deg",
)
"""Figures of a summary that are the largest of their cells."""


def summarise(subject: str, condition: str, results: Sequence[CellResult]) -> Summary:
    """Return the figures of one table."""
    on_road = [result for result in results if not result.spun]
    overshoots = [result.overshoot_percent for result in on_road if result.overshoot_percent is not None]
    return Summary(
        subject=subject,
        condition=condition,
        cells=len(results),
        spins=tuple(result.cell for result in results if result.spun),
        unsettled=tuple(result.cell for result in on_road if not result.settled),
        overshoot_mean_percent=sum(overshoots) / len(overshoots) if overshoots else None,
        map_error_percent=extreme(on_road, "map_error_percent", functools.partial(max, key=abs)),
        **{name: extreme(on_road, name) for name in LARGEST},
    )


def extreme(results: Sequence[CellResult], name: str, choose: Callable[..., float] = max) -> Extreme | None:
    """Return the largest (or smallest) value of a figure with its cell, the first of equals; None if no run has it."""
    values = [value for result in results if (value := getattr(result, name)) is not None]
    if not values:
        return None
    wanted = choose(values)
    return next(Extreme(wanted, result.cell) for result in results if getattr(result, name) == wanted)
