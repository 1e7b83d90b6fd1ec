"""The two-track plant in a steady turn, many turns at once.

At a speed, a front angle and a yaw rate the steady turn has two unknowns: the slip angles at the middle of both axles (they
give the lateral speed and the rear angle). Two equations hold them, the side forces and their yaw moments:

    Y_f + Y_r = m vx r,    lf Y_f + M_f - lr Y_r + M_r = 0

where Y is the sum of the lateral tyre forces of an axle and M their moment about its middle (each acts half a track away,
turned by the steering angle). Wheel loads, slip angles and forces are those of `vehicle.dynamics.two_track` with all
derivatives zero. Newton's method solves them from the single-track car's answer; the same derivatives give how the turn
changes with r.

Beyond its slip bound the force of an axle continues along its tangent. Such turns are infeasible, so no result depends on them,
but every yaw rate then has a turn and the excess over the bound leads to where it is met.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IndexArray
from codegen.configuration import Config
from codegen.optimum.problem import STABILITY_MARGIN
from codegen.vehicle.tyre import WHEEL_SPEED_MIN, AxleTyres, MagicFormulaTyre, load_transfer_per_lateral_acceleration

INVERSE_POINTS = 400

SLOPE_MIN = 0.05
"""Least slope of the force beyond the slip bound, as a fraction of the axle's cornering stiffness."""

_SIDES: Any = np.array([[1.0], [-1.0]])
"""Left (inner in a left turn) and right wheel."""


@dataclass(frozen=True)
class Axle:
    """One axle: its tyre without shifts, load transfer in N for each m/s^2, and the slip bound in rad."""

    tyre: MagicFormulaTyre
    load_transfer: float
    slip_max: float

    @property
    def stiffness(self) -> float:
        """N/rad, both tyres at their static load."""
        return 2.0 * self.tyre.cornering_stiffness

    def loads(self, lateral_acceleration: FloatArray, friction: float) -> tuple[FloatArray, FloatArray]:
        """Peak forces D (2, N) of the left and the right tyre in N, and their derivatives by the lateral acceleration."""
        tyre = self.tyre
        moved = self.load_transfer * lateral_acceleration
        lifted = np.abs(moved) >= tyre.static_load
        load = tyre.static_load - _SIDES * np.clip(moved, -tyre.static_load, tyre.static_load)
        by_load = np.where(lifted, 0.0, -_SIDES * self.load_transfer)
        if tyre.peak_load_sensitivity == 0.0:
            share = friction * tyre.peak_factor
            return share * load, share * by_load
        relative = tyre.peak_factor + tyre.peak_load_sensitivity * (load / tyre.static_load - 1.0)
        slope = np.where(relative > 0.0, relative + tyre.peak_load_sensitivity * load / tyre.static_load, 0.0)
        return friction * np.maximum(relative, 0.0) * load, friction * slope * by_load

    def onward(self, slope: FloatArray, inside: BoolArray) -> FloatArray:
        """Limit the slope of the force (N/rad, negative) beyond the slip bound to at least SLOPE_MIN in magnitude."""
        return np.where(inside, slope, np.minimum(slope, -SLOPE_MIN * self.stiffness))

    def slip_for(self, share: FloatArray) -> FloatArray:
        """Slip angle in rad, as a magnitude, at which the tyre gives a share of its peak; goes on along the tangent."""
        slips = np.linspace(0.0, self.slip_max, INVERSE_POINTS)
        shape, slope = curve(self.tyre, slips)
        rate = max(float(slope[-1]), SLOPE_MIN * float(slope[0]))
        slip = np.interp(share, np.maximum.accumulate(shape), slips)
        result: FloatArray = slip + np.maximum(share - shape[-1], 0.0) / rate
        return result


