"""View models of single-track dynamics and reference model: CasADi functions as C bodies, and tyre curves as tables."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.emit.casadi_c import LIBRARY, function_body
from codegen.emit.text import Precision, lines_of, literal
from codegen.errors import BuildError
from codegen.vehicle.dynamics import Model, single_track, single_track_step
from codegen.vehicle.plant_car import load_transfer_losses
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

SPEED_MIN = 1.0
"""Lower bound of the speed in the ECU's dynamics, in m/s: the slip angles contain 1/speed."""

_LIBRARY_CALL = re.compile(rf"\b({'|'.join(LIBRARY.values())})f?\(")


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


CURVE_ERROR_MAX = 1e-3
"""Largest error of the table, as a fraction of the peak of the curve: far below tyre scatter, and a small table suffices."""
CELLS = (32, 64, 128, 256, 512)
COMPRESSIONS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
ERROR_SAMPLES = 64
"""Points of each cell at which the interpolation error is evaluated."""
ERROR_ALLOWANCE = 1.02
"""Allowance for errors between those points. Near its maximum the error of a chord is a parabola, flat to (1/64)^2. The rest of
the allowance covers rounding in the target's precision."""

SIDESLIP_MAX = math.radians(20.0)
LATERAL_ACCELERATION_MAX = 20.0
"""Bounds of the model's state, in rad and m/s^2; no tyre reaches the second."""
ARGUMENT_MAX = 1000.0
"""Bound of the arguments of the tyre curves, where these are level."""


@dataclass(frozen=True)
class CurveView:
    """The table of one tyre's curve."""

    name: str
    NAME: str
    title: str
    cells: int
    compression: str
    compression_value: float
    lines: tuple[str, ...]
    values: tuple[float, ...]
    error: float
    error_text: str


@dataclass(frozen=True)
class ReferenceModelView:
    """Everything that the templates of the reference model print."""

    front: CurveView
    rear: CurveView
    arguments: FunctionView
    change: FunctionView
    period_text: str
    speed_min: str
    speed_min_text: str
    rear_angle_max: str
    sideslip_max: str
    sideslip_text: str
    yaw_rate_max: str
    yaw_rate_text: str
    lateral_acceleration_max: str
    lateral_acceleration_text: str
    actuator_share: str
    actuator_step_max: str
    rear_arm: str
    per_axle: bool
    is_relaxed: bool
    relaxation_text: str
    argument_max: str
    front_argument: str
    rear_argument: str

    state: Mapping[str, str]

    @property
    def size(self) -> int:
        """Numbers of the state that the step depends on, without the actuator."""
        return 4 if self.is_relaxed else 2


@dataclass(frozen=True)
class Curve:
    """The curve of an axle at even steps of s = x/(x + compression), from x = 0 (s = 0) to infinity (s = 1).

    The curve is sin(C atan(x - E (x - atan x))) less the loss by load transfer, see `vehicle.plant_car.load_transfer_losses`.

    Attributes:
        compression: compression of the argument.
        values: values of the curve, (cells + 1,).
        error: bound on |interpolation - curve|.
    """

    compression: float
    values: FloatArray
    error: float


def tabulate(tyre: MagicFormulaTyre, loss: float = 0.0, where: str = "tyre") -> Curve:
    """Return the smallest table whose interpolation error is at most CURVE_ERROR_MAX. Raises BuildError if there is none."""
    for cells in CELLS:
        found = min((_curve(tyre, loss, cells, compression) for compression in COMPRESSIONS), key=lambda curve: curve.error)
        if found.error <= CURVE_ERROR_MAX:
            return found
    raise BuildError(
        f"no table of {CELLS[-1]} cells follows the tyre's curve within {CURVE_ERROR_MAX:g} of its peak",
        where=where,
        remedy="check shape_factor_c and curvature_factor_e",
    )


def _curve(tyre: MagicFormulaTyre, loss: float, cells: int, compression: float) -> Curve:
    points, places = (np.linspace(0.0, 1.0, count) for count in (cells + 1, cells * ERROR_SAMPLES + 1))
    values = _shape(tyre, loss, points, compression)
    error = np.abs(np.interp(places, points, values) - _shape(tyre, loss, places, compression)).max()
    return Curve(compression, values, float(error) * ERROR_ALLOWANCE)


