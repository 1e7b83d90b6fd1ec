"""The vehicle's equations in C against CasADi's own machine: within the rounding of single precision, to the bit in double."""

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from codegen.config import Config
from codegen.sil.software import Software
from codegen.vehicle.dynamics import TyreModel, single_track
from tests.sil.case import Case

FloatArray = npt.NDArray[np.float64]
MODELS: tuple[TyreModel, ...] = ("linear", "magic-formula")
POINTS = 250
HALF_ULP = 2.0**-24
"""Largest relative error of one rounding to float32."""


def rounding_bounds(function: Any, *inputs: FloatArray) -> list[FloatArray]:
    """Return how far float32 may be from the exact value, (n, elements) for each output; inputs (n, elements) are float32.

    Running error analysis (N. J. Higham, Accuracy and Stability of Numerical Algorithms, section 3.3): along with each value
    goes a bound of its error, which grows by the derivative of each operation and by its own rounding; library functions
    count with one unit in the last place.
    """
    count = len(inputs[0])
    value: dict[int, FloatArray] = {}
    error: dict[int, FloatArray] = {}
    results = [np.empty((count, function.nnz_out(k))) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, source, target = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            results[target[0]][:, target[1]] = error[source[0]]
        elif operation == ca.OP_INPUT:
            value[target[0]], error[target[0]] = inputs[source[0]][:, source[1]], np.zeros(count)
        elif operation == ca.OP_CONST:
            constant = function.instruction_constant(k)
            value[target[0]], error[target[0]] = np.full(count, constant), np.full(count, abs(constant) * HALF_ULP)
        else:
            value[target[0]], error[target[0]] = _propagated(operation, [(value[s], error[s]) for s in source])
    return results


def _propagated(operation: int, arguments: list[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    (a, ea), (b, eb) = arguments[0], arguments[-1]
    if operation == ca.OP_NEG:
        return -a, ea
    if operation == ca.OP_TWICE:
        return 2.0 * a, 2.0 * ea
    if operation in (ca.OP_ADD, ca.OP_SUB):
        result, grown = (a + b if operation == ca.OP_ADD else a - b), ea + eb
    elif operation in (ca.OP_MUL, ca.OP_SQ):
        result, grown = a * b, np.abs(a) * eb + np.abs(b) * ea + ea * eb
    elif operation == ca.OP_DIV:
        result = a / b
        grown = (ea + np.abs(result) * eb) / (np.abs(b) - eb)
    elif operation == ca.OP_INV:
        result = 1.0 / a
        grown = np.abs(result) * ea / (np.abs(a) - ea)
    elif operation in (ca.OP_SIN, ca.OP_COS):
        result = np.sin(a) if operation == ca.OP_SIN else np.cos(a)
        return result, ea + (np.abs(result) + ea) * 2.0 * HALF_ULP
    elif operation == ca.OP_ATAN:
        result = np.arctan(a)
        grown = ea / (1.0 + np.maximum(np.abs(a) - ea, 0.0) ** 2)
        return result, grown + (np.abs(result) + grown) * 2.0 * HALF_ULP
    else:
        raise AssertionError(f"operation {operation} has no rule here")
    return result, grown + (np.abs(result) + grown) * HALF_ULP


def dynamics_points(count: int) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """States and inputs of a car that is driven, or slides."""
    rng = np.random.default_rng(6)
    x = rng.normal(size=(count, 2)) * [0.06, 0.4]
    u = np.column_stack([rng.uniform(1.0, 60.0, count), rng.normal(size=(count, 2)) * 0.08, rng.uniform(0.1, 1.2, count)])
    return x.astype(np.float32), u.astype(np.float32)


def generated(software: Software, name: str, x: npt.NDArray[Any], u: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Rows of the generated function's results; a Jacobian as 2 x (2 + 4) by rows."""
    function = software.function(f"dynamics_{name}")
    state, given = software.new("dynamics_state"), software.new("dynamics_input")
    rows = []
    for point, values in zip(x, u, strict=True):
        state.sideslip_angle, state.yaw_rate = point
        given.speed, given.front_angle, given.rear_angle, given.friction = values
        result = function(state, given)
        if name.endswith("jacobian"):
            rows.append([*result.state[0], *result.input[0], *result.state[1], *result.input[1]])
        else:
            rows.append([result.sideslip_angle, result.yaw_rate])
    return np.array(rows)


def by_rows(dfdx: Any, dfdu: Any) -> FloatArray:
    """CasADi's column-major elements in the order of `generated`; each (n, elements)."""
    return np.hstack([dfdx[:, 0::2], dfdu[:, 0::2], dfdx[:, 1::2], dfdu[:, 1::2]])


def as_double(*arrays: npt.NDArray[Any]) -> list[FloatArray]:
    return [array.astype(np.float64) for array in arrays]


def machine_derivative(config: Config, tyre_model: TyreModel, x: npt.NDArray[Any], u: npt.NDArray[Any]) -> FloatArray:
    x, u = as_double(x, u)
    return np.array(single_track(config, tyre_model).derivative.map(len(x))(x.T, u.T)).T


def machine_jacobian(config: Config, tyre_model: TyreModel, x: npt.NDArray[Any], u: npt.NDArray[Any]) -> FloatArray:
    function = single_track(config, tyre_model).jacobian
    pairs = [function(point, values) for point, values in zip(*as_double(x, u), strict=True)]
    dfdx, dfdu = (np.array([np.array(pair[k]).ravel(order="F") for pair in pairs]) for k in (0, 1))
    return by_rows(dfdx, dfdu)


def _known(case: Case) -> list[tuple[str, Any, Any]]:
    """Return the name of each function, what the machine gives and how far rounding may be from it."""
    config, (x, u) = case.built.software.config, dynamics_points(POINTS)
    wide = as_double(x, u)
    known = []
    for model in MODELS:
        functions, name = single_track(config, model), model.replace("-", "_")
        (bound,) = rounding_bounds(functions.derivative, *wide)
        both = by_rows(*rounding_bounds(functions.jacobian, *wide))
        for wanted, most, tight, what in ((machine_derivative(config, model, x, u), bound, 3e-6, ""),
                                          (machine_jacobian(config, model, x, u), both, 6e-5, "_jacobian")):  # fmt: skip
            # 6e-5 where lf Cf and lr Cr nearly cancel, in the car's neutral balance; 1.1e-5 elsewhere.
            assert (most.max(axis=0) <= tight * np.abs(wanted).max(axis=0)).all(), "the bound says something"
            known.append((name + what, wanted, most if case.built.real is np.float32 else 0.0))
    return known


def check_dynamics(case: Case) -> None:
    """Values and Jacobians of both tyres are the machine's, and a speed below one counts as one."""
    if "dynamics" not in case.known:
        case.known["dynamics"] = _known(case)
    x, u = dynamics_points(POINTS)
    for name, wanted, bound in case.known["dynamics"]:
        assert (np.abs(generated(case.built.software, name, x, u) - wanted) <= bound).all(), name
        slow = u[:20].copy()
        found = {}
        for speed in (1.0, 0.999, 0.1, 0.0, -0.0, -20.0, -np.inf, np.nan, 1.001):
            slow[:, 0] = speed
            found[speed] = generated(case.built.software, name, x[:20], slow)
        faster = found.pop(1.001)
        assert all(np.array_equal(values, found[1.0]) for values in found.values()), name
        assert not (faster == found[1.0]).all(axis=1).any(), name