def curve(tyre: MagicFormulaTyre, slip: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the value of the tyre's curve, from -1 to 1, and its derivative by the slip angle in 1/rad."""
    return tyre.curve.value_and_slope(tyre, tyre.stiffness_factor * slip)


@dataclass(frozen=True)
class AxleForce:
    """Y in N and M in N m (see `nonlinear_car`), each (N,), with derivatives by slip, lateral speed and yaw rate."""

    side: FloatArray
    side_by_slip: FloatArray
    side_by_speed: FloatArray
    side_by_yaw_rate: FloatArray
    moment: FloatArray
    moment_by_slip: FloatArray
    moment_by_speed: FloatArray
    moment_by_yaw_rate: FloatArray


@dataclass(frozen=True)
class Motion:
    """Motion of the car in SI units: speed and yaw rate (N,); `rolling` is the speed used for slip angles, m/s."""

    speed: FloatArray
    rolling: FloatArray
    yaw_rate: FloatArray
    half_track: float
    wheel_speed_min: float
    friction: float

    def of(self, some: IndexArray) -> Motion:
        """Return the motion of some of the cars."""
        return replace(self, speed=self.speed[some], rolling=self.rolling[some], yaw_rate=self.yaw_rate[some])


def axle_force(axle: Axle, motion: Motion, slip: FloatArray, lateral: FloatArray) -> AxleForce:
    """Return the force of an axle from the slip angle (N,) in rad and lateral speed (N,) in m/s at its middle."""
    half, rolling = motion.half_track, motion.rolling
    wheel = motion.speed - half * _SIDES * motion.yaw_rate
    turning = wheel > motion.wheel_speed_min
    wheel = np.maximum(wheel, motion.wheel_speed_min)
    square = wheel * wheel + lateral * lateral
    direction = np.arctan(lateral / rolling)
    by_speed_middle = rolling / (rolling * rolling + lateral * lateral)
    shape, slope = curve(axle.tyre, slip + (np.arctan(lateral / wheel) - direction))
    peak, peak_rate = axle.loads(motion.speed * motion.yaw_rate, motion.friction)
    force = -peak * shape
    by_slip = -peak * slope
    by_speed = by_slip * (wheel / square - by_speed_middle)
    by_yaw_rate = by_slip * (half * _SIDES * turning) * lateral / square - shape * peak_rate * motion.speed
    angle = direction - slip
    along, across = np.cos(angle), half * np.sin(angle)
    both, apart = force[0] + force[1], force[0] - force[1]
    return AxleForce(
        side=along * both,
        side_by_slip=along * (by_slip[0] + by_slip[1]) + across / half * both,
        side_by_speed=along * (by_speed[0] + by_speed[1]) - across / half * by_speed_middle * both,
        side_by_yaw_rate=along * (by_yaw_rate[0] + by_yaw_rate[1]),
        moment=across * apart,
        moment_by_slip=across * (by_slip[0] - by_slip[1]) - half * along * apart,
        moment_by_speed=across * (by_speed[0] - by_speed[1]) + half * along * by_speed_middle * apart,
        moment_by_yaw_rate=across * (by_yaw_rate[0] - by_yaw_rate[1]),
    )


STEP_TOLERANCE = 1e-13
"""rad: Newton's method ends with a step below; angles are of order 0.1 rad."""
STEP_ACCEPTED = 1e-10
"""rad: a last step up to this still counts as converged, for rounding may keep the steps above the tolerance."""
RESIDUAL_ACCEPTED = 2e-8
"""m/s^2, of the whole car: so does a turn that is so well balanced."""
STEPS_MAX = 8
DAMPED_STEPS = 40
ROUNDS = 6
"""Alternations between the axles; their coupling is weak, so few are needed."""
NEAR = 1e-5
"""rad: near enough for Newton's method."""
BRACKET_TOLERANCE = 1e-6
REACH = 1.0
"""rad beyond the slip bound, where the force that goes on along its tangent is larger than any turn needs."""
ANGLE_MAX = 1.5
"""rad. Directions of travel are kept below, where the tangent is finite."""


@dataclass(frozen=True)
class _Balance:
    """Residuals of both equations, N m about the rear axle and N, and their derivatives by slip angles and yaw rate."""

    moments: FloatArray
    sides: FloatArray
    moments_by_front: FloatArray
    moments_by_rear: FloatArray
    sides_by_front: FloatArray
    sides_by_rear: FloatArray
    moments_by_yaw_rate: FloatArray
    sides_by_yaw_rate: FloatArray

    def solved(self, moments: FloatArray, sides: FloatArray) -> Slips:
        """Return the changes of both slip angles that cancel given moments and side forces."""
        scale = 1.0 / (self.moments_by_front * self.sides_by_rear - self.moments_by_rear * self.sides_by_front)
        front = (self.moments_by_rear * sides - moments * self.sides_by_rear) * scale
        return front, (moments * self.sides_by_front - self.moments_by_front * sides) * scale

    def size(self, wheelbase: float) -> FloatArray:
        """Return the norm of the residuals in N."""
        return np.hypot(self.moments / wheelbase, self.sides)


@dataclass(frozen=True)
class SteadyCar:
    """The plant in a steady turn: SI units. Tyre shifts are left out, so that right turns mirror left ones."""

    mass: float
    front_arm: float
    rear_arm: float
    half_track: float
    friction: float
    wheel_speed_min: float
    front: Axle
    rear: Axle

    @classmethod
    def from_config(cls, config: Config, slips: tuple[float, float]) -> Self:
        """Return the plant on the road of its map, with slip bounds in rad. Raises ConfigError (see `AxleTyres`)."""
        tyres = AxleTyres.from_config(config)
        axles = (
            Axle(replace(tyre, horizontal_shift=0.0, vertical_shift=0.0), transfer, slip)
            for tyre, transfer, slip in zip(
                (tyres.front, tyres.rear), load_transfer_per_lateral_acceleration(config), slips, strict=True
            )
        )
        vehicle = config.vehicle
        return cls(
            vehicle.mass_kg,
            vehicle.cg_to_front_axle_m,
            vehicle.cg_to_rear_axle_m,
            0.5 * vehicle.track_m,
            config.road.friction,
            WHEEL_SPEED_MIN,
            *axles,
        )

    @property
    def wheelbase(self) -> float:
        """L in m."""
        return self.front_arm + self.rear_arm

    def grip_yaw_rate(self, speed: FloatArray) -> FloatArray:
        """rad/s about which a slip bound is met, an upper estimate by the single-track car, for speeds (m/s) above zero."""
        reach = []
        for axle, arm in ((self.front, self.rear_arm), (self.rear, self.front_arm)):
            peak = axle.tyre.peak_factor + max(axle.tyre.peak_load_sensitivity, 0.0)
            force = 2.0 * self.friction * peak * axle.tyre.static_load * float(curve(axle.tyre, np.array(axle.slip_max))[0])
            reach.append(force * self.wheelbase / (self.mass * arm))
        result: FloatArray = min(reach) / speed
        return result

    def start(self, speed: FloatArray, yaw_rate: FloatArray) -> Slips:
        """Slip angles (rad) of the single-track car with these tyres and loads, of any shape."""
        slips = []
        lateral_acceleration = speed * yaw_rate
        for axle, arm in ((self.front, self.rear_arm), (self.rear, self.front_arm)):
            peak, _ = axle.loads(lateral_acceleration.ravel(), self.friction)
            total = np.maximum(peak.sum(axis=0), 1e-6 * axle.tyre.static_load).reshape(lateral_acceleration.shape)
            slips.append(-axle.slip_for(self.mass * lateral_acceleration * arm / (self.wheelbase * total)))
        return slips[0], slips[1]

    def stability(self, speed: FloatArray, rear_rate: FloatArray) -> FloatArray:
        """Return the distance to the stability limit, as a fraction of L/vx less STABILITY_MARGIN, from d delta_r/d r in s."""
        result: FloatArray = -rear_rate * np.maximum(speed, self.wheel_speed_min) / self.wheelbase - STABILITY_MARGIN
        return result

    def turns(
        self,
        speed: FloatArray,
        front_angle: FloatArray,
        yaw_rate: FloatArray,
        start: Slips | None = None,
        tolerance: float = STEP_TOLERANCE,
    ) -> Turns:
        """The turns at speeds, front angles (rad) and yaw rates (rad/s), each (N,).

        By Newton's method from given slip angles, by default those of the single-track car; where that does not end, each axle
        for itself inside a bracket, in turns. `converged` is False where neither ends.
        """
        motion = self._motion(speed, yaw_rate)
        slips = self.start(speed, yaw_rate) if start is None else start
        turn = self._by_newton(motion, front_angle, slips, tolerance)
        for slowly in (self._damped, self._by_brackets):
            rest = np.flatnonzero(~turn.converged)
            if not rest.size:
                break
            # Most that need more are few.
            some, angle = motion.of(rest), front_angle[rest]
            slips = slowly(some, angle, self.start(some.speed, some.yaw_rate))
            turn = replace_turns(turn, rest, self._by_newton(some, angle, slips, tolerance))
        return turn

    def corrected(self, speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray, slips: Slips) -> Turns:
        """One step of Newton's method from given slip angles, with the rates of the turn there; arrays (N,)."""
        motion = self._motion(speed, yaw_rate)
        return self._step(self._balance(motion, front_angle, slips), motion, front_angle, slips)

    def geometry(self, speed: FloatArray, front_angle: FloatArray, yaw_rate: FloatArray, slips: Slips) -> Turns:
        """All angles that go with slip angles (N,), whatever the forces; rates as if those did not change."""
        unchanged = np.zeros(speed.shape), np.zeros(speed.shape)
        return self._turns(self._motion(speed, yaw_rate), front_angle, slips, unchanged)

    def _motion(self, speed: FloatArray, yaw_rate: FloatArray) -> Motion:
        rolling = np.maximum(speed, self.wheel_speed_min)
        return Motion(speed, rolling, yaw_rate, self.half_track, self.wheel_speed_min, self.friction)

    def _by_newton(self, motion: Motion, front_angle: FloatArray, slips: Slips, tolerance: float) -> Turns:
        front, rear = slips
        for _ in range(STEPS_MAX):
            at = self._balance(motion, front_angle, (front, rear))
            turn = self._step(at, motion, front_angle, (front, rear))
            step = np.maximum(np.abs(turn.slip_front - front), np.abs(turn.slip_rear - rear))
            front, rear = turn.slip_front, turn.slip_rear
            if (step <= tolerance).all():
                break
        # On the very bound of a slip angle, where the slope of the force may jump, steps may go to and fro for ever.
        balanced = at.size(self.wheelbase) <= RESIDUAL_ACCEPTED * self.mass
        return replace(turn, converged=(step <= max(tolerance, STEP_ACCEPTED)) | balanced)

    def _damped(self, motion: Motion, front_angle: FloatArray, start: Slips) -> Slips:
        """Slip angles near the turns by Newton's method, each step halved until the residuals shrink."""
        here, at = start, self._balance(motion, front_angle, start)
        share = np.ones(front_angle.shape)
        for _ in range(DAMPED_STEPS):
            step = at.solved(at.moments, at.sides)
            if (share * np.maximum(np.abs(step[0]), np.abs(step[1])) < NEAR).all():
                break
            there = here[0] + share * step[0], here[1] + share * step[1]
            then = self._balance(motion, front_angle, there)
            better = then.size(self.wheelbase) < at.size(self.wheelbase)
            here = np.where(better, there[0], here[0]), np.where(better, there[1], here[1])
            at = _Balance(*(np.where(better, getattr(then, e.name), getattr(at, e.name)) for e in fields(_Balance)))
            share = np.where(better, np.minimum(2.0 * share, 1.0), 0.5 * share)
        return here

    def _by_brackets(self, motion: Motion, front_angle: FloatArray, start: Slips) -> Slips:
        """Slip angles near the turns, found by taking each axle for itself while the other one stands still."""
        n = front_angle.size
        slips = list(start)
        for _ in range(ROUNDS):
            moved = 0.0
            for axle, own in enumerate((self.front, self.rear)):
                limit = np.full(n, own.slip_max + REACH)

                def residual(some: IndexArray, slip: FloatArray, axle: int = axle) -> FloatArray:
                    at = [values[some] for values in slips]
                    at[axle] = slip
                    balance = self._balance(motion.of(some), front_angle[some], (at[0], at[1]))
                    return balance.moments if axle == 0 else balance.sides

                everywhere = np.arange(n)
                ends = (residual(everywhere, -limit), residual(everywhere, limit))
                before, slips[axle] = slips[axle], shrink(residual, -limit, limit, *ends, BRACKET_TOLERANCE)[1]
                moved = max(moved, float(np.abs(slips[axle] - before).max()))
            if moved < NEAR:
                break
        return slips[0], slips[1]

    def _balance(self, motion: Motion, front_angle: FloatArray, slips: Slips) -> _Balance:
        """Return the residuals of given slip angles, zero in a steady turn."""
        slip_front, slip_rear = slips
        rolling, mass, wheelbase = motion.rolling, self.mass, self.wheelbase
        # The front axle first: its steering angle is given, so that the slip angle sets its lateral speed.
        clipped = np.clip(slip_front, -self.front.slip_max, self.front.slip_max)
        inside = slip_front == clipped
        lateral, by_slip = _lateral(rolling, front_angle + clipped)
        front = axle_force(self.front, motion, clipped, lateral)
        side_front = self.front.onward(front.side_by_slip + front.side_by_speed * by_slip, inside)
        moment_front = (front.moment_by_slip + front.moment_by_speed * by_slip) * inside
        lateral, by_slip = _lateral(rolling, front_angle + slip_front)
        at_rear = lateral - wheelbase * motion.yaw_rate
        excess = slip_front - clipped
        clipped = np.clip(slip_rear, -self.rear.slip_max, self.rear.slip_max)
        inside = slip_rear == clipped
        rear = axle_force(self.rear, motion, clipped, at_rear)
        side_rear = self.rear.onward(rear.side_by_slip, inside)
        sides = front.side + side_front * excess, rear.side + side_rear * (slip_rear - clipped)
        needed = mass * motion.speed * motion.yaw_rate
        by_yaw_rate = (
            wheelbase * (front.side_by_yaw_rate - rear.moment_by_speed)
            + front.moment_by_yaw_rate
            + rear.moment_by_yaw_rate
            - self.rear_arm * mass * motion.speed,
            front.side_by_yaw_rate + rear.side_by_yaw_rate - wheelbase * rear.side_by_speed - mass * motion.speed,
        )
        return _Balance(
            moments=wheelbase * sides[0] + front.moment + rear.moment - self.rear_arm * needed,
            sides=sides[0] + sides[1] - needed,
            moments_by_front=wheelbase * side_front + moment_front + rear.moment_by_speed * by_slip,
            moments_by_rear=rear.moment_by_slip * inside,
            sides_by_front=side_front + rear.side_by_speed * by_slip,
            sides_by_rear=side_rear,
            moments_by_yaw_rate=by_yaw_rate[0],
            sides_by_yaw_rate=by_yaw_rate[1],
        )

    def _step(self, at: _Balance, motion: Motion, front_angle: FloatArray, slips: Slips) -> Turns:
        """Angles after one further Newton step, and the rates before it."""
        front_step, rear_step = at.solved(at.moments, at.sides)
        rates = at.solved(at.moments_by_yaw_rate, at.sides_by_yaw_rate)
        return self._turns(motion, front_angle, (slips[0] + front_step, slips[1] + rear_step), rates)

    def _turns(self, motion: Motion, front_angle: FloatArray, slips: Slips, rates: Slips) -> Turns:
        """All angles of the turns with those slip angles and their rates."""
        front, rear = slips
        rolling, yaw_rate = motion.rolling, motion.yaw_rate
        lateral, by_slip = _lateral(rolling, front_angle + front)
        lateral_rate = by_slip * rates[0]
        middle = lateral - self.front_arm * yaw_rate
        back = lateral - self.wheelbase * yaw_rate
        sideslip_rate = (lateral_rate - self.front_arm) * rolling / (rolling * rolling + middle * middle)
        rear_rate = (lateral_rate - self.wheelbase) * rolling / (rolling * rolling + back * back) - rates[1]
        return Turns(
            yaw_rate=yaw_rate,
            slip_front=front,
            slip_rear=rear,
            sideslip=np.arctan(middle / rolling),
            rear_angle=np.arctan(back / rolling) - rear,
            rates=np.stack([rates[0], rates[1], sideslip_rate, rear_rate]),
            converged=np.ones(front.shape, dtype=np.bool_),
        )


def _lateral(rolling: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lateral speed in m/s at a direction of travel in rad, and its derivative by that."""
    lateral = rolling * np.tan(np.clip(direction, -ANGLE_MAX, ANGLE_MAX))
    return lateral, rolling + lateral * lateral / rolling


Slips = tuple[FloatArray, FloatArray]
"""Slip angles in rad, or what changes them, of the front and of the rear axle."""


@dataclass(frozen=True)
class Turns:
    """Steady turns, attributes (N,) or of any one shape, in rad; `rates` are the derivatives by the yaw rate, in s.

    `slip_front` and `slip_rear` are at the middle of the axles, negative in a left turn.
    """

    yaw_rate: FloatArray
    slip_front: FloatArray
    slip_rear: FloatArray
    sideslip: FloatArray
    rear_angle: FloatArray
    rates: FloatArray  # (4, ...): of slip_front, slip_rear, sideslip, rear_angle
    converged: BoolArray

    @property
    def values(self) -> FloatArray:
        """(4, ...): slip_front, slip_rear, sideslip, rear_angle."""
        return np.stack([self.slip_front, self.slip_rear, self.sideslip, self.rear_angle])

    @property
    def slips(self) -> Slips:
        """Slip angles of the front and of the rear axle."""
        return self.slip_front, self.slip_rear

    def reshaped(self, shape: tuple[int, ...]) -> Turns:
        """The same turns in arrays of another shape."""
        parts = {name: getattr(self, name) for name in PARTS}
        return Turns(**{name: values.reshape((4, *shape) if name == "rates" else shape) for name, values in parts.items()})


PARTS = ("yaw_rate", "slip_front", "slip_rear", "sideslip", "rear_angle", "rates", "converged")
"""Attributes of `Turns`."""


def select_turns(turns: Turns, chosen: IndexArray) -> Turns:
    """Some of the turns, by their last index."""
    return Turns(**{name: getattr(turns, name)[..., chosen] for name in PARTS})


def concatenate_turns(parts: Sequence[Turns]) -> Turns:
    """Turns after each other along the last index."""
    return Turns(**{name: np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in PARTS})


def unknown_turns(count: int) -> Turns:
    """Return `count` unknown turns, filled with NaN."""
    nothing = {name: np.full((4, count) if name == "rates" else count, np.nan) for name in PARTS[:-1]}
    return Turns(**nothing, converged=np.zeros(count, dtype=np.bool_))


def replace_turns(turns: Turns, at: IndexArray, others: Turns) -> Turns:
    """Return the turns with some replaced, by their last index."""
    changed = {name: getattr(turns, name).copy() for name in PARTS}
    for name, values in changed.items():
        values[..., at] = getattr(others, name)
    return Turns(**changed)


Function = Callable[[IndexArray, FloatArray], FloatArray]
"""(indices of some of the functions, a number for each) -> their values there."""

HALVINGS_MORE = 10
"""Steps beyond twice those of bisection before the search is given up."""


def shrink(
    function: Function, first: FloatArray, second: FloatArray, at_first: FloatArray, at_second: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Shrink brackets (k,) around a root; return the end with the sign of `at_first`, and the root by the secant.

    Inverse quadratic interpolation where the last three points are nearly on a parabola, else bisection (T. R. Chandrupatla,
    Advances in Engineering Software 28(3), 1997): as fast as Brent's method, and the same arithmetic for every bracket.

    Args:
        tolerance: width at which a bracket may stay, as a share of its first one.
    """
    start, width, sign = first, second - first, np.where(at_first < 0.0, -1.0, 1.0)
    # Positions inside the brackets: the newest point, the other end, and the point before.
    new, other, old = np.zeros_like(first), np.ones_like(first), np.ones_like(first)
    at_new, at_other, at_old = (np.array(values, dtype=np.float64) for values in (at_first, at_second, at_second))
    is_first, share = np.ones(first.shape, dtype=np.bool_), np.full(first.shape, 0.5)  # whether `new` is the end to return
    left = np.flatnonzero(width != 0.0)
    for _ in range(2 * int(np.ceil(np.log2(1.0 / tolerance))) + HALVINGS_MORE):
        if not left.size:
            break
        tried = new[left] + share[left] * (other[left] - new[left])
        value = function(left, start[left] + tried * width[left])
        on_first_side = sign[left] * value > 0.0
        same = on_first_side == is_first[left]
        old[left], at_old[left] = np.where(same, new[left], other[left]), np.where(same, at_new[left], at_other[left])
        other[left], at_other[left] = np.where(same, other[left], new[left]), np.where(same, at_other[left], at_new[left])
        new[left], at_new[left], is_first[left] = tried, value, on_first_side
        left = left[np.abs(new - other)[left] > tolerance]
        share[left] = _next_share(new[left], other[left], old[left], at_new[left], at_other[left], at_old[left], tolerance)
    low, high = np.where(is_first, new, other), np.where(is_first, other, new)
    value_low, value_high = np.where(is_first, at_new, at_other), np.where(is_first, at_other, at_new)
    drop = value_low - value_high
    root = low + np.clip(np.divide(value_low, drop, out=np.full(drop.shape, 0.5), where=drop != 0.0), 0.0, 1.0) * (high - low)
    return start + low * width, start + root * width


def _next_share(
    new: FloatArray,
    other: FloatArray,
    old: FloatArray,
    at_new: FloatArray,
    at_other: FloatArray,
    at_old: FloatArray,
    tolerance: float,
) -> FloatArray:
    """Return the next point of Chandrupatla's method as a share of the way from `new` to `other`."""
    with np.errstate(divide="ignore", invalid="ignore"):  # where it bisects
        position, level = (new - other) / (old - other), (at_new - at_other) / (at_old - at_other)
        is_smooth = (level**2 < position) & ((1.0 - level) ** 2 < 1.0 - position)
        inverse = at_new / (at_other - at_new) * at_old / (at_other - at_old)
        inverse += (old - new) / (other - new) * at_new / (at_old - at_new) * at_other / (at_old - at_other)
    margin = 0.5 * tolerance / np.abs(other - new)
    return np.clip(np.where(is_smooth, inverse, 0.5), margin, 1.0 - margin)
