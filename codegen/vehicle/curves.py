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
from codegen.vehicle.roots import bracketed_root


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
