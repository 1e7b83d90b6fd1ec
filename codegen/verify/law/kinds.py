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
"""By kind: from configuration, anything with the fields of the C parameter struct, the look-up of the map, the road that it was
made for, and the rear angle to start from (rad), a controller in the numbers of the look-up."""


def second_controller(config: Config, parameters: Any, lookup: Lookup, road: Road, rear_angle: float) -> SecondController:
    """A controller of the configured kind; see `SECOND`. Raises KeyError: nobody has written that kind a second time."""
    return SECOND[config.controller.kind](config, parameters, lookup, road, rear_angle)