def _shape(tyre: MagicFormulaTyre, loss: float, places: FloatArray, compression: float) -> FloatArray:
    with np.errstate(divide="ignore"):
        x = compression * places / (1.0 - places)  # infinite at the end
    value = tyre.curve.tabulated(tyre, x)
    result: FloatArray = 2.0 * value / (1.0 + np.sqrt(np.maximum(1.0 + 4.0 * loss * value * value, 0.0)))
    return result


def rounded_up(value: float) -> str:
    """Return a value rounded up to two digits."""
    exponent = math.floor(math.log10(value))
    return f"{math.ceil(value / 10.0 ** (exponent - 1)) * 10.0 ** (exponent - 1):.1e}"


def reference_model_view(config: Config, precision: Precision, *, per_axle: bool = False) -> ReferenceModelView:
    """Return the view of a car's reference model, with `per_axle` for a friction of each axle."""
    period = config.controller.sampling_time_s
    model, tyres = single_track_step(config, period, per_axle=per_axle), AxleTyres.from_config(config)
    losses = load_transfer_losses(config)
    car, inputs, actuator = SingleTrack.from_config(config), config.controller.inputs, config.rear_actuator

    def text(value: float) -> str:
        return literal(value, precision)

    return ReferenceModelView(
        front=_curve_view(tyres.front, losses[0], "front", precision),
        rear=_curve_view(tyres.rear, losses[1], "rear", precision),
        arguments=function_view(model.arguments, "arguments_of", precision),
        change=function_view(model.change, "change_of", precision),
        period_text=f"{period * 1e3:g} ms",
        speed_min=text(SPEED_MIN),
        speed_min_text=f"{SPEED_MIN:.3g} m/s",
        rear_angle_max=text(actuator.angle_max),
        sideslip_max=text(SIDESLIP_MAX),
        sideslip_text=f"{SIDESLIP_MAX:.3g} rad",
        yaw_rate_max=text(math.radians(inputs.yaw_rate_max_deg_s)),
        yaw_rate_text=f"{math.radians(inputs.yaw_rate_max_deg_s):.3g} rad/s",
        lateral_acceleration_max=text(LATERAL_ACCELERATION_MAX),
        lateral_acceleration_text=f"{LATERAL_ACCELERATION_MAX:g} m/s^2",
        # A slow command waits for lag and bus alone, whatever the order of the actuator: 1/(share lag^2 s^2 + lag s + 1).
        actuator_share=text(1.0 - math.exp(-period / (actuator.lag_s + config.driven_delay_samples * period))),
        actuator_step_max=text(math.radians(actuator.rate_max_deg_s) * period),
        rear_arm=text(car.rear_arm),
        per_axle=per_axle,
        is_relaxed=model.is_relaxed,
        relaxation_text=f"{config.plant.relaxation_length_m:g} m",
        argument_max=text(ARGUMENT_MAX),
        front_argument=text(-tyres.front.stiffness_factor * car.front_slip_per_lateral_acceleration),
        rear_argument=text(-tyres.rear.stiffness_factor * car.rear_slip_per_lateral_acceleration),
        state={name: text(bound) for name, bound in model_state(config).items()},
    )


def model_state(config: Config) -> dict[str, float]:
    """Return the fields of the state of a car's reference model, with their bounds."""
    return {
        "sideslip_angle": SIDESLIP_MAX,
        "yaw_rate": math.radians(config.controller.inputs.yaw_rate_max_deg_s),
        "rear_angle": config.rear_actuator.angle_max,
        "lateral_acceleration": LATERAL_ACCELERATION_MAX,
        **(dict.fromkeys(("front_argument", "rear_argument"), ARGUMENT_MAX) if config.plant.relaxation_length_m else {}),
    }


def _curve_view(tyre: MagicFormulaTyre, loss: float, name: str, precision: Precision) -> CurveView:
    curve = tabulate(tyre, loss, f"tyre.{name}")
    return CurveView(
        name=name,
        NAME=name.upper(),
        title=f"{name.capitalize()} tyre",
        cells=curve.values.size - 1,
        compression=literal(curve.compression, precision),
        compression_value=curve.compression,
        lines=lines_of([literal(float(value), precision) for value in curve.values]),
        values=tuple(float(value) for value in curve.values),
        error=curve.error,
        error_text=rounded_up(curve.error),
    )
