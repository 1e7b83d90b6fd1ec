"""The reference model of kind "tracking" as its header describes it, in NumPy.

It has the bits of the C. Its order of operations is known: where the C prints a CasADi expression, the instructions of the same
CasADi function are walked here in the build's number type; the rest is written from the header.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from codegen.configuration import Config
from codegen.emit.reference_model_view import tabulate
from codegen.vehicle.dynamics import single_track_step
from codegen.vehicle.plant_car import load_transfer_losses
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre

FloatArray = npt.NDArray[np.float64]
SIDESLIP_MAX = math.radians(20.0)
SPEED_MIN = 1.0
"""m/s. Lower speeds count as this."""

_OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ADD: lambda a, b: a + b,
    ca.OP_SUB: lambda a, b: a - b,
    ca.OP_MUL: lambda a, b: a * b,
    ca.OP_DIV: lambda a, b: a / b,
    ca.OP_NEG: lambda a, _: -a,
    ca.OP_SQ: lambda a, _: a * a,
    ca.OP_TWICE: lambda a, _: a + a,
    ca.OP_FMAX: lambda a, b: np.where(a > b, a, b),  # the second for NaN, as in the C
}


@dataclass(frozen=True)
class Instruction:
    """One of a CasADi function: what it does, with which places of work or of an input or output, and a constant's value."""

    operation: int
    arguments: tuple[int, ...]
    results: tuple[int, ...]
    constant: Any

    @classmethod
    def all_of(cls, function: Any, real: Any) -> tuple[Instruction, ...]:
        """Those of a function, with its constants in a number type."""
        return tuple(
            cls(
                function.instruction_id(k),
                tuple(function.instruction_input(k)),
                tuple(function.instruction_output(k)),
                real(function.instruction_constant(k)) if function.instruction_id(k) == ca.OP_CONST else None,
            )
            for k in range(function.n_instructions())
        )


def walk(instructions: Iterable[Instruction], inputs: Sequence[Sequence[Any]]) -> list[Any]:
    """The elements of the only output, each operation done in the number type of constants and inputs (argument, element)."""
    work: dict[int, Any] = {}
    output: dict[int, Any] = {}
    for each in instructions:
        arguments = each.arguments
        if each.operation == ca.OP_CONST:
            work[each.results[0]] = each.constant
        elif each.operation == ca.OP_INPUT:
            work[each.results[0]] = inputs[arguments[0]][arguments[1]]
        elif each.operation == ca.OP_OUTPUT:
            output[each.results[1]] = work[arguments[0]]
        else:
            work[each.results[0]] = _OPERATIONS[each.operation](work[arguments[0]], work[arguments[-1]])
    return [output[index] for index in sorted(output)]


def within(value: Any, limit: Any) -> Any:
    """The value within +-limit; the bound for what is no number."""
    return np.where(np.isnan(value), limit, np.clip(value, -limit, limit))


def at_least(value: Any, low: Any) -> Any:
    """The value, not below a bound; what is no number stays so."""
    return np.where(value < low, low, value)


@dataclass(frozen=True)
class TableCurve:
    """A tyre's curve from its table, in one number type."""

    values: Any
    compression: Any

    @classmethod
    def of(cls, tyre: MagicFormulaTyre, real: Any, loss: float = 0.0) -> TableCurve:
        """The table that a build has."""
        curve = tabulate(tyre, loss)
        return cls(curve.values.astype(real), real(curve.compression))

    def __call__(self, x: Any) -> tuple[Any, Any]:
        """Value and slope; where the curve falls, its slope counts as zero."""
        real = self.values.dtype.type
        cells, one = self.values.size - 1, real(1.0)
        inverse = one / (np.abs(x) + self.compression)
        position = np.abs(x) * inverse * real(cells)
        cell = np.where(position < cells, position, cells - 1).astype(np.int64)
        rise = self.values[cell + 1] - self.values[cell]
        value = self.values[cell] + (position - cell.astype(real)) * rise
        steep = rise * (self.compression * real(cells) * (inverse * inverse))
        return np.where(x < 0.0, -value, value), np.where(rise > 0.0, steep, real(0.0))


class SecondReferenceModel:
    """States (sideslip, yaw rate, rear angle) and inputs (speed, front angle, rear angle, friction) as arrays of one shape."""

    def __init__(self, config: Config, real: Any) -> None:
        actuator, period = config.rear_actuator, config.controller.sampling_time_s
        vehicle, tyres = config.vehicle, AxleTyres.from_config(config)
        stiffness = 2.0 * tyres.rear.cornering_stiffness
        self.real = real
        functions = single_track_step(config, period)
        self.arguments, self.change = (Instruction.all_of(each, real) for each in (functions.arguments, functions.change))
        both = zip((tyres.front, tyres.rear), load_transfer_losses(config), strict=True)
        self.curves = [TableCurve.of(tyre, real, loss) for tyre, loss in both]
        self.speed_min = real(SPEED_MIN)
        self.rear_angle_max = real(math.radians(actuator.angle_max_deg))
        self.yaw_rate_max = real(math.radians(config.controller.inputs.yaw_rate_max_deg_s))
        self.share = real(1.0 - math.exp(-period / (actuator.lag_s + period)))
        self.travel = real(math.radians(actuator.rate_max_deg_s) * period)
        self.rear_arm = real(vehicle.cg_to_rear_axle_m)
        self.rear_slip = real(vehicle.mass_kg * vehicle.cg_to_front_axle_m / (vehicle.wheelbase * stiffness))

    def start(self, speed: Any, yaw_rate: Any, rear_angle: Any) -> tuple[Any, Any, Any]:
        """The state of the linear car's steady turn."""
        forward = at_least(speed, self.speed_min)
        yaw_rate, rear_angle = within(yaw_rate, self.yaw_rate_max), within(rear_angle, self.rear_angle_max)
        sideslip = rear_angle + yaw_rate * (self.rear_arm / forward - self.rear_slip * forward)
        return within(sideslip, self.real(SIDESLIP_MAX)), yaw_rate, rear_angle

    def step(self, state: Iterable[Any], inputs: Iterable[Any]) -> tuple[Any, Any, Any]:
        """One sampling time later; the rear wheels stand in the middle of their way."""
        sideslip, yaw_rate, rear_angle = state
        speed, front, commanded, friction = inputs
        half, one = self.real(0.5), self.real(1.0)
        moved = within(self.share * (commanded - rear_angle), self.travel)
        u = [one / at_least(speed, self.speed_min), front, rear_angle + half * moved, friction]
        x = [sideslip, yaw_rate]
        arguments = walk(self.arguments, [x, u])
        values, slopes = zip(*(curve(argument) for curve, argument in zip(self.curves, arguments, strict=True)), strict=True)
        change = walk(self.change, [x, u, values, slopes])
        return (
            within(sideslip + change[0], self.real(SIDESLIP_MAX)),
            within(yaw_rate + change[1], self.yaw_rate_max),
            within(rear_angle + moved, self.rear_angle_max),
        )
