"""Loss of rear steering: its consequences for a map.

There are two results. The first is the set of operating points that are feasible only with rear steer: the same car under the
same bounds cannot drive them with its rear wheels straight. The second is the motion after the loss. At some operating points
the two-track plant is in its steady turn. The driver holds the front angle and the speed, and from t = 0 the rear angle is
held, ramped to zero or set to zero.

The operating points: eight speeds, evenly spaced from the lowest to the highest at which the map has a feasible cell and the
controller does not stand by, each moved to the nearest such breakpoint; at each 50, 75 and 100 % of the front angle of the
last feasible cell, with the map's own values, interpolated over the front angle.

All operating points advance at once, as the columns of one matrix, by a Runge-Kutta method in CasADi. The road has the friction
of the configuration.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.map_file.map import ReferenceMap
from codegen.metrics.runs import SPIN_REAR_SLIP, SPIN_SIDESLIP
from codegen.optimum.turns import passively_feasible, turns_behind
from codegen.units import KM_H
from codegen.vehicle.dynamics import MOTOR_ANGLE, Model, two_track
from codegen.vehicle.single_track import SingleTrack

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
        """Return one column for each point. States without a value in the linear car start at zero."""
        wheel = points.front_angle * self.config.steering.ratio
        known = {
            "lateral_speed": points.speed * np.tan(points.sideslip),
            "yaw_rate": points.yaw_rate,
            "steering_wheel_angle": wheel,
            "rear_angle": points.rear_angle,
            MOTOR_ANGLE: points.rear_angle,
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


__all__ = ["MODES", "LossOfFunction", "loss_of_function", "rounded"]


SPEEDS = 8
SHARES = (0.5, 0.75, 1.0)
"""Fractions of the largest feasible front angle."""

KEPT_RESULTS = 4


@dataclass(frozen=True, eq=False)
class LossOfFunction:
    """Consequences of losing rear steering for a map of n speeds and m front angles, at k operating points. Read-only arrays.

    Attributes:
        only_with_rear_steer: (n, m) feasible in the map and not with the rear wheels straight; None for a bare map.
        share_of_feasible: share of these among the feasible cells; None for a bare map.
        speed: (k,) m/s. front_angle: (k,) rad. rear_angle: (k,) rad, before the loss, within the actuator's angle. Where a
            bare map has none it is delta_f - r/G, which gives the map's yaw rate in the linear single-track car.
        passively_feasible: (k,) whether the point is feasible without rear steer too; None for a bare map.
        settles: (k,) whether the plant settles into a steady turn before the loss. Where not, the loss is not simulated.
        sideslip: (k,) rad, of that steady turn, with sign; NaN where it does not settle.
        ramp_rate: (k,) rad/s: the fail-safe's rate.
        sideslip_max: (3, k) rad, largest magnitude from t = 0 on for each of MODES; NaN where it does not settle.
        spins: (3, k) whether the car spins (see `SPIN_SIDESLIP`); False where it does not settle.
        horizon: (3,) s simulated in each mode.
    """

    only_with_rear_steer: BoolArray | None
    share_of_feasible: float | None
    speed: FloatArray
    front_angle: FloatArray
    rear_angle: FloatArray
    passively_feasible: BoolArray | None
    settles: BoolArray
    sideslip: FloatArray
    ramp_rate: FloatArray
    sideslip_max: FloatArray
    spins: BoolArray
    horizon: tuple[float, float, float]

    @property
    def share_of_grid(self) -> float | None:
        """Share of the cells feasible only with rear steer among all; None for a bare map."""
        return None if self.only_with_rear_steer is None else float(np.mean(self.only_with_rear_steer))

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values, in lists with an entry for each operating point; null where the plant does not settle.

        Cells that are feasible only with rear steer are "x" in a text for each speed.

        Sideslip angles are rounded to 0.1 deg, so that the last bits of a libm do not show.
        """
        only: dict[str, Any] | None = None
        if self.only_with_rear_steer is not None:
            only = {
                "cells": int(self.only_with_rear_steer.sum()),
                "share_of_feasible": rounded(self.share_of_feasible, 4),
                "share_of_grid": rounded(self.share_of_grid, 4),
                "by_speed_and_front_angle": ["".join(".x"[int(cell)] for cell in row) for row in self.only_with_rear_steer],
            }
        points: dict[str, Any] = {
            "speed_km_h": [rounded(value, 2) for value in self.speed / KM_H],
            "front_angle_deg": _degrees(self.front_angle, 3),
            "rear_angle_deg": _degrees(self.rear_angle, 2),
            "passively_feasible": None if self.passively_feasible is None else self.passively_feasible.tolist(),
            "settles": self.settles.tolist(),
            "sideslip_deg": _degrees(self.sideslip, 1),
            "ramp_rate_deg_s": _degrees(self.ramp_rate, 2),
        }
        modes = {
            mode: {
                "horizon_s": rounded(self.horizon[row], 2),
                "sideslip_max_deg": _degrees(self.sideslip_max[row], 1),
                "spins": [bool(spins) if known else None for spins, known in zip(self.spins[row], self.settles, strict=True)],
            }
            for row, mode in enumerate(MODES)
        }
        return {"only_with_rear_steer": only, "operating_points": points, "rear_angle_after_loss": modes}


