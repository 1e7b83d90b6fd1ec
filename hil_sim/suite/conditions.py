"""Conditions for every cell: a car that differs from the configured one, and a road."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

from codegen.configuration import Config
from hil_sim.suite import plants
from hil_sim.suite.plants import Change, unchanged

Group = Literal["nominal", "lag", "mass", "tyre", "combined", "friction"]

LAGS_S = (0.02, 0.05, 0.1)
FRICTIONS = (0.6, 0.4)
ESTIMATE_ERROR = 0.2
"""Largest overestimate of the friction."""


@dataclass(frozen=True)
class Condition:
    """A car and a road.

    Attributes:
        name, title: key, and name in tables.
        group: varied property.
        plant: change of the configuration for the plant.
        friction: friction of the road; None for the configured one.
        estimate: friction estimate for the controller; None for unknown.
        what: details beyond the title.
    """

    name: str
    title: str
    group: Group
    plant: Change = unchanged
    friction: float | None = None
    estimate: float | None = None
    what: str = ""

    @property
    def estimate_or_nan(self) -> float:
        """Friction estimate as passed to the C."""
        return math.nan if self.estimate is None else self.estimate

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values, without the function."""
        names = ("name", "title", "group", "friction", "estimate", "what")
        return {name: getattr(self, name) for name in names}


NOMINAL = Condition("nominal", "as configured", "nominal")
LAGS = tuple(
    Condition(f"lag-{1e3 * lag:.0f}", f"actuator lag {1e3 * lag:.0f} ms", "lag", plants.actuator_lag(lag)) for lag in LAGS_S
)
MASSES = (
    Condition("mass-minus-20", "mass -20 %", "mass", plants.mass(-20.0)),
    Condition("mass-plus-20", "mass +20 %", "mass", plants.mass(20.0)),
)
TYRES = (
    Condition("stiffness-minus-20", "tyre stiffness -20 %", "tyre", plants.stiffness(-20.0, -20.0)),
    Condition("stiffness-plus-15", "tyre stiffness +15 %", "tyre", plants.stiffness(15.0, 15.0)),
    Condition("rear-stiffness-minus-20", "rear tyre stiffness -20 %", "tyre", plants.stiffness(0.0, -20.0)),
    Condition("peak-minus-10", "tyre peak -10 %", "tyre", plants.peak(-10.0)),
    Condition("peak-plus-10", "tyre peak +10 %", "tyre", plants.peak(10.0)),
    Condition("load-sensitivity", "load sensitivity p2 = -0.1", "tyre", plants.load_sensitivity(-0.1)),
    Condition("relaxation-300", "relaxation length 0.3 m", "tyre", plants.relaxation(0.3)),
    Condition("relaxation-600", "relaxation length 0.6 m", "tyre", plants.relaxation(0.6)),
)
COMBINED = Condition(
    "combined",
    "many at once",
    "combined",
    plants.together(
        plants.actuator_lag(0.1),
        plants.mass(20.0),
        plants.stiffness(-20.0, -20.0),
        plants.peak(-10.0),
        plants.load_sensitivity(-0.1),
        plants.relaxation(0.6),
    ),
    what="actuator lag 100 ms, mass +20 %, tyre stiffness -20 %, peak -10 %, p2 = -0.1 and relaxation length 0.6 m",
)


def _on_road(friction: float) -> tuple[Condition, ...]:
    key, road = f"friction-{100.0 * friction:.0f}", f"friction {friction:g}"
    wrong = round(friction + ESTIMATE_ERROR, 9)
    return (
        Condition(key, f"{road}, no estimate", "friction", friction=friction),
        Condition(f"{key}-exact", f"{road}, estimated {friction:g}", "friction", friction=friction, estimate=friction),
        Condition(f"{key}-wrong", f"{road}, estimated {wrong:g}", "friction", friction=friction, estimate=wrong),
    )


SLIPPERY = tuple(condition for friction in FRICTIONS for condition in _on_road(friction))

CONDITIONS = (NOMINAL, *LAGS, *MASSES, *TYRES, COMBINED, *SLIPPERY)


def conditions(config: Config) -> tuple[Condition, ...]:
    """Return the conditions that apply to a configuration: no road with more friction than its map assumes."""
    return tuple(each for each in CONDITIONS if each.friction is None or each.friction < config.road.friction)
