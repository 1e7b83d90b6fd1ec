"""Resampling of a signal to the grid of a drive, without a delay of its own.

A measured quantity is interpolated linearly between its own time stamps: that has no phase at any frequency, whereas holding
the last sample delays the signal by half of its sampling time. The difference of delays between two signals is what an
identification measures. A command is held, because the actuator holds it from one frame to the next.

A signal that is sampled faster than the grid is filtered first, so that its higher frequencies do not appear as lower ones. The
filter is symmetric about each sample, thus without phase.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import firwin, upfirdn

from codegen.arrays import FloatArray
from codegen.identify.conditioning import Conditioned

FILTER_STEPS = 5
"""Half length of the filter in steps of the grid. So many steps beside a gap and at both ends have no value."""
KAISER_BETA = 5.0
"""Window of the filter: at least 53 dB above half of the grid's rate (J. F. Kaiser, 1974). With this length the transition is
0.31 of that rate wide, half of it above the cutoff."""
CUTOFF = 0.335
"""Cutoff as a fraction of the grid's rate."""
TIME_RESOLUTION_S = 2e-6
"""Difference below which two times of a log are equal: ASC and candump have 1 us, a float64 of Unix time 0.24 us."""
FACTOR_MAX = 50
"""Largest number of filtered samples in a step: of an even faster signal every so many samples suffice."""
FASTER = 1.25
"""Ratio of the rates up to which a signal is not filtered."""


def resample(signal: Conditioned, grid: FloatArray, *, is_held: bool) -> FloatArray:
    """Return the values (n,) of a signal on a uniform grid (n,); NaN outside of its samples, in gaps and beside NaN.

    Args:
        signal: samples at their own times.
        grid: s, on the same clock.
        is_held: hold each sample until the next one; else interpolate.
    """
    step = float(grid[1] - grid[0])
    factor = min(math.ceil(step / signal.period - (FASTER - 1.0)), FACTOR_MAX)
    if factor < 2:
        return _at(signal, grid, is_held)
    fine = grid[0] + step / factor * np.arange(factor * (grid.size - 1) + 1)
    half = FILTER_STEPS * factor
    taps = firwin(2 * half + 1, 2.0 * CUTOFF / factor, window=("kaiser", KAISER_BETA))
    beyond = np.full(half, np.nan)
    padded = np.concatenate((beyond, _at(signal, fine, is_held), beyond))
    # Output k of the convolution has the filter's middle at input k * factor - half, and the first `half` inputs are padding.
    filtered: FloatArray = upfirdn(taps, padded, down=factor)[2 * FILTER_STEPS : 2 * FILTER_STEPS + grid.size]
    return filtered


def _at(signal: Conditioned, times: FloatArray, is_held: bool) -> FloatArray:
    """Return the values at times (n,), interpolated or held within a pause that is no gap; NaN elsewhere."""
    time, values = signal.time, signal.values
    inside = (times >= time[0] - TIME_RESOLUTION_S) & (times <= time[-1] + TIME_RESOLUTION_S)
    left = np.clip(np.searchsorted(time, times, side="right") - 1, 0, time.size - 2)
    before, after = time[left], time[left + 1]
    share = np.clip((times - before) / (after - before), 0.0, 1.0)
    share[times - before <= TIME_RESOLUTION_S] = 0.0
    share[after - times <= TIME_RESOLUTION_S] = 1.0
    between = values[left] if is_held else values[left] + share * (values[left + 1] - values[left])
    found = np.where(share == 0.0, values[left], np.where(share == 1.0, values[left + 1], between))
    has_value = (share == 0.0) | (share == 1.0) | (after - before <= signal.pause_max)
    return np.where(inside & has_value, found, np.nan)
