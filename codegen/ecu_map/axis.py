"""A lookup axis as the generated C sees it: evenly spaced, perhaps with one wider cell at either end, or uneven.

The even kind finds its cell with one multiplication; the uneven kind with a binary search of fixed length.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
