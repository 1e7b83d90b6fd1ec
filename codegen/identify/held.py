"""Quantities of the tyre curves that are held as configured, and what their uncertainty adds to that of the others.

The curve of a tyre that did not reach its peak shows in the drives as a bend of the force, of which D, C, E and the load
sensitivity are almost interchangeable causes. An estimate of each would mostly reflect errors of the model, and the four
together would describe an arbitrary curve beyond the driven slip. Therefore only as many of them are fitted as the driven part
requires.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from codegen.arrays import BoolArray
from codegen.configuration import Config
from codegen.identify.estimate import Fit, curvature
from codegen.identify.identifiability import Identifiability
from codegen.identify.parameters import BY_NAME, CURVE_PARAMETERS
from codegen.identify.reached import exceeds_reached, reached, tyres_of

PEAK_SLIP_FACTOR_MAX = 2.0
"""Largest ratio of the slip at the peak to the largest driven slip: beyond it, more of the curve is extrapolated than
driven."""


def undetermined_curves(fitted: Fit, judged: Identifiability, config: Config) -> list[str]:
    """Return the quantities of the tyre curves that the next fit holds at their configured values.

    Without the peak, the drives cannot distinguish D from C and the load sensitivity, nor, in the next fit, from E. D is held
    too if, in the last one, the curve was not driven beyond its slip bound. However small the deviation of D is, C and load
    sensitivity are not determined if the curve goes far beyond the drives, or has a quantity at the end of its range.
    """
    names, values = fitted.problem.prior.names, fitted.named()
    departure = config.limits.slip_departure_percent / 100.0
    held: list[str] = []
    driven = reached(fitted, config)
    for axle, (curve, tyre) in enumerate(zip(CURVE_PARAMETERS, tyres_of(config, values), strict=True)):
        peak, shape, curvature, sensitivity = curve
        free = {name for name in curve if fitted.free[names.index(name)]}
        others = {shape, sensitivity} & free
        goes_beyond = (
            exceeds_reached(config.road.friction * values[peak], driven.friction[axle])
            or tyre.peak_slip > PEAK_SLIP_FACTOR_MAX * driven.slip[axle]
            or any(BY_NAME[name].end_at(values[name]) is not None for name in free)
        )
        if peak not in free or (judged.is_identified[names.index(peak)] and not (others and goes_beyond)):
            continue
        if others := others or {curvature} & free:
            held += sorted(others)
            continue
        if tyre.departure(driven.slip[axle]) < departure:
            held.append(peak)
    return held


def with_held_spread(fitted: Fit, held: BoolArray) -> Fit:
    """Return the fit with the covariance of all quantities if those in `held` (k,) are as uncertain as assumed before.

    With H the curvature, the prior included, of free quantities f and held ones h, a change of h moves the fit of f by G =
    -H_ff^-1 H_fh. Information of the drives about h beyond that is not used. The assumption about f holds on the way too,
    which leaves the covariance (I + G^T G)^-1 for h.
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
