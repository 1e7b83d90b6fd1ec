"""The law of kind "tracking" as its header and the configuration's comments describe it, in Python, to the bit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup
from codegen.emit.controller_view import REFERENCE_OVERSHOOT
from codegen.sil.software import Measurement
from codegen.verify.law.controller import SecondController
from codegen.verify.law.inputs import Quality
from codegen.verify.law.limiter import clip
from codegen.verify.law.reference_model import SecondReferenceModel


class Road(Protocol):
    """What the map was made for; a TotalMap is one."""

    @property
    def friction(self) -> float:
        """Peak friction."""

    @property
    def lateral_acceleration_cap(self) -> float:
        """m/s^2 that the map allows on it."""


@dataclass(frozen=True)
class Sample:
    """What the map says of a sample, a little ahead of the front wheels."""

    yaw_rate: Any
    rear_angle: Any
    lateral_acceleration: Any
    friction: Any


class SecondTracking(SecondController):
    """Feedforward, reference model, scheduled feedback of bounded authority. `happened` tells what a drive has made it do."""

    def __init__(self, parameters: Any, lookup: Lookup, road: Road, config: Config, angle: float) -> None:
        real: Any = lookup.real
        actuator_max = float(real(config.rear_actuator.angle_max))
        super().__init__(parameters, lookup, config.controller.sampling_time_s, actuator_max, real, angle)
        self.car = SecondReferenceModel(config, real)
        self.full_grip = real(road.lateral_acceleration_cap)
        # A little above the quotient: full grip is never less than the map's own road.
        self.friction_per_grip = real(road.friction / road.lateral_acceleration_cap * (1.0 + 4.0 * float(np.finfo(real).eps)))
        self.grip = self.full_grip
        self.state = self.car_state(0.0, 0.0)
        self.previous_model_yaw_rate = self.state[1]
        self.trim = self.integral = self.last_front = self.front_rate = self.last_yaw_rate = self.reached = real(0.0)
        self.starting = False
        self.happened: set[str] = set()

    def car_state(self, speed: Any, yaw_rate: Any) -> Any:
        start = [np.asarray(value, dtype=self.real) for value in (speed, yaw_rate, self.angle)]
        return tuple(self.real(value) for value in self.car.start(*start))

    def start(self, m: Measurement) -> None:
        self.happened.add("start")
        zero = self.real(0.0)
        self.last_front, self.front_rate, self.last_yaw_rate, self.trim = m.front_angle, zero, m.yaw_rate, zero
        self.state = self.car_state(m.speed, m.yaw_rate)
        self.previous_model_yaw_rate = self.state[1]
        self.starting = True

    def stand_by(self) -> None:
        self.reached = self.reached - self.parameter("grip_forgetting") * self.period * self.reached
        self.grip = min(self.grip + self.parameter("grip_recovery_idle") * self.period, self.full_grip)

    def look(self, m: Measurement) -> Sample:
        """The map where the front wheels will be after the lead time, on the road that is known or seen."""
        p = self.parameter
        most = p("lead_angle_max")
        if self.quality is not Quality.MISSING:
            rate = (m.front_angle - self.last_front) / (self.period * self.real(self.missed + 1))
            self.front_rate = self.front_rate + p("lead_smoothing") * (rate - self.front_rate)
            self.last_front = m.front_angle
        lead = clip(self.scheduled("lead_time", m.speed) * self.front_rate, -most, most)
        seen, estimated = self.grip * self.friction_per_grip, self.friction(m)
        friction = min(estimated, seen)
        yaw_rate, rear_angle = (self.real(value) for value in self.lookup.reference(m.speed, m.front_angle + lead, friction))
        own = self.state[1]
        expected = own + p("response_samples") * (own - self.previous_model_yaw_rate)
        rear_angle = rear_angle - self.scheduled("response_gain", m.speed) * (yaw_rate - expected)
        bound = p("rear_angle_max")
        road = self.lookup.lateral_acceleration(friction)
        self.note("lead at its bound", abs(lead) == most)
        self.note("estimate below what was seen", estimated < seen)
        return Sample(yaw_rate, clip(rear_angle, -bound, bound), road, friction)

    def law(self, m: Measurement) -> tuple[Any, bool]:
        sample = self.look(m)
        reference = self.reachable_yaw_rate(sample, m.speed)
        error = self.error if self.quality is Quality.MISSING else reference - m.yaw_rate
        gain, integral_gain = (self.scheduled(name, m.speed) for name in ("proportional_gain", "integral_gain"))
        low, high = self.feedback_range(m, sample.rear_angle)
        if self.starting:
            self.integral, self.starting = self.angle - sample.rear_angle, False
        integral = self.integral if m.inhibit else self.integral - integral_gain * self.period * error
        feedback = integral - gain * error
        limited = not low <= feedback <= high
        if limited and not m.inhibit:
            deeper = integral > self.integral if feedback > high else integral < self.integral
            integral = clip(self.integral if deeper else integral, low, high)
        feedback = clip(feedback, low, high)
        demand = sample.rear_angle + feedback
        reachable = self.reachable(demand)
        if reachable != demand:
            limited = True
            if (demand > reachable and integral > self.integral) or (demand < reachable and integral < self.integral):
                integral = self.integral
                self.note("the rate limit holds the integral", True)
        self.note("limited while inhibited", limited and m.inhibit)
        self.note("free", not limited)
        self.integral, self.angle = integral, reachable
        if not m.inhibit and self.quality is Quality.GOOD:
            self.update_grip(m, reference)
        self.last_yaw_rate = m.yaw_rate
        inputs = (m.speed, m.front_angle, sample.rear_angle, sample.friction)
        with np.errstate(all="ignore"):
            after = self.car.step(self.state, [np.asarray(value, dtype=self.real) for value in inputs])
        self.previous_model_yaw_rate = self.state[1]
        self.state = tuple(self.real(value) for value in after)
        return reference, limited

    def reachable_yaw_rate(self, sample: Sample, speed: Any) -> Any:
        p, own = self.parameter, self.state[1]
        bound = p("trim_share") * abs(sample.yaw_rate)
        missing = clip(sample.yaw_rate - own, -bound, bound)
        self.trim = self.trim + p("trim_rate") * self.period * (missing - self.trim)
        limit = self.real(REFERENCE_OVERSHOOT) * (sample.lateral_acceleration / speed)
        self.note("reference at the road's limit", abs(own + self.trim) > limit)
        self.note("trim bounded", abs(missing) == bound)
        return clip(own + self.trim, -limit, limit)

    def scheduled(self, name: str, speed: Any) -> Any:
        """A parameter over speed: linear between the breakpoints, held beyond them."""
        speeds, values = ([self.real(value) for value in getattr(self.p, field)] for field in ("schedule_speed", name))
        self.note("below the schedule", speed < speeds[0])
        self.note("beyond the schedule", speed > speeds[-1])
        k = max([0, *(k for k in range(len(speeds)) if speeds[k] <= speed)])
        if speed < speeds[0]:
            return values[0]
        if k == len(speeds) - 1:
            return values[k - 1] + self.real(1.0) * (values[k] - values[k - 1])
        share = (speed - speeds[k]) / (speeds[k + 1] - speeds[k])
        return values[k] + share * (values[k + 1] - values[k])

    def feedback_range(self, m: Measurement, feedforward: Any) -> tuple[Any, Any]:
        """What feedback may add: free against the turn, a little where it makes the car turn more."""
        low, high = self.actuator_range(m)
        more = self.parameter("yaw_increasing_max")
        two = (m.yaw_rate, self.last_yaw_rate)
        if max(two) > 0.0 and low < feedforward - more:
            low = clip(feedforward - more, low, high)
            self.note("authority to the left", True)
        if min(two) < 0.0 and high > feedforward + more:
            high = clip(feedforward + more, low, high)
            self.note("authority to the right", True)
        return low - feedforward, high - feedforward

    def update_grip(self, m: Measurement, reference: Any) -> None:
        p = self.parameter
        side = self.real(1.0 if reference > 0.0 else -1.0)
        asked, turning = side * reference * m.speed, side * m.yaw_rate * m.speed
        idle = asked < self.real(0.5) * self.grip
        self.note("idle", idle)
        self.reached = max(abs(turning), self.reached - p("grip_forgetting") * self.period * self.reached)
        grip = self.grip + p("grip_recovery_idle" if idle else "grip_recovery") * self.period
        if turning > 0.0 and asked - turning > p("grip_shortfall"):
            grip = self.grip - p("grip_loss_rate") * self.period * (asked - turning - p("grip_shortfall"))
            self.note("grip lost", True)
        self.note("grip held by what was reached", grip < self.reached)
        grip = max(grip, self.reached)
        least = p("friction_min") / self.friction_per_grip
        self.note("grip at its least", grip < least)
        self.note("grip recovers", self.grip < self.full_grip and grip > self.grip)
        self.grip = clip(grip, least, self.full_grip)

    def note(self, what: str, happens: Any) -> None:
        if happens:
            self.happened.add(what)
