"""Time stamps: those that cannot be used, and restarts of the clock.

A stamp is unusable if it is not finite, lies far from both of its neighbours, or does not increase. A jump back by more than
RESTART_S is a restart of the logger's clock. Times before and after a restart have no known relation, so only the longest block
is used.
"""

from __future__ import annotations

import numpy as np

from codegen.arrays import BoolArray, FloatArray, IndexArray

RESTART_S = 1.0
"""Smallest jump back, in s, that counts as a restart. Frames of several controllers may be logged out of order by some ms."""


def is_isolated(time: FloatArray) -> BoolArray:
    """Return which stamps (n,) are not finite, or off by more than RESTART_S between two neighbours that fit each other."""
    bad = ~np.isfinite(time)
    good = np.flatnonzero(~bad)
    before, here, after = (
        (time[good[start : good.size - 2 + start]] for start in range(3)) if good.size > 2 else (time[:0],) * 3
    )
    fits = np.abs(after - before) <= RESTART_S
    bad[good[1:-1][fits & (np.minimum(np.abs(here - before), np.abs(here - after)) > RESTART_S)]] = True
    return bad


def blocks(time: FloatArray) -> list[IndexArray]:
    """Return the indices of the stamps (n,) in each block between restarts, without isolated stamps."""
    good = np.flatnonzero(~is_isolated(time))
    if not good.size:
        return []
    return np.split(good, np.flatnonzero(np.diff(time[good]) < -RESTART_S) + 1)


def increasing(time: FloatArray) -> BoolArray:
    """Return which stamps (n,) are above all earlier ones."""
    above = np.ones(time.size, dtype=bool)
    if time.size:
        above[1:] = time[1:] > np.maximum.accumulate(time)[:-1]
    return above
