"""Error of a map for a lower friction in place of one under longitudinal acceleration.

An ECU without a stack over longitudinal acceleration comes near to it by lowering its friction estimate while it brakes: the
weaker axle limits both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.errors import ConfigError
from codegen.map_file.longitudinal import like_friction
from codegen.map_file.map import ReferenceMap, on_road
from codegen.map_file.tables import ACCELERATION
from codegen.optimum.problem import breakpoints
from codegen.optimum.turns import turns_of


@dataclass(frozen=True)
class FrictionError:
    """Errors of the map for `friction` in place of one layer, over the cells that are feasible in both; rad/s and rad."""

    acceleration: float
    friction: float
    yaw_rate_rms: float
    yaw_rate_max: float
    rear_angle_max: float

    @property
    def line(self) -> str:
        """Text for the user."""
        return (
            f"at {self.acceleration:g} m/s^2 like friction {self.friction:.2f}: yaw rate within "
            f"{math.degrees(self.yaw_rate_max):.2f} deg/s (rms {math.degrees(self.yaw_rate_rms):.2f}), rear angle within "
            f"{math.degrees(self.rear_angle_max):.2f} deg"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {
            "acceleration_m_s2": self.acceleration,
            "friction": round(self.friction, 4),
            "yaw_rate_rms_deg_s": round(math.degrees(self.yaw_rate_rms), 4),
            "yaw_rate_max_deg_s": round(math.degrees(self.yaw_rate_max), 4),
            "rear_angle_max_deg": round(math.degrees(self.rear_angle_max), 4),
        }


def friction_errors(reference_map: ReferenceMap) -> tuple[FrictionError, ...]:
    """Compare the layers of a solved stack over longitudinal acceleration with maps for their `like_friction`.

    Layers without such a map are left out: the friction is too low for one, or no cell is feasible in both.

    Raises:
        MapError: a steady turn is not found.
    """
    config, case = reference_map.config, reference_map.case
    if config is None or case is None or reference_map.quantity is not ACCELERATION:
        return ()
    errors = []
    for layer in reference_map.layers:
        friction = like_friction(config, layer.value)
        try:
            road = on_road(config, friction)
            breakpoints(road)  # an oversteering car becomes unstable at a lower speed
        except ConfigError:
            continue
        other = turns_of(road, config.case(case)).solve(reference_map.speed, reference_map.front_angle)
        assert layer.map.rear_angle is not None  # it was solved
        both = layer.map.feasible & other.feasible
        if not both.any():
            continue
        yaw_rate = (layer.map.yaw_rate - other.yaw_rate)[both]
        rear_angle = (layer.map.rear_angle - other.rear_angle)[both]
        rms = float(np.sqrt(np.mean(yaw_rate**2)))
        largest = (float(np.abs(values).max()) for values in (yaw_rate, rear_angle))
        errors.append(FrictionError(layer.value, friction, rms, *largest))
    return tuple(errors)
