"""Shapes of the tyre force over the slip angle: one list for numbers, for CasADi and for the solvers.

A curve runs from -1 to 1 over X = B (alpha - S_H); the force is D times its value.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from codegen.arrays import FloatArray

STEPS_MAX = 200


def bracketed_root(
    function: Callable[[float], float], low: float, high: float, atol: float = 1e-15, rtol: float = 1e-14
) -> float:
    """Return the root between `low` and `high`, where the function has opposite signs.

    R. P. Brent, Algorithms for Minimization without Derivatives, chapter 4: secant or inverse quadratic steps as long as they
    shrink fast enough, else bisection. It ends with the root within atol + rtol |x|.
    """
    # The iterate before, the best one, and the end on the other side of the root; each with its value.
    before, best = (low, function(low)), (high, function(high))
    other = before
    last = step = high - low
    for _ in range(STEPS_MAX):
        if (before[1] < 0.0) != (best[1] < 0.0):
            other = before
            last = step = best[0] - before[0]
        if abs(other[1]) < abs(best[1]):
            before, best, other = best, other, best
        near = 0.5 * (atol + rtol * abs(best[0]))
        half = 0.5 * (other[0] - best[0])
        if best[1] == 0.0 or abs(half) < near:
            break
        tried = half
        if abs(last) > near and abs(best[1]) < abs(before[1]):
            tried = _extrapolated(before, best, other)
        shrinks = 2.0 * abs(tried) < min(abs(last), 3.0 * abs(half) - near)
        last, step = (step, tried) if shrinks else (half, half)
        before = best
        moved = step if abs(step) > near else (near if half > 0.0 else -near)
        best = (best[0] + moved, function(best[0] + moved))
    return best[0]


def _extrapolated(before: tuple[float, float], best: tuple[float, float], other: tuple[float, float]) -> float:
    """Step from the best point to the root of the line through two points, or of the inverse parabola through three."""
    if before[0] == other[0]:
        return -best[1] * (best[0] - before[0]) / (best[1] - before[1])
    slope = (before[1] - best[1]) / (before[0] - best[0])
    slope_other = (other[1] - best[1]) / (other[0] - best[0])
    # Zero differences only where the values repeat, far below what the tolerance resolves: any step is then refused.
    below = slope_other * slope * (other[1] - before[1])
    return -best[1] * (other[1] * slope_other - before[1] * slope) / below if below != 0.0 else float("inf")


class CurveFactors(Protocol):
    """Factors of a tyre that a curve may use: numbers or CasADi symbols; see `tyre.MagicFormulaTyre`."""

    @property
    def stiffness_factor(self) -> Any:
        """B in 1/rad."""

    @property
    def shape_factor(self) -> Any:
        """C."""

    @property
    def curvature_factor(self) -> Any:
        """E."""


@dataclass(frozen=True)
class TyreCurve:
    """One curve.

    Attributes:
        value: (factors, X, functions) -> value, where `functions` is numpy or casadi.
        value_and_slope: (factors, X) -> value and its derivative by the slip angle in 1/rad, for arrays.
        tabulated: (factors, X) -> value for arrays, also at infinite X.
        initial_slope: factors -> derivative by X at zero.
        peak: factors -> X of the largest value, infinite where the curve rises throughout.
    """

    value: Callable[[CurveFactors, Any, Any], Any]
    value_and_slope: Callable[[CurveFactors, FloatArray], tuple[FloatArray, FloatArray]]
    tabulated: Callable[[CurveFactors, FloatArray], FloatArray]
    initial_slope: Callable[[CurveFactors], Any]
    peak: Callable[[CurveFactors], float]


def _magic_formula(tyre: CurveFactors, x: Any, functions: Any) -> Any:
    bent = x - tyre.curvature_factor * (x - functions.arctan(x))
    return functions.sin(tyre.shape_factor * functions.arctan(bent))


def _magic_formula_and_slope(tyre: CurveFactors, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    b, c, e = tyre.stiffness_factor, tyre.shape_factor, tyre.curvature_factor
    bent = x - e * (x - np.arctan(x))
    angle = c * np.arctan(bent)
    slope = np.cos(angle) * (b * c) * (1.0 - e + e / (1.0 + x * x)) / (1.0 + bent * bent)
    return np.sin(angle), slope


def _magic_formula_tabulated(tyre: CurveFactors, x: FloatArray) -> FloatArray:
    straight = (1.0 - tyre.curvature_factor) * x if tyre.curvature_factor < 1.0 else 0.0
    value: FloatArray = np.sin(tyre.shape_factor * np.arctan(straight + tyre.curvature_factor * np.arctan(x)))
    return value


def _magic_formula_peak(tyre: CurveFactors) -> float:
    """Solve C atan(X - E (X - atan X)) = pi/2 for X."""
    if tyre.shape_factor <= 1.0:
        return math.inf
    bent, e = math.tan(0.5 * math.pi / tyre.shape_factor), tyre.curvature_factor
    if e == 1.0:
        return math.tan(bent) if bent < 0.5 * math.pi else math.inf
    # X - E (X - atan X) rises by at least the smaller of 1 and 1 - E, and by at most the larger one.
    return bracketed_root(lambda x: x - e * (x - math.atan(x)) - bent, 0.0, bent / min(1.0, 1.0 - e))


MAGIC_FORMULA = TyreCurve(
    value=_magic_formula,
    value_and_slope=_magic_formula_and_slope,
    tabulated=_magic_formula_tabulated,
    initial_slope=lambda tyre: tyre.shape_factor,
    peak=_magic_formula_peak,
)

CURVES = {"magic-formula": MAGIC_FORMULA}
"""All curves, by `configuration.Tyre.curve`."""
