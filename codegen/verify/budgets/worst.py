"""Search for the longest call of a function: drives first, then variants of the longest calls among them.

What is found is a measured maximum, no proof.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import IntArray
from codegen.verify.budgets.counting import Rows

PARENTS, COPIES, WINDOW = 12, 24, 3
"""Longest calls that are varied, variants of each, and calls in a window (the call and those before it)."""

EXCHANGED = np.array([0.03, 0.1, 0.25])
"""Share of the inputs that a descendant has from elsewhere."""

Figures = Mapping[str, IntArray]
"""Figures of each call by their names, arrays of one length; negative: not to be counted."""


@dataclass(frozen=True)
class Spread:
    """Smallest, mean and largest value of a figure."""

    smallest: int
    mean: float
    largest: int

    def to_dict(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"min": self.smallest, "mean": round(self.mean, 1), "max": self.largest}


def spread_of(values: IntArray, usual: IntArray | None = None) -> Spread:
    """Return the spread of all values and the mean of usual calls; negative values are not counted."""
    counted, typical = values[values >= 0], values if usual is None else usual
    return Spread(int(counted.min()), float(typical[typical >= 0].mean()), int(counted.max()))


class Search:
    """Search for the longest call of a function.

    Args:
        count: calls the function for rows of inputs and returns the figures.
        names: figures to maximise, the most important first.
    """

    def __init__(self, count: Callable[[Rows], Figures], *names: str) -> None:
        self._count, self._names = count, names
        self._rows: list[Rows] = []
        self._figures: list[Figures] = []

    def run(self, drives: Sequence[Rows]) -> None:
        """Make the calls of drives."""
        for rows in drives:
            self._add(rows)

    def improve(self, rounds: int, generator: np.random.Generator, moved: Callable[[Rows], Rows] | None = None) -> None:
        """Repeat calls near the longest ones, crossed with those of the drives.

        Args:
            moved: applies inputs (n, fields) in other states of the function.
        """
        pool = np.concatenate(self._rows)
        for _ in range(rounds):
            self._add(_descendants(self.longest(), pool, generator))
            if moved is not None:
                self._add(moved(self.longest()[:, -1]))

    def _add(self, rows: Rows) -> None:
        self._rows.append(rows)
        self._figures.append(self._count(rows))

    @property
    def calls(self) -> int:
        """Number of calls."""
        return int(sum(map(len, self._rows)))

    def longest(self) -> Rows:
        """Return the longest calls with those before them, (PARENTS, WINDOW, fields)."""
        rows, each = np.concatenate(self._rows), PARENTS // len(self._names)
        ends = np.concatenate([np.argsort(-self._all(name), kind="stable")[:each] for name in self._names])
        return np.stack([rows[end - WINDOW + 1 : end + 1] for end in ends.clip(WINDOW - 1)])

    def largest(self, name: str) -> tuple[Rows, dict[str, int]]:
        """Return inputs (fields,) and all figures of the call with the largest value of a figure."""
        call = int(self._all(name).argmax())
        return np.concatenate(self._rows)[call], {each: int(self._all(each)[call]) for each in self._figures[0]}

    def worst_input(self) -> Rows:
        """Return the inputs of the longest call, (fields,)."""
        return self.largest(self._names[0])[0]

    def spread(self, name: str, typical: int) -> Spread:
        """Return the spread of a figure over all calls, with the mean over the first drives."""
        return spread_of(self._all(name), np.concatenate([figures[name] for figures in self._figures[:typical]]))

    def _all(self, name: str) -> IntArray:
        return np.concatenate([figures[name] for figures in self._figures])


def _descendants(parents: Rows, pool: Rows, generator: np.random.Generator) -> Rows:
    """Cross windows (n, length, fields): some inputs are those of other calls."""
    children = np.repeat(parents, COPIES, axis=0)
    others = pool[generator.integers(len(pool), size=children.shape[:2])]
    share = generator.choice(EXCHANGED, (len(children), 1, 1))
    found: Rows = np.where(generator.random(children.shape) < share, others, children).reshape(-1, children.shape[-1])
    return found


def described(row: Rows, columns: Sequence[str]) -> str:
    """Format a row of inputs, such as "speed 14.4, front_angle nan"."""
    return ", ".join(f"{name} {float(value):.6g}" for name, value in zip(columns, row, strict=True))
