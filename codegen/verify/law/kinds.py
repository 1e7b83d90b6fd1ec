"""The second implementation by the kind of controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup
from codegen.verify.law.controller import SecondController, SecondFeedforward, SecondPi, SecondProportional
from codegen.verify.law.tracking import Road, SecondTracking

Make = Callable[[Config, Any, Lookup, Road, float], SecondController]


def _around_look_up(law: type[SecondController]) -> Make:
    def make(config: Config, parameters: Any, lookup: Lookup, road: Road, rear_angle: float) -> SecondController:
        del road
        actuator_max = float(lookup.real(config.rear_actuator.angle_max))
        return law(parameters, lookup, config.controller.sampling_time_s, actuator_max, lookup.real, rear_angle)

    return make


def _tracking(config: Config, parameters: Any, lookup: Lookup, road: Road, rear_angle: float) -> SecondController:
    return SecondTracking(parameters, lookup, road, config, rear_angle)


SECOND: Mapping[str, Make] = {
    "pi": _around_look_up(SecondPi),
    "tracking": _tracking,
    "feedforward": _around_look_up(SecondFeedforward),
    "proportional": _around_look_up(SecondProportional),
}
"""Second implementation by kind, from the configuration, the C parameters, the lookup of the map, the road of the map, and
the initial rear angle in rad."""


def second_controller(config: Config, parameters: Any, lookup: Lookup, road: Road, rear_angle: float) -> SecondController:
    """Return a controller of the configured kind; see `SECOND`. Raises KeyError if that kind has no second implementation."""
    return SECOND[config.controller.kind](config, parameters, lookup, road, rear_angle)
