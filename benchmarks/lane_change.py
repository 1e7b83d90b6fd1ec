"""Largest entry speed into the obstacle avoidance track of ISO 3888-2 over a set of drivers.

Track and driver are those of the scenario `double-lane-change`: the cones as functions of the width of the car, and optimal
preview (MacAdam 1981) with the passive linear car as the driver's model. A driver passes where the sides of the car, taken
parallel to the road, clear all cones and the car does not spin. The speed is constant; in the standard the car coasts.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.metrics.runs import is_spinning
from codegen.sil.software import RECORD_COLUMNS
from codegen.units import KM_H
from hil_sim.manoeuvres import Hands, PreviewDriver
from hil_sim.metrics.others import cone_clearance
from hil_sim.scenarios import DEPARTURE_TIME_S, PATH_SCENARIOS, Scenario

PREVIEWS_AND_DELAYS_S = ((0.3, 0.05), (0.4, 0.05), (0.4, 0.1), (0.5, 0.1), (0.5, 0.15), (0.6, 0.15), (0.6, 0.2), (0.8, 0.2))
"""Preview time and reaction time. The pairs surround those with which a driver of the paper's car passes at its largest entry
speed; who reacts later must look farther ahead."""
GAINS = (0.7, 0.8, 0.9, 1.0, 1.1, 1.25)
"""Factors on the angle that is optimal for the linear passive car."""
DRIVERS = tuple(Hands(*times, gain) for times, gain in itertools.product(PREVIEWS_AND_DELAYS_S, GAINS))
FEW_DRIVERS = DRIVERS[1::3]
"""Drivers of random cars: each pair of times with the gains 0.8 and 1.1."""

FIRST_KM_H, STEP_KM_H, LAST_KM_H = 35.0, 1.0, 100.0
"""Entry speeds of the search."""
MISSES = 2
"""The search ends after so many speeds in sequence at which no driver passes."""
AFTER_S = 0.5
"""Time of driving after the track, in s."""


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


Drive = Callable[[LaneChange], FloatArray]
"""Function that returns the recording (samples, columns), RECORD_COLUMNS, of a lane change."""


def sideslip_if_passed(record: FloatArray, scenario: LaneChange, config: Config) -> float | None:
    """Return the largest sideslip angle of a lane change in deg; None where a cone is hit or the car spins."""
    of = dict(zip(RECORD_COLUMNS, record.T, strict=True))
    if is_spinning(of["sideslip_rad"], of["slip_rear_rad"]).any():
        return None
    path = scenario.road_path(config)
    assert path is not None
    clearance = cone_clearance(path.cones, *_positions(of, config.controller.sampling_time_s))
    return None if clearance is None or clearance < 0.0 else float(np.rad2deg(np.abs(of["sideslip_rad"]).max()))


def _positions(of: dict[str, FloatArray], step: float) -> tuple[FloatArray, FloatArray]:
    """Return positions forward and to the left in m, by the trapezoidal rule."""

    def integral(values: FloatArray) -> FloatArray:
        return np.concatenate([[0.0], np.cumsum(0.5 * step * (values[1:] + values[:-1]))])

    heading, speed = integral(of["yaw_rate_rad_s"]), of["speed_m_s"]
    aside = speed * np.tan(of["sideslip_rad"])
    along, across = np.cos(heading), np.sin(heading)
    return integral(speed * along - aside * across), integral(speed * across + aside * along)


def largest_entry_speed(drive: Drive, config: Config, drivers: Sequence[Hands] = DRIVERS) -> float:
    """Return the largest entry speed in km/h at which at least one driver passes; zero for none.

    Speeds rise by STEP_KM_H. The driver who passed last comes first at the next speed.
    """
    found, order, misses = 0.0, list(drivers), 0
    for speed in np.arange(FIRST_KM_H, LAST_KM_H + STEP_KM_H, STEP_KM_H).tolist():
        passed = next((hands for hands in order if _sideslip(drive, config, speed, hands) is not None), None)
        if passed is None:
            misses += 1
            if misses == MISSES:
                break
            continue
        found, misses = speed, 0
        order.remove(passed)
        order.insert(0, passed)
    return found


def least_sideslip(drive: Drive, config: Config, speed_km_h: float, drivers: Sequence[Hands] = DRIVERS) -> float:
    """Return the largest sideslip angle in deg of the driver who passes with the least; infinite where nobody passes."""
    found = (_sideslip(drive, config, speed_km_h, hands) for hands in drivers)
    return min((sideslip for sideslip in found if sideslip is not None), default=np.inf)


def _sideslip(drive: Drive, config: Config, speed_km_h: float, hands: Hands) -> float | None:
    scenario = LaneChange.at(speed_km_h, hands)
    return sideslip_if_passed(drive(scenario), scenario, config)
