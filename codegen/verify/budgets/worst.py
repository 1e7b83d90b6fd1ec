"""The longest call of a function that can be found: drives first, then descendants of the longest calls among them.

What is found is a measured maximum, no proof.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.verify.budgets.counting import Rows
from codegen.verify.target.emulator import IntArray

PARENTS, COPIES, WINDOW = 12, 24, 3
"""From how many of the longest calls descendants are made, how many of each, and of how many calls: it and the ones before."""

EXCHANGED = np.array([0.03, 0.1, 0.25])
"""Share of the inputs that a descendant has from elsewhere."""

Figures = Mapping[str, IntArray]
"""Figures of each call by their names, arrays of one length; negative: not to be counted."""


@dataclass(frozen=True)
class Spread:
    """Of one figure over calls."""

    smallest: int
    mean: float
    largest: int

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {"min": self.smallest, "mean": round(self.mean, 1), "max": self.largest}


def spread_of(values: IntArray, usual: IntArray | None = None) -> Spread:
    """Of all values, the mean over those of usual calls; those below zero are not counted."""
    counted, typical = values[values >= 0], values if usual is None else usual
    return Spread(int(counted.min()), float(typical[typical >= 0].mean()), int(counted.max()))


class Search:
    """Calls of one function, and the longest of them.

    Args:
        count: makes the calls for some rows of inputs and tells their figures.
        judged: the figures whose largest values are sought, the first of them above all.
    """

    def __init__(self, count: Callable[[Rows], Figures], *judged: str) -> None:
        self._count, self._judged = count, judged
        self._rows: list[Rows] = []
        self._figures: list[Figures] = []

    def run(self, drives: Sequence[Rows]) -> None:
        """Make the calls of drives."""
        for rows in drives:
            self._add(rows)

    def improve(self, rounds: int, generator: np.random.Generator, moved: Callable[[Rows], Rows] | None = None) -> None:
        """So many times, make more calls from the longest ones, crossed with those of the drives that were run.

        Args:
            moved: puts inputs (n, fields) into other states of what is called.
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
        """How many were made."""
        return int(sum(map(len, self._rows)))

    def longest(self) -> Rows:
        """The longest calls with the ones before them, (PARENTS, WINDOW, fields)."""
        rows, each = np.concatenate(self._rows), PARENTS // len(self._judged)
        ends = np.concatenate([np.argsort(-self._all(name), kind="stable")[:each] for name in self._judged])
        return np.stack([rows[end - WINDOW + 1 : end + 1] for end in ends.clip(WINDOW - 1)])

    def largest(self, name: str) -> tuple[Rows, dict[str, int]]:
        """Inputs, (fields,), and all figures of the call with the largest one of a name."""
        call = int(self._all(name).argmax())
        return np.concatenate(self._rows)[call], {each: int(self._all(each)[call]) for each in self._figures[0]}

    def worst_input(self) -> Rows:
        """Of the longest call, (fields,)."""
        return self.largest(self._judged[0])[0]

    def spread(self, name: str, typical: int) -> Spread:
        """Of a figure over all calls, the mean over the first so many drives."""
        return spread_of(self._all(name), np.concatenate([figures[name] for figures in self._figures[:typical]]))

    def _all(self, name: str) -> IntArray:
        return np.concatenate([figures[name] for figures in self._figures])


def _descendants(parents: Rows, pool: Rows, generator: np.random.Generator) -> Rows:
    """Of short windows (n, length, fields), one after the other: some inputs are those of other calls."""
    children = np.repeat(parents, COPIES, axis=0)
    others = pool[generator.integers(len(pool), size=children.shape[:2])]
    share = generator.choice(EXCHANGED, (len(children), 1, 1))
    found: Rows = np.where(generator.random(children.shape) < share, others, children).reshape(-1, children.shape[-1])
    return found


def described(row: Rows, columns: Sequence[str]) -> str:
    """A row of inputs in words, such as "speed 14.4, front_angle nan"."""
    return ", ".join(f"{name} {float(value):.6g}" for name, value in zip(columns, row, strict=True))
