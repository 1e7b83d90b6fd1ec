"""Quantities of the tyre curves that are held as configured, and what their uncertainty adds to that of the others.

The curve of a tyre that did not reach its peak shows in the drives as a small bend of the force, of which D, C, E and the load
sensitivity are almost interchangeable causes. What the drives would say about each of them is mostly an error of the model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from codegen.arrays import BoolArray
from codegen.configuration import Config
from codegen.identify.estimate import Fit, curvature
from codegen.identify.identifiability import Identifiability
from codegen.identify.parameters import CURVES
from codegen.identify.reached import reached, tyres_of


def undetermined_curves(fitted: Fit, judged: Identifiability, config: Config) -> list[str]:
    """Return the quantities of the tyre curves that the next fit holds at their configured values, where D is not determined.

    Without the peak, the drives do not tell D from C and the load sensitivity; nor, in the next fit, from E. D is held too if,
    in the last one, the curve was not driven beyond its slip bound.
    """
    names, values = fitted.problem.prior.names, fitted.named()
    departure = config.limits.slip_departure_percent / 100.0
    held: list[str] = []
    for curve, tyre, slip in zip(CURVES, tyres_of(config, values), reached(fitted, config).slip, strict=True):
        peak, shape, curvature, sensitivity = curve
        free = {name for name in curve if fitted.free[names.index(name)]}
        if peak not in free or judged.is_identified[names.index(peak)]:
            continue
        if others := {shape, sensitivity} & free or {curvature} & free:
            held += sorted(others)
            continue
        if tyre.departure(slip) < departure:
            held.append(peak)
    return held


def with_held_spread(fitted: Fit, held: BoolArray) -> Fit:
    """Return the fit with the covariance of all quantities if those in `held` (k,) are as uncertain as assumed before.

    With H the curvature, the prior included, of free quantities f and held ones h, a change of h moves the fit of f by G =
    -H_ff^-1 H_fh. What the drives say about h beyond that is not used. The assumption about f holds on the way too, which
    leaves the covariance (I + G^T G)^-1 for h.
    """
    if not held.any():
        return fitted
    both = np.flatnonzero(fitted.free | held)
    f, h = fitted.free[both], held[both]
    information = curvature(fitted, fitted.free | held)
    gain = -np.linalg.solve(information[np.ix_(f, f)] + np.eye(f.sum()), information[np.ix_(f, h)])
    spread = np.linalg.inv(np.eye(h.sum()) + gain.T @ gain)
    moved = np.zeros((len(both), h.sum()))
    moved[f], moved[h] = gain, np.eye(h.sum())
    covariance = fitted.covariance.copy()
    added = moved @ spread @ moved.T
    covariance[np.ix_(both, both)] += 0.5 * (added + added.T)
    return replace(fitted, covariance=covariance)
