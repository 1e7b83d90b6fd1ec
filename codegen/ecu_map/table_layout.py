"""What tables are placed for: the numbers that they are to hold, and what the lookup makes of those.

A bound on an error is one in rad/s. The error of a rear angle counts as the yaw rate that the linear car makes of it without
being steered otherwise: the angle times the passive yaw gain G. A law that looks the rear angle up steers by it, or lets its
reference model steer by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.ecu_map.reference_surface import SurfaceLayer, above_zero, interpolated
from codegen.ecu_map.total import CapSteering, GripTable

FloatArray = npt.NDArray[np.float64]
Stacked = Callable[[FloatArray, FloatArray], FloatArray]
"""Speeds (n,) in m/s and front angles (m,) in rad -> (k, n, m)."""
Outcome = Callable[[FloatArray, FloatArray], FloatArray]
"""Numbers of tables (k, ...) and those beside them (f, ...) -> rad/s (d, ...)."""


@dataclass(frozen=True)
class TableLayout:
    """Of one friction.

    Attributes:
        values: of k tables. beside: f numbers that the outcome depends on besides.
        outcome: d yaw rates from both. truth: what they are to be, rad/s.
    """

    values: Stacked
    beside: Stacked
    outcome: Outcome
    truth: Stacked


def yaw_rate_layout(layer: SurfaceLayer, grip: GripTable | None) -> TableLayout:
    """Of the table of the yaw rate, beside a table of the share of the cap (None: no such table)."""
    stored = _beside(layer, grip)
    return TableLayout(
        values=lambda v, angle: layer.surface(v, angle)[0][np.newaxis],
        beside=lambda v, angle: stored.limit(v, angle)[np.newaxis],
        outcome=np.minimum,
        truth=lambda v, angle: layer.truth(v, angle)[0][np.newaxis],
    )


def reference_layout(layer: SurfaceLayer, grip: GripTable | None) -> TableLayout:
    """Of both tables, that of the yaw rate and that of the rear angle, likewise."""
    stored, car = _beside(layer, grip), layer.total.steering
    largest = car.rear_angle_max

    def beside(v: FloatArray, angle: FloatArray) -> FloatArray:
        limit = stored.limit(v, angle)
        speed = above_zero(v)[:, np.newaxis]
        in_phase = car.sideslip_max - limit * (car.rear_arm / speed - car.rear_slip_per_lateral_acceleration * speed)
        needed = np.broadcast_to(1.0 / gain_of(car, speed), limit.shape)
        return np.stack([limit, needed, np.minimum(in_phase, largest)])

    def outcome(values: FloatArray, numbers: FloatArray) -> FloatArray:
        (yaw_rate, rear_angle), (limit, needed, most) = values, numbers
        allowed = np.minimum(yaw_rate, limit)
        # `lookup.capped_rear_angle`, for all at once, within the range that the laws hold it in.
        turned = np.minimum((yaw_rate - allowed) * needed, np.maximum(most - rear_angle, 0.0))
        return np.stack([allowed, np.clip(rear_angle + turned, -largest, largest) / needed])

    def truth(v: FloatArray, angle: FloatArray) -> FloatArray:
        yaw_rate, rear_angle = layer.truth(v, angle)
        return np.stack([yaw_rate, rear_angle * gain_of(car, above_zero(v)[:, np.newaxis])])

    return TableLayout(lambda v, angle: np.stack(layer.surface(v, angle)), beside, outcome, truth)


def grip_layout(layer: SurfaceLayer) -> TableLayout:
    """Of the table of the share of the cap, beside the exact surface of the yaw rate."""

    def scale(v: FloatArray) -> FloatArray:
        return (layer.cap / above_zero(v))[:, np.newaxis]

    return TableLayout(
        values=lambda v, angle: (layer.limit(v, angle) / scale(v))[np.newaxis],
        beside=lambda v, angle: np.stack(np.broadcast_arrays(scale(v), layer.surface(v, angle)[0])),
        outcome=lambda share, numbers: np.minimum(share * numbers[:1], numbers[1:]),
        truth=lambda v, angle: layer.truth(v, angle)[0][np.newaxis],
    )


def gain_of(car: CapSteering, speed: FloatArray) -> FloatArray:
    """G in 1/s, the passive car's yaw rate for each rad, at speeds (m/s, any shape) above zero."""
    result: FloatArray = 1.0 / (car.wheelbase / speed + car.understeer_coefficient * speed)
    return result


def _beside(layer: SurfaceLayer, grip: GripTable | None) -> SurfaceLayer:
    """The same with the share of the cap that a table holds."""
    return layer if grip is None else layer.with_share(interpolated(grip.speed, grip.front_angle, grip.share))
