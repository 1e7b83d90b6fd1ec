"""View model of the single-track dynamics: CasADi functions as C bodies."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from codegen.configuration import Config
from codegen.emit.casadi_c import function_body
from codegen.emit.text import Precision, literal
from codegen.vehicle.dynamics import Model, single_track

SPEED_MIN = 1.0
"""Lower bound of the speed in the ECU's dynamics, in m/s: the slip angles contain 1/speed."""

_LIBRARY_CALL = re.compile(r"\b(sin|cos|atan)f?\(")


@dataclass(frozen=True)
class ArrayView:
    """An output array of a generated function."""

    name: str
    size: int


@dataclass(frozen=True)
class FunctionView:
    """One straight-line function of x and u; `unused` are the arguments that its body does not read."""

    name: str
    outputs: tuple[ArrayView, ...]
    body: tuple[str, ...]
    unused: tuple[str, ...]


@dataclass(frozen=True)
class ModelView:
    """A typed pair of functions (derivative and Jacobian) around two straight-line ones."""

    name: str
    comment: str
    derivative: str
    jacobian: str


@dataclass(frozen=True)
class DynamicsView:
    """Everything that the dynamics templates print."""

    models: tuple[ModelView, ...]
    functions: tuple[FunctionView, ...]
    math_functions: tuple[str, ...]
    math_text: str
    speed_min: str
    speed_min_text: str


def function_view(function: Any, name: str, precision: Precision) -> FunctionView:
    """Return a CasADi function as C text."""
    body = function_body(function, precision)
    text = "\n".join(body)
    return FunctionView(
        name=name,
        outputs=tuple(ArrayView(function.name_out(k), function.nnz_out(k)) for k in range(function.n_out())),
        body=tuple(body),
        unused=tuple(argument for argument in ("x", "u") if f"{argument}[" not in text),
    )


def library_functions(functions: tuple[FunctionView, ...]) -> tuple[str, ...]:
    """Return the names of the mathematical functions that C bodies call, sorted."""
    return tuple(
        sorted({match.group(0)[:-1] for view in functions for line in view.body for match in _LIBRARY_CALL.finditer(line)})
    )


def dynamics_view(config: Config, precision: Precision) -> DynamicsView:
    """Return the view of both single-track models of a car."""
    models, functions = [], []
    described: tuple[tuple[str, str, Model], ...] = (
        ("linear", "Time derivative of the state with linear tyres.", single_track(config, "linear")),
        (
            "magic_formula",
            "Time derivative of the state with Magic Formula tyres at static wheel loads.",
            single_track(config, "magic-formula"),
        ),
    )
    for name, comment, model in described:
        derivative, jacobian = f"{name}_derivative", f"{name}_jacobian"
        functions += [
            function_view(model.derivative, derivative, precision),
            function_view(model.jacobian, jacobian, precision),
        ]
        models.append(ModelView(name, comment, derivative, jacobian))
    library = library_functions(tuple(functions))
    return DynamicsView(
        models=tuple(models),
        functions=tuple(functions),
        math_functions=library,
        math_text=", ".join(library) if library else "none",
        speed_min=literal(SPEED_MIN, precision),
        speed_min_text=f"{SPEED_MIN:g} m/s",
    )
