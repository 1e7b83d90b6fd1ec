"""Paths of n runs on the road, and their clearance to cones."""

from __future__ import annotations

import numpy as np

from codegen.arrays import FloatArray
from codegen.metrics.runs import Runs


def paths(runs: Runs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return heading (rad) and position forward and to the left (m) of the centre of gravity, (samples, n) each, from zero.

    Speed, yaw rate and sideslip are integrated by the trapezoidal rule.
    """
    step = np.diff(runs.time)[:, np.newaxis]

    def integral(values: FloatArray) -> FloatArray:
        steps = 0.5 * step * (values[1:] + values[:-1])
        return np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])

    speed = runs.signals["speed_m_s"]
    heading = integral(runs.signals["yaw_rate_rad_s"])
    aside = speed * np.tan(runs.signals["sideslip_rad"])
    along, across = np.cos(heading), np.sin(heading)
    return heading, integral(speed * along - aside * across), integral(speed * across + aside * along)


def cone_clearances(cones: FloatArray, forward: FloatArray, left: FloatArray) -> FloatArray:
    """Return the smallest distances (n,) in m from the sides of the cars to the cones that they have passed.

    Negative where a cone is hit, NaN for a car that has passed none.

    Args:
        cones: (k, 3) m: position along the road, and the smallest and the largest lateral position of the centre of gravity at
            which the sides of the car clear the cones there; infinite where there is no cone on that side.
        forward, left: (samples, n) m, positions of the centres of gravity.
    """
    at, low, high = cones.T
    found = []
    for along, aside in zip(forward.T, left.T, strict=True):
        passed = at <= along[-1]
        lateral = np.interp(at[passed], along, aside)
        clearance = np.minimum(lateral - low[passed], high[passed] - lateral)
        found.append(float(clearance.min()) if clearance.size else np.nan)
    return np.array(found)
