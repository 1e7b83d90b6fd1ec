"""A recorded run with the quantities that metrics need, and the metric itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.sil.software import RECORD_COLUMNS, Status
from hil_sim.scenarios import Scenario

LookUp = Callable[[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike, npt.ArrayLike], npt.NDArray[Any]]
"""The map's steady yaw rate (rad/s) as a function of speed (m/s), front angle (rad), friction estimate (NaN: unknown) and
longitudinal acceleration (m/s^2)."""

SPIN_SIDESLIP = math.radians(10.0)
"""Sideslip angle beyond which a car spins: no driver holds it, and later metrics are meaningless."""
SPIN_REAR_SLIP = math.radians(5.0)
"""Rear slip angle that a spin needs as well: in a tight turn at walking speed the sideslip angle alone is as large."""


def column(record: FloatArray, name: str) -> FloatArray:
    """Return a column (samples,) of a recording by its name, in SI units."""
    return record[:, RECORD_COLUMNS.index(name)]


def spin_time(record: FloatArray) -> float | None:
    """Return the time in s of the first sample of a recording (samples, 12) in which the car spins; None where it does not."""
    spinning = np.abs(column(record, "sideslip_rad")) > SPIN_SIDESLIP
    spinning &= np.abs(column(record, "slip_rear_rad")) > SPIN_REAR_SLIP
    # A state that is not finite counts as a spin as well.
    spinning |= ~np.isfinite(record[:, : RECORD_COLUMNS.index("slip_rear_rad") + 1]).all(axis=1)
    first = np.flatnonzero(spinning)
    return float(column(record, "time_s")[first[0]]) if first.size else None


@dataclass(frozen=True)
class Figures:
    """Base of results whose JSON values are their fields."""

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)


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
    words: tuple[str, str] = ("no", "yes")


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


def extremes(run: Run, name: str, where: BoolArray) -> tuple[float | None, float | None]:
    """Return the smallest and the largest value of an angle in deg; None where there is no sample."""
    values = run.degrees(name)[where]
    return (float(values.min()), float(values.max())) if values.size else (None, None)


def common(run: Run, where: BoolArray | None = None) -> list[Metric]:
    """Return the extremes of the motion over samples, by default all after the driver begins. Every scenario has them."""
    where = run.after if where is None else where
    rear_low, rear_high = extremes(run, "rear_angle_rad", where)
    return [
        Metric("yaw_rate_abs_max_deg_s", "|yaw rate|, largest", "deg/s", largest(run.degrees("yaw_rate_rad_s"), where)),
        Metric("sideslip_abs_max_deg", "|sideslip|, largest", "deg", largest(run.degrees("sideslip_rad"), where)),
        Metric("rear_angle_min_deg", "rear angle, smallest", "deg", rear_low),
        Metric("rear_angle_max_deg", "rear angle, largest", "deg", rear_high),
        Metric(
            "lateral_acceleration_max_m_s2",
            "lateral acceleration, largest",
            "m/s^2",
            largest(run["lateral_acceleration_m_s2"], where),
        ),
    ]
