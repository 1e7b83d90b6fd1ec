"""Largest entry speed into the obstacle avoidance track of ISO 3888-2 over a set of drivers.

Track and driver are those of the scenario `double-lane-change`: the cones as functions of the width of the car, and optimal
preview (MacAdam 1981) with the passive linear car as the driver's model. A driver passes where the sides of the car, taken
parallel to the road, clear all cones and the car does not spin. The speed is constant; in the standard the car coasts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.judgement.bench import Bench
from codegen.metrics import Runs
from codegen.metrics.runs import cone_clearances, is_spinning, paths
from codegen.sil.batch import Drivers
from codegen.units import KM_H
from hil_sim.manoeuvres import Hands, Preview, PreviewDriver
from hil_sim.scenarios import DEPARTURE_TIME_S, PATH_SCENARIOS, Scenario

PREVIEWS_AND_DELAYS_S = ((0.3, 0.05), (0.4, 0.05), (0.4, 0.1), (0.5, 0.1), (0.5, 0.15), (0.6, 0.15), (0.6, 0.2), (0.8, 0.2))
"""Preview time and reaction time. The pairs surround those with which a driver of the paper's car passes at its largest entry
speed; a driver who reacts later must look farther ahead."""
GAINS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.25)
"""Factors on the angle that is optimal for the linear passive car."""
DRIVERS = tuple(Hands(*times, gain) for times, gain in itertools.product(PREVIEWS_AND_DELAYS_S, GAINS))

FIRST_KM_H, STEP_KM_H, LAST_KM_H = 35.0, 1.0, 100.0
"""Entry speeds of the search."""
MISSES = 2
"""The search ends after so many speeds in sequence at which no driver passes."""
AFTER_S = 0.5
"""Time of driving after the track, in s."""
PATH_SPACING_M = 0.05
"""Distance of the points of the path; interpolation between them is off by less than 0.1 mm."""
SPEEDS_AT_ONCE = 8
"""Entry speeds that are driven in one batch."""
LANE_CHANGE_COLUMNS = ("speed_m_s", "yaw_rate_rad_s", "sideslip_rad", "slip_front_rad", "slip_rear_rad")


@dataclass(frozen=True)
class LaneChange(Scenario):
    """The scenario with another driver."""

    hands: Hands = DRIVERS[0]

    @classmethod
    def at(cls, speed_km_h: float, hands: Hands) -> LaneChange:
        """Return the lane change of a driver at an entry speed."""
        base = PATH_SCENARIOS["double-lane-change"]
        path_length = 61.0  # ISO 3888-2:2011, table 1: 12, 13.5, 11, 12.5 and 12 m
        return cls(
            **{
                **vars(base),
                "duration": DEPARTURE_TIME_S + path_length / (speed_km_h * KM_H) + AFTER_S,
                "settings": replace(base.settings, speed_km_h=speed_km_h),
            },
            hands=hands,
        )

    def driver(self, config: Config) -> PreviewDriver | None:
        """See `Scenario.driver`."""
        path = self.road_path(config)
        assert path is not None  # the base has one
        return PreviewDriver(config, path, self.settings.speed, config.controller.sampling_time_s, self.hands)


def sideslips_if_passed(runs: Runs, scenario: LaneChange, config: Config) -> FloatArray:
    """Return the largest sideslip angles (n,) of lane changes in deg; NaN where a cone is hit or the car spins.

    The runs are those of drivers at one entry speed. Samples after the end of the scenario do not count.
    """
    path = scenario.road_path(config)
    assert path is not None
    count = int(np.searchsorted(runs.time, scenario.duration - 1e-9))
    runs = replace(runs, time=runs.time[:count], signals={name: values[:count] for name, values in runs.signals.items()})
    sideslip = runs.signals["sideslip_rad"]
    spins = is_spinning(sideslip, runs.signals["slip_rear_rad"]).any(axis=0)
    _, forward, left = paths(runs)
    passed = (cone_clearances(path.cones, forward, left) >= 0.0) & ~spins
    return np.where(passed, np.rad2deg(np.abs(sideslip).max(axis=0)), np.nan)


def largest_entry_speed(passes: Callable[[float], bool], last_km_h: float = LAST_KM_H) -> float:
    """Return the largest entry speed in km/h at which at least one driver passes; zero for none.

    Speeds rise by STEP_KM_H to the last one. `passes` returns whether a driver passes at a speed in km/h.
    """
    found, misses = 0.0, 0
    for speed in np.arange(FIRST_KM_H, min(last_km_h, LAST_KM_H) + 0.5 * STEP_KM_H, STEP_KM_H).tolist():
        if passes(speed):
            found, misses = speed, 0
            continue
        misses += 1
        if misses == MISSES:
            break
    return found


@dataclass(frozen=True)
class LaneChangeFigures:
    """Both cars in the lane change.

    Attributes:
        speed_km_h, passive_speed_km_h: largest entry speeds; zero where no driver passes at all.
        sideslip_deg, passive_sideslip_deg: peak at the smaller of both speeds, of the driver who passes with the least; NaN
            where that speed is zero.
        slip: (2, 2) rad, largest front and rear slip of these drives, of the controlled and of the passive car.
        drivers: number of drivers.
    """

    speed_km_h: float
    passive_speed_km_h: float
    sideslip_deg: float
    passive_sideslip_deg: float
    slip: FloatArray
    drivers: int


class _Drives:
    """Lane changes of both cars, driven for several entry speeds at once when first needed."""

    def __init__(self, bench: Bench, drivers: Sequence[Hands]) -> None:
        self._bench, self._drivers = bench, drivers
        self._sideslip: dict[float, FloatArray] = {}
        self._slip: dict[float, FloatArray] = {}

    def sideslips(self, speed_km_h: float) -> FloatArray:
        """Return the largest sideslip angles (2, drivers) of the controlled and of the passive car in deg; NaN: not passed."""
        if speed_km_h not in self._sideslip:
            self._drive([speed_km_h + STEP_KM_H * k for k in range(SPEEDS_AT_ONCE)])
        return self._sideslip[speed_km_h]

    def slips(self, speed_km_h: float) -> FloatArray:
        """Return the largest front and rear slip angles (2, 2, drivers) in rad: axles, cars, drivers."""
        self.sideslips(speed_km_h)
        return self._slip[speed_km_h]

    def _drive(self, speeds: Sequence[float]) -> None:
        config = self._bench.config
        scenarios = [LaneChange.at(speed, self._drivers[0]) for speed in speeds]
        speed = np.repeat([scenario.settings.speed for scenario in scenarios], len(self._drivers))
        longest = max(scenario.duration for scenario in scenarios)
        runs = self._bench.run(
            self._bench.profile(0.0, longest),
            DEPARTURE_TIME_S,
            LANE_CHANGE_COLUMNS,
            speed=speed,
            drivers=self._of_batch(scenarios),
        )
        shape = (2, len(speeds), len(self._drivers))
        for number, (kmh, scenario) in enumerate(zip(speeds, scenarios, strict=True)):
            signals = {
                name: values.reshape(-1, *shape)[:, :, number].reshape(values.shape[0], -1)
                for name, values in runs.signals.items()
            }
            own = Runs(runs.time, signals, runs.steer_time)
            self._sideslip[kmh] = sideslips_if_passed(own, scenario, config).reshape(2, -1)
            self._slip[kmh] = np.stack(
                [np.abs(signals[f"slip_{axle}_rad"]).max(axis=0).reshape(2, -1) for axle in ("front", "rear")]
            )

    def _of_batch(self, scenarios: Sequence[LaneChange]) -> Drivers:
        config = self._bench.config
        previews = [Preview.of(config, scenario.settings.speed, hands) for scenario in scenarios for hands in self._drivers]
        path = scenarios[0].road_path(config)
        assert path is not None
        begin = path.start - PATH_SPACING_M
        points = begin + PATH_SPACING_M * np.arange(math.ceil(path.length / PATH_SPACING_M) + 3, dtype=np.float64)
        starts = [DEPARTURE_TIME_S * scenario.settings.speed - PATH_SPACING_M for scenario in scenarios]
        period = config.controller.sampling_time_s
        return Drivers(
            path.lateral(points),
            PATH_SPACING_M,
            np.repeat(starts, len(self._drivers)),
            np.array([preview.ahead for preview in previews]),
            np.stack([preview.path_weight for preview in previews], axis=1),
            np.stack([preview.motion_weight for preview in previews], axis=1),
            np.tile([round(hands.delay_s / period) for hands in self._drivers], len(scenarios)),
            config.steering.ratio * config.steering.front_angle_stop,
        )


def lane_change_figures(bench: Bench, drivers: Sequence[Hands] = DRIVERS, last_km_h: float = LAST_KM_H) -> LaneChangeFigures:
    """Drive the lane change with and without the controller, up to a speed in km/h."""
    drives = _Drives(bench, drivers)

    def passes(car: int) -> Callable[[float], bool]:
        return lambda speed: bool(np.isfinite(drives.sideslips(speed)[car]).any())

    speeds = [largest_entry_speed(passes(car), last_km_h) for car in (0, 1)]
    common = min(speeds)
    sideslips, slip = np.full(2, np.nan), np.full((2, 2), np.nan)
    if common:
        found = drives.sideslips(common)
        sideslips = np.nanmin(found, axis=1)
        least = np.nanargmin(found, axis=1)
        slip = drives.slips(common)[:, (0, 1), least]
    return LaneChangeFigures(speeds[0], speeds[1], float(sideslips[0]), float(sideslips[1]), slip, len(drivers))
