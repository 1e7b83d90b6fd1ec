"""Error of a total map in its stored numbers against the continuous map: sampled in every cell, then refined at its peaks."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.ecu_map.lookup import Lookup
from codegen.ecu_map.placement_axes import Axes, Lattice, gain_of
from codegen.ecu_map.reference_surface import Pair, ReferenceSurface, above_zero
from codegen.ecu_map.storage import Real
from codegen.ecu_map.total import TotalMap

PLACES, ROUNDS, SIDE, CLOSER = 24, 3, 9, 0.25
"""Refinement at the peaks: starts for each sign, rounds, points along a side of the window, and its next relative width."""

YAW_RATE, REAR_ANGLE, REAR_YAW_RATE = range(3)
"""Error channels: rad/s, rad, and rad/s."""


@dataclass(frozen=True)
class MeasuredError:
    """Largest errors of yaw rate (rad/s) and rear angle (rad) after the cap, over the range of the map's own breakpoints and,
    with `_whole`, over the domain of the ECU. `rear_yaw_rate_whole` is the rear angle error times the passive
    yaw gain, in rad/s."""

    yaw_rate: float = 0.0
    yaw_rate_whole: float = 0.0
    rear_angle: float = 0.0
    rear_angle_whole: float = 0.0
    rear_yaw_rate_whole: float = 0.0

    def bounded(self, tables: int) -> float:
        """Return the largest error that a request bounds, in rad/s. The rear angle counts if it has a table."""
        return self.yaw_rate_whole if tables == 1 else max(self.yaw_rate_whole, self.rear_yaw_rate_whole)

    def __or__(self, other: MeasuredError) -> MeasuredError:
        """Return the larger value of each error."""
        return MeasuredError(*(max(getattr(self, key.name), getattr(other, key.name)) for key in fields(self)))


class ErrorEstimator:
    """Estimator of the error of total maps on the same axes against a surface, at each layer. The lookup
    computes in `real`. The rear angle is clipped to its range, as in the laws."""

    def __init__(self, surface: ReferenceSurface, axes: Axes, real: Real) -> None:
        self.surface, self.real = surface, real
        speed, front_angle = (axis.astype(real).astype(np.float64) for axis in Lattice.points(surface, axes))
        self._axes = (speed, front_angle)
        self._truth = [layer.truth(speed, front_angle) for layer in surface.layers]
        self._own = np.ix_(_within(speed, surface.own_speed), _within(front_angle, surface.own_front_angle))

    def on_lattice(self, total: TotalMap) -> MeasuredError:
        """Return the errors sampled in every cell."""
        found = MeasuredError()
        for errors in self._errors(Lookup.from_map(total, self.real)):
            own = [float(error[self._own].max()) for error in errors]
            whole = [float(error.max()) for error in errors]
            found |= MeasuredError(own[YAW_RATE], whole[YAW_RATE], own[REAR_ANGLE], whole[REAR_ANGLE], whole[REAR_YAW_RATE])
        return found

    def error(self, total: TotalMap) -> MeasuredError:
        """Return the largest errors, refined from the lattice to local maxima, because kinks of the surface cross cells."""
        lookup, found = Lookup.from_map(total, self.real), self.on_lattice(total)
        for index, errors in enumerate(self._errors(lookup)):
            for channel in (YAW_RATE, REAR_YAW_RATE):
                for place in _tops(errors[channel]):
                    found |= self._climb(lookup, index, channel, place)
        return found

    def _errors(self, lookup: Lookup) -> Iterator[list[FloatArray]]:
        for index, truth in enumerate(self._truth):
            yield self._differences(lookup, index, self._axes, truth)

    def _climb(self, lookup: Lookup, index: int, channel: int, start: tuple[int, int]) -> MeasuredError:
        """Return the largest error near a lattice point. Near a point in the map's own range, search only that range."""
        ends = (self.surface.own_speed, self.surface.own_front_angle)
        layer = self.surface.layers[index]
        own = all(_within(axis[k : k + 1], end)[0] for axis, k, end in zip(self._axes, start, ends, strict=True))
        windows = []
        for axis, k, end in zip(self._axes, start, ends, strict=True):
            low, high = axis[max(k - 1, 0)], axis[min(k + 1, axis.size - 1)]
            windows.append((max(low, end[0]), min(high, end[1])) if own else (low, high))
        top = 0.0
        for _ in range(ROUNDS):
            speed, front_angle = (np.linspace(low, high, SIDE) for low, high in windows)
            error = self._differences(lookup, index, (speed, front_angle), layer.truth(speed, front_angle))[channel]
            best = np.unravel_index(int(error.argmax()), error.shape)
            top = max(top, float(error.max()))
            windows = [
                _narrower(window, float(points[k]))
                for window, points, k in zip(windows, (speed, front_angle), best, strict=True)
            ]
        if channel == REAR_YAW_RATE:
            return MeasuredError(rear_yaw_rate_whole=top)
        return MeasuredError(yaw_rate=top if own else 0.0, yaw_rate_whole=top)

    def _differences(self, lookup: Lookup, index: int, axes: Axes, truth: Pair) -> list[FloatArray]:
        """Return the error of each channel, increased by the error of the layer's surfaces."""
        layer, speed = self.surface.layers[index], axes[0][:, np.newaxis]
        found = lookup.reference(speed, axes[1][np.newaxis, :], *lookup.layer_at(index))
        yaw_rate, rear_angle = (each.astype(np.float64) for each in found)
        largest = layer.total.steering.rear_angle_max
        turned = np.abs(np.clip(rear_angle, -largest, largest) - truth[1])
        by_turning = turned * gain_of(layer.total.steering, above_zero(speed))
        errors = (np.abs(yaw_rate - truth[0]), turned, by_turning)
        return [error + gap for error, gap in zip(errors, astuple(layer.gap), strict=True)]


def _narrower(window: tuple[float, float], centre: float) -> tuple[float, float]:
    half = 0.5 * CLOSER * (window[1] - window[0])
    return max(window[0], centre - half), min(window[1], centre + half)


def _within(axis: FloatArray, ends: tuple[float, float]) -> npt.NDArray[np.bool_]:
    slack = 1e-6 * ends[1]
    return (axis >= ends[0] - slack) & (axis <= ends[1] + slack)


def _tops(error: FloatArray) -> Iterator[tuple[int, int]]:
    """The largest errors of the rows and columns with the largest errors."""
    rows, columns = error.max(axis=1), error.max(axis=0)
    found = {(int(i), int(error[i].argmax())) for i in np.argsort(-rows, kind="stable")[:PLACES]}
    found |= {(int(error[:, j].argmax()), int(j)) for j in np.argsort(-columns, kind="stable")[:PLACES]}
    yield from sorted(found)
