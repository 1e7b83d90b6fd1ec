"""The second implementation by the kind of controller."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup
from codegen.sil.software import Measurement
from tests.oracle.controller import Road, SecondController, clip
from tests.oracle.tracking import SecondTracking


class SecondPi(SecondController):
    """PI on the yaw-rate error."""

    integral: Any = 0.0

    def start(self, m: Measurement) -> None:
        self.integral = self.angle + self.parameter("proportional_gain") * (self.map_yaw_rate(m) - m.yaw_rate)

    def law(self, m: Measurement) -> tuple[Any, bool]:
        p = self.parameter
        reference = self.map_yaw_rate(m)
        error = reference - m.yaw_rate
        proportional = p("proportional_gain") * error
        low, high = self.actuator_range(m)
        integral = self.integral if m.inhibit else self.integral - p("integral_gain") * self.period * error
        demand = integral - proportional
        limited = not low <= demand <= high
        demand = clip(demand, low, high)
        if limited and not m.inhibit:
            integral = demand + proportional
        reachable = self.reachable(demand)
        if reachable != demand:
            limited = True
            if (demand > reachable and integral > self.integral) or (demand < reachable and integral < self.integral):
                integral = self.integral
        self.integral, self.angle = integral, reachable
        return reference, limited


class SecondFeedforward(SecondController):
    """The map's own rear angle, at the rate limit."""

    def law(self, m: Measurement) -> tuple[Any, bool]:
        yaw_rate, wanted = self.lookup.reference(abs(m.speed), m.front_angle, self.friction(m), m.longitudinal_acceleration)
        bound = self.parameter("rear_angle_max")
        self.angle = self.reachable(clip(wanted, -bound, bound))
        return -yaw_rate if m.speed < 0.0 else yaw_rate, bool(self.angle != wanted)


class SecondProportional(SecondController):
    """k(speed) times the front angle, k = -(lr - s v^2) / (L - lr + (K + s) v^2)."""

    def law(self, m: Measurement) -> tuple[Any, bool]:
        p = self.parameter
        squared, arm, slip = m.speed * m.speed, p("rear_arm"), p("rear_slip_per_acceleration")
        rest = (self.real(self.p.inputs.wheelbase) - arm) + (self.real(self.p.inputs.understeer_coefficient) + slip) * squared
        wanted = -((arm - slip * squared) / max(rest, self.real(0.01))) * m.front_angle
        bound = p("rear_angle_max")
        self.angle = self.reachable(clip(wanted, -bound, bound))
        return self.map_yaw_rate(m), bool(self.angle != wanted)


SECOND: Mapping[str, type[SecondController]] = {
    "pi": SecondPi,
    "tracking": SecondTracking,
    "feedforward": SecondFeedforward,
    "proportional": SecondProportional,
}
"""Second implementation by kind."""


def second_controller(config: Config, parameters: Any, lookup: Lookup, road: Road, rear_angle: float) -> SecondController:
    """Return a controller of the configured kind that starts from a rear angle in rad. Raises KeyError: there is none."""
    return SECOND[config.controller.kind](config, parameters, lookup, road, rear_angle)
