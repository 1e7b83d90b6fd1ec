"""Law of kind "tracking", written from its header and the comments of the configuration, bit for bit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from codegen.configuration import Config
from codegen.ecu_map.lookup import Lookup
from codegen.emit.controller_view import (
    ESTIMATE_FACTOR,
    LEAD_LOSS,
    REFERENCE_OVERSHOOT,
    SIDESLIP_GAIN,
    SIDESLIP_RETURN,
)
from codegen.emit.dynamics_view import tabulate
from codegen.sil.software import Measurement
from codegen.vehicle.dynamics import single_track_step
from codegen.vehicle.plant_car import load_transfer_losses
from codegen.vehicle.tyre import SLIP_SEARCH_MAX, AxleTyres, MagicFormulaTyre
from tests.oracle.controller import Road, SecondController, clip
from tests.oracle.inputs import Quality

SIDESLIP_MAX = math.radians(20.0)
LATERAL_ACCELERATION_MAX = 20.0
ARGUMENT_MAX = 1000.0
SPEED_MIN = 1.0
"""Smallest speed of the model, in m/s."""

_OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_NEG: lambda a, _: -a,
    ca.OP_SQ: lambda a, _: a * a,
    ca.OP_TWICE: lambda a, _: a + a,
    ca.OP_FMAX: lambda a, b: np.where(a > b, a, b),  # the second for NaN, as in the C
}


Instruction = tuple[int, Sequence[int], Sequence[int], Any]
"""Operation, work places or element indices of its arguments and of its results, and the value of a constant."""


def instructions_of(function: Any, real: Any) -> list[Instruction]:
    """Return the instructions of a CasADi function, with constants in a number type."""
    found = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        constant = real(function.instruction_constant(k)) if operation == ca.OP_CONST else None
        found.append((operation, function.instruction_input(k), function.instruction_output(k), constant))
    return found


def walk(instructions: Iterable[Instruction], inputs: Sequence[Sequence[Any]]) -> list[Any]:
    """Evaluate the only output, every operation in the number type of the inputs. Inputs by (argument, element)."""
    work: dict[int, Any] = {}
    output: dict[int, Any] = {}
    for operation, arguments, results, constant in instructions:
        if operation == ca.OP_CONST:
            work[results[0]] = constant
        elif operation == ca.OP_INPUT:
            work[results[0]] = inputs[arguments[0]][arguments[1]]
        elif operation == ca.OP_OUTPUT:
            output[results[1]] = work[arguments[0]]
        else:
            work[results[0]] = _OPERATIONS[operation](work[arguments[0]], work[arguments[-1]])
    return [output[index] for index in sorted(output)]


def within(value: Any, limit: Any) -> Any:
    """Limit a value to +-limit; NaN becomes the bound."""
    return np.where(np.isnan(value), limit, np.clip(value, -limit, limit))


def at_least(value: Any, low: Any) -> Any:
    """Limit a value from below; NaN stays NaN."""
    return np.where(value < low, low, value)


@dataclass(frozen=True)
class TableCurve:
    """A tyre's curve from its table, in one number type."""

    values: Any
    compression: Any

    @classmethod
    def of(cls, tyre: MagicFormulaTyre, real: Any, loss: float = 0.0) -> TableCurve:
        """Return the table of a build."""
        curve = tabulate(tyre, loss)
        return cls(curve.values.astype(real), real(curve.compression))

    def __call__(self, x: Any) -> tuple[Any, Any]:
        """Return value and slope; a negative slope counts as zero."""
        real = self.values.dtype.type
        cells = self.values.size - 1
        cells_per_x = real(cells) / (np.abs(x) + self.compression)
        position = np.abs(x) * cells_per_x
        cell = np.where(position < cells, position, cells - 1).astype(np.int64)
        rise = self.values[cell + 1] - self.values[cell]
        value = self.values[cell] + (position - cell.astype(real)) * rise
        steep = rise * (self.compression / real(cells) * (cells_per_x * cells_per_x))
        return np.where(x < 0.0, -value, value), np.where(rise > 0.0, steep, real(0.0))

    def level(self, x: Any) -> Any:
        """Return the value, and for infinity and NaN the last one."""
        value, last = self(x)[0], self.values[-2] + (self.values[-1] - self.values[-2])
        return np.where(np.isnan(value), np.where(x < 0.0, -last, last), value)


