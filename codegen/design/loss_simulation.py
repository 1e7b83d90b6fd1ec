"""The two-track plant in steady turns, and from there with its rear angle held, ramped or set to zero.

All operating points advance at once, as the columns of one matrix, by a Runge-Kutta method in CasADi. The driver holds the
front angle and the speed; the road has the friction of the configuration.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.vehicle.dynamics import Model, two_track

MODES = ("hold", "ramp", "zero")
"""Rear angle from t = 0: held; to zero at the rate of the fail-safe; to zero as fast as the actuator can."""

HORIZON = 4.0
"""Simulated time in s from t = 0; with "ramp" from the end of the slowest ramp, but RAMP_HORIZON_MAX in all."""
RAMP_HORIZON_MAX = 12.0
SETTLING_TIME = 5.0
"""Time in s for the plant to settle from the steady turn of the linear car; SETTLING_ROUNDS times that where it is slow."""
SETTLING_ROUNDS = 4
STEP_MAX = 0.005
"""Largest step in s; the largest sideslip angles then differ by less than 0.001 deg from those with 1 ms."""

SPIN_SIDESLIP = math.radians(10.0)
"""A car spins where its sideslip angle is beyond this while its rear axle slides: beyond SPIN_REAR_SLIP at its middle."""
SPIN_REAR_SLIP = math.radians(5.0)
SETTLED_SIDESLIP_RATE = math.radians(0.1)
"""rad/s; a turn is steady where neither this nor SETTLED_YAW_ACCELERATION (rad/s^2) is exceeded."""
SETTLED_YAW_ACCELERATION = math.radians(0.5)

AT_ONCE = 1e9
"""Rate of a command, in rad/s, that completes in one step."""

# The motion does not depend on position or heading, and sine and cosine of the heading would cost time.
_NO_FEEDBACK = ("position_x", "position_y", "heading")
# These are constant here, so they do not limit the step.
_AT_REST = (*_NO_FEEDBACK, "steering_wheel_angle")
# Rows of a column below the states of the plant.
_EXTRA = ("command", "ramp_rate", "speed", "wheel_command", "sideslip_max", "spun")


@dataclass(frozen=True)
class Points:
    """Steady turns of the linear car, arrays (k,): m/s, rad, rad, rad/s, rad."""

    speed: FloatArray
    front_angle: FloatArray
    rear_angle: FloatArray
    yaw_rate: FloatArray
    sideslip: FloatArray


@dataclass(frozen=True)
class Simulated:
    """Outcome of k operating points in each of MODES.

    Attributes:
        settles: (k,) whether the plant reached a steady turn before t = 0 without a spin.
        sideslip: (k,) rad, in that turn; NaN where it did not settle.
        sideslip_max: (3, k) rad, largest magnitude from t = 0 on; NaN where it did not settle.
        spins: (3, k) whether the car spins; False where it did not settle.
        horizon: (3,) s.
    """

    settles: BoolArray
    sideslip: FloatArray
    sideslip_max: FloatArray
    spins: BoolArray
    horizon: tuple[float, float, float]


def simulate(points: Points, ramp_rate: FloatArray, config: Config) -> Simulated:
    """Let the plant settle at each point, then remove the rear steering. `ramp_rate` (k,) in rad/s, above zero."""
    car = _Car.at(points, config)
    columns, sideslip = car.settle(car.start(points))
    settles = np.isfinite(sideslip)
    begin = columns[:, settles]
    begin[car.row("sideslip_max")] = np.abs(sideslip[settles])
    slowest = float(np.max(np.abs(points.rear_angle[settles]) / ramp_rate[settles], initial=0.0))
    horizon = (HORIZON, min(HORIZON + slowest, RAMP_HORIZON_MAX), HORIZON)
    sideslip_max = np.full((len(MODES), settles.size), np.nan)
    spins = np.zeros(sideslip_max.shape, dtype=np.bool_)
    for mode, rate in enumerate((np.zeros_like(ramp_rate), ramp_rate, np.full_like(ramp_rate, AT_ONCE))):
        begin[car.row("ramp_rate")] = rate[settles]
        end = car.run(begin, horizon[mode])
        sideslip_max[mode, settles] = end[car.row("sideslip_max")]
        # A car whose state is not finite has spun too.
        spins[mode, settles] = (end[car.row("spun")] > 0.0) | ~np.isfinite(end).all(axis=0)
    return Simulated(settles, sideslip, sideslip_max, spins, horizon)


@dataclass(frozen=True)
class _Car:
    """The plant with the step (s) that suits it. Columns hold its states and _EXTRA."""

    model: Model
    config: Config
    step: float

    @classmethod
    def at(cls, points: Points, config: Config) -> _Car:
        """Return the plant; its step is at most STEP_MAX and the fastest time constant (fourth order: error below 1 %)."""
        car = cls(two_track(config), config, STEP_MAX)
        size = len(car.model.states)
        moving = [index for index, name in enumerate(car.model.states) if name not in _AT_REST]
        fastest = 0.0
        for column in car.start(points).T:
            by_state = np.array(car.model.jacobian(column[:size], car.inputs(column[size:]))[0])
            fastest = max(fastest, float(np.abs(np.linalg.eigvals(by_state[np.ix_(moving, moving)])).max()))
        return cls(car.model, config, min(STEP_MAX, 1.0 / max(fastest, 1e-9)))

    def row(self, name: str) -> int:
        """Return the row of one of _EXTRA in a column."""
        return len(self.model.states) + _EXTRA.index(name)

    def start(self, points: Points) -> FloatArray:
        """Return one column for each point. States that the linear car does not have start at zero."""
        wheel = points.front_angle * self.config.steering.ratio
        known = {
            "lateral_speed": points.speed * np.tan(points.sideslip),
            "yaw_rate": points.yaw_rate,
            "steering_wheel_angle": wheel,
            "rear_angle": points.rear_angle,
            "command": points.rear_angle,
            "speed": points.speed,
            "wheel_command": wheel,
        }
        return np.array([known.get(name, np.zeros_like(wheel)) for name in (*self.model.states, *_EXTRA)])

    def inputs(self, extra: Any) -> list[Any]:
        """Return the inputs of the plant from values in the order of _EXTRA."""
        known = {
            "speed": extra[_EXTRA.index("speed")],
            "steering_wheel_command": extra[_EXTRA.index("wheel_command")],
            "rear_angle_command": extra[_EXTRA.index("command")],
            "friction": self.config.road.friction,
        }
        return [known.get(name, 0.0) for name in self.model.inputs]

    def run(self, columns: FloatArray, duration: float) -> FloatArray:
        """Return the columns after a duration (s)."""
        if not columns.shape[1]:
            return columns
        steps = math.ceil(duration / self.step - 1e-9)
        result: FloatArray = np.array(self._stepper(duration / steps).fold(steps).map(columns.shape[1])(columns))
        return result

    def settle(self, columns: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the steady columns and their sideslip angles (rad), NaN where they spin or never become steady."""
        columns, sideslip = columns.copy(), np.full(columns.shape[1], np.nan)
        waiting = np.arange(columns.shape[1])
        for _ in range(SETTLING_ROUNDS):
            columns[:, waiting] = self.run(columns[:, waiting], SETTLING_TIME)
            for index in waiting:
                sideslip[index] = self._steady_sideslip(columns[:, index])
            waiting = waiting[np.isnan(sideslip[waiting]) & (columns[self.row("spun"), waiting] == 0.0)]
        return columns, sideslip

    def _steady_sideslip(self, column: FloatArray) -> float:
        """Return the steady sideslip angle in rad; NaN where the turn is not steady, or the car spun before."""
        state, inputs = column[: len(self.model.states)], self.inputs(column[len(self.model.states) :])
        rate = dict(zip(self.model.states, np.array(self.model.derivative(state, inputs)).ravel(), strict=True))
        steady = (
            abs(rate["lateral_speed"]) <= SETTLED_SIDESLIP_RATE * column[self.row("speed")]
            and abs(rate["yaw_rate"]) <= SETTLED_YAW_ACCELERATION
            and column[self.row("spun")] == 0.0
        )
        return float(self._slips(state, inputs)[0]) if steady else math.nan

    def _slips(self, state: Any, inputs: Any) -> tuple[Any, Any]:
        """Return sideslip angle and rear slip angle, rad."""
        assert self.model.output is not None  # the plant has outputs
        y = self.model.output(state, inputs)
        return y[self.model.outputs.index("sideslip_angle")], y[self.model.outputs.index("slip_rear")]

    def _stepper(self, step: float) -> Any:
        """Return one fourth-order Runge-Kutta step over a column.

        The command changes once a step, as a sampled controller's does, and holds in between.
        """
        size = len(self.model.states)
        column = ca.SX.sym("column", size + len(_EXTRA))
        x, extra = column[:size], [column[size + index] for index in range(len(_EXTRA))]
        command, ramp_rate, *_, sideslip_max, spun = extra
        extra[0] = ca.sign(command) * ca.fmax(ca.fabs(command) - ramp_rate * step, 0.0)
        inputs = ca.vertcat(*self.inputs(extra))
        counted = ca.DM([0.0 if name in _NO_FEEDBACK else 1.0 for name in self.model.states])

        def slope(state: Any) -> Any:
            return counted * self.model.derivative(state, inputs)

        first = slope(x)
        second = slope(x + 0.5 * step * first)
        third = slope(x + 0.5 * step * second)
        fourth = slope(x + step * third)
        x = x + step / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        sideslip, rear_slip = self._slips(x, inputs)
        spinning = ca.logic_and(ca.fabs(sideslip) > SPIN_SIDESLIP, ca.fabs(rear_slip) > SPIN_REAR_SLIP)
        extra[-2:] = [ca.fmax(sideslip_max, ca.fabs(sideslip)), ca.fmax(spun, spinning)]
        return ca.Function("step", [column], [ca.vertcat(x, *extra)])
