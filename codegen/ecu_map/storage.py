"""The part of a map that an ECU stores: the axes of the lookup and the numbers of the tables.

An axis is evenly spaced, perhaps with one wider cell at either end, or uneven. The even kind finds its cell with one
multiplication; the uneven kind with a binary search of fixed length. Tables hold real numbers, or 16-bit integers with one
scale for each table, value = scale * raw.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray

EVENNESS = 1e-9
"""Largest deviation of an even breakpoint from its even position, as a fraction of a step: far below what single
precision resolves over 2000 breakpoints."""


@dataclass(frozen=True)
class Axis:
    """Breakpoints (n,), strictly increasing from zero, and their spacing.

    Attributes:
        breakpoints: SI units.
        even: whether the breakpoints `core_start` to `core_end` (indices, inclusive) are evenly spaced and cover all cells
            but at most one at either end.
        core_start: 0, or 1 with a wider (or narrower) first cell.
        core_end: n - 1, or n - 2 with a wider last cell.
    """

    breakpoints: FloatArray
    even: bool
    core_start: int
    core_end: int

    @classmethod
    def from_breakpoints(cls, breakpoints: FloatArray) -> Axis:
        """Classify breakpoints as even or uneven, with as few end cells as possible."""
        n = breakpoints.size
        for start, end in ((0, n - 1), (1, n - 1), (0, n - 2), (1, n - 2)):
            core = breakpoints[start : end + 1]
            if core.size < 2:
                continue
            step = (core[-1] - core[0]) / (core.size - 1)
            if np.all(np.abs(core - core[0] - step * np.arange(core.size)) <= EVENNESS * step):
                return cls(breakpoints, True, start, end)
        return cls(breakpoints, False, 0, n - 1)

    @property
    def size(self) -> int:
        """Number of breakpoints."""
        return int(self.breakpoints.size)

    @property
    def has_first_cell(self) -> bool:
        """Whether a cell of another width lies before the even core."""
        return self.even and self.core_start == 1

    @property
    def has_last_cell(self) -> bool:
        """Whether a cell of another width lies after the even core."""
        return self.even and self.core_end == self.size - 2

    @property
    def step(self) -> float:
        """Width of a core cell (even axes)."""
        span = self.breakpoints[self.core_end] - self.breakpoints[self.core_start]
        return float(span / (self.core_end - self.core_start))

    @property
    def search_steps(self) -> tuple[int, ...]:
        """Strides of the binary search over an uneven axis, largest first: powers of two below the number of cells."""
        cells = self.size - 1
        return tuple(1 << k for k in reversed(range((cells - 1).bit_length())))


Real = type[np.float32] | type[np.float64]
Storage = Literal["float", "int16"]

RAW_MAX = 32767
"""Largest raw number; -32768 is unused, so that every value has its negative."""


@dataclass(frozen=True)
class Scales:
    """Scales of int16 tables: rad/s and rad for each raw unit, in the target's precision."""

    yaw_rate: float
    rear_angle: float

    @classmethod
    def of(cls, yaw_rate_max: float, rear_angle_max: float, real: Real) -> Scales:
        """Return the finest scales for the largest magnitudes, rad/s and rad."""
        return cls(scale_of(yaw_rate_max, real), scale_of(rear_angle_max, real))


def scale_of(largest: float, real: Real) -> float:
    """Return the finest scale with which a raw number reaches `largest`, in the target's precision."""
    scale = real((largest or 1.0) / RAW_MAX)
    while float(scale) * RAW_MAX < largest:
        scale = np.nextafter(scale, real(np.inf))
    return float(scale)


def raw_of(table: FloatArray, scale: float) -> npt.NDArray[np.int16]:
    """Return the nearest raw numbers of a table of any shape."""
    raw: npt.NDArray[np.int16] = np.clip(np.rint(table / scale), -RAW_MAX, RAW_MAX).astype(np.int16)
    return raw


def values_of(raw: npt.NDArray[Any], scale: float) -> FloatArray:
    """Return the values of raw numbers. In single precision the products are exact here and rounded once, there as in the C."""
    return scale * raw.astype(np.float64)


def table_bytes(speeds: int, front_angles: int, tables: int, layers: int, storage: Storage, real: Real) -> int:
    """Return the bytes of the tables with their axes, scales and, for a stack, frictions."""
    number = np.dtype(real).itemsize
    frictions = layers if layers > 1 else 0
    cells, scales = tables * layers * speeds * front_angles, tables if storage == "int16" else 0
    return cells * (2 if storage == "int16" else number) + number * (speeds + front_angles + frictions + scales)
