"""Reference of the generated lookup, in NumPy and in the same precision: the C is compared with it bit for bit.

It is written from the rules for a total map, not from the C, and imports nothing from the code generator. The order of the
operations is part of the contract, because in floating point it decides the last bit:

1. speed and |front angle|: NaN and values below zero are at the first breakpoint, i = 0 and u = 0; beyond the last one u = 1.
2. axes begin at zero. Even axis, of N cells from x_a to x_b: core p = (x - x_a) / (x_b - x_a) N, i = int(p), u = p - i; first
cell u = x / x_1; last cell u = min((x - x_b) / (x_top - x_b), 1). Uneven axis: i by binary search, u = (x - x_i) / (x_{i+1} -
x_i), clamped to 0 to 1. 3. a = t00 + u (t10 - t00), b = t01 + u (t11 - t01), r = a + w (b - a), u along speed and w along the
front angle. The rear angle likewise from its own table. With a stack of layers: both layers around the friction, then p + s (q
- p).
   With a stack over longitudinal acceleration: around a / max(g, 1/16), g = friction / map_friction up to 1; the same
   acceleration takes more of the grip of a slippery road. Beyond the stack, and for NaN the first, the end layers.
4. where r speed > ay_cap: r = ay_cap / speed, with the speed not clamped above, and the rear angle increases by the angle that
   the linear car needs for this reduction, up to the sideslip bound (`capped_rear_angle`). A friction below the lowest layer's
   scales ay_cap; above it, ay_cap is interpolated. With a stack over acceleration the interpolated ay_cap is divided by
   map_friction and multiplied by the friction up to that. Where grip leaves a share of ay_cap, it is looked up like the
   others, on its own axes, and multiplies ay_cap where it is below one (and by zero where below zero). The sign of the front
   angle comes back last.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.ecu_map.storage import Axis
from codegen.ecu_map.total import CapSteering, TotalMap
from codegen.map_file.tables import ACCELERATION_STACK

Real = type[np.float32] | type[np.float64]

GRIP_LEAST = 1.0 / 16.0
"""Smallest friction, as a fraction of the map's own, by which an acceleration is divided."""


def cap_in_precision(lateral_acceleration_cap: float, real: Real) -> Any:
    """ay_cap as the C holds it: rounded down by four units in the last place, so that r speed stays below the true value."""
    return real(lateral_acceleration_cap * (1.0 - 4.0 * float(np.finfo(real).eps)))


@dataclass(frozen=True)
class AxisConstants:
    """Constants of an axis in the precision of the target, as the C holds them."""

    axis: Axis
    real: Real

    def _at(self, index: int) -> Any:
        return self.real(self.axis.breakpoints[index])

    @property
    def top(self) -> Any:
        """The last breakpoint, where the axis clamps."""
        return self._at(-1)

    @property
    def core_origin(self) -> Any:
        """First breakpoint of the even core."""
        return self._at(self.axis.core_start)

    @property
    def core_top(self) -> Any:
        """Last breakpoint of the even core."""
        return self._at(self.axis.core_end)

    @property
    def cells(self) -> Any:
        """Number of cells of the even core."""
        return self.real(self.axis.core_end - self.axis.core_start)

    @property
    def unevenness(self) -> float:
        """Largest shift of a breakpoint of the even core by rounding to the target's precision, as a fraction of a step."""
        axis, core = self.axis, self.table[self.axis.core_start : self.axis.core_end + 1]
        step = (core[-1] - core[0]) / self.cells
        if not (axis.even and step > 0.0):
            return 0.0
        return float(np.max(np.abs((core - core[0]) - np.arange(core.size, dtype=self.real) * step)) / step)

    @property
    def table(self) -> npt.NDArray[Any]:
        """All breakpoints in the target's precision."""
        return self.axis.breakpoints.astype(self.real)

    def locate(self, x: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int64], npt.NDArray[Any]]:
        """Cell index and position inside the cell, 0 to 1, for any values."""
        return self._locate_even(x) if self.axis.even else self._locate_uneven(x)

    def _locate_even(self, x: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int64], npt.NDArray[Any]]:
        axis, zero, one = self.axis, self.real(0.0), self.real(1.0)
        steps = ((x - self.core_origin) / (self.core_top - self.core_origin)) * self.cells
        # Just below core_top, `steps` may round up to `cells`. That index is the last cell, if the axis has a wider last cell.
        within = x < self.core_top if axis.has_last_cell else steps < self.cells
        core = (x >= self.core_origin) & within
        whole = np.where(core, steps, zero).astype(np.int64)
        cell = np.where(core, whole + axis.core_start, 0)
        fraction = np.where(core, steps - whole.astype(self.real), zero)
        if axis.has_first_cell:
            fraction = np.where((x > zero) & (x < self.core_origin), x / self._at(1), fraction)
        beyond = (x >= self.core_origin) & ~within
        last = np.minimum((x - self.core_top) / (self.top - self.core_top), one) if axis.has_last_cell else one
        return np.where(beyond, axis.size - 2, cell), np.where(beyond, last, fraction)

    def _locate_uneven(self, x: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int64], npt.NDArray[Any]]:
        table = self.table
        cell = np.zeros(x.shape, dtype=np.int64)
        for stride in self.axis.search_steps:
            candidate = cell + stride
            within = candidate <= self.axis.size - 2
            cell = np.where(within & (x >= table[np.minimum(candidate, self.axis.size - 2)]), candidate, cell)
        fraction = (x - table[cell]) / (table[cell + 1] - table[cell])
        return cell, np.where(fraction > self.real(0.0), np.minimum(fraction, self.real(1.0)), self.real(0.0))


