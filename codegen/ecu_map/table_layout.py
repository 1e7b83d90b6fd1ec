"""Layouts for the placement of breakpoints: the numbers that tables hold, and the yaw rates that the lookup computes from them.

A bound on an error is one in rad/s. The error of a rear angle counts as the yaw rate that the linear car makes of it without
being steered otherwise: the angle times the passive yaw gain G. A law that looks the rear angle up steers by it, or lets its
reference model steer by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from codegen.arrays import FloatArray
from codegen.ecu_map.reference_surface import SurfaceLayer, above_zero, interpolated
from codegen.ecu_map.total import CapSteering, GripTable

Stacked = Callable[[FloatArray, FloatArray], FloatArray]
"""Speeds (n,) in m/s and front angles (m,) in rad -> (k, n, m)."""
Outcome = Callable[[FloatArray, FloatArray], FloatArray]
"""Numbers of tables (k, ...) and accompanying numbers (f, ...) -> rad/s (d, ...)."""


@dataclass(frozen=True)
class TableLayout:
    """Layout of the tables of one friction.

    Attributes:
        values: numbers of k tables. beside: f accompanying numbers that the outcome also depends on.
        outcome: d yaw rates from both, rad/s. truth: their exact values, rad/s.
    """

    values: Stacked
    beside: Stacked
    outcome: Outcome
    truth: Stacked


def yaw_rate_layout(layer: SurfaceLayer, grip: GripTable | None) -> TableLayout:
    """Return the layout of the yaw rate table, with a grip table (None: no such table)."""
    stored = _beside(layer, grip)
    return TableLayout(
        values=lambda v, angle: layer.surface(v, angle)[0][np.newaxis],
        beside=lambda v, angle: stored.limit(v, angle)[np.newaxis],
        outcome=np.minimum,
        truth=lambda v, angle: layer.truth(v, angle)[0][np.newaxis],
    )


def reference_layout(layer: SurfaceLayer, grip: GripTable | None) -> TableLayout:
    """Return the layout of the tables of yaw rate and rear angle, with a grip table or None."""
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
        # `lookup.capped_rear_angle`, vectorised, within the range to which the laws clip it.
        turned = np.minimum((yaw_rate - allowed) * needed, np.maximum(most - rear_angle, 0.0))
        return np.stack([allowed, np.clip(rear_angle + turned, -largest, largest) / needed])

    def truth(v: FloatArray, angle: FloatArray) -> FloatArray:
        yaw_rate, rear_angle = layer.truth(v, angle)
        return np.stack([yaw_rate, rear_angle * gain_of(car, above_zero(v)[:, np.newaxis])])

    return TableLayout(lambda v, angle: np.stack(layer.surface(v, angle)), beside, outcome, truth)


def grip_layout(layer: SurfaceLayer) -> TableLayout:
    """Return the layout of the grip table, with the exact surface of the yaw rate."""

    def scale(v: FloatArray) -> FloatArray:
        return (layer.cap / above_zero(v))[:, np.newaxis]

    return TableLayout(
        values=lambda v, angle: (layer.limit(v, angle) / scale(v))[np.newaxis],
        beside=lambda v, angle: np.stack(np.broadcast_arrays(scale(v), layer.surface(v, angle)[0])),
        outcome=lambda share, numbers: np.minimum(share * numbers[:1], numbers[1:]),
        truth=lambda v, angle: layer.truth(v, angle)[0][np.newaxis],
    )


def gain_of(car: CapSteering, speed: FloatArray) -> FloatArray:
    """Return the passive yaw gain G in 1/s at speeds (m/s, any shape) above zero."""
    result: FloatArray = 1.0 / (car.wheelbase / speed + car.understeer_coefficient * speed)
    return result


def _beside(layer: SurfaceLayer, grip: GripTable | None) -> SurfaceLayer:
    """Return the layer with the share of the cap that a table holds."""
    return layer if grip is None else layer.with_share(interpolated(grip.speed, grip.front_angle, grip.share))
