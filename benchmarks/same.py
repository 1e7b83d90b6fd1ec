"""Compare two solutions of a map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from codegen.optimum.exact import Solution

NARROW = 1e-6
"""rad. Cells whose feasible interval is narrower are counted, not compared: there, rounding decides."""


@dataclass(frozen=True)
class Sameness:
    """Difference of two solutions: largest difference of the yaw rates in rad/s in cells feasible in both, and numbers of
    cells."""

    largest: float
    feasible: int
    otherwise: int
    narrow: int
    cells: int

    @classmethod
    def of(cls, ours: Solution, peer: Solution, stride: int) -> Self:
        """Compare a solution with one of every `stride`-th speed and front angle of it."""
        cells = (slice(None, None, stride), slice(None, None, stride))
        narrow = np.abs(ours.margin[cells]) < NARROW  # NaN where none was searched for: it is compared
        feasible = ours.feasible[cells]
        both = ~narrow & feasible & peer.feasible
        return cls(
            largest=float(np.abs(ours.yaw_rate[cells] - peer.yaw_rate)[both].max()),
            feasible=int(both.sum()),
            otherwise=int(np.sum(~narrow & (feasible != peer.feasible))),
            narrow=int(narrow.sum()),
            cells=narrow.size,
        )

    def within(self, yaw_rate: float) -> bool:
        """Return whether the same cells are feasible, with yaw rates no further apart in rad/s."""
        return self.otherwise == 0 and self.largest <= yaw_rate

    def __str__(self) -> str:
        return (
            f"yaw rates differ by at most {self.largest:.1e} rad/s in {self.feasible} feasible cells, "
            f"feasibility in {self.otherwise} of {self.cells}, {self.narrow} too narrow to compare"
        )
