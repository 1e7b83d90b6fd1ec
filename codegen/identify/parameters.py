"""The table of identified quantities: unit, key, what is assumed before, bounds, and the manoeuvre that each needs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.units import DEGREE
from codegen.vehicle.tyre import AxleTyres

Group = Literal["vehicle", "actuator", "steering"]


END_SPREADS = 1e-3
"""Distance to an end of the range, in spreads, within which a value counts as at that end: far below every deviation."""


@dataclass(frozen=True)
class Parameter:
    """One identified quantity.

    Attributes:
        name: identifier.
        title: name for messages.
        group: problem that determines it.
        key: key of ars.toml; empty for a property of the sensors, which has none.
        unit: unit of the key, or the shown unit.
        size: SI value of that unit.
        spread: standard deviation of what is assumed before, around the configured value: a fraction if `is_relative`, else SI.
        is_relative: whether the quantity is positive and varies in proportion; its logarithm is estimated.
        low, high: bounds in SI.
        manoeuvre: what to drive to determine it.
    """

    name: str
    title: str
    group: Group
    key: str
    unit: str
    size: float
    spread: float
    is_relative: bool
    low: float
    high: float
    manoeuvre: str

    def end_at(self, value: float) -> float | None:
        """Return the end of the range at which a value (SI) lies; None inside."""
        for end in (self.low, self.high):
            if abs(value - end) <= END_SPREADS * self.spread * (end if self.is_relative else 1.0):
                return end
        return None


_TURN = "steady turns at several speeds and step steers, up to 4 m/s^2"
_LIMIT = "slowly increasing steer up to the limit of grip"
_SWEEP = "sine sweep of the steering wheel up to 3 Hz, at two speeds"
_STRAIGHT = "straight driving at several speeds"


def _tyre(axle: str) -> tuple[Parameter, ...]:
    table = f"tyre.{axle}"
    push = _LIMIT if axle == "front" else f"{_LIMIT}, with the rear wheels turned against the front ones"
    return (
        Parameter(
            f"{axle}_stiffness",
            f"{axle} cornering stiffness",
            "vehicle",
            f"{table}.cornering_stiffness_n_per_rad",
            "N/rad",
            1.0,
            0.5,
            True,
            3e3,
            2e6,
            f"{_TURN}; with rear steering or measured sideslip" if axle == "rear" else _TURN,
        ),
        Parameter(f"{axle}_peak", f"{axle} D", "vehicle", f"{table}.peak_factor_p1", "", 1.0, 0.15, True, 0.2, 3.0, push),
        Parameter(f"{axle}_shape", f"{axle} C", "vehicle", f"{table}.shape_factor_c", "", 1.0, 0.2, False, 0.5, 2.5, push),
        Parameter(
            f"{axle}_curvature", f"{axle} E", "vehicle", f"{table}.curvature_factor_e", "", 1.0, 0.7, False, -20.0, 1.0, push
        ),
        Parameter(
            f"{axle}_load_sensitivity",
            f"{axle} load sensitivity",
            "vehicle",
            f"{table}.peak_load_sensitivity_p2",
            "",
            1.0,
            0.1,
            False,
            -1.0,
            1.0,
            push,
        ),
    )


def _sensor(name: str, title: str, unit: str, size: float, spread: float, bound: float, manoeuvre: str) -> Parameter:
    return Parameter(name, title, "vehicle", "", unit, size, spread, False, -bound, bound, manoeuvre)


def _delay(name: str, title: str) -> Parameter:
    return _sensor(f"{name}_delay", f"{title} delay", "s", 1.0, 0.02, 0.2, _SWEEP)


PARAMETERS = (
    *_tyre("front"),
    *_tyre("rear"),
    Parameter(
        "yaw_inertia", "yaw inertia", "vehicle", "vehicle.yaw_inertia_kg_m2", "kg m^2", 1.0, 0.4, True, 50.0, 5e5, _SWEEP
    ),
    Parameter(
        "relaxation_length",
        "relaxation length",
        "vehicle",
        "plant.relaxation_length_m",
        "m",
        1.0,
        0.3,
        False,
        0.05,
        2.0,
        _SWEEP,
    ),
    Parameter(
        "steering_ratio",
        "steering ratio",
        "vehicle",
        "steering.ratio",
        "",
        1.0,
        0.1,
        True,
        1.0,
        40.0,
        "slow turns below 20 km/h, or measure the angle of the front wheels",
    ),
    _sensor("front_offset", "front angle offset", "deg", DEGREE, 0.5 * DEGREE, 5.0 * DEGREE, _STRAIGHT),
    Parameter("speed_factor", "speed factor", "vehicle", "", "", 1.0, 0.02, True, 0.8, 1.2, "steady turns at 3 m/s^2 or more"),
    _sensor("speed_offset", "speed offset", "m/s", 1.0, 0.1, 2.0, "steady turns at low and at high speed"),
    Parameter(
        "lateral_acceleration_factor",
        "lateral acceleration factor",
        "vehicle",
        "",
        "",
        1.0,
        0.05,
        True,
        0.8,
        1.3,
        "steady turns at 3 m/s^2 or more, at two speeds",
    ),
    _sensor("yaw_rate_offset", "yaw rate offset", "deg/s", DEGREE, 1.0 * DEGREE, 10.0 * DEGREE, _STRAIGHT),
    _sensor("lateral_acceleration_offset", "lateral acceleration offset", "m/s^2", 1.0, 0.5, 3.0, _STRAIGHT),
    _sensor("sideslip_offset", "sideslip offset", "deg", DEGREE, 1.0 * DEGREE, 10.0 * DEGREE, _STRAIGHT),
    _delay("yaw_rate", "yaw rate"),
    _delay("lateral_acceleration", "lateral acceleration"),
    _delay("sideslip", "sideslip"),
    Parameter(
        "actuator_lag",
        "actuator lag",
        "actuator",
        "rear_actuator.lag_s",
        "s",
        1.0,
        0.7,
        True,
        0.002,
        1.0,
        "sine sweep or small steps of the rear angle command",
    ),
    Parameter(
        "actuator_rate",
        "actuator rate",
        "actuator",
        "rear_actuator.rate_max_deg_s",
        "deg/s",
        DEGREE,
        0.7,
        True,
        1.0 * DEGREE,
        500.0 * DEGREE,
        "steps of the rear angle command over the whole angle",
    ),
    Parameter(
        "actuator_delay",
        "actuator delay",
        "actuator",
        "plant.command_delay_samples",
        "s",
        1.0,
        0.02,
        False,
        -0.05,
        0.5,
        "sine sweep or small steps of the rear angle command",
    ),
    Parameter(
        "rear_offset",
        "rear angle offset",
        "actuator",
        "",
        "deg",
        DEGREE,
        0.5 * DEGREE,
        False,
        -0.1,
        0.1,
        "a rear angle command",
    ),
)
"""All quantities. Actuator rates and angles are in rad/s and rad inside."""

CURVE_PARAMETERS = tuple(
    tuple(f"{axle}_{name}" for name in ("peak", "shape", "curvature", "load_sensitivity")) for axle in ("front", "rear")
)
"""Quantities that describe one curve: where the first is determined, all are taken, else none."""

HANDLING_PARAMETERS = ("front_stiffness", "rear_stiffness", "yaw_inertia")
"""Quantities whose ratios make the response of the car: where one is determined, weakly determined ones are taken with it."""

BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}


def configured(config: Config) -> dict[str, float]:
    """Return the configured value of every quantity in SI; sensor errors are zero, their delays those of `[sensors]`."""
    tyres = AxleTyres.from_config(config)
    period = config.controller.sampling_time_s
    values = {
        "yaw_inertia": config.vehicle.yaw_inertia_kg_m2,
        "relaxation_length": config.plant.relaxation_length_m,
        "steering_ratio": config.steering.ratio,
        "speed_factor": 1.0,
        "lateral_acceleration_factor": 1.0,
        "yaw_rate_delay": config.sensors.yaw_rate.delay_samples * period,
        "lateral_acceleration_delay": config.sensors.lateral_acceleration.delay_samples * period,
        "actuator_lag": config.rear_actuator.lag_s,
        "actuator_rate": math.radians(config.rear_actuator.rate_max_deg_s),
        "actuator_delay": config.plant.command_delay_samples * period,
    }
    for axle, tyre in (("front", tyres.front), ("rear", tyres.rear)):
        values |= {
            f"{axle}_stiffness": tyre.cornering_stiffness,
            f"{axle}_peak": tyre.peak_factor,
            f"{axle}_shape": tyre.shape_factor,
            f"{axle}_curvature": tyre.curvature_factor,
            f"{axle}_load_sensitivity": tyre.peak_load_sensitivity,
        }
    return {parameter.name: float(values.get(parameter.name, 0.0)) for parameter in PARAMETERS}


@dataclass(frozen=True)
class Prior:
    """Assumptions about the quantities of one problem, and their scaled form z: zero at the centre, one at its spread.

    Attributes:
        parameters: the quantities, in order.
        centre: (k,) SI.
    """

    parameters: tuple[Parameter, ...]
    centre: FloatArray

    @classmethod
    def of(cls, names: tuple[str, ...], centre: dict[str, float]) -> Prior:
        """Return the prior of the named quantities around the values of `centre`."""
        return cls(tuple(BY_NAME[name] for name in names), np.array([centre[name] for name in names]))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def _spread(self) -> FloatArray:
        return np.array([parameter.spread for parameter in self.parameters])

    @property
    def _is_relative(self) -> FloatArray:
        return np.array([parameter.is_relative for parameter in self.parameters], dtype=bool)

    def scaled(self, values: FloatArray) -> FloatArray:
        """Return z (k,) of values (k,) in SI."""
        relative = self._is_relative
        result: FloatArray = (values - self.centre) / self._spread
        result[relative] = np.log(values[relative] / self.centre[relative]) / self._spread[relative]
        return result

    def values(self, z: FloatArray) -> FloatArray:
        """Return the values (k,) in SI of z (k,)."""
        relative = self._is_relative
        result: FloatArray = self.centre + z * self._spread
        result[relative] = self.centre[relative] * np.exp(z[relative] * self._spread[relative])
        return result

    def slope(self, values: FloatArray) -> FloatArray:
        """Return the derivative (k,) of the values by z."""
        result: FloatArray = np.where(self._is_relative, values, 1.0) * self._spread
        return result

    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of z."""
        low, high = (np.array([getattr(parameter, side) for parameter in self.parameters]) for side in ("low", "high"))
        return self.scaled(low), self.scaled(high)
