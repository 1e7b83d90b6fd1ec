"""Arrays of steady turns: functions to join and split them, and one bracketed root for each of many functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IndexArray

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
