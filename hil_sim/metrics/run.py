"""A recorded run with the quantities that metrics need, and the metric itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.metrics.runs import Extremes, FigureTable, Runs, spin_times
from codegen.sil.software import RECORD_COLUMNS, Status
from codegen.vehicle.tyre import slip_bounds
from hil_sim.scenarios import Scenario

LookUp = Callable[[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike, npt.ArrayLike], npt.NDArray[Any]]
"""The map's steady yaw rate (rad/s) as a function of speed (m/s), front angle (rad), friction estimate (NaN: unknown) and
longitudinal acceleration (m/s^2)."""


def column(record: FloatArray, name: str) -> FloatArray:
    """Return a column (samples,) of a recording by its name, in SI units."""
    return record[:, RECORD_COLUMNS.index(name)]


def spin_time(record: FloatArray) -> float | None:
    """Return the time in s of the first sample of a recording (samples, 12) in which the car spins; None where it does not."""
    found = float(spin_times(Runs.of_record(record, 0.0))[0])
    return None if math.isnan(found) else found


@dataclass(frozen=True)
class Figures:
    """Base of results whose JSON values are their fields."""

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)


NO_YES = ("no", "yes")


@dataclass(frozen=True)
class Metric:
    """One metric of one run.

    Attributes:
        key: name in JSON, with the unit.
        title, unit: row heading in tables.
        value: a number, or whether something holds; None where the run does not have it.
        digits: digits after the point in tables.
        until: last time of the run, in s, that the metric uses; a spin before it invalidates the metric.
        words: texts for False and True.
    """

    key: str
    title: str
    unit: str
    value: float | bool | None
    digits: int = 2
    until: float = math.inf
    words: tuple[str, str] = NO_YES


@dataclass(frozen=True)
class Run:
    """Recording (samples, 12), columns RECORD_COLUMNS, with its scenario and the configuration of its car.

    `look_up` is the map of the controller, `Software.map_yaw_rate`; None where it is not known.
    """

    record: FloatArray
    scenario: Scenario
    config: Config
    look_up: LookUp | None = None

    def __getitem__(self, name: str) -> FloatArray:
        return column(self.record, name)

    def degrees(self, name: str) -> FloatArray:
        """Return a column of angles or angular rates in deg or deg/s."""
        result: FloatArray = np.rad2deg(column(self.record, name))
        return result

    @cached_property
    def runs(self) -> Runs:
        """The run as one of n."""
        return Runs.of_record(
            self.record,
            self.scenario.steer_time,
            steering_ratio=self.config.steering.ratio,
            mass=self.config.vehicle.mass_kg,
            slip_bounds=slip_bounds(self.config),
            map_yaw_rate=None if self.map_yaw_rate is None else self.map_yaw_rate[-1],
        )

    @cached_property
    def time(self) -> FloatArray:
        """Sampling times, (samples,) s."""
        return column(self.record, "time_s")

    @cached_property
    def step(self) -> float:
        """Time between samples, in s."""
        return float(self.time[1] - self.time[0]) if len(self.time) > 1 else self.config.controller.sampling_time_s

    @cached_property
    def map_yaw_rate(self) -> FloatArray | None:
        """Steady yaw rate of the map in each sample, (samples,) rad/s; None where no map is known."""
        if self.look_up is None:
            return None
        estimate = self.scenario.settings.friction_estimate
        friction = math.nan if estimate is None else estimate
        speed = self["speed_m_s"]
        acceleration = np.gradient(speed, self.step) if len(speed) > 1 else 0.0
        return self.look_up(speed, self["front_angle_rad"], friction, acceleration).astype(np.float64)

    @cached_property
    def after(self) -> BoolArray:
        """Samples from the time at which the driver begins, (samples,)."""
        return self.time >= self.scenario.steer_time - 1e-9

    @cached_property
    def controlled(self) -> BoolArray:
        """Samples in which the controller is active, (samples,)."""
        return column(self.record, "status") <= Status.LIMITED

    @cached_property
    def steering_wheel_angle(self) -> FloatArray:
        """Angle of the steering wheel, (samples,) rad."""
        return self["front_angle_rad"] * self.config.steering.ratio

    def within(self, start: float, end: float) -> BoolArray:
        """Return the samples (samples,) from `start` to `end` (s), both included."""
        return (self.time >= start - 1e-9) & (self.time <= end + 1e-9)

    def at(self, time: float, name: str) -> float:
        """Return a column's value at a time (s), interpolated linearly."""
        return float(np.interp(time, self.time, self[name]))


def largest(values: FloatArray, where: BoolArray | None = None) -> float | None:
    """Return the largest magnitude; None where there is no sample."""
    chosen = values if where is None else values[where]
    return float(np.abs(chosen).max()) if chosen.size else None


def rows_of(table: FigureTable) -> list[Metric]:
    """Return the figures of one run as rows of a table."""
    values, ends = table.of_one(), {figure: np.asarray(table.until(figure.name)) for figure in table.figures()}
    return [
        Metric(each.name, each.title, each.unit, values[each.name], each.digits, float(end.flat[0]), each.words or NO_YES)
        for each, end in ends.items()
    ]


def common(run: Run, begin: float | None = None) -> list[Metric]:
    """Return the extremes of the motion from a time in s on, by default where the driver begins. Every scenario has them."""
    return rows_of(Extremes(run.runs if begin is None else replace(run.runs, steer_time=begin)))
