"""A recorded run as figures are read from it, and what a figure is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.sil.software import RECORD_COLUMNS, Status
from hil_sim.scenarios import Scenario

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
LookUp = Callable[[npt.ArrayLike, npt.ArrayLike, npt.ArrayLike], npt.NDArray[Any]]
"""Speed (m/s), front angle (rad) and friction estimate (NaN: unknown) to the map's steady yaw rate (rad/s)."""

SPIN_SIDESLIP = math.radians(10.0)
"""Beyond this sideslip angle a car is spinning: no driver holds it, and no figure of what follows means anything."""
SPIN_REAR_SLIP = math.radians(5.0)
"""The rear axle must slide as well: a car that rolls through a tight turn at walking speed has such sideslip angles too."""


def column(record: FloatArray, name: str) -> FloatArray:
    """One column (samples,) of a recording by its name, SI units."""
    return record[:, RECORD_COLUMNS.index(name)]


def spin_time(record: FloatArray) -> float | None:
    """s of the first sample of a recording (samples, 12) in which the car spins; None where it never does."""
    spinning = np.abs(column(record, "sideslip_rad")) > SPIN_SIDESLIP
    spinning &= np.abs(column(record, "slip_rear_rad")) > SPIN_REAR_SLIP
    # A car that went out of all numbers has not stayed on the road either.
    spinning |= ~np.isfinite(record[:, : RECORD_COLUMNS.index("slip_rear_rad") + 1]).all(axis=1)
    first = np.flatnonzero(spinning)
    return float(column(record, "time_s")[first[0]]) if first.size else None


@dataclass(frozen=True)
class Metric:
    """One figure of one run.

    Attributes:
        key: its name in JSON, with the unit.
        title, unit: for tables.
        value: a number, or yes and no; None where the run does not have it.
        digits: after the point, in tables.
        until: s of the run up to which it looks; a spin before that takes the figure away.
        words: for no and yes.
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
    """A recording (samples, 12), columns RECORD_COLUMNS, with the scenario and the car that it is of.

    `look_up` is the map of the controller, `Software.map_yaw_rate`; None where it is not known.
    """

    record: FloatArray
    scenario: Scenario
    config: Config
    look_up: LookUp | None = None

    def __getitem__(self, name: str) -> FloatArray:
        return column(self.record, name)

    def degrees(self, name: str) -> FloatArray:
        """A column of angles or angular rates in deg or deg/s."""
        result: FloatArray = np.rad2deg(column(self.record, name))
        return result

    @cached_property
    def time(self) -> FloatArray:
        """s."""
        return column(self.record, "time_s")

    @cached_property
    def step(self) -> float:
        """s between samples."""
        return float(self.time[1] - self.time[0]) if len(self.time) > 1 else self.config.controller.sampling_time_s

    @cached_property
    def map_yaw_rate(self) -> FloatArray | None:
        """Steady yaw rate in rad/s that the map gives in each sample; None where no map is known."""
        if self.look_up is None:
            return None
        estimate = self.scenario.settings.friction_estimate
        friction = math.nan if estimate is None else estimate
        return self.look_up(self["speed_m_s"], self["front_angle_rad"], friction).astype(np.float64)

    @cached_property
    def after(self) -> BoolArray:
        """Samples from the moment on at which the driver begins."""
        return self.time >= self.scenario.steer_time - 1e-9

    @cached_property
    def controlled(self) -> BoolArray:
        """Samples in which the controller follows its reference."""
        return column(self.record, "status") <= Status.LIMITED

    @cached_property
    def steering_wheel_angle(self) -> FloatArray:
        """rad: the front angle at the steering wheel."""
        return self["front_angle_rad"] * self.config.steering.ratio

    def within(self, start: float, end: float) -> BoolArray:
        """Samples from `start` to `end` (s), both included."""
        return (self.time >= start - 1e-9) & (self.time <= end + 1e-9)

    def at(self, time: float, name: str) -> float:
        """A column at a time (s), between samples linearly."""
        return float(np.interp(time, self.time, self[name]))


def largest(values: FloatArray, where: BoolArray | None = None) -> float | None:
    """The largest magnitude; None where there is no sample."""
    chosen = values if where is None else values[where]
    return float(np.abs(chosen).max()) if chosen.size else None


def extremes(run: Run, name: str, where: BoolArray) -> tuple[float | None, float | None]:
    """Smallest and largest value of an angle in deg; None where there is no sample."""
    values = run.degrees(name)[where]
    return (float(values.min()), float(values.max())) if values.size else (None, None)


def common(run: Run, where: BoolArray | None = None) -> list[Metric]:
    """What is told of any run over the samples `where` (all after the driver begins): extremes of the car's motion."""
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
