"""The optimum of the nonlinear steady turn by brute force: nothing is shared with the solver but the plant's equations.

For each of many yaw rates (a car that does not steer its rear wheels has one rear angle instead) the two slip angles at the
middle of the axles are laid out on a dense grid, which fixes lateral speed and rear angle. Where both residuals of
`vehicle.dynamics.two_track` change sign between the corners of a square of that grid there may be a steady turn; Newton's
method with the plant's own Jacobian finds it. All turns found are judged by all bounds, and the yaw rates are laid out again,
ever closer, around the best turn (or, where none is feasible, around the one that misses the bounds by least).

With a floor or a cap of the yaw rate, the same search then finds the feasible turn nearest to the yaw rate asked for. The floor
is its own. The cap is given: it is a choice of the map, no result of a search.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.configuration import Case, Config
from codegen.optimum.ipopt import without_shifts
from codegen.optimum.problem import PEAK_SHARE, STABILITY_MARGIN
from codegen.vehicle.dynamics import PLANT_INPUTS, Model, two_track
from codegen.vehicle.tyre import WHEEL_SPEED_MIN, AxleTyres, MagicFormulaTyre

BEYOND = 1.25
"""Largest slip angle of the search as a multiple of its bound, so that turns just beyond it are found too."""
ZOOMS = 4
"""The last yaw rates are some 1e-6 rad/s apart."""
CLOSER = 1.5
"""Steps of the grid that the next one reaches to either side."""
NEWTON_STEPS = 10
RESIDUAL_MAX = 1e-9
"""m/s^2 and rad/s^2."""
JUST = 1e-9
"""A bound counts as kept up to this share above it."""

LATERAL_SPEED, YAW_RATE, REAR_ANGLE = 0, 1, 3
"""States of the plant."""
_R, _REAR, _OBJECTIVE, _VIOLATION = range(4)
"""Columns of turns."""


@dataclass(frozen=True)
class Best:
    """Result of the search at one operating point.

    Attributes:
        yaw_rate: rad/s, of the best feasible turn; NaN where there is none, or where its floor is not known. rear_angle: rad.
        objective: of that turn.
        violation: smallest relative violation of the most violated bound; zero or negative if feasible; inf without a steady
            turn.
    """

    yaw_rate: float
    rear_angle: float
    objective: float
    violation: float

    @property
    def feasible(self) -> bool:
        """Whether a feasible turn was found."""
        return self.violation <= JUST


@dataclass(frozen=True)
class DenseSearch:
    """The search for one car and case; SI units. `slip_max`: front and rear, rad. `cap`: speed -> lateral acceleration."""

    model: Model
    config: Config
    case: Case
    slip_max: tuple[float, float]
    cap: Callable[[float], float]
    yaw_rates: int
    slips: int
    wanted: float | None = None
    """Yaw rate in rad/s whose distance is the objective instead."""

    @classmethod
    def of(cls, config: Config, case: Case, cap: Callable[[float], float], yaw_rates: int = 41, slips: int = 25) -> Self:
        """Search for a case, with the given number of yaw rates at a time and of slip angles of each axle."""
        plain, use = without_shifts(config), config.limits.grip_use_max
        tyres, bounds = AxleTyres.from_config(plain), AxleTyres.from_config(config)
        if use is None:
            front = min(bounds.front_slip_bound, PEAK_SHARE * _peak(tyres.front))
            rear = min(bounds.rear_slip_bound, PEAK_SHARE * _peak(tyres.rear))
        else:
            front, rear = _slip_at(tyres.front, use), _slip_at(tyres.rear, use)
        return cls(two_track(plain), plain, case, (front, rear), cap, yaw_rates, slips)

    def best(self, speed: float, front_angle: float) -> Best:
        """Return the turn of the map at one operating point (m/s, rad)."""
        if not self.case.rear_steering:
            turns = self._turns(speed, front_angle, np.zeros(1), REAR_ANGLE)
            return _result(_choose(turns))
        limit = self._lateral_acceleration_max / speed
        step = 2.0 * limit / (self.yaw_rates - 1)
        found = self._turns(speed, front_angle, np.linspace(-limit, limit, self.yaw_rates), YAW_RATE)
        # Turns to the left and to the right may be all but equally good: each side has its own best.
        sides = (found[found[:, _R] > 0.0], found[found[:, _R] <= 0.0])
        best = _result(_choose(np.array([self._closer(speed, front_angle, _choose(side), step) for side in sides])))
        limits = self.config.limits
        if not best.feasible or self.wanted is not None or not (limits.grip_use_max or limits.yaw_gain_floor):
            return best
        asked = self._asked(speed, front_angle, best.yaw_rate)
        if math.isnan(asked):
            return replace(best, yaw_rate=math.nan)
        return replace(self, wanted=asked).best(speed, front_angle)

    def _asked(self, speed: float, front_angle: float, optimum: float) -> float:
        """Return the yaw rate asked for, in rad/s, for that of the optimum.

        NaN where a floor refers to a passive turn beyond the slip bounds. How a map goes on there is its own choice."""
        limits, wheelbase = self.config.limits, self.config.vehicle.wheelbase
        passive = self._turns(speed, front_angle, np.zeros(1), REAR_ANGLE, beyond=1.0 + JUST)[:, _R]
        if limits.yaw_gain_floor > 0.0 and not passive.size:
            return math.nan
        straight = min(passive.max(initial=0.0), self._lateral_acceleration_max / speed)
        characteristic = limits.reference_characteristic_speed_km_h / 3.6
        understeering = min(straight, speed * front_angle / wheelbase / (1.0 + (speed / characteristic) ** 2))
        share = min(max(3.6 * speed / 20.0 - 3.0, 0.0), 1.0)
        share *= share * (3.0 - 2.0 * share)  # zero at 60 km/h, one at 80 km/h, without a kink
        floor = limits.yaw_gain_floor * ((1.0 - share) * straight + share * understeering)
        cap = self.cap(speed) / speed
        asked = max(min(optimum, cap / 0.99), floor)
        return float(asked / (1.0 + (asked / cap) ** 50) ** 0.02)

    @property
    def _lateral_acceleration_max(self) -> float:
        return float(self.config.limits.lateral_acceleration_max_g * self.config.road.gravity_m_s2)

    def _closer(self, speed: float, front_angle: float, best: FloatArray, step: float) -> FloatArray:
        """Return the best turn near another one by refining the yaw rates, which are `step` (rad/s) apart."""
        limit = self._lateral_acceleration_max / speed
        for _ in range(ZOOMS if np.isfinite(best[_R]) else 0):
            around = np.linspace(best[_R] - CLOSER * step, best[_R] + CLOSER * step, self.yaw_rates)
            found = self._turns(speed, front_angle, np.unique(np.clip(around, -limit, limit)), YAW_RATE)
            best = _choose(np.vstack([found, best]))
            step *= 2.0 * CLOSER / (self.yaw_rates - 1)
        return best

    def _turns(self, speed: float, front_angle: float, fixed: FloatArray, which: int, beyond: float = BEYOND) -> FloatArray:
        """Return steady turns (k, 4) at yaw rates or rear angles: yaw rate, rear angle, objective, violation.

        `beyond`: largest slip angle as a multiple of its bound."""
        shares = np.linspace(-BEYOND, BEYOND, self.slips)
        grid = np.meshgrid(shares * self.slip_max[0], shares * self.slip_max[1], fixed, indexing="ij")
        a, b, c = (values.ravel() for values in grid)
        state = self._state(speed, front_angle, a, b, c, which)
        force, moment = (part.reshape(grid[0].shape) for part in self._rates(speed, front_angle, state))
        i, j, k = np.nonzero(_changes(force) & _changes(moment))
        if not k.size:
            return np.empty((0, 4))
        front, rear = (0.5 * (shares[at] + shares[at + 1]) * bound for at, bound in zip((i, j), self.slip_max, strict=True))
        state = self._state(speed, front_angle, front, rear, fixed[k], which)
        free = [LATERAL_SPEED, REAR_ANGLE if which == YAW_RATE else YAW_RATE]
        for _ in range(NEWTON_STEPS):
            rates, jacobian = self._rates(speed, front_angle, state), self._jacobian(speed, front_angle, state)
            (a, b), (c, d) = jacobian[:, free]
            with np.errstate(all="ignore"):
                moves = np.array([b * rates[1] - d * rates[0], c * rates[0] - a * rates[1]]) / (a * d - b * c)
            # One that runs away is none.
            state[free] = np.clip(np.where(np.isfinite(moves), state[free] + moves, 0.0), -100.0, 100.0)
        return self._judged(speed, front_angle, state, beyond)

    def _judged(self, speed: float, front_angle: float, state: FloatArray, beyond: float) -> FloatArray:
        rates, jacobian = self._rates(speed, front_angle, state), self._jacobian(speed, front_angle, state)
        output = np.array(self._call(self.model.output, speed, front_angle, state))
        beta, yaw_rate, rear = output[0], state[YAW_RATE], state[REAR_ANGLE]
        # dr/d delta_r of the steady turn is -effect / determinant, and -L/vx the other way round for a neutral car.
        determinant = jacobian[0, 0] * jacobian[1, 1] - jacobian[0, 1] * jacobian[1, 0]
        effect = jacobian[0, 0] * jacobian[1, 3] - jacobian[1, 0] * jacobian[0, 3]
        neutral = self.config.vehicle.wheelbase / max(speed, WHEEL_SPEED_MIN)
        limits = self.config.limits
        slips = [np.abs(output[3]) / self.slip_max[0] - 1.0, np.abs(output[4]) / self.slip_max[1] - 1.0]
        violation = np.max(
            [
                *slips,
                np.abs(beta) / limits.sideslip_max - 1.0,
                np.abs(speed * yaw_rate) / self._lateral_acceleration_max - 1.0,
                np.abs(rear) / limits.rear_angle_max - 1.0,
                STABILITY_MARGIN - determinant / (neutral * effect),
            ],
            axis=0,
        )
        objective = -(yaw_rate**2) + self.case.sideslip_weight_per_s2 * beta**2
        if self.wanted is not None:
            objective = (yaw_rate - self.wanted) ** 2
        solved = (np.abs(rates).max(axis=0) < RESIDUAL_MAX) & (np.max(slips, axis=0) < beyond - 1.0)
        turns: FloatArray = np.array([yaw_rate, rear, objective, violation]).T[solved]
        return turns

    def _state(
        self, speed: float, front_angle: float, slip_front: FloatArray, slip_rear: FloatArray, fixed: FloatArray, which: int
    ) -> FloatArray:
        """Return states (7, k) of the plant with given slip angles and yaw rates or rear angles."""
        vehicle, rolling = self.config.vehicle, max(speed, WHEEL_SPEED_MIN)
        ahead = rolling * np.tan(slip_front + front_angle)
        if which == YAW_RATE:
            yaw_rate, rear = fixed, np.arctan((ahead - vehicle.wheelbase * fixed) / rolling) - slip_rear
        else:
            yaw_rate, rear = (ahead - rolling * np.tan(slip_rear + fixed)) / vehicle.wheelbase, fixed
        state = np.zeros((7, slip_front.size))
        state[LATERAL_SPEED], state[YAW_RATE] = ahead - vehicle.cg_to_front_axle_m * yaw_rate, yaw_rate
        state[2], state[REAR_ANGLE] = front_angle * self.config.steering.ratio, rear
        return state

    def _call(self, function: Any, speed: float, front_angle: float, state: FloatArray) -> Any:
        inputs = np.zeros((len(PLANT_INPUTS), state.shape[1]))
        inputs[0], inputs[1], inputs[2] = speed, front_angle * self.config.steering.ratio, state[REAR_ANGLE]
        inputs[3] = self.config.road.friction
        return function.map(state.shape[1])(state, inputs)

    def _rates(self, speed: float, front_angle: float, state: FloatArray) -> FloatArray:
        """Return the derivatives of lateral speed and yaw rate, (2, k)."""
        rates: FloatArray = np.array(self._call(self.model.derivative, speed, front_angle, state))[:2]
        return rates

    def _jacobian(self, speed: float, front_angle: float, state: FloatArray) -> FloatArray:
        """Return their Jacobian by the states, (2, 7, k)."""
        both = np.array(self._call(self.model.jacobian, speed, front_angle, state)[0])
        jacobian: FloatArray = both.reshape(7, -1, 7).transpose(0, 2, 1)[:2]
        return jacobian


def _peak(tyre: MagicFormulaTyre) -> float:
    """Return the slip angle in rad with the largest force, up to 60 degrees; inf if that is the last."""
    slips = np.linspace(0.0, math.radians(60.0), 600_001)
    largest = int(np.argmax(tyre.force(slips)))
    return float(slips[largest]) if largest < slips.size - 1 else math.inf


def _slip_at(tyre: MagicFormulaTyre, use: float) -> float:
    """Return the smallest slip angle in rad with a share of the largest force up to 45 degrees."""
    slips = np.linspace(0.0, math.radians(45.0), 450_001)
    force = tyre.force(slips)
    first = int(np.argmax(force >= use * force.max()))
    return float(np.interp(use * force.max(), force[first - 1 : first + 1], slips[first - 1 : first + 1]))


def _changes(values: FloatArray) -> npt.NDArray[np.bool_]:
    """Return the squares, (n - 1, n - 1, k), without the same sign at all four corners."""
    corners = np.stack([values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]])
    result: npt.NDArray[np.bool_] = (corners.min(axis=0) <= 0.0) & (corners.max(axis=0) >= 0.0)
    return result


def _choose(found: FloatArray) -> FloatArray:
    """Return the best feasible turn, else the one with the smallest violation; NaN and inf if there is none."""
    kept = found[found[:, _VIOLATION] <= JUST]
    if kept.size:
        # Of equal ones the left turn.
        best: FloatArray = kept[np.lexsort((-kept[:, _R], kept[:, _OBJECTIVE]))[0]]
        return best
    if not found.size:
        return np.array([np.nan, np.nan, np.nan, np.inf])
    least: FloatArray = found[np.argmin(found[:, _VIOLATION])]
    return least


def _result(best: FloatArray) -> Best:
    yaw_rate, rear_angle, objective, violation = (float(value) for value in best)
    return Best(yaw_rate if violation <= JUST else math.nan, rear_angle, objective, violation)