class SecondReferenceModel:
    """States (sideslip, yaw rate, rear angle, lateral acceleration) and inputs (speed, front angle, rear angle, friction).

    Both are arrays of one shape. With a relaxation length, the states end with the arguments of both tyre curves.

    With `per_axle` there is a friction for each axle.
    """

    is_constant = True
    """The object itself has no state: `step` receives one and returns the next; see `pairs.state_of`."""

    def __init__(self, config: Config, real: Any, *, per_axle: bool = False) -> None:
        actuator, period = config.rear_actuator, config.controller.sampling_time_s
        vehicle, tyres = config.vehicle, AxleTyres.from_config(config)
        stiffness = 2.0 * tyres.rear.cornering_stiffness
        self.real = real
        functions = single_track_step(config, period, per_axle=per_axle)
        self.arguments, self.change = (instructions_of(each, real) for each in (functions.arguments, functions.change))
        both = zip((tyres.front, tyres.rear), load_transfer_losses(config), strict=True)
        self.curves = [TableCurve.of(tyre, real, loss) for tyre, loss in both]
        self.speed_min = real(SPEED_MIN)
        self.rear_angle_max = real(math.radians(actuator.angle_max_deg))
        self.yaw_rate_max = real(math.radians(config.controller.inputs.yaw_rate_max_deg_s))
        self.is_relaxed = functions.is_relaxed
        slips = (
            vehicle.cg_to_rear_axle_m / tyres.front.cornering_stiffness,
            vehicle.cg_to_front_axle_m / tyres.rear.cornering_stiffness,
        )
        self.arguments_per_acceleration = [
            real(-tyre.stiffness_factor * vehicle.mass_kg * slip / (2.0 * vehicle.wheelbase))
            for tyre, slip in zip((tyres.front, tyres.rear), slips, strict=True)
        ]
        self.acceleration_max = real(LATERAL_ACCELERATION_MAX)
        delay = max(1, config.plant.command_delay_samples) * period
        self.share = real(1.0 - math.exp(-period / (actuator.lag_s + delay)))
        self.travel = real(math.radians(actuator.rate_max_deg_s) * period)
        self.rear_arm = real(vehicle.cg_to_rear_axle_m)
        self.rear_slip = real(vehicle.mass_kg * vehicle.cg_to_front_axle_m / (vehicle.wheelbase * stiffness))

    def start(self, speed: Any, yaw_rate: Any, rear_angle: Any) -> tuple[Any, ...]:
        """Return the steady state of the linear car."""
        forward = at_least(speed, self.speed_min)
        yaw_rate, rear_angle = within(yaw_rate, self.yaw_rate_max), within(rear_angle, self.rear_angle_max)
        sideslip = rear_angle + yaw_rate * (self.rear_arm / forward - self.rear_slip * forward)
        acceleration = within(forward * yaw_rate, self.acceleration_max)
        arguments = [each * acceleration for each in self.arguments_per_acceleration] if self.is_relaxed else []
        return within(sideslip, self.real(SIDESLIP_MAX)), yaw_rate, rear_angle, acceleration, *arguments

    def step(self, state: Iterable[Any], inputs: Iterable[Any]) -> tuple[Any, ...]:
        """Advance by one sampling time, without a relaxation length with the rear wheels at the mean of their angles."""
        sideslip, yaw_rate, rear_angle, _, *lagging = state
        speed, front, commanded, *friction = inputs
        half, one = self.real(0.5), self.real(1.0)
        moved = within(self.share * (commanded - rear_angle), self.travel)
        rear = rear_angle if self.is_relaxed else rear_angle + half * moved
        u = [one / at_least(speed, self.speed_min), front, rear, *friction]
        x = [sideslip, yaw_rate, *lagging]
        arguments = walk(self.arguments, [x, u])
        curves = zip(self.curves, arguments, strict=True)
        if self.is_relaxed:
            curved: list[Any] = [[curve.level(argument) for curve, argument in curves]]
            lagging = [within(argument, self.real(ARGUMENT_MAX)) for argument in arguments]
        else:
            curved = [*zip(*(curve(argument) for curve, argument in curves), strict=True)]  # values and slopes
        change = walk(self.change, [x, u, *curved])
        return (
            within(sideslip + change[0], self.real(SIDESLIP_MAX)),
            within(yaw_rate + change[1], self.yaw_rate_max),
            within(rear_angle + moved, self.rear_angle_max),
            within(change[2], self.acceleration_max),
            *lagging,
        )


