"""Signals of n runs of one scenario, tables of figures of them, and what all scenarios have: spins, extremes and paths."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, Self, TypeVar, overload

import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration.signals import RECORD_COLUMNS

IndexArray = npt.NDArray[np.intp]

METRIC_COLUMNS = tuple(name for name in RECORD_COLUMNS if name not in ("time_s", "speed_m_s", "rear_angle_command_rad"))
"""Columns of a recording from which the figures are computed."""
FINITE = RECORD_COLUMNS[1 : RECORD_COLUMNS.index("slip_rear_rad") + 1]
"""Columns that are finite while the car is on the road."""

SPIN_SIDESLIP = math.radians(10.0)
"""Sideslip angle in rad beyond which a car spins: no driver holds it, and later figures are meaningless."""
SPIN_REAR_SLIP = math.radians(5.0)
"""Rear slip angle in rad that a spin needs as well: in a tight turn at walking speed the sideslip angle alone is as large."""


@dataclass(frozen=True, eq=False)
class Runs:
    """n runs of one scenario.

    Attributes:
        time: (samples,) s.
        signals: name of RECORD_COLUMNS -> (samples, n), SI. A figure needs only the columns that it is computed from.
        steer_time: s, start of steering.
        steering_ratio: ratio of steering wheel to road wheel, one or (n,).
        mass: kg, one or (n,).
        slip_bounds: rad, of front and rear axle of the configured car; None for tyres without bounds.
        map_yaw_rate: (n,) rad/s, the map's steady yaw rate at the end of the run; None if unknown.
    """

    time: FloatArray
    signals: Mapping[str, FloatArray]
    steer_time: float
    steering_ratio: FloatArray | float = 1.0
    mass: FloatArray | float = math.nan
    slip_bounds: tuple[float, float] | None = None
    map_yaw_rate: FloatArray | float | None = None

    @classmethod
    def of_record(cls, record: FloatArray, steer_time: float, **more: Any) -> Runs:
        """Return one run from its recording (samples, 12), columns RECORD_COLUMNS."""
        signals = {name: record[:, place, np.newaxis] for place, name in enumerate(RECORD_COLUMNS)}
        return cls(record[:, 0], signals, steer_time, **more)

    @property
    def after(self) -> slice:
        """Samples from the start of steering."""
        return slice(int(np.searchsorted(self.time, self.steer_time - 1e-9)), None)

    def at(self, times: FloatArray, name: str) -> FloatArray:
        """Return (n,) values of a column at times (n,) in s, interpolated linearly."""
        values, time = self.signals[name], self.time
        safe = np.where(np.isnan(times), time[0], times)
        index = np.clip(np.searchsorted(time, safe, side="right") - 1, 0, time.size - 2)
        each = np.arange(values.shape[1])
        low, high = values[index, each], values[index + 1, each]
        share = np.clip((safe - time[index]) / (time[index + 1] - time[index]), 0.0, 1.0)
        return low + share * (high - low)


def total(values: FloatArray) -> FloatArray:
    """Return the sums (n,) of columns, in an order that does not depend on n, as `ndarray.sum` does."""
    result: FloatArray = np.cumsum(values, axis=0)[-1]
    return result


def first_from(where: BoolArray, begin: IndexArray | int) -> IndexArray:
    """Return (n,) indices of the first true sample of each column from `begin` on, one or (n,); -1 if there is none."""
    if not isinstance(begin, int):
        where = where & (np.arange(where.shape[0])[:, np.newaxis] >= begin)
    elif begin:
        found = first_from(where[begin:], 0)
        return np.where(found < 0, found, found + begin)
    return np.where(where.any(axis=0), where.argmax(axis=0), -1)


def crossing(time: FloatArray, values: FloatArray, level: FloatArray | float, begin: IndexArray | int) -> FloatArray:
    """Return (n,) times in s at which each column, from `begin` on, first rises to `level`, interpolated; NaN if never."""
    index = first_from(values >= level, begin)
    each = np.arange(values.shape[1])
    at, before = values[index, each], values[index - 1, each]
    between = time[index - 1] + (level - before) / (at - before) * (time[index] - time[index - 1])
    return np.where(index < 0, np.nan, np.where((index == 0) | (index == begin), time[index], between))


def largest(values: FloatArray) -> FloatArray:
    """Return the largest magnitudes (n,) of columns; NaN for columns without a sample."""
    return np.maximum(_most(values, np.max), -_most(values, np.min))


def _most(values: FloatArray, extreme: Callable[..., Any]) -> FloatArray:
    return np.asarray(extreme(values, axis=0)) if values.shape[0] else np.full(values.shape[1], np.nan)


def is_spinning(sideslip: FloatArray, slip_rear: FloatArray) -> BoolArray:
    """Return whether a car spins at its sideslip angle and rear slip angle, rad; NaN counts as a spin."""
    result: BoolArray = ~((np.abs(sideslip) <= SPIN_SIDESLIP) | (np.abs(slip_rear) <= SPIN_REAR_SLIP))
    return result


def spin_times(runs: Runs) -> FloatArray:
    """Return (n,) times in s of the first sample in which a car spins or a signal is not finite; NaN if it does not spin."""
    spinning = is_spinning(runs.signals["sideslip_rad"], runs.signals["slip_rear_rad"])
    for name in FINITE:
        if name in runs.signals:
            spinning |= ~np.isfinite(runs.signals[name])
    return np.where(spinning.any(axis=0), runs.time[spinning.argmax(axis=0)], np.nan)


T = TypeVar("T")


class Lazy(Generic[T]):
    """A value of an object, computed when it is first read.

    `cached_property` of Python 3.11 has one lock for all objects. This has none: threads compute tables of their own.
    """

    def __init__(self, compute: Callable[[Any], T]) -> None:
        self.compute = compute
        self.__doc__ = compute.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    @overload
    def __get__(self, table: None, owner: type) -> Self: ...

    @overload
    def __get__(self, table: object, owner: type) -> T: ...

    def __get__(self, table: object | None, owner: type) -> Self | T:
        if table is None:
            return self
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            value = table.__dict__[self.name] = self.compute(table)
        return value


class Figure(Lazy[FloatArray]):
    """A figure of a table: values (n,), NaN for runs without it.

    Attributes:
        name: name of the attribute, with the unit; the key in JSON and the column in a campaign.
        title, unit: heading in tables.
        digits: digits after the point in tables.
        words: texts for 0 and 1 of a figure that is no or yes; None for a number.
    """

    def __init__(
        self,
        title: str,
        unit: str,
        digits: int,
        compute: Callable[[Any], FloatArray],
        words: tuple[str, str] | None = None,
    ) -> None:
        super().__init__(compute)
        self.title, self.unit, self.digits, self.words = title, unit, digits, words


class FigureTable:
    """Figures of n runs: the attributes of type `Figure`. Each is computed when it is first read."""

    def __init__(self, runs: Runs) -> None:
        self.runs = runs

    @classmethod
    def figures(cls) -> tuple[Figure, ...]:
        """Return the figures in the order of the table."""
        return tuple(each for each in vars(cls).values() if isinstance(each, Figure))

    def until(self, name: str) -> FloatArray | float:
        """Return the last time in s that a figure uses, one or (n,). A spin before it invalidates the figure."""
        del name
        return math.inf

    def of_one(self) -> dict[str, float | bool | None]:
        """Return the figures of the first run; None where it does not have one."""
        values = {figure: float(getattr(self, figure.name)[0]) for figure in self.figures()}
        return {
            figure.name: None if math.isnan(value) else bool(value) if figure.words else value
            for figure, value in values.items()
        }

    def after(self, name: str) -> FloatArray:
        """Return a column (samples, n) from the start of steering."""
        return self.runs.signals[name][self.runs.after]


def _largest(column: str) -> Callable[[FigureTable], FloatArray]:
    return lambda of: np.rad2deg(largest(of.after(column)))


class Extremes(FigureTable):
    """Extremes of the motion after the start of steering. Every scenario has them."""

    yaw_rate_abs_max_deg_s = Figure("|yaw rate|, largest", "deg/s", 2, _largest("yaw_rate_rad_s"))
    sideslip_abs_max_deg = Figure("|sideslip|, largest", "deg", 2, _largest("sideslip_rad"))
    rear_angle_min_deg = Figure(
        "rear angle, smallest", "deg", 2, lambda of: np.rad2deg(_most(of.after("rear_angle_rad"), np.min))
    )
    rear_angle_max_deg = Figure(
        "rear angle, largest", "deg", 2, lambda of: np.rad2deg(_most(of.after("rear_angle_rad"), np.max))
    )
    lateral_acceleration_max_m_s2 = Figure(
        "lateral acceleration, largest", "m/s^2", 2, lambda of: largest(of.after("lateral_acceleration_m_s2"))
    )


def paths(runs: Runs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heading (rad) and position forward and to the left (m) of the centre of gravity, (samples, n) each, from zero.

    Speed, yaw rate and sideslip are integrated by the trapezoidal rule.
    """
    step = np.diff(runs.time)[:, np.newaxis]

    def integral(values: FloatArray) -> FloatArray:
        steps = 0.5 * step * (values[1:] + values[:-1])
        return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])

    speed = runs.signals["speed_m_s"]
    heading = integral(runs.signals["yaw_rate_rad_s"])
    aside = speed * np.tan(runs.signals["sideslip_rad"])
    along, across = np.cos(heading), np.sin(heading)
    return heading, integral(speed * along - aside * across), integral(speed * across + aside * along)


def cone_clearances(cones: FloatArray, forward: FloatArray, left: FloatArray) -> FloatArray:
    """Return the smallest distances (n,) in m from the sides of the cars to the cones that they have passed.

    Negative where a cone is hit, NaN for a car that has passed none.

    Args:
        cones: (k, 3) m: position along the road, and the smallest and the largest lateral position of the centre of gravity at
            which the sides of the car clear the cones there; infinite where there is no cone on that side.
        forward, left: (samples, n) m, positions of the centres of gravity.
    """
    at, low, high = cones.T
    found = []
    for along, aside in zip(forward.T, left.T, strict=True):
        passed = at <= along[-1]
        lateral = np.interp(at[passed], along, aside)
        clearance = np.minimum(lateral - low[passed], high[passed] - lateral)
        found.append(float(clearance.min()) if clearance.size else np.nan)
    return np.array(found)
