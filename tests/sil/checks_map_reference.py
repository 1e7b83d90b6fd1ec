"""Checks of the generated map with the optimum's rear angle, with and without a stack of frictions.

Each check takes the units of a build and raises AssertionError if the build fails it.
"""

import itertools
import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from codegen.ecu_map.extend import CapSteering, TotalMap
from codegen.ecu_map.lookup import cap_in_precision, error_bound
from codegen.ecu_map.total import GripTable
from tests.sil.checks_lookup import finite_points
from tests.sil.units import Units

FloatArray = np.ndarray[Any, np.dtype[np.float64]]
COLUMNS = ("yaw rate", "rear angle", "lateral acceleration", "yaw rate alone")


def frictions(units: Units) -> list[Any]:
    """Return each layer's friction, its neighbours and values between, below the first, beyond the last, and invalid ones."""
    real = units.real
    own = [real(layer.friction) for layer in units.total.stack]
    near = [np.nextafter(value, real(side)) for value in own for side in (0.0, 2.0)]
    between = [real(0.5) * (left + right) for left, right in zip([real(0.0), *own[:-1]], own, strict=True)]
    special = [real(value) for value in (math.nan, -math.inf, -0.5, -0.0, 0.0, 1e-3, 1e-30, 1.4, math.inf)]
    return [*special, *own, *near, *between, np.finfo(real).smallest_subnormal]


def road_lateral_acceleration(total: TotalMap, real: Any, friction: Any) -> Any:
    """Return the map's largest lateral acceleration on a road, m/s^2, in the build's numbers.

    It is interpolated between the layers' caps, and proportional to friction below the lowest layer.
    """
    stack = total.stack
    caps = [cap_in_precision(layer.lateral_acceleration_cap, real) for layer in stack]
    own = [real(layer.friction) for layer in stack]
    known = own[-1] if not friction < own[-1] else friction if friction > 0.0 else real(0.0)
    if known < own[0]:
        return cap_in_precision(stack[0].lateral_acceleration_cap / stack[0].friction, real) * known
    if len(own) == 1:
        return caps[0]
    layer = max(k for k in range(len(own) - 1) if known >= own[k])
    share = (known - own[layer]) / (own[layer + 1] - own[layer])
    return caps[layer] + share * (caps[layer + 1] - caps[layer])


def _bilinear(axes: TotalMap | GripTable, table: FloatArray, speed: FloatArray, angle: FloatArray) -> FloatArray:
    v, a = np.clip(speed, 0.0, axes.speed[-1]), np.clip(np.abs(angle), 0.0, axes.front_angle[-1])
    i = np.clip(np.searchsorted(axes.speed, v, side="right") - 1, 0, axes.speed.size - 2)
    j = np.clip(np.searchsorted(axes.front_angle, a, side="right") - 1, 0, axes.front_angle.size - 2)
    u = (v - axes.speed[i]) / (axes.speed[i + 1] - axes.speed[i])
    w = (a - axes.front_angle[j]) / (axes.front_angle[j + 1] - axes.front_angle[j])
    slower, faster = ((1.0 - w) * table[i + k, j] + w * table[i + k, j + 1] for k in (0, 1))
    result: FloatArray = (1.0 - u) * slower + u * faster
    return result