@dataclass(frozen=True)
class Sample:
    """Reference of the map slightly ahead of the front wheels. `friction`: for the model, one or one for each axle."""

    yaw_rate: Any
    rear_angle: Any
    lateral_acceleration: Any
    friction: tuple[Any, ...]


class SecondTracking(SecondController):
    """Feedforward, reference model, and scheduled feedback of bounded authority."""

    def __init__(self, config: Config, parameters: Any, lookup: Lookup, road: Road, angle: float) -> None:
        super().__init__(config, parameters, lookup, road, angle)
        real: Any = lookup.real
        self.car = SecondReferenceModel(config, real, per_axle=lookup.is_moving)
        self.full_grip = real(road.lateral_acceleration_cap)
        # A little above the quotient: full grip is never less than the map's own road.
        self.friction_per_grip = real(road.friction / road.lateral_acceleration_cap * (1.0 + 4.0 * float(np.finfo(real).eps)))
        self.grip = self.full_grip
        self.state = tuple(real(0.0) for _ in self.car_state(0.0, 0.0))  # straight ahead, whatever the rear angle
        self.previous_model_yaw_rate = self.state[1]
        self.sideslip = real(0.0)
        half_peak_slip = 0.5 * min(AxleTyres.from_config(config).rear.peak_slip, SLIP_SEARCH_MAX)
        self.rear_slip, self.rear_slip_per_friction = real(half_peak_slip), real(half_peak_slip / road.friction)
        self.trim = self.integral = self.last_front = self.front_rate = self.last_yaw_rate = self.reached = real(0.0)
        self.starting = False

    def car_state(self, speed: Any, yaw_rate: Any) -> tuple[Any, ...]:
        start = [np.asarray(value, dtype=self.real) for value in (speed, yaw_rate, self.angle)]
        return tuple(self.real(value) for value in self.car.start(*start))

    def start(self, m: Measurement) -> None:
        zero = self.real(0.0)
        self.last_front, self.front_rate, self.last_yaw_rate, self.trim = m.front_angle, zero, m.yaw_rate, zero
        self.state = self.car_state(self.model_speed(m), m.yaw_rate)
        self.previous_model_yaw_rate = self.state[1]
        self.sideslip = self.state[0]
        self.starting = True

    def model_speed(self, m: Measurement) -> Any:
        """Return the speed of the model in m/s, which is not that slow."""
        return max(m.speed, self.parameter("slow_speed"))

    def feedback_share(self, m: Measurement) -> Any:
        """Return the share of the feedback: none for a slow car and in reverse."""
        slow = self.parameter("slow_speed")
        return clip((m.speed - slow) / slow, self.real(0.0), self.real(1.0))

    def recover_grip(self) -> None:
        self.reached = self.reached - self.parameter("grip_forgetting") * self.period * self.reached
        self.grip = min(self.grip + self.parameter("grip_recovery_idle") * self.period, self.full_grip)

    def road_friction(self, m: Measurement) -> Any:
        return min(self.real(ESTIMATE_FACTOR) * self.friction(m), self.grip * self.friction_per_grip)

    def look(self, m: Measurement) -> Sample:
        """Return the map's value for the front angle after the lead time, for the known or estimated friction."""
        p = self.parameter
        most = p("lead_angle_max")
        if self.quality is not Quality.MISSING:
            rate = (m.front_angle - self.last_front) / (self.period * self.real(self.missed + 1))
            self.front_rate = self.front_rate + p("lead_smoothing") * (rate - self.front_rate)
            self.last_front = m.front_angle
        speed = self.model_speed(m)
        lead = clip(self.scheduled("lead_time", speed) * self.front_rate, -most, most)
        friction = self.road_friction(m)
        moving = m.longitudinal_acceleration
        found = self.lookup.reference(abs(m.speed), m.front_angle + lead, friction, moving)
        yaw_rate, rear_angle = (self.real(value) for value in found)
        own = self.state[1]
        expected = own + p("response_samples") * (own - self.previous_model_yaw_rate)
        response = self.feedback_share(m) * self.scheduled("response_gain", speed)
        rear_angle = rear_angle - response * (yaw_rate - expected)
        bound = p("rear_angle_max")
        road = self.lookup.lateral_acceleration(friction, moving)
        shares = self.lookup.axle_shares_at(friction, moving) if self.lookup.is_moving else [self.real(1.0)]
        return Sample(yaw_rate, clip(rear_angle, -bound, bound), road, tuple(friction * share for share in shares))

    def law(self, m: Measurement) -> tuple[Any, bool]:
        sample, share, speed = self.look(m), self.feedback_share(m), self.model_speed(m)
        if not self.inputs.yaw_rate.is_measured:
            self.sideslip = self.state[0]
        outward = self.observe(m)
        reference = followed = self.reachable_yaw_rate(sample, m, outward)
        if not share > 0.0:
            followed = -sample.yaw_rate if m.speed < 0.0 else sample.yaw_rate
        error = self.error if self.quality is Quality.MISSING else reference - m.yaw_rate
        gain, integral_gain = (self.scheduled(name, speed) for name in ("proportional_gain", "integral_gain"))
        low, high = self.feedback_range(m, sample.rear_angle, outward)
        if self.starting:
            self.integral, self.starting = self.angle - sample.rear_angle, False
        integral = self.integral if m.inhibit else self.integral - integral_gain * self.period * error
        feedback = integral - gain * error
        limited = bool(share > 0.0) and not low <= feedback <= high
        if limited and not m.inhibit:
            deeper = integral > self.integral if feedback > high else integral < self.integral
            integral = clip(self.integral if deeper else integral, low, high)
        feedback = clip(feedback, low, high)
        demand = sample.rear_angle + share * feedback
        reachable = self.reachable(demand)
        if reachable != demand:
            limited = True
            if (demand > reachable and integral > self.integral) or (demand < reachable and integral < self.integral):
                integral = self.integral
        self.integral, self.angle = integral if share > 0.0 else self.real(0.0), reachable
        if not share > 0.0:
            self.sideslip = self.state[0]
        self.last_yaw_rate, self.previous_model_yaw_rate = m.yaw_rate, self.state[1]
        self.move(speed, m.front_angle, sample.rear_angle, *sample.friction)
        if self.quality is not Quality.MISSING:
            if m.speed <= self.parameter("slow_speed"):
                self.recover_grip()
            elif not m.inhibit and self.quality is Quality.GOOD:
                self.update_grip(m, self.state[3])
        return followed, limited

    def move(self, *inputs: Any) -> None:
        """Advance the reference model by a sample with inputs as for `SecondReferenceModel`."""
        with np.errstate(all="ignore"):
            after = self.car.step(self.state, [np.asarray(value, dtype=self.real) for value in inputs])
        self.state = tuple(self.real(value) for value in after)

    def rest(self, m: Measurement) -> None:
        friction = self.road_friction(m)
        self.move(m.speed, m.front_angle, self.angle, *[friction] * (2 if self.lookup.is_moving else 1))

    def model(self) -> tuple[Any, ...] | None:
        return self.state

    def observe(self, m: Measurement) -> Any:
        """Update the observed sideslip; return the part out of the model's turn, as a share of the largest."""
        slowness = self.real(1.0) / self.model_speed(m)
        rate = m.lateral_acceleration * slowness - m.yaw_rate + self.real(SIDESLIP_RETURN) * (self.state[0] - self.sideslip)
        self.sideslip = within(self.sideslip + self.period * rate, self.real(SIDESLIP_MAX))[()]
        return (-self.sideslip if self.state[1] > 0.0 else self.sideslip) / self.parameter("sideslip_max")

    def reachable_yaw_rate(self, sample: Sample, m: Measurement, outward: Any) -> Any:
        p, own, real, speed = self.parameter, self.state[1], self.real, self.model_speed(m)
        bound = p("trim_share") * abs(sample.yaw_rate)
        missing = clip(sample.yaw_rate - own, -bound, bound)
        self.trim = self.trim + p("trim_rate") * self.period * (missing - self.trim)
        share = clip(real(1.0) - real(LEAD_LOSS) * outward, real(0.0), real(1.0))
        ahead = share * abs(own * speed - self.state[3])
        turn = abs(m.lateral_acceleration) + ahead + max(p("turn_margin_rate") * speed, p("turn_margin"))
        limit = real(1.0) / speed * min(real(REFERENCE_OVERSHOOT) * sample.lateral_acceleration, turn)
        if outward > 1.0:
            limit = max(limit - real(SIDESLIP_GAIN) * p("sideslip_max") * (outward - real(1.0)), real(0.0))
        return clip(own + self.trim, -limit, limit)

    def scheduled(self, name: str, speed: Any) -> Any:
        """Interpolate a parameter over speed linearly, constant beyond the breakpoints."""
        speeds, values = ([self.real(value) for value in getattr(self.p, field)] for field in ("schedule_speed", name))
        k = max([0, *(k for k in range(len(speeds)) if speeds[k] <= speed)])
        if speed < speeds[0]:
            return values[0]
        if k == len(speeds) - 1:
            return values[k - 1] + self.real(1.0) * (values[k] - values[k - 1])
        share = (speed - speeds[k]) / (speeds[k + 1] - speeds[k])
        return values[k] + share * (values[k + 1] - values[k])

    def feedback_range(self, m: Measurement, feedforward: Any, outward: Any) -> tuple[Any, Any]:
        """Return the range of the feedback: small in the direction of the turn, against it free up to the rear tyres' peak."""
        low, high = self.actuator_range(m)
        least, widest = self.parameter("yaw_increasing_max"), self.parameter("yaw_increasing_wide")
        more = least + clip(self.real(1.0) - outward, self.real(0.0), self.real(1.0)) * (widest - least)
        two = (m.yaw_rate, self.last_yaw_rate)
        if max(two) > 0.0 and low < feedforward - more:
            low = clip(feedforward - more, low, high)
        if min(two) < 0.0 and high > feedforward + more:
            high = clip(feedforward + more, low, high)
        travel = self.sideslip - self.car.rear_arm * (m.yaw_rate * (self.real(1.0) / self.model_speed(m)))
        slip = self.rear_slip + self.road_friction(m) * self.rear_slip_per_friction
        high = clip(travel + slip, low, high)
        low = clip(travel - slip, low, high)
        return low - feedforward, high - feedforward

    def update_grip(self, m: Measurement, asked: Any) -> None:
        """Learn the grip from the lateral acceleration. `asked`: that of the model, m/s^2."""
        p, real = self.parameter, self.real
        turning = m.lateral_acceleration if asked > 0.0 else -m.lateral_acceleration
        asked = abs(asked)
        idle = asked < real(0.5) * self.grip
        unused = max(real(1.0) - asked / self.grip, real(0.0))
        missing = asked - turning - (p("grip_shortfall") + p("grip_shortfall_share") * asked * unused)
        self.reached = max(abs(turning), self.reached - p("grip_forgetting") * self.period * self.reached)
        grip = self.grip + p("grip_recovery_idle" if idle else "grip_recovery") * self.period
        if turning > 0.0 and missing > 0.0:
            grip = self.grip - p("grip_loss_rate") * self.period * missing
        grip = max(grip, self.reached)
        least = p("friction_min") / self.friction_per_grip
        self.grip = clip(grip, least, self.full_grip)
