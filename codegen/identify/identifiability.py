"""Quantities that the drives determine, and combinations that they do not.

In the scaled parameters z the prior is a unit sphere. A direction in which the estimate is hardly narrower than the prior is
not determined by the drives. Reports name such a direction by the quantities that change along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.identify.parameters import Parameter

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