def rounded(value: float | None, digits: int) -> float | None:
    """Return a number rounded for JSON, which has neither NaN nor infinity; -0.0 becomes 0.0."""
    return round(float(value), digits) + 0.0 if value is not None and math.isfinite(value) else None


def _degrees(values: FloatArray, digits: int) -> list[float | None]:
    return [rounded(value, digits) for value in np.rad2deg(values)]


def loss_of_function(reference_map: ReferenceMap, config: Config) -> LossOfFunction:
    """Return the consequences of losing rear steering for a map, on the road of the map (without the layers of a stack).

    Results are cached by map and configuration.

    Args:
        reference_map: solved or bare. The car that it was solved for decides what is feasible without rear steer.
        config: the simulated car, its road, its actuator and its fail-safe.
    """
    return _kept(_Request(_digest(reference_map, config), reference_map, config))


@dataclass(frozen=True)
class _Request:
    """The arguments, compared by a digest of everything that affects the result."""

    digest: str
    reference_map: ReferenceMap = field(compare=False)
    config: Config = field(compare=False)


def _digest(reference_map: ReferenceMap, config: Config) -> str:
    own = reference_map.config
    texts = (config.to_json(), "" if own is None else own.to_json(), str(reference_map.case), str(reference_map.solved))
    tables = (
        reference_map.speed,
        reference_map.front_angle,
        reference_map.yaw_rate,
        reference_map.feasible,
        reference_map.rear_angle,
    )
    hashed = hashlib.sha256()
    for text in texts:
        hashed.update(f"{len(text)}:{text}".encode())
    for table in tables:
        hashed.update(b"none" if table is None else f"{table.dtype.str}{table.shape}".encode() + table.tobytes())
    return hashed.hexdigest()


@lru_cache(maxsize=KEPT_RESULTS)
def _kept(request: _Request) -> LossOfFunction:
    result = _computed(request.reference_map, request.config)
    for entry in fields(result):
        value = getattr(result, entry.name)
        if isinstance(value, np.ndarray):
            value.setflags(write=False)  # shared through the cache
    return result


def _computed(reference_map: ReferenceMap, config: Config) -> LossOfFunction:
    points = _operating_points(reference_map, config)
    only = share = passive = None
    turns = turns_behind(reference_map)
    if turns is not None:
        feasible = reference_map.feasible
        only = feasible & ~passively_feasible(turns, reference_map.speed, reference_map.front_angle)
        share = float(only.sum() / max(int(feasible.sum()), 1))
        passive = turns.without_rear_steering().at(points.speed, points.front_angle).feasible
    ramp_rate = np.full_like(points.speed, math.radians(config.controller.fail_safe.rate_deg_s))
    simulated = simulate(points, ramp_rate, config)
    return LossOfFunction(
        only_with_rear_steer=only,
        share_of_feasible=share,
        speed=points.speed,
        front_angle=points.front_angle,
        rear_angle=points.rear_angle,
        passively_feasible=passive,
        settles=simulated.settles,
        sideslip=simulated.sideslip,
        ramp_rate=ramp_rate,
        sideslip_max=simulated.sideslip_max,
        spins=simulated.spins,
        horizon=simulated.horizon,
    )


def _rows(reference_map: ReferenceMap, config: Config) -> npt.NDArray[np.intp]:
    """Return the indices of the examined speeds. Where the controller stands by there is no function to lose."""
    speed = reference_map.speed
    standby = config.controller.feedback_speeds_km_h[0] * KM_H
    usable = np.flatnonzero(reference_map.feasible.any(axis=1) & (speed >= standby))
    if not usable.size:
        return usable
    wanted = np.linspace(speed[usable[0]], speed[usable[-1]], SPEEDS)
    nearest = np.argmin(np.abs(speed[usable] - wanted[:, np.newaxis]), axis=1)
    return np.unique(usable[nearest])


def _operating_points(reference_map: ReferenceMap, config: Config) -> Points:
    """Return the operating points, SHARES at each of `_rows`; none where the controller stands by at all speeds of the map."""
    car = SingleTrack.from_config(config)
    limit = config.rear_actuator.angle_max
    turns = []
    for row in _rows(reference_map, config):
        speed, known = reference_map.speed[row], reference_map.feasible[row]
        # Straight ahead everything is zero, and the map is symmetric.
        angles = np.append(0.0, reference_map.front_angle[known])
        front = np.array(SHARES) * angles[-1]
        yaw_rate = np.interp(front, angles, np.append(0.0, reference_map.yaw_rate[row, known]))
        if reference_map.rear_angle is not None:
            rear = np.interp(front, angles, np.append(0.0, reference_map.rear_angle[row, known]))
        else:
            rear = front - yaw_rate / car.yaw_gain(speed)
        rear = np.clip(rear, -limit, limit)
        sideslip = rear + car.sideslip_per_yaw_rate(speed) * yaw_rate
        turns.append(np.array([np.full(front.shape, speed), front, rear, yaw_rate, sideslip]))
    return Points(*(np.concatenate(turns, axis=1) if turns else np.zeros((5, 0))))
