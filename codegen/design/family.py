"""The family of cars that the feedback must suit: deviations from the configured car and their combinations."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from codegen.configuration import Config
from codegen.errors import ConfigError

MEMBERS_MAX = 4096
"""Largest number of combinations that the design accepts, far above that of both ends and the middle of each deviation."""

DEVIATIONS = ("actuator_lag_s", "mass_percent", "stiffness_percent", "relaxation_length_m")


@dataclass(frozen=True)
class Member:
    """One car of the family.

    Attributes:
        actuator_lag: s, first order.
        mass_factor: factor on mass and yaw inertia; 1 is the configured car, as for the next two.
        front_stiffness_factor: factor on the cornering stiffness of the front axle.
        rear_stiffness_factor: factor on the cornering stiffness of the rear axle.
        relaxation_length: m, tyres of both axles; 0 where the force follows the slip at once.
    """

    actuator_lag: float
    mass_factor: float = 1.0
    front_stiffness_factor: float = 1.0
    rear_stiffness_factor: float = 1.0
    relaxation_length: float = 0.0

    def __str__(self) -> str:
        """Return a short text for messages and tables: "lag 50 ms, mass +20 %, stiffness -20/+15 %, relaxation 0.6 m"."""
        stiffness = f"{_percent(self.front_stiffness_factor)}/{_percent(self.rear_stiffness_factor)} %"
        return (
            f"lag {1e3 * self.actuator_lag:.4g} ms, mass {_percent(self.mass_factor)} %, stiffness {stiffness}, "
            f"relaxation {self.relaxation_length:.3g} m"
        )


def _percent(factor: float) -> str:
    deviation = round(100.0 * (factor - 1.0), 3)
    return f"{deviation:+.3g}" if deviation else "0"


def nominal(config: Config) -> Member:
    """Return the configured car, with the relaxation length of the simulated plant."""
    return Member(actuator_lag=config.rear_actuator.lag_s, relaxation_length=config.plant.relaxation_length_m)


def members(config: Config) -> tuple[Member, ...]:
    """Return all combinations of the deviations in `config.tuning`, each once, and the configured car.

    The stiffnesses of front and rear axle vary independently; the yaw inertia goes with the mass.

    Raises:
        ConfigError: a list of deviations is empty, or there are more than MEMBERS_MAX combinations.
    """
    tuning = config.tuning
    for key in DEVIATIONS:
        if not getattr(tuning, key):
            raise ConfigError("an empty list", where=f"tuning.{key}", remedy="list at least one value, 0 for no deviation")
    factors = [tuple(1.0 + value / 100.0 for value in values) for values in (tuning.mass_percent, tuning.stiffness_percent)]
    axes = (tuning.actuator_lag_s, factors[0], factors[1], factors[1], tuning.relaxation_length_m)
    distinct = [tuple(dict.fromkeys(axis)) for axis in axes]
    count = math.prod(len(axis) for axis in distinct)
    if count > MEMBERS_MAX:
        raise ConfigError(
            f"{count} combinations of deviations; at most {MEMBERS_MAX} are taken",
            where="tuning",
            remedy="list fewer values: the ends and the middle of each deviation",
        )
    family = dict.fromkeys(Member(*combination) for combination in itertools.product(*distinct))
    return tuple(family | {nominal(config): None})
