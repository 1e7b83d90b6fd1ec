"""View models of single-track dynamics and reference model: CasADi functions as C bodies, and tyre curves as tables."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from codegen.arrays import FloatArray
from codegen.configuration import Config
from codegen.emit.casadi_c import function_body, library_calls
from codegen.emit.text import Precision
from codegen.errors import BuildError
from codegen.vehicle.dynamics import single_track, single_track_step
from codegen.vehicle.plant_car import load_transfer_losses
from codegen.vehicle.single_track import SingleTrack
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

SPEED_MIN = 1.0
"""Lower bound of the speed in the ECU's dynamics, in m/s: the slip angles contain 1/speed."""


@dataclass(frozen=True)
class FunctionView:
    """A CasADi function of x and u as straight-line C."""

    name: str
    function: Any
    precision: Precision

    @functools.cached_property
    def body(self) -> tuple[str, ...]:
        """Its statements."""
        return tuple(function_body(self.function, self.precision))

    @property
    def outputs(self) -> dict[str, int]:
        """Name and size of the arrays that it writes."""
        return {self.function.name_out(k): self.function.nnz_out(k) for k in range(self.function.n_out())}

    @property
    def unused(self) -> tuple[str, ...]:
        """Arguments that it does not read."""
        steps = [k for k in range(self.function.n_instructions()) if self.function.instruction_id(k) == ca.OP_INPUT]
        read = {self.function.name_in(self.function.instruction_input(k)[0]) for k in steps}
        return tuple(argument for argument in ("x", "u") if argument not in read)


@dataclass(frozen=True)
class DynamicsView:
    """Both single-track models of a car, as the dynamics templates print them."""

    config: Config
    precision: Precision

    speed_min = SPEED_MIN
    models: ClassVar = {
        "linear": "Time derivative of the state with linear tyres.",
        "magic_formula": "Time derivative of the state with Magic Formula tyres at static wheel loads.",
    }
    """Name and comment of each model. It has the functions `<name>_derivative` and `<name>_jacobian`."""

    @functools.cached_property
    def functions(self) -> tuple[FunctionView, ...]:
        """The straight-line functions."""
        linear, magic_formula = single_track(self.config, "linear"), single_track(self.config, "magic-formula")
        return tuple(
            FunctionView(f"{name}_{what}", function, self.precision)
            for name, model in zip(self.models, (linear, magic_formula), strict=True)
            for what, function in (("derivative", model.derivative), ("jacobian", model.jacobian))
        )

    @property
    def math_functions(self) -> list[str]:
        """Names of the mathematical functions that they call, sorted."""
        return sorted(set().union(*(library_calls(each.function, self.precision) for each in self.functions)))


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

    @property
    def cells(self) -> int:
        """Number of its steps."""
        return self.values.size - 1

    @property
    def error_text(self) -> str:
        """The error, rounded up to two digits."""
        return rounded_up(self.error)


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


def model_state(config: Config) -> dict[str, float]:
    """Return the fields of the state of a car's reference model, with their bounds."""
    return {
        "sideslip_angle": SIDESLIP_MAX,
        "yaw_rate": math.radians(config.controller.inputs.yaw_rate_max_deg_s),
        "rear_angle": config.rear_actuator.angle_max,
        "lateral_acceleration": LATERAL_ACCELERATION_MAX,
        **(dict.fromkeys(("front_argument", "rear_argument"), ARGUMENT_MAX) if config.plant.relaxation_length_m else {}),
    }


@dataclass(frozen=True)
class ReferenceModelView:
    """A car's reference model, as its templates print it, in SI units; with `per_axle` for a friction of each axle."""

    config: Config
    precision: Precision
    per_axle: bool = False

    speed_min, sideslip_max = SPEED_MIN, SIDESLIP_MAX
    lateral_acceleration_max, argument_max = LATERAL_ACCELERATION_MAX, ARGUMENT_MAX

    @functools.cached_property
    def _model(self) -> Any:
        return single_track_step(self.config, self.config.controller.sampling_time_s, per_axle=self.per_axle)

    @functools.cached_property
    def _tyres(self) -> AxleTyres:
        return AxleTyres.from_config(self.config)

    @functools.cached_property
    def _car(self) -> SingleTrack:
        return SingleTrack.from_config(self.config)

    @functools.cached_property
    def curves(self) -> dict[str, Curve]:
        """Curve of the tyres of each axle."""
        losses = load_transfer_losses(self.config)
        axles = {"front": self._tyres.front, "rear": self._tyres.rear}
        return {name: tabulate(tyre, loss, f"tyre.{name}") for (name, tyre), loss in zip(axles.items(), losses, strict=True)}

    @property
    def is_relaxed(self) -> bool:
        """Whether side forces follow the slip over a relaxation length."""
        return bool(self._model.is_relaxed)

    @functools.cached_property
    def arguments(self) -> FunctionView:
        """The arguments of the curves."""
        return FunctionView("arguments_of", self._model.arguments, self.precision)

    @functools.cached_property
    def change(self) -> FunctionView:
        """The change of the state in a step."""
        return FunctionView("change_of", self._model.change, self.precision)

    @property
    def size(self) -> int:
        """Numbers of the state that the step depends on, without the actuator."""
        return 4 if self.is_relaxed else 2

    @property
    def state(self) -> dict[str, float]:
        """Fields of the state, with their bounds."""
        return model_state(self.config)

    @property
    def rear_angle_max(self) -> float:
        """Largest angle of the actuator."""
        return self.config.rear_actuator.angle_max

    @property
    def yaw_rate_max(self) -> float:
        """Bound of the yaw rate."""
        return math.radians(self.config.controller.inputs.yaw_rate_max_deg_s)

    @property
    def actuator_share(self) -> float:
        """Share of the remaining way that the actuator covers in a sample."""
        actuator, period = self.config.rear_actuator, self.config.controller.sampling_time_s
        # A slow command waits for lag and bus alone, whatever the order of the actuator: 1/(share lag^2 s^2 + lag s + 1).
        return 1.0 - math.exp(-period / (actuator.lag_s + self.config.driven_delay_samples * period))

    @property
    def actuator_step_max(self) -> float:
        """Largest movement of the actuator in a sample."""
        return math.radians(self.config.rear_actuator.rate_max_deg_s) * self.config.controller.sampling_time_s

    @property
    def rear_arm(self) -> float:
        """Distance from centre of gravity to rear axle."""
        return self._car.rear_arm

    @property
    def front_argument(self) -> float:
        """Argument of the front curve per lateral acceleration."""
        return -self._tyres.front.stiffness_factor * self._car.front_slip_per_lateral_acceleration

    @property
    def rear_argument(self) -> float:
        """Argument of the rear curve per lateral acceleration."""
        return -self._tyres.rear.stiffness_factor * self._car.rear_slip_per_lateral_acceleration
