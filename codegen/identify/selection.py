"""Choice of drives for a measurement programme.

The criterion is Bayesian D_s-optimality (A. C. Atkinson, A. N. Donev, R. D. Tobias, Optimum Experimental Designs, with SAS,
chapters 10 and 18): the determinant of the covariance of the car's own quantities, those with a key in ars.toml, is least.
The errors of the sensors only count as far as they blur these. Unlike the trace of the covariance, the determinant does not
depend on the scale of the quantities, and half the uncertainty of any quantity counts alike. The trace is dominated
by the quantities that no drive within the limits determines.
"""

from __future__ import annotations

import numpy as np

from codegen.arrays import BoolArray, FloatArray

EXCHANGES_MAX = 100
GAIN_MIN = 1e-6
"""Least improvement of the criterion by an exchange."""
TIME_TOLERANCE_S = 1e-9


def criterion(information: FloatArray, of_interest: BoolArray) -> FloatArray:
    """Return the information gain of drives in nats: half the logarithm of the ratio of the determinants.

    Args:
        information: (..., k, k) of drives, in units of the prior.
        of_interest: (k,) whether a quantity counts.
    """
    known = np.eye(len(of_interest)) + information
    others = np.flatnonzero(~of_interest)
    whole = np.linalg.slogdet(known)[1]
    result: FloatArray = 0.5 * (whole - np.linalg.slogdet(known[..., others[:, None], others])[1])
    return result


def select(each: FloatArray, durations: FloatArray, of_interest: BoolArray, duration_max: float) -> list[int]:
    """Return the drives of a programme, in increasing order; a drive may be repeated.

    The drive that gains most in its time is added until none fits. Then drives are exchanged while that helps
    (V. V. Fedorov, Theory of Optimal Experiments, 1972). Drives are added again in the time that an exchange leaves.

    Args:
        each: (drives, k, k) information in units of the prior. durations: (drives,) s.
        of_interest: (k,) whether a quantity counts.
        duration_max: s, of the programme.
    """
    chosen = _filled([], each, durations, of_interest, duration_max)
    for _ in range(EXCHANGES_MAX):
        better = _exchanged(chosen, each, durations, of_interest, duration_max)
        if better is None:
            break
        chosen = _filled(better, each, durations, of_interest, duration_max)
    return sorted(chosen)


def _filled(
    chosen: list[int], each: FloatArray, durations: FloatArray, of_interest: BoolArray, duration_max: float
) -> list[int]:
    """Return the drives, with others in the time that is left."""
    chosen = list(chosen)
    while True:
        left = duration_max - durations[chosen].sum() + TIME_TOLERANCE_S
        fitting = np.flatnonzero(durations <= left)
        if not fitting.size:
            return chosen
        total = each[chosen].sum(axis=0)
        gains = (criterion(total + each[fitting], of_interest) - criterion(total, of_interest)) / durations[fitting]
        chosen.append(int(fitting[np.argmax(gains)]))


def _exchanged(
    chosen: list[int], each: FloatArray, durations: FloatArray, of_interest: BoolArray, duration_max: float
) -> list[int] | None:
    """Return the drives after the best exchange of one of them; None if none improves the criterion."""
    total, time = each[chosen].sum(axis=0), durations[chosen].sum()
    best, result = float(criterion(total, of_interest)) + GAIN_MIN, None
    for place in range(len(chosen)):
        out = chosen[place]
        if out in chosen[:place]:
            continue
        fitting = np.flatnonzero(durations <= duration_max - time + durations[out] + TIME_TOLERANCE_S)
        reached = criterion(total - each[out] + each[fitting], of_interest)
        k = int(np.argmax(reached))
        if reached[k] > best:
            best, result = float(reached[k]), [*chosen[:place], int(fitting[k]), *chosen[place + 1 :]]
    return result
