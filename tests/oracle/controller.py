"""The controller around any law, and the safety limiter behind it, as their headers and README describe them, in Python."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, NamedTuple

from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup
from codegen.emit.controller_view import SLOW_RATE, STANDING_SPEED
from codegen.sil.software import Command, Measurement, Status
from tests.oracle.inputs import Quality, SecondInputs


def clip(value: Any, low: Any, high: Any) -> Any:
    """Limit a value. The upper bound wins if the bounds cross; NaN becomes the lower bound."""
    return min(max(value, low), high)


class SecondLimiter:
    """Second implementation of the limiter. `parameters` has the fields of the C parameter struct; `period` in s; initial
    `angle` in rad."""

    def __init__(self, parameters: Any, period: float, real: Any, angle: Any = 0.0) -> None:
        self.real = real
        self.period = real(period)
        self.parameters = parameters
        self.angle = real(angle) if abs(real(angle)) <= 1.0 else real(0.0)
        self.speed: Any = None
        self.front_angle = real(0.0)

    def parameter(self, name: str) -> Any:
        return self.real(getattr(self.parameters, name))

    def step(self, speed: Any, front_angle: Any, demand: Any) -> Any:
        speed, front_angle, demand = (self.real(value) for value in (speed, front_angle, demand))
        if abs(speed) <= self.parameter("speed_max"):
            self.speed = abs(speed)
        if abs(front_angle) <= self.parameter("front_angle_max"):
            self.front_angle = front_angle
        wanted = self.angle
        if self.speed is not None:
            low, high = self.range()
            wanted = clip(wanted if math.isnan(demand) else demand, low, high)
        travel = self.parameter("rear_rate_max") * self.period
        wanted = clip(wanted, self.angle - travel, self.angle + travel)
        bound = self.parameter("rear_angle_max")
        self.angle = clip(wanted, -bound, bound)
        return self.angle

    def range(self) -> tuple[Any, Any]:
        """Return the range of the rear angle in rad at the speed and front angle."""
        opposite = self.opposite_phase_bound()
        share = min(abs(self.front_angle) / self.parameter("in_phase_from_front_angle"), self.real(1.0))
        in_phase = opposite + share * (self.parameter("rear_angle_max") - opposite)
        if self.front_angle < 0.0:
            return -in_phase, opposite
        return -opposite, in_phase if self.front_angle > 0.0 else opposite

    def opposite_phase_bound(self) -> Any:
        speeds, bounds = (
            [self.real(value) for value in getattr(self.parameters, name)]
            for name in ("opposite_phase_speed", "opposite_phase_max")
        )
        if self.speed <= speeds[0]:
            return bounds[0]
        for k in range(1, len(speeds)):
            if self.speed < speeds[k]:
                share = (self.speed - speeds[k - 1]) / (speeds[k] - speeds[k - 1])
                return bounds[k - 1] + share * (bounds[k] - bounds[k - 1])
        return bounds[-1]


class Road(NamedTuple):
    """Road for which the map was made: peak friction, and the lateral acceleration in m/s^2 that the map allows on it."""

    friction: float
    lateral_acceleration_cap: float


class SecondController(ABC):
    """Supervision that all kinds share, around a control law: input monitoring first, limiter last.

    Args:
        config: configuration of the build.
        parameters: anything with the fields of the C parameter struct.
        lookup: of the map.
        road: of the map.
        angle: rad, to start from.
    """

    def __init__(self, config: Config, parameters: Any, lookup: Lookup, road: Road, angle: float) -> None:
        self.p = parameters
        self.lookup = lookup
        self.road = road
        self.real: Any = lookup.real
        real = self.real
        period, actuator_max = config.controller.sampling_time_s, float(real(config.rear_actuator.angle_max))
        self.period = real(period)
        self.actuator_max = actuator_max
        self.place(angle)
        self.inputs = SecondInputs(parameters.inputs, real, period, lookup.strongest_braking)
        self.status = Status.STANDBY
        self.waits_for_speed = config.controller.waits_for_speed
        self.runs = False
        self.missed = 0
        self.quality = Quality.GOOD
        self.error = real(0.0)

    def place(self, angle: float) -> None:
        """Go on from the angle in rad that the actuator holds."""
        within = min(max(angle, -self.actuator_max), self.actuator_max)
        self.angle = self.real(0.0) if math.isnan(angle) else self.real(within)
        self.limiter = SecondLimiter(self.p.limiter, float(self.period), self.real, self.angle)

    def start(self, m: Measurement) -> None:  # noqa: B027 - most laws have no state to start
        """Start the law without a jump from the commanded angle."""

    def rest(self, m: Measurement) -> None:  # noqa: B027 - most laws have no model
        """Compute a sample without control, down to `angle`."""

    def model(self) -> tuple[Any, ...] | None:
        """Return the state of the reference model; None for laws without one."""
        return None

    @abstractmethod
    def law(self, m: Measurement) -> tuple[Any, bool]:
        """Compute one sample of the law, down to `angle`. Return the reference yaw rate and whether a limit acted."""

    def parameter(self, name: str) -> Any:
        return self.real(getattr(self.p, name))

    def step(self, measurement: Measurement) -> Command:
        yaw_rate_reference = self.real(0.0)
        self.quality, sample = self.inputs.step(measurement, self.angle, self.model())
        if self.quality is Quality.UNUSABLE:
            self.status, self.runs = Status.FAIL_SAFE, False
        elif self.quality is Quality.MISSING:
            if self.runs or (self.waits_for_speed and self.status is not Status.FAIL_SAFE):
                self.status = Status.DEGRADED
            if self.waits_for_speed:
                self.runs &= not sample.speed < self.parameter("disable_speed")
            if self.runs:
                self.missed += 1
                yaw_rate_reference = self._within_distance(sample)[0]
        else:
            ran = self.runs
            if self.waits_for_speed:
                self._choose_by_speed(sample.speed)
            elif not self.runs:
                self.runs, self.status = bool(self.inputs.speed.is_measured or sample.speed), Status.STANDBY
            if self.runs:
                yaw_rate_reference = self._control(sample, ran)
        if self.status is Status.STANDBY and self.waits_for_speed:
            self.approach_zero(self.parameter("standby_rate"))
        elif self.status is Status.FAIL_SAFE:
            self.approach_zero(self.parameter("fail_safe_rate"))
        if not self.runs:
            self.rest(sample)
        limited = self.limiter.step(sample.speed, sample.front_angle, self.angle)
        if limited != self.angle and self.status is Status.TRACKING:
            self.status = Status.LIMITED
        self.angle = limited
        return Command(float(self.angle), float(yaw_rate_reference), self.status)

    def _choose_by_speed(self, speed: Any) -> None:
        if speed >= self.parameter("enable_speed"):
            self.runs = True
        if speed < self.parameter("disable_speed"):
            self.runs = False
        self.status = Status.STANDBY

    def approach_zero(self, rate: Any) -> None:
        """Return the angle to zero at a rate in rad/s."""
        left = abs(self.angle) - rate * self.period
        self.angle = self.real(math.copysign(max(left, self.real(0.0)), self.angle))

    def _within_distance(self, m: Measurement) -> tuple[Any, bool]:
        """Run the law; a slow car turns the rear wheels over the distance that it drives, and none at standstill."""
        before, real = self.angle, self.real
        reference, limited = self.law(m)
        if self.waits_for_speed or m.speed >= real(3.0) * self.parameter("slow_speed"):
            return reference, limited
        slow, speed = self.parameter("slow_speed"), abs(m.speed)
        travel = self.parameter("fade_rate") * (real(0.0) if speed < real(STANDING_SPEED) else speed * self.period)
        travel = min(travel, real(SLOW_RATE) * self.period)
        if m.speed > slow:
            share = (m.speed - slow) / (real(2.0) * slow)
            travel = travel + self.parameter("rear_rate_max") * self.period * (share * share)
        allowed = clip(self.angle, before - travel, before + travel)
        limited, self.angle = limited or bool(allowed != self.angle), allowed
        return reference, limited

    def _control(self, m: Measurement, ran: bool) -> Any:
        if not ran:
            self.start(m)
        reference, limited = self._within_distance(m)
        self.status = Status.LIMITED if limited else Status.TRACKING
        if self.quality is Quality.REPLACED:
            self.status = Status.DEGRADED
        self.error = reference - m.yaw_rate
        self.missed = 0
        return reference

    def friction(self, m: Measurement) -> Any:
        """Return the friction estimate, limited to the smallest accepted value."""
        return max(m.friction, self.parameter("friction_min"))

    def map_yaw_rate(self, m: Measurement) -> Any:
        """Return the reference yaw rate in rad/s for speed, front angle and friction of a sample; in reverse the other way."""
        size = self.lookup(abs(m.speed), m.front_angle, self.friction(m), m.longitudinal_acceleration)
        return -size if m.speed < 0.0 else size

    def actuator_range(self, m: Measurement) -> tuple[Any, Any]:
        """Return the range of the demand in rad: the actuator's, limited to a distance from the measured angle."""
        p = self.parameter
        bound, ahead = p("rear_angle_max"), p("rear_angle_error_max")
        low, high = (clip(m.rear_angle + offset, -bound, bound) for offset in (-ahead, ahead))
        return low, high

    def reachable(self, demand: Any) -> Any:
        """Return the demand limited by the rate limit."""
        travel = min(self.parameter("rear_rate_max"), self.real(self.p.limiter.rear_rate_max)) * self.period
        return clip(demand, self.angle - travel, self.angle + travel)