def reference_by_rule(
    total: TotalMap, speed: FloatArray, angle: FloatArray, friction: float
) -> tuple[FloatArray, FloatArray, Any]:
    """Return yaw rate, rear angle, and where the road's cap acts, for speeds above zero and front angles to the left.

    Values are interpolated between the two layers around the friction. Where the cap reduces the yaw rate, the rear angle is
    the one at which the linear car turns by that much less, limited where its sideslip reaches the bound (but not below the
    table's value).
    """
    stack = total.stack
    own = np.array([layer.friction for layer in stack])
    known = min(total.friction if math.isnan(friction) else friction, total.friction)

    def over_friction(values: list[Any]) -> Any:
        if len(stack) == 1:
            return values[0]
        at = float(np.clip(known, own[0], own[-1]))
        k = min(int(np.searchsorted(own, at, side="right")) - 1, own.size - 2)
        share = (at - own[k]) / (own[k + 1] - own[k])
        return values[k] * (1.0 - share) + values[k + 1] * share

    cap = over_friction([layer.lateral_acceleration_cap for layer in stack]) * min(1.0, known / own[0])
    if total.grip is not None:
        grips = [layer.grip for layer in stack if layer.grip is not None]
        cap = cap * np.clip(over_friction([_bilinear(grip, grip.share, speed, angle) for grip in grips]), 0.0, 1.0)
    asked = over_friction([_bilinear(total, layer.yaw_rate, speed, angle) for layer in stack])
    rear = over_friction([_bilinear(total, layer.rear_angle, speed, angle) for layer in stack])
    yaw_rate = np.minimum(asked, cap / speed)
    capped = asked > yaw_rate
    car, v = total.steering, np.minimum(speed, total.speed[-1])
    for name in ("understeer_coefficient", "rear_slip_per_lateral_acceleration"):  # for the tyres on that road
        car = replace(car, **{name: over_friction([getattr(layer.steering, name) for layer in stack])})
    less_turn = rear + (asked - yaw_rate) * inverse_gain(car, v)
    sideslip_bound = car.sideslip_max - yaw_rate * (car.rear_arm / v - car.rear_slip_per_lateral_acceleration * v)
    steered = np.maximum(np.minimum(np.minimum(less_turn, sideslip_bound), car.rear_angle_max), rear)
    return yaw_rate, np.where(capped, steered, rear), capped


def inverse_gain(car: CapSteering, speed: Any) -> Any:
    """Return the linear car's steering angle per yaw rate, s."""
    return car.wheelbase / speed + car.understeer_coefficient * speed


def rounding(units: Units, speed: FloatArray, angle: FloatArray, friction: float) -> FloatArray:
    """Return the bound on the rear angle's rounding error, rad.

    It combines the rule's variation for inputs 6 u away (see `lookup.error_bound`) with the yaw rate's own rounding, at most
    ten units, converted to steering by the linear car.
    """
    unit = 0.5 * units.eps
    _, rear_angle, capped = reference_by_rule(units.total, speed, angle, friction)
    moved = np.zeros(speed.shape)
    for corner in itertools.product((1.0 - 6.0 * unit, 1.0 + 6.0 * unit), repeat=3):
        speed_share, angle_share, friction_share = corner
        other = reference_by_rule(units.total, speed * speed_share, angle * angle_share, friction * friction_share)[1]
        moved = np.maximum(moved, np.abs(other - rear_angle))
    tables = max(float(np.abs(layer.rear_angle).max()) for layer in units.total.stack)
    largest = max(float(layer.yaw_rate.max()) for layer in units.total.stack)
    steering = 10.0 * unit * largest * inverse_gain(units.total.steering, np.maximum(speed, 0.1))
    result: FloatArray = moved + 18.0 * unit * tables + np.where(capped, steering, 0.0)
    return result


def check_reference_rule(units: Units) -> None:
    """Check that an independent formulation of the rule agrees inside the table and where the cap acts."""
    speed, angle = finite_points(units, 4000)
    forward = (speed > 0.1) & (angle > 0.0)
    step = max(1, int(forward.sum()) // 8000)
    speed, angle = speed[forward][::step], angle[forward][::step]
    wide = speed.astype(np.float64), angle.astype(np.float64)
    acted = 0
    for friction in (math.nan, *(0.5 * (a.friction + b.friction) for a, b in pairwise(units.total.stack)), 0.35):
        got = units.map_reference(speed, angle, friction).astype(np.float64)
        road = float(units.real(friction))
        yaw_rate, rear_angle, capped = reference_by_rule(units.total, *wide, road)
        assert np.abs(got[0] - yaw_rate).max() <= error_bound(units.total, units.real)
        assert (np.abs(got[1] - rear_angle) <= rounding(units, *wide, road)).all()
        acted += int((capped & (np.abs(rear_angle) < units.total.steering.rear_angle_max)).sum())
    assert acted > 20, "the linear car's steering has an effect"
