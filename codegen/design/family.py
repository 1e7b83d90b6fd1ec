"""The family of cars that the feedback must suit: deviations from the configured car and their combinations.

Measured deviations come from `[identified]`, together and with their correlations: the ends of the principal axes of the
ellipsoid that contains ELLIPSOID_SHARE of all cars, and the points half way between the axes. A figure that is linear in the
deviations is then, for at least 99.5 % of the cars, no worse than for the worst of these points (five keys or fewer). The other
deviations are those of `[tuning]`, in all combinations.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from codegen.configuration import Config
from codegen.errors import ConfigError
from codegen.vehicle.population import Population, varying_keys

MEMBERS_MAX = 4096
"""Largest number of combinations that the design accepts, far above those of both ends and the middle of each deviation."""

ELLIPSOID_SHARE = 0.99

SLOW_LAG_FACTOR = 2.0 - 1e-9
"""Factor on the configured lag from which an actuator is slow."""


@dataclass(frozen=True)
class Member:
    """One car of the family.

    Attributes:
        actuator_lag: s; the time constant of its motor, `plant.actuator_motor_share`, is in proportion.
        mass_factor: factor on mass and yaw inertia; 1 is the configured car, as for the next two.
        front_stiffness_factor: factor on the cornering stiffness of the front axle.
        rear_stiffness_factor: factor on the cornering stiffness of the rear axle.
        relaxation_length: m, of the front tyres, and times `plant.rear_relaxation_factor` of the rear ones; 0 where the force
            follows the slip at once.
        yaw_inertia_factor: factor on the yaw inertia, on top of that of the mass.
        is_slow: whether both actuator and tyres are slow, SLOW_LAG_FACTOR times the lag with a relaxation length. Such a car
            needs less margin.
    """

    actuator_lag: float
    mass_factor: float = 1.0
    front_stiffness_factor: float = 1.0
    rear_stiffness_factor: float = 1.0
    relaxation_length: float = 0.0
    yaw_inertia_factor: float = 1.0
    is_slow: bool = False

    def __str__(self) -> str:
        """Return a short text for messages and tables: "lag 50 ms, mass +20 %, stiffness -20/+15 %, relaxation 0.6 m"."""
        stiffness = f"{_percent(self.front_stiffness_factor)}/{_percent(self.rear_stiffness_factor)} %"
        inertia = "" if self.yaw_inertia_factor == 1.0 else f", yaw inertia {_percent(self.yaw_inertia_factor)} %"
        return (
            f"lag {1e3 * self.actuator_lag:.4g} ms, mass {_percent(self.mass_factor)} %{inertia}, stiffness {stiffness}, "
            f"relaxation {self.relaxation_length:.3g} m"
        )


def _percent(factor: float) -> str:
    deviation = round(100.0 * (factor - 1.0), 3)
    return f"{deviation:+.3g}" if deviation else "0"


def nominal(config: Config) -> Member:
    """Return the configured car, with the relaxation length of the simulated plant."""
    return Member(actuator_lag=config.rear_actuator.lag_s, relaxation_length=config.plant.relaxation_length_m)


MEASURABLE = {
    "rear_actuator.lag_s": "actuator_lag",
    "vehicle.yaw_inertia_kg_m2": "yaw_inertia_factor",
    "tyre.front.cornering_stiffness_n_per_rad": "front_stiffness_factor",
    "tyre.rear.cornering_stiffness_n_per_rad": "rear_stiffness_factor",
    "plant.relaxation_length_m": "relaxation_length",
}
"""Key of `[identified]` -> attribute of a member that it gives, as a value or as a factor on the configured value."""


def measured_keys(config: Config) -> tuple[str, ...]:
    """Return the keys of `[identified]` that give deviations of the family: none if they are in doubt."""
    if config.identified.is_doubtful:
        return ()
    return tuple(key for key in varying_keys(config) if key in MEASURABLE)


def members(config: Config) -> tuple[Member, ...]:
    """Return all combinations of the deviations in `config.tuning`, each once, and the configured car.

    The stiffnesses of front and rear axle vary independently; the yaw inertia goes with the mass. Measured deviations replace
    those of `config.tuning`.

    Raises:
        ConfigError: there are more than MEMBERS_MAX combinations, or the measured correlations contradict each other.
    """
    tuning = config.tuning
    factors = [tuple(1.0 + value / 100.0 for value in values) for values in (tuning.mass_percent, tuning.stiffness_percent)]
    axes = {
        "actuator_lag": config.actuator_lags_s,
        "mass_factor": factors[0],
        "front_stiffness_factor": factors[1],
        "rear_stiffness_factor": factors[1],
        "relaxation_length": tuning.relaxation_length_m,
    }
    measured = _measured(config)
    distinct = {name: tuple(dict.fromkeys(axis)) for name, axis in axes.items() if name not in measured[0]}
    count = len(measured) * math.prod(len(axis) for axis in distinct.values())
    if count > MEMBERS_MAX:
        raise ConfigError(
            f"{count} combinations of deviations; at most {MEMBERS_MAX} are taken",
            where="tuning",
            remedy="list fewer values: the ends and the middle of each deviation",
        )
    combinations: Iterator[dict[str, Any]] = (
        dict(zip(distinct, values, strict=True)) for values in itertools.product(*distinct.values())
    )
    cars = (Member(**combination, **point) for combination in combinations for point in measured)
    slow_lag = SLOW_LAG_FACTOR * config.rear_actuator.lag_s
    family = dict.fromkeys(replace(car, is_slow=car.actuator_lag >= slow_lag and car.relaxation_length > 0.0) for car in cars)
    return tuple(family | {nominal(config): None})


def _measured(config: Config) -> list[dict[str, Any]]:
    """Return the measured deviations: attributes of a member, none in the only entry if nothing was measured."""
    keys = measured_keys(config)
    if not keys:
        return [{}]
    population = Population.of(config, keys)
    cars = (config, *population.axes(ELLIPSOID_SHARE), *population.corners(ELLIPSOID_SHARE))
    return [{MEASURABLE[key]: _deviation(car, config, key) for key in keys} for car in cars]


def _deviation(car: Config, config: Config, key: str) -> float:
    value = float(car.value(key))
    return value / config.value(key) if MEASURABLE[key].endswith("_factor") else value


def origin(config: Config) -> str:
    """Return where the deviations of the family come from, in words; "" if all are those of `[tuning]`."""
    keys = measured_keys(config)
    if not keys:
        return ""
    taken = {MEASURABLE[key] for key in keys}
    others = {
        "lag": "actuator_lag" in taken,
        "mass": False,
        "stiffness": taken >= {"front_stiffness_factor", "rear_stiffness_factor"},
        "relaxation": "relaxation_length" in taken,
    }
    rest = ", ".join(name for name, is_measured in others.items() if not is_measured)
    return f"{', '.join(keys)} from [identified] ({100.0 * ELLIPSOID_SHARE:g} % of the cars); {rest} from [tuning]"