@dataclass(frozen=True)
class SteeringConstants:
    """`total.CapSteering` in the precision of the target."""

    wheelbase: Any
    understeer_coefficient: Any
    rear_arm: Any
    rear_slip: Any
    sideslip_max: Any
    rear_angle_max: Any

    @classmethod
    def of(cls, steering: CapSteering, real: Real) -> SteeringConstants:
        """Return the constants of a car."""
        return cls(*(real(value) for value in astuple(steering)))

    def towards(self, other: SteeringConstants, share: Any) -> SteeringConstants:
        """Interpolate between two roads, which differ in the stiffness of the tyres."""
        coefficient = self.understeer_coefficient + share * (other.understeer_coefficient - self.understeer_coefficient)
        slip = self.rear_slip + share * (other.rear_slip - self.rear_slip)
        return replace(self, understeer_coefficient=coefficient, rear_slip=slip)


@dataclass(frozen=True)
class GripConstants:
    """`total.GripTable` of each layer in the precision of the target; `shares` (k, a, b)."""

    speed_axis: AxisConstants
    front_axis: AxisConstants
    shares: npt.NDArray[Any]

    @classmethod
    def of(cls, total: TotalMap, real: Real) -> GripConstants | None:
        """Return the constants of a total map and its layers; None where it has no grip table."""
        if total.grip is None:
            return None
        speed, front_angle = (Axis.from_breakpoints(axis) for axis in (total.grip.speed, total.grip.front_angle))
        shares = np.stack([layer.grip.share for layer in total.stack if layer.grip is not None]).astype(real)
        return cls(AxisConstants(speed, real), AxisConstants(front_angle, real), shares)

    def locate(self, speed: npt.NDArray[Any], magnitude: npt.NDArray[Any]) -> tuple[Any, Any]:
        """Cell and position on each axis."""
        return self.speed_axis.locate(speed), self.front_axis.locate(magnitude)


