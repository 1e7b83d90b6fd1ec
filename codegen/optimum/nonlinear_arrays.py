"""Arrays of steady turns, and functions to join and split them."""

from __future__ import annotations

from collections.abc import Sequence
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
