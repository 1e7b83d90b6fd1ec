"""Quantities that the drives determine, combinations that they do not, and quantities that are held as configured.

In the scaled parameters z the prior is a unit sphere. A direction in which the estimate is hardly narrower than the prior is
not determined by the drives. Reports name such a direction by the quantities that change along it.

The curve of a tyre that did not reach its peak shows in the drives as a bend of the force, of which D, C, E and the load
sensitivity are almost interchangeable causes. An estimate of each would mostly reflect errors of the model, and the four
together would describe an arbitrary curve beyond the driven slip. Therefore only as many of them are fitted as the driven part
requires.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.configuration import Config
from codegen.identify.estimate import Fit, curvature
from codegen.identify.parameters import BY_NAME, CURVE_PARAMETERS, Parameter
from codegen.identify.reached import exceeds_reached, reached, tyres_of

DETERMINED_SHARE_MAX = 0.3
"""Largest standard deviation of a determined quantity or direction, as a fraction of its spread before the drives."""
WEAK_SHARE_MAX = 0.6
"""Largest standard deviation of a weakly determined quantity, as the same fraction."""
NOTHING = 0.95
"""From this fraction on, the drives do not determine a quantity at all. Such quantities are named one by one."""
COMPONENT_MIN = 0.35
"""Smallest component, of a unit vector, of a quantity that is named in a direction."""


@dataclass(frozen=True)
class Direction:
    """A combination of quantities that the drives hardly determine.

    Attributes:
        share: standard deviation along it, as a fraction of the spread before; at most 1.
        singular_value: of the scaled Jacobian, along it: how many standard deviations of the noise one spread moves the drives.
        components: title of each quantity that it moves -> its component.
    """

    share: float
    singular_value: float
    components: dict[str, float]

    @property
    def text(self) -> str:
        """The direction in words."""
        names = list(self.components)
        if len(names) == 1:
            return f"{names[0]}: {'not' if self.share > NOTHING else 'hardly'} in these drives"
        return f"{', '.join(names[:-1])} and {names[-1]} only together"


@dataclass(frozen=True, eq=False)
class Identifiability:
    """Result for the parameters of one fit.

    Attributes:
        shares: (k,) standard deviation over spread; 1 for a parameter that was not free.
        is_identified: (k,).
        directions: singular directions: quantities without any information, then combinations, the weakest first.
    """

    shares: FloatArray
    is_identified: BoolArray
    directions: tuple[Direction, ...]


def analyse(
    parameters: tuple[Parameter, ...], free: BoolArray, covariance: FloatArray, information: FloatArray
) -> Identifiability:
    """Return what the drives determine.

    Args:
        parameters: (k,). free: (k,) whether each was estimated.
        covariance: (k, k) of z. information: (k, k) of the data, in z.
    """
    shares = np.where(free, np.sqrt(np.diag(covariance)), 1.0)
    scaled = 0.5 * (information + information.T)
    directions = [
        Direction(min(float(shares[k]), 1.0), float(np.sqrt(max(scaled[k, k], 0.0))), {parameters[k].title: 1.0})
        for k in np.flatnonzero(free & (shares > NOTHING))
    ]
    chosen = np.flatnonzero(free & (shares <= NOTHING))
    size, vectors = np.linalg.eigh(covariance[np.ix_(chosen, chosen)])
    for value, vector in sorted(zip(size, vectors.T, strict=True), key=lambda pair: -pair[0]):
        if value <= DETERMINED_SHARE_MAX**2:
            break
        order = [k for k in np.argsort(-np.abs(vector)) if abs(vector[k]) >= COMPONENT_MIN]
        components = {parameters[chosen[k]].title: float(vector[k]) for k in order}
        strength = float(vector @ scaled[np.ix_(chosen, chosen)] @ vector)
        directions.append(Direction(min(float(np.sqrt(value)), 1.0), float(np.sqrt(max(strength, 0.0))), components))
    return Identifiability(shares, free & (shares <= DETERMINED_SHARE_MAX), tuple(directions))


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