@dataclass(frozen=True)
class Lookup:
    """Yaw rate (rad/s) and rear angle (rad) of a total map at any speed (m/s) and front angle (rad), in the target's precision.

    Attributes:
        tables, rear_tables: (k, n, m), rising by friction or acceleration; k is 1 for a map without a stack.
        frictions: (k,) of the layers; (1,) of the map itself with a stack over acceleration.
        caps: (k,) ay_cap in m/s^2.
        lateral_acceleration_cap_per_friction: m/s^2, of the lowest layer: below its friction the cap shrinks in proportion.
        accelerations: (k,) longitudinal, m/s^2; (1,) zero without a stack over it.
        axle_shares: (k, 2) `TotalMap.axle_shares`, likewise.
        cars: (k,) of the layers.
        grip: shares of the caps; None where the caps are the same everywhere.
    """

    speed_axis: AxisConstants
    front_axis: AxisConstants
    tables: npt.NDArray[Any]
    rear_tables: npt.NDArray[Any]
    frictions: npt.NDArray[Any]
    caps: npt.NDArray[Any]
    lateral_acceleration_cap_per_friction: Any
    cars: tuple[SteeringConstants, ...]
    real: Real
    grip: GripConstants | None = None
    accelerations: npt.NDArray[Any] = field(default_factory=lambda: np.zeros(1))
    axle_shares: npt.NDArray[Any] = field(default_factory=lambda: np.ones((1, 2)))

    @classmethod
    def from_map(cls, total: TotalMap, real: Real = np.float32) -> Lookup:
        """Return the lookup of a total map."""
        stack, moving = total.stack, total.quantity is ACCELERATION_STACK
        lowest, roads = total if moving else stack[0], (total,) if moving else stack
        speeds = stack if moving else (total,)
        return cls(
            speed_axis=AxisConstants(Axis.from_breakpoints(total.speed), real),
            front_axis=AxisConstants(Axis.from_breakpoints(total.front_angle), real),
            tables=np.stack([layer.yaw_rate for layer in stack]).astype(real),
            rear_tables=np.stack([layer.rear_angle for layer in stack]).astype(real),
            frictions=np.array([layer.friction for layer in roads], dtype=real),
            caps=np.array([cap_in_precision(layer.lateral_acceleration_cap, real) for layer in stack], dtype=real),
            lateral_acceleration_cap_per_friction=cap_in_precision(lowest.lateral_acceleration_cap / lowest.friction, real),
            cars=tuple(SteeringConstants.of(layer.steering, real) for layer in stack),
            real=real,
            grip=GripConstants.of(total, real),
            accelerations=np.array([layer.acceleration for layer in speeds], dtype=real),
            axle_shares=np.array([layer.axle_shares for layer in speeds], dtype=real),
        )

    @property
    def is_moving(self) -> bool:
        """Whether the stack is over longitudinal acceleration."""
        return self.accelerations.size > 1

    @property
    def own(self) -> int:
        """Index of the map itself in the stack."""
        return int(np.flatnonzero(self.accelerations == 0.0)[0]) if self.is_moving else self.frictions.size - 1

    @property
    def strongest_braking(self) -> float:
        """Smallest acceleration of the stack in m/s^2."""
        return float(self.accelerations[0])

    @property
    def values(self) -> npt.NDArray[Any]:
        """Frictions or accelerations (k,) of the stack."""
        return self.accelerations if self.is_moving else self.frictions

    def layer_at(self, index: int) -> tuple[float, float]:
        """Return friction (NaN: the map's own) and acceleration of a layer, the last arguments of `reference`."""
        if self.is_moving:
            return math.nan, float(self.accelerations[index])
        return (float(self.frictions[index]) if self.frictions.size > 1 else math.nan), 0.0

    @property
    def table(self) -> npt.NDArray[Any]:
        """Yaw rates (n, m) in rad/s of the map itself."""
        table: npt.NDArray[Any] = self.tables[self.own]
        return table

    @property
    def lateral_acceleration_cap(self) -> Any:
        """Cap in m/s^2 of the map itself."""
        return self.caps[self.own]

    @property
    def friction(self) -> Any:
        """Friction of the map."""
        return self.frictions[-1]

    def __call__(
        self, speed: npt.ArrayLike, front_angle: npt.ArrayLike, friction: float = math.nan, acceleration: float = 0.0
    ) -> npt.NDArray[Any]:
        """Return the yaw rate in rad/s, in `real`, in the broadcast shape of the arguments.

        Args:
            speed: m/s, any value, NaN and infinity too.
            front_angle: rad, any value.
            friction: estimated peak friction; NaN, and more than the map assumes, count as the map's own.
            acceleration: longitudinal, m/s^2, any value; NaN counts as the strongest braking of the stack.
        """
        return self.reference(speed, front_angle, friction, acceleration)[0]

    def reference(
        self, speed: npt.ArrayLike, front_angle: npt.ArrayLike, friction: float = math.nan, acceleration: float = 0.0
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return yaw rate in rad/s and rear angle in rad; arguments as in `__call__`."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
            v: npt.NDArray[Any] = np.asarray(speed, dtype=self.real)
            angle: npt.NDArray[Any] = np.asarray(front_angle, dtype=self.real)
            zero = self.real(0.0)
            clamped = np.where(v > self.speed_axis.top, self.speed_axis.top, v)
            row = self.speed_axis.locate(v)
            magnitude = np.where(angle < zero, np.negative(angle), angle)
            column = self.front_axis.locate(magnitude)
            layer, cap = self._road(self.real(friction), self.real(acceleration))
            yaw_rate, rear_angle = (self._over_stack(table, layer, row, column) for table in (self.tables, self.rear_tables))
            if self.grip is not None:
                share = self._over_stack(self.grip.shares, layer, *self.grip.locate(v, magnitude))
                cap = cap * np.where(share < self.real(1.0), np.maximum(share, self.real(0.0)), self.real(1.0))
            capped = yaw_rate * v > cap
            car = self._car(layer)
            rear_angle = np.where(capped, capped_rear_angle(car, yaw_rate, rear_angle, cap / v, clamped), rear_angle)
            yaw_rate = np.where(capped, cap / v, yaw_rate)
            left = ~(angle < zero)
            return np.where(left, yaw_rate, -yaw_rate), np.where(left, rear_angle, -rear_angle)

    def lateral_acceleration(self, friction: float, acceleration: float = 0.0) -> Any:
        """Return the lateral acceleration cap in m/s^2, in `real`; arguments as in `__call__`."""
        return self._road(self.real(friction), self.real(acceleration))[1]

    def axle_shares_at(self, friction: float, acceleration: float) -> npt.NDArray[Any]:
        """Return `TotalMap.axle_shares` (2,) between the layers, in `real`; only with a stack over acceleration."""
        (layer, share), _ = self._road(self.real(friction), self.real(acceleration))
        result: npt.NDArray[Any] = self.axle_shares[layer] + share * (self.axle_shares[layer + 1] - self.axle_shares[layer])
        return result

    def _moving(self, friction: Any, acceleration: Any) -> tuple[tuple[int, Any], Any]:
        """Return the same as `_road` for a stack over acceleration."""
        values, caps = self.accelerations, self.caps
        friction = max(friction, self.real(0.0)) if friction < self.friction else self.friction
        with np.errstate(over="ignore"):
            on_stack = acceleration / max(friction / self.friction, self.real(GRIP_LEAST))
        on_stack = on_stack if on_stack > values[0] else values[0]
        on_stack = min(on_stack, values[-1])
        layer = int(np.count_nonzero(on_stack >= values[1:-1]))
        share = (on_stack - values[layer]) / (values[layer + 1] - values[layer])
        return (layer, share), (caps[layer] + share * (caps[layer + 1] - caps[layer])) / self.friction * friction

    def _road(self, friction: Any, acceleration: Any) -> tuple[tuple[int, Any], Any]:
        """Return the layer, the position above it, and ay_cap at a friction estimate (NaN: none) and an acceleration."""
        if self.is_moving:
            return self._moving(friction, acceleration)
        frictions, caps = self.frictions, self.caps
        if not friction < frictions[-1]:
            friction = frictions[-1]
        friction = friction if friction > 0.0 else self.real(0.0)
        on_stack = max(friction, frictions[0])
        layer = int(np.count_nonzero(on_stack >= frictions[1:-1]))
        if frictions.size == 1:
            cap = caps[0] if friction == frictions[0] else self.lateral_acceleration_cap_per_friction * friction
            return (0, self.real(0.0)), cap
        share = (on_stack - frictions[layer]) / (frictions[layer + 1] - frictions[layer])
        cap = caps[layer] + share * (caps[layer + 1] - caps[layer])
        if friction < frictions[0]:
            cap = self.lateral_acceleration_cap_per_friction * friction
        return (layer, share), cap

    def _car(self, layer: tuple[int, Any]) -> SteeringConstants:
        index, share = layer
        return self.cars[0] if len(self.cars) == 1 else self.cars[index].towards(self.cars[index + 1], share)

    def _over_stack(self, tables: npt.NDArray[Any], layer: tuple[int, Any], row: Any, column: Any) -> npt.NDArray[Any]:
        index, share = layer
        slippery = _interpolate(tables[index], row, column)
        if len(tables) == 1:
            return slippery
        result: npt.NDArray[Any] = slippery + share * (_interpolate(tables[index + 1], row, column) - slippery)
        return result


def capped_rear_angle(
    car: SteeringConstants, yaw_rate: Any, rear_angle: Any, allowed_yaw_rate: Any, speed: Any
) -> npt.NDArray[Any]:
    """Return the rear angle in rad where the cap reduces `yaw_rate`; `speed` (m/s) is at most the last breakpoint."""
    excess = yaw_rate - allowed_yaw_rate
    wanted = rear_angle + excess * (car.wheelbase / speed + car.understeer_coefficient * speed)
    bound = car.sideslip_max - allowed_yaw_rate * (car.rear_arm / speed - car.rear_slip * speed)
    wanted = np.where(wanted > bound, bound, wanted)
    wanted = np.where(wanted > car.rear_angle_max, car.rear_angle_max, wanted)
    result: npt.NDArray[Any] = np.where(wanted > rear_angle, wanted, rear_angle)
    return result


def _interpolate(table: npt.NDArray[Any], row: Any, column: Any) -> npt.NDArray[Any]:
    (i, u), (j, w) = row, column
    lower = table[i, j] + u * (table[i + 1, j] - table[i, j])
    upper = table[i, j + 1] + u * (table[i + 1, j + 1] - table[i, j + 1])
    result: npt.NDArray[Any] = lower + w * (upper - lower)
    return result


def error_bound(total: TotalMap, real: Real = np.float32) -> float:
    """Return a bound in rad/s on the difference of the lookup in `real` from the same rule in exact arithmetic, for all inputs.

    Rounding-error analysis to first order in the unit roundoff u (N. J. Higham, Accuracy and Stability of Numerical
    Algorithms, chapter 3). Rounded breakpoints, the subtractions, the quotient and the product move the position by at
    most 6 u x, worth the steepest slope at hand (of a cell or its neighbour, for rounding may choose that one). Stored corners
    and three interpolations add 8 u times the largest corner. The lowered cap and its quotient add 10 u times the largest
    value. A grip table adds its own terms of the same form.
    """
    unit = 0.5 * float(np.finfo(real).eps)
    return max(_layer_bound(layer, unit) for layer in total.stack) + _stack_bound(total, unit)


def _stack_bound(total: TotalMap, unit: float) -> float:
    """Return the bound along the axis of the stack: position and interpolation of yaw rate and cap between layers. An
    acceleration is divided by the grip first, 3 u more, and the cap multiplied by it, which the last term covers."""
    stack = total.stack
    bound = 0.0
    for lower, upper in pairwise(stack):
        rise = float(np.abs(upper.yaw_rate - lower.yaw_rate).max())
        largest, step = upper.friction, upper.friction - lower.friction
        if total.quantity is ACCELERATION_STACK:
            largest, step = max(map(abs, (lower.acceleration, upper.acceleration))), upper.acceleration - lower.acceleration
        bound = max(bound, (9.0 if total.quantity is ACCELERATION_STACK else 6.0) * unit * largest * rise / step)
    return bound + (16.0 * unit * float(total.yaw_rate.max()) if len(stack) > 1 else 0.0)


def _layer_bound(total: TotalMap, unit: float) -> float:
    largest = float(total.yaw_rate.max())
    bound = 18.0 * unit * largest + _position_bound(total.speed, total.front_angle, total.yaw_rate, unit)
    if total.grip is not None:
        # The result is cap times share, so the relative error of the share adds to that of the result.
        grip = total.grip
        off = 9.0 * unit + _position_bound(grip.speed, grip.front_angle, grip.share, unit)
        bound += off / float(grip.share.min()) * largest
    return bound


def _position_bound(speed: FloatArray, front_angle: FloatArray, table: FloatArray, unit: float) -> float:
    """Return the effect of position errors, in the unit of a table (n, m)."""
    bound = 0.0
    for breakpoints, rise in (
        (speed, np.abs(np.diff(table, axis=0)).max(axis=1)),
        (front_angle, np.abs(np.diff(table, axis=1)).max(axis=0)),
    ):
        slope = rise / np.diff(breakpoints)
        padded = np.pad(slope, 1, mode="edge")
        steepest = np.maximum(np.maximum(padded[:-2], padded[2:]), slope)
        bound += 6.0 * unit * float((breakpoints[1:] * steepest).max())
    return bound
