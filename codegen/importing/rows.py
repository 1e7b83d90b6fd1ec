"""Account of the rows of a measurement: counts by group of channels and by channel.

The readers of all formats return these counts. A row has one stamp and one sample of each channel of its group; a table is one
group. The number of rows comes from the file (its head, or its lines), the other counts from what was read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from codegen.arrays import FloatArray

RESOLUTION_S = 1e-6
"""Difference in s from which a stamp goes back. Unix time in a float64 has steps of 0.24 us."""
NO_TIME, NO_VALUE, INVALID, TEXT, ARRAY = "no time", "no value", "marked as invalid", "a text", "an array"
"""Reasons why a row or a sample does not count."""
MISSING_CHANNEL = "not in the data of the file"
UNUSED_GROUP = "no channel of their group is used"


@dataclass(frozen=True)
class Group:
    """Rows of channels with common stamps.

    Attributes:
        name: name of the group; "" for a table, and if it has none.
        rows: number of rows in the file.
        skipped: reason -> number of rows that were not read, and the place of the first one.
        first_s, duration_s: first stamp and time from the smallest to the largest; None without a stamp.
        back, repeated: number of stamps that go back, and of those that repeat another one.
    """

    name: str
    rows: int
    skipped: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    first_s: float | None = None
    duration_s: float | None = None
    back: int = 0
    repeated: int = 0

    @property
    def read(self) -> int:
        """Number of rows that were read."""
        return self.rows - sum(count for count, _ in self.skipped.values())


@dataclass(frozen=True)
class Count:
    """Samples of a channel: name, unit, number of its group, number of samples with a number, and without one by reason."""

    channel: str
    unit: str
    group: int
    samples: int
    without: Mapping[str, int] = field(default_factory=dict)


def group_of(name: str, time: FloatArray, rows: int, place: Callable[[int], str] = lambda row: f"row {row + 1}") -> Group:
    """Return the counts of a group.

    Args:
        time: (n,) stamps that were read, s; NaN without one.
        rows: number of rows in the file.
        place: place of a row, from 0.
    """
    skipped: dict[str, tuple[int, str]] = {}
    if time.size < rows:
        skipped[MISSING_CHANNEL] = rows - time.size, place(time.size)
    bad = np.flatnonzero(~np.isfinite(time))
    if bad.size:
        skipped[NO_TIME] = int(bad.size), place(int(bad[0]))
    good = time[np.isfinite(time)]
    if not good.size:
        return Group(name, rows, skipped)
    back = int(np.count_nonzero(np.diff(good) < -RESOLUTION_S))
    repeated = int(np.count_nonzero(np.diff(np.sort(good)) == 0.0))
    return Group(name, rows, skipped, float(good[0]), float(np.ptp(good)), back, repeated)


def without(values: FloatArray, **others: int) -> dict[str, int]:
    """Return the samples without a number by reason: NaN in (n,) values, and others that are known."""
    reasons = {NO_VALUE: int(np.count_nonzero(np.isnan(values))), **others}
    return {reason: count for reason, count in reasons.items() if count}
