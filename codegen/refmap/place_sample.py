"""How far a stored map is off an optimum that takes too long to be asked all through the search for its breakpoints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from codegen.refmap.lookup import Lookup
from codegen.refmap.map import ReferenceMap
from codegen.refmap.storage import Real
from codegen.refmap.total import TotalMap
from codegen.refmap.turns import passively_feasible, turns_behind

POINTS = 201
"""Speeds, and front angles: evenly over the breakpoints of the map."""


def off_optimum(reference_map: ReferenceMap, total: TotalMap, real: Real) -> float | None:
    """Largest difference in rad/s between what the lookup gives and the optimum, where there is one, at POINTS x POINTS points.

    Of a stack, over the friction of each layer. A sample: between its points it can be more.

    Args:
        total: of that map, as it is stored. real: the numbers of the target.

    Returns:
        None for a map without an optimisation behind it.

    Raises:
        MapError: a steady turn is not found.
    """
    lookup = Lookup.from_map(total, real)
    maps = [*(layer.map for layer in reference_map.layers), reference_map]
    found = [_largest(one, lookup, float(friction)) for one, friction in zip(maps, lookup.frictions, strict=True)]
    known = [error for error in found if error is not None]
    return max(known) if len(known) == len(found) else None


def _largest(layer: ReferenceMap, lookup: Lookup, friction: float) -> float | None:
    turns = turns_behind(layer)
    if turns is None or layer.config is None or layer.case is None:
        return None
    speed, front_angle = (_evenly(axis) for axis in (layer.speed, layer.front_angle))
    optimum = turns.solve(speed, front_angle)
    feasible = optimum.feasible
    if layer.config.case(layer.case).passive_safe:
        feasible = feasible & passively_feasible(turns, speed, front_angle)
    stored, _ = lookup.reference(speed[:, np.newaxis], front_angle[np.newaxis, :], friction)
    return float(np.abs(stored.astype(np.float64) - optimum.yaw_rate)[feasible].max(initial=0.0))


def _evenly(axis: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    return np.linspace(axis[axis > 0.0][0], axis[-1], POINTS)
