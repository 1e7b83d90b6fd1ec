"""Design of the gain schedule over speed, so that the whole family of cars keeps its margins.

Cars that must meet the demands:

- up to the last speed of the map's grid: every member of the family, or the design fails;
- beyond, up to the top speed of the car: the configured car, and every member that is stable there with its rear wheels held.
  If no gains suit all of those, only the configured car counts. If none suit that car either, the gains of the speed before
  are held, and a build warns;
- below the first breakpoint, whose gains are held there, down to the speed at which the controller switches off: every member.

Between breakpoints the interpolated gains are checked; where they fail, both ends are designed again with more reserve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config, Schedule
from codegen.configuration.controller import SCHEDULE_POINTS_MAX
from codegen.design.family import Member, measured_keys, members, nominal
from codegen.design.margins import Margins, worst_of
from codegen.design.sampled import SampledCar, frequency_grid, sample
from codegen.design.search import Cars, Demands, Shortfall, best_gains
from codegen.errors import ConfigError
from codegen.units import KM_H

Progress = Callable[[int, int], None]

STEP_BEYOND = 1.25
"""Largest ratio of neighbouring breakpoints beyond those of `tuning.speed_km_h`."""

FADED_TO = 0.8
"""Share of the speed of whole feedback down to which the first gains are checked: below, little of the feedback is left."""

BETWEEN = 3
"""Number of speeds checked inside each interval of the schedule, including the middle, where interpolated gains differ most
from a design, and below its first breakpoint."""

RESERVES_MAX = 100

UNBOUNDED = 999.99
"""Substitute for an infinite margin or sensitivity, which a file cannot hold."""


class Counted(IntEnum):
    """Cars that meet the demands at a breakpoint."""

    NOBODY = 0
    CONFIGURED = 1
    FAMILY = 2


@dataclass
class Breakpoint:
    """Design state of a breakpoint. The first reserve is for rounding the gains, and for cars between the checked speeds."""

    speed_km_h: float
    beyond: bool
    counted: Counted = Counted.FAMILY
    reserves: int = 1
    kp: float = 0.0
    ki: float = 0.0


@dataclass(frozen=True, eq=False)
class Design:
    """A schedule and the cars for which it was designed, with one entry for each breakpoint.

    Attributes:
        schedule: gains and the worst margins of the counted cars that are not slow (`Member.is_slow`), or of the configured
            car where none counts.
        limiting: the counted car that is not slow and nearest to one of its demands, or misses it most.
        slow: worst margins of the counted slow cars in dB and deg, and their peak sensitivity; None if no slow car counts.
        counted: number of members that meet the demands; 0 beyond the grid where no gains were found.
        family_size: number of members.
    """

    schedule: Schedule
    limiting: tuple[Member, ...]
    slow: tuple[tuple[float, ...] | None, ...]
    counted: tuple[int, ...]
    family_size: int


def tune(config: Config, progress: Progress | None = None) -> Schedule:
    """Return the gain schedule of a configuration (see `design`)."""
    return design(config, progress).schedule


def design(config: Config, progress: Progress | None = None) -> Design:
    """Design the gain schedule; the same configuration gives the same gains.

    Args:
        config: `tuning` holds the family and the demands.
        progress: called with (done, in all).

    Raises:
        ConfigError: no gains meet the demands at some speed of the grid, or there are too many breakpoints or members.
    """
    designer = _Designer(config, breakpoints(config), members(config))
    steps = len(designer.points) + 1
    for place in range(len(designer.points)):
        designer.design(place)
        if progress is not None:
            progress(place + 1, steps)
    designer.mend_between()
    result = designer.result()
    if progress is not None:
        progress(steps, steps)
    return result


def breakpoints(config: Config) -> list[Breakpoint]:
    """Return the breakpoints of `config.tuning` up to the top speed, the last speed of the grid, and that speed.

    From the end of that list on, further ones are inserted.
    """
    top, listed = config.top_speed_km_h, config.tuning.speed_km_h
    last = min(config.grid.last_speed_km_h, top)
    inside = [speed for speed in listed if speed < 0.999 * last]  # no two points within rounding
    inside = [*inside, *_up_to(last, listed[-1])] if inside else [FADED_TO * config.controller.feedback_speeds_km_h[1]]
    points = [Breakpoint(speed, False) for speed in dict.fromkeys((*inside, last))]
    points += [Breakpoint(speed, True) for speed in _up_to(top, last)]
    if len(points) > SCHEDULE_POINTS_MAX:
        raise ConfigError(
            f"with those up to the top speed, {len(points)} breakpoints; a schedule has at most {SCHEDULE_POINTS_MAX}",
            where="tuning.speed_km_h",
            remedy=f"list {len(points) - SCHEDULE_POINTS_MAX} less",
        )
    return points


def _up_to(last: float, first: float) -> list[float]:
    """Return speeds above the first one up to the last one, at most STEP_BEYOND apart; none if the last one is not above it."""
    if first >= 0.999 * last:
        return []
    steps = math.ceil(math.log(last / first) / math.log(STEP_BEYOND) - 1e-9)
    return [round(first * (last / first) ** (k / steps), 1) for k in range(1, steps)] + [last]


def round_down(value: float, digits: int = 4) -> float:
    """Round a value from zero up towards zero to significant digits; fewer digits stay unchanged."""
    if value == 0.0:
        return 0.0
    places = digits - 1 - math.floor(math.log10(value))
    nearest = round(value, places)
    return nearest if nearest <= value else round(nearest - 10.0**-places, places)


@dataclass
class _Designer:
    """Design state of all breakpoints, and the sampled cars so far."""

    config: Config
    points: list[Breakpoint]
    family: tuple[Member, ...]
    binding: list[Member] = field(default_factory=list)
    sampled: dict[tuple[float, ...], SampledCar] = field(default_factory=dict)
    frequency: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.frequency = frequency_grid(self.config.controller.sampling_time_s)

    def cars(self, speeds: tuple[float, ...], counted: Counted, beyond: bool) -> Cars:
        """Return the cars that count at speeds (km/h) together."""
        own = self.family.index(nominal(self.config))
        if speeds not in self.sampled:
            self.sampled[speeds] = sample(self.config, self.family, np.array(speeds) * KM_H)
        sampled = self.sampled[speeds]
        keep: BoolArray = np.full((len(self.family), len(speeds)), counted == Counted.FAMILY)
        if beyond:
            keep &= sampled.open_loop_stable()
        keep[own] = counted != Counted.NOBODY
        return Cars.of(self.family, speeds, sampled, keep, self.frequency)

    def at(self, place: int) -> Cars:
        """Return the cars that count at a breakpoint; for the first, those below it too."""
        point, lowest = self.points[place], FADED_TO * self.config.controller.feedback_speeds_km_h[1]
        speeds: tuple[float, ...] = (point.speed_km_h,)
        if place == 0 and lowest < point.speed_km_h:
            below = np.geomspace(lowest, point.speed_km_h, BETWEEN + 1)[:-1]
            speeds += tuple(float(speed) for speed in below)
        return self.cars(speeds, point.counted, point.beyond)

    def design(self, place: int) -> None:
        """Find the gains of a breakpoint; beyond the grid, for fewer cars if none suit all."""
        point = self.points[place]
        while point.counted != Counted.NOBODY:
            short = self._try(place, point.reserves)
            if short is None:
                return
            if not point.beyond:
                raise _unmet(self.config, short)
            point.counted = Counted(point.counted - 1)

    def _try(self, place: int, reserves: int) -> Shortfall | None:
        """Set the best gains of a breakpoint with a number of reserves; where there are none, return the shortfall."""
        point = self.points[place]
        cars = self.at(place)
        found = best_gains(cars, Demands.of(self.config.tuning, cars.members, reserves), self.binding)
        if isinstance(found, Shortfall):
            return found
        point.kp, point.ki = (round_down(gain) for gain in found)
        point.reserves = reserves
        return None

    def mend_between(self) -> None:
        """Check the gains between breakpoints, and design the ends again until they hold there too."""
        intervals = set(range(len(self.points) - 1))
        waiting = set(intervals)
        while waiting:
            first = min(waiting)
            short = self.between(first)
            if short is None:
                waiting.remove(first)
                continue
            waiting |= intervals & {place for end in self._mend(first, short) for place in (end - 1, end)}

    def _mend(self, first: int, short: Shortfall) -> list[int]:
        """Redesign breakpoints `first` and the next where the gains between fail; return the breakpoints that changed."""
        mended = []
        more = Demands.of(self.config.tuning, [short.member]).reserves_missing(short)
        for place in (first, first + 1):
            # First by the missing amount, because margins between two points rise about as much as at them; then step by step.
            wanted = min(self.points[place].reserves + more, RESERVES_MAX)
            if wanted > self.points[place].reserves and self._try(place, wanted) is None:
                mended.append(place)
        if mended:
            return mended
        last = self.points[first + 1]
        if not last.beyond:
            raise _unmet(self.config, short, (self.points[first].speed_km_h, last.speed_km_h))
        last.counted, last.reserves = Counted(last.counted - 1), 1
        self.design(first + 1)
        return [first + 1]

    def between(self, first: int) -> Shortfall | None:
        """Return the worst car between breakpoint `first` and the next; None where all that count at both meet the demands."""
        low, high = self.points[first], self.points[first + 1]
        counted = min(low.counted, high.counted)
        if counted == Counted.NOBODY:
            return None
        speeds = np.linspace(low.speed_km_h, high.speed_km_h, BETWEEN + 2)[1:-1]
        cars = self.cars(tuple(float(speed) for speed in speeds), counted, high.beyond)
        share = (np.array(cars.speeds) - low.speed_km_h) / (high.speed_km_h - low.speed_km_h)
        kp, ki = low.kp + share * (high.kp - low.kp), low.ki + share * (high.ki - low.ki)
        return cars.worst_for(Demands.of(self.config.tuning, cars.members), kp, ki)

    def result(self) -> Design:
        """Return the schedule with the margins at its breakpoints."""
        found, limiting, slow, counted = [], [], [], []
        for place, point in enumerate(self.points):
            if point.counted == Counted.NOBODY:
                point.kp, point.ki = self.points[place - 1].kp, self.points[place - 1].ki
            cars = self.cars((point.speed_km_h,), max(point.counted, Counted.CONFIGURED), point.beyond)
            quick, late = (
                cars.pick([place for place, member in enumerate(cars.members) if member.is_slow == is_slow])
                for is_slow in (False, True)
            )
            margins = quick.margins(point.kp, point.ki)
            found.append(_rounded(worst_of(margins)[0]))
            limiting.append(quick.members[int(Demands.of(self.config.tuning, quick.members).score(margins).argmin())])
            slow.append(_rounded(worst_of(late.margins(point.kp, point.ki))[0]) if len(late) else None)
            counted.append(len(cars) if point.counted else 0)
        gain, phase, peak = (list(column) for column in zip(*found, strict=True))
        schedule = Schedule(
            speed_km_h=[point.speed_km_h for point in self.points],
            proportional_gain_s=[point.kp for point in self.points],
            integral_gain=[point.ki for point in self.points],
            gain_margin_db=gain,
            phase_margin_deg=phase,
            sensitivity=peak,
        )
        return Design(schedule, tuple(limiting), tuple(slow), tuple(counted), len(self.family))


def _rounded(margins: Margins) -> tuple[float, ...]:
    """Return margins (1,) as a file holds them."""
    return tuple(float(np.round(np.minimum(value[0], UNBOUNDED), 2)) for value in margins.figures())


def _unmet(config: Config, short: Shortfall, ends: tuple[float, float] | None = None) -> ConfigError:
    """Return the error, with the breakpoints at both ends where the gains between them fail."""
    if ends is not None:
        return ConfigError(
            f"straight lines between the gains at {ends[0]:g} and {ends[1]:g} km/h do not meet the demands: at "
            f"{short.speed_km_h:.4g} km/h the car with {short.member} {short.reached}",
            where="tuning.speed_km_h",
            remedy="list a breakpoint between them",
        )
    prefix = "slow_" if short.member.is_slow else ""
    narrow = "drive with more excitation, remove [identified]" if measured_keys(config) else "narrow the family"
    return ConfigError(
        f"no gains meet the demands at {short.speed_km_h:.4g} km/h: the car with {short.member} {short.reached}",
        where="[tuning]",
        remedy=f"lower {prefix}gain_margin_db or {prefix}phase_margin_deg, raise {prefix}sensitivity_max, {narrow}, "
        "or end the grid sooner",
    )
