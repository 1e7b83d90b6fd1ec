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

TRUNCATION = 0.2
HALVINGS_MORE = 1


def shrink(
    function: Function, first: FloatArray, second: FloatArray, at_first: FloatArray, at_second: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Brackets (k,) shrunk around a root: the end with the sign of `at_first`, and the root by the secant in what is left.

    The ITP method (I. F. D. Oliveira, R. H. C. Takahashi, ACM Trans. Math. Softw. 47(1), 2020): as fast as the secant on a
    smooth function, and never more than one step behind bisection.

    Args:
        tolerance: how wide a bracket may stay, as a share of what it was.
    """
    start, width = first.copy(), second - first
    low, high = np.zeros_like(first), np.ones_like(first)  # positions inside the brackets
    sign = np.where(at_first < 0.0, -1.0, 1.0)
    value_low, value_high = np.abs(at_first), -np.abs(at_second)
    halvings = int(np.ceil(np.log2(1.0 / tolerance))) + HALVINGS_MORE
    for count in range(halvings + 1):
        left = np.flatnonzero((high - low > tolerance) & (width != 0.0))
        if not left.size:
            break
        a, b = low[left], high[left]
        middle, reach = 0.5 * (a + b), 0.5 * tolerance * 2.0 ** (halvings - count) - 0.5 * (b - a)
        secant = _secant(a, b, value_low[left], value_high[left])
        towards = np.sign(middle - secant)
        shift = TRUNCATION * (b - a) ** 2
        tried = np.where(shift <= np.abs(middle - secant), secant + towards * shift, middle)
        tried = np.where(np.abs(tried - middle) <= reach, tried, middle - towards * reach)
        tried = np.clip(tried, a, b)
        value = sign[left] * function(left, start[left] + tried * width[left])
        positive = value > 0.0
        low[left], high[left] = np.where(positive, tried, a), np.where(positive, b, tried)
        value_low[left] = np.where(positive, value, value_low[left])
        value_high[left] = np.where(positive, value_high[left], value)
    return start + low * width, start + _secant(low, high, value_low, value_high) * width


def _secant(low: FloatArray, high: FloatArray, value_low: FloatArray, value_high: FloatArray) -> FloatArray:
    """Return the zero of the line through both ends; the middle if both ends are zero."""
    drop = value_low - value_high
    share = np.where(drop > 0.0, value_low / np.where(drop > 0.0, drop, 1.0), 0.5)
    return low + np.clip(share, 0.0, 1.0) * (high - low)
