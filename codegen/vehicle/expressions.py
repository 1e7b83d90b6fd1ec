"""Parts of the car models: a model as CasADi functions, and the tyre force as an expression.

The quantities of a tyre may be numbers or symbols of CasADi.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from codegen.vehicle.tyre import MagicFormulaTyre


@dataclass(frozen=True)
class Model:
    """A dynamic model x' = f(x, u), y = h(x, u) with its Jacobians, as CasADi functions of column vectors.

    Attributes:
        name: also the name of the C function.
        states, inputs, outputs: the names of the elements of x, u and y, in order, SI units.
        derivative: (x, u) -> x'.
        jacobian: (x, u) -> (df/dx, df/du).
        output: (x, u) -> y, None if the model has no outputs.
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    derivative: Any
    jacobian: Any
    output: Any | None


def is_zero(value: Any) -> bool:
    """Whether a quantity of a car is the number zero; a symbol is not."""
    return isinstance(value, int | float) and value == 0.0


def curve_argument(tyre: MagicFormulaTyre, slip: Any) -> Any:
    """X: the slip angle as the formula's curve takes it."""
    return tyre.stiffness_factor * (slip - tyre.horizontal_shift)


def curve(tyre: MagicFormulaTyre, x: Any) -> Any:
    """The formula's curve, from -1 to 1."""
    return tyre.curve.value(tyre, x, ca)


def axle_curve(tyre: MagicFormulaTyre, x: Any, loss: float) -> Any:
    """The curve of an axle with a loss by load transfer, see `plant_car.load_transfer_losses`: c = s - loss s c^2."""
    value = curve(tyre, x)
    return 2.0 * value / (1.0 + ca.sqrt(ca.fmax(1.0 + 4.0 * loss * value * value, 0.0))) if loss else value


def magic_formula(tyre: MagicFormulaTyre, slip: Any, load: Any, friction: Any) -> Any:
    """F in N for one wheel; see `tyre.MagicFormulaTyre.force`."""
    relative: Any = tyre.peak_factor
    if not is_zero(tyre.peak_load_sensitivity):
        relative = ca.fmax(tyre.peak_factor + tyre.peak_load_sensitivity * (load / tyre.static_load - 1.0), 0.0)
    return friction * relative * load * curve(tyre, curve_argument(tyre, slip)) + tyre.vertical_shift


def clamp(value: Any, limit: Any) -> Any:
    """The value, kept within plus and minus the limit."""
    return ca.fmin(ca.fmax(value, -limit), limit)


def make_model(
    name: str,
    names: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...]],
    x: Any,
    u: Any,
    derivative: Any,
    output: Any | None,
) -> Model:
    """The model of these expressions over the symbols x and u; `names` of states, inputs and outputs."""
    states, inputs, outputs = names
    return Model(
        name=name,
        states=states,
        inputs=inputs,
        outputs=outputs,
        derivative=ca.Function(f"{name}_derivative", [x, u], [derivative], ["x", "u"], ["dx"]),
        jacobian=ca.Function(
            f"{name}_jacobian",
            [x, u],
            [ca.densify(ca.jacobian(derivative, x)), ca.densify(ca.jacobian(derivative, u))],
            ["x", "u"],
            ["dfdx", "dfdu"],
        ),
        output=None if output is None else ca.Function(f"{name}_output", [x, u], [output], ["x", "u"], ["y"]),
    )
