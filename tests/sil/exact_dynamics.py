"""The physics of the reference model in double precision, from the equations of the single-track car and not from CasADi."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.config import Config
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

FloatArray = npt.NDArray[np.float64]


def magic_formula(tyre: MagicFormulaTyre, x: Any) -> Any:
    """The curve itself: sin(C atan(x - E (x - atan x)))."""
    return np.sin(tyre.shape_factor * np.arctan(x - tyre.curvature_factor * (x - np.arctan(x))))


def exact_slope(config: Config, state: FloatArray, inputs: FloatArray, curves: Sequence[Callable[[Any], Any]]) -> FloatArray:
    """(2, n): time derivative of sideslip and yaw rate in double precision, for states (2, n) and inputs (4, n)."""
    vehicle, tyres = config.vehicle, AxleTyres.from_config(config)
    (beta, r), (v, front, rear, friction) = state, inputs
    lf, lr = vehicle.cg_to_front_axle_m, vehicle.cg_to_rear_axle_m
    slips = beta + lf * r / v - front, beta - lr * r / v - rear
    forces = [
        -2.0
        * (
            friction * tyre.peak_factor * tyre.static_load * curve(tyre.stiffness_factor * (slip - tyre.horizontal_shift))
            + tyre.vertical_shift
        )
        for tyre, curve, slip in zip((tyres.front, tyres.rear), curves, slips, strict=True)
    ]
    lateral = sum(forces) / (vehicle.mass_kg * v) - r
    return np.array([lateral, (lf * forces[0] - lr * forces[1]) / vehicle.yaw_inertia_kg_m2])


def exact_step(
    config: Config, state: FloatArray, inputs: FloatArray, curves: Sequence[Callable[[Any], Any]], step: float
) -> FloatArray:
    """(2, n): sideslip and yaw rate one Heun step later; inputs hold the rear angle of the middle of the step."""
    first = exact_slope(config, state, inputs, curves)
    return state + 0.5 * step * (first + exact_slope(config, state + step * first, inputs, curves))
