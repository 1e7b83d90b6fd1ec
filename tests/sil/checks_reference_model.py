"""What must hold of the generated reference model. Each check takes the units of a build and raises AssertionError where it
does not hold."""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from codegen.config import Config
from codegen.emit.reference_model_view import ARGUMENT_MAX, tabulate
from codegen.vehicle.tyre import AxleTyres, MagicFormulaTyre
from codegen.verify.law.reference_model import SIDESLIP_MAX, SecondReferenceModel, TableCurve
from tests.sil.checks_lookup import RealArray, any_numbers, special_values
from tests.sil.units import Units

FloatArray = npt.NDArray[np.float64]
KM_H = 1.0 / 3.6


def limits(units: Units) -> tuple[RealArray, RealArray]:
    """Of the state (3,) and of the inputs (4,)."""
    inputs = units.config.controller.inputs
    rear = math.radians(units.config.rear_actuator.angle_max_deg)
    yaw_rate, front = math.radians(inputs.yaw_rate_max_deg_s), math.radians(inputs.front_angle_max_deg)
    states = np.array([SIDESLIP_MAX, yaw_rate, rear], dtype=units.real)
    return states, np.array([inputs.speed_max_km_h * KM_H, front, rear, units.config.road.friction], dtype=units.real)


def random_states(units: Units, count: int, seed: int) -> RealArray:
    """States (count, 3) as the C can leave them: plain ones, some at their bounds, some next to zero."""
    rng, real = np.random.default_rng(seed), units.real
    states = rng.uniform(-1.0, 1.0, (count, 3)) * rng.choice([1.0, 0.2, 0.01], (count, 1))
    states = np.where(rng.random((count, 3)) < 0.05, rng.choice([-1.0, 1.0, 0.0, -0.0], (count, 3)), states)
    tiny = rng.choice([float(np.finfo(real).smallest_subnormal), float(np.finfo(real).tiny), -1e-30], (count, 3))
    states = np.where(rng.random((count, 3)) < 0.02, tiny, states).astype(real) * limits(units)[0]
    return states.astype(real)


def random_inputs(units: Units, count: int, seed: int) -> RealArray:
    """Inputs (count, 4): plausible ones, a tenth of them beyond their limits."""
    rng = np.random.default_rng(seed)
    inputs = rng.uniform(-0.1, 1.0, (count, 4)) * rng.choice([0.1, 0.4, 1.0, 1.4], (count, 4))
    inputs[:, 1:3] *= rng.choice([-1.0, 1.0], (count, 2))
    result: RealArray = (inputs * limits(units)[1]).astype(units.real)
    return result


def wild_inputs(units: Units, count: int, seed: int) -> RealArray:
    """Inputs (count, 4) of any bit pattern."""
    rng = np.random.default_rng(seed)
    special = np.concatenate([special_values(units.real), limits(units)[1]])
    return np.stack([any_numbers(rng, units.real, count, special) for _ in range(4)], axis=1)


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


def check_model_physics(units: Units) -> None:
    """One step is Heun's on the equations of the single-track car with Magic Formula tyres.

    Tolerance: the slope is some 30 operations on terms of at most mu g L / v_min and mu g m L / Iz; each rounds by half a unit.
    The curve's argument is of size B times the slip, its rounding goes through a slope of at most C B.
    """
    config, count = units.config, 20_000
    states = random_states(units, count, 11).astype(np.float64)
    inputs = random_inputs(units, count, 12).astype(np.float64)
    model = SecondReferenceModel(config, np.float64)
    tyres = AxleTyres.from_config(config)
    after = units.model_from(states, inputs).astype(np.float64)
    demand = np.clip(inputs[:, 2], -model.rear_angle_max, model.rear_angle_max)
    moved = np.clip(float(model.share) * (demand - states[:, 2]), -model.travel, model.travel)
    assert np.abs(after[:, 2] - (states[:, 2] + moved)).max() <= 4.0 * units.eps * model.rear_angle_max
    front = np.clip(inputs[:, 1], -model.front_angle_max, model.front_angle_max)
    friction = np.clip(inputs[:, 3], 0.0, model.friction)
    u = np.stack([np.clip(inputs[:, 0], *model.speeds), front, states[:, 2] + 0.5 * moved, friction])
    curves = [TableCurve.of(tyre, np.float64) for tyre in (tyres.front, tyres.rear)]
    exact = exact_step(config, states[:, :2].T, u, curves, float(model.period))
    bounds = limits(units)[0][:2, np.newaxis].astype(np.float64)
    exact = np.clip(exact, -bounds, bounds)
    largest = 9.81 * 0.9 * np.stack([3.0 / u[0], np.full(count, 3.0)])
    slip = np.abs(states[:, 0]) + 2.0 * np.abs(states[:, 1]) / u[0] + np.abs(u[1]) + 0.1
    tolerance = units.eps * (np.abs(exact) + float(model.period) * largest * (30.0 + 60.0 * slip))
    assert (np.abs(after[:, :2].T - exact) <= tolerance).all()


def check_curves(units: Units, count: int = 400_000) -> None:
    """Each curve is off by at most what is stated, as far as the table goes; it is odd, and takes any number.

    Rounding: the position rounds by three units of the number of cells, worth at most a cell's rise each; the interpolation and
    the stored corners by four units of 1.
    """
    tyres = AxleTyres.from_config(units.config)
    x = np.concatenate([np.linspace(0.0, 30.0, count), np.geomspace(1e-6, ARGUMENT_MAX, count)]).astype(units.real)
    for tyre, values, mirrored in zip((tyres.front, tyres.rear), units.curves(x), units.curves(-x), strict=True):
        table = tabulate(tyre)
        rise = float(np.abs(np.diff(table.values)).max())
        rounding = units.eps * (3.0 * table.values.size * rise + 4.0)
        error = np.abs(values.astype(np.float64) - magic_formula(tyre, x.astype(np.float64)))
        assert error.max() <= table.error + rounding
        assert error.max() >= 0.9 * table.error, "the bound is not far above the error"
        assert np.array_equal(values, -mirrored)
    special = special_values(units.real)
    for values in units.curves(special):
        assert np.isfinite(values).all()
        assert (np.abs(values) <= 1.0).all()
        assert (values[np.isnan(special) | (special == 0.0)] == 0.0).all()


def check_curves_at_their_ends(units: Units) -> None:
    """At the end of its table and beyond, a curve has the table's last value; just before, the one but last cell is over."""
    tyres, real = AxleTyres.from_config(units.config), units.real
    last = real(ARGUMENT_MAX)
    near = np.array([last, np.nextafter(last, real(0.0)), np.nextafter(last, real(math.inf)), 2.0 * last, math.inf], dtype=real)
    for tyre, values in zip((tyres.front, tyres.rear), units.curves(near), strict=True):
        end, rise = tabulate(tyre).values[-1], abs(np.diff(tabulate(tyre).values)[-1])
        # The position rounds by three units of the number of cells, worth a cell's rise each; the rest by four units.
        assert (np.abs(values - end) <= units.eps * (3.0 * tabulate(tyre).values.size * rise + 4.0)).all()
