"""The printer of CasADi functions: every operation against the CasADi virtual machine, in both precisions."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from codegen.config import Config, parse
from codegen.emit.casadi_c import function_body
from codegen.emit.text import Precision, c_type, numpy_type
from codegen.sil.compile import Library, compile_library
from codegen.sil.software import Software
from codegen.vehicle.dynamics import TyreModel, single_track, two_track
from tests import builds

FloatArray = npt.NDArray[np.float64]
PRECISIONS: tuple[Precision, ...] = ("single", "double")

X = ca.SX.sym("x", 3)
"""Arguments of every expression here: two numbers of any sign and one that is not negative."""
A, B, P = X[0], X[1], X[2]

EXACT: dict[str, Any] = {
    "add": A + B,
    "subtract": A - B,
    "multiply": A * B,
    "divide": A / B,
    "negate": -A,
    "square": A**2,
    "twice": 2 * A,
    "invert": 1 / A,
    "square_root": ca.sqrt(P),
    "less": A < B,
    "less_or_equal": A <= B,
    "greater_or_equal": A >= B,
    "minimum": ca.fmin(A, B),
    "maximum": ca.fmax(A, B),
    "not": ca.logic_not(A < B),
    "choose": ca.if_else(A < B, P, B),
    "not_of_a_number": ca.logic_not(A),
    "choose_by_a_number": ca.if_else(A, P, B),
    "input": ca.SX(A),
    "constant": ca.SX(-0.1),
    "times_negative_constant": -1.7e-3 * A,
    "negative_of_negative": -(ca.SX(-2.5) - A),
}
"""Operations that IEEE 754 rounds correctly, or not at all. Any number but zero is true, negative ones too."""
LIBRARY: dict[str, Any] = {"sine": ca.sin(A), "cosine": ca.cos(A), "arctangent": ca.atan(A)}


def function_of(expression: Any, name: str = "f") -> Any:
    return ca.Function(name, [X], [ca.densify(ca.SX(expression))], ["x"], ["y"])


def compiled(functions: dict[str, Any], precision: Precision) -> Library:
    """C functions `name(const real *x, real *y, int count)` over rows of arguments."""
    real = c_type(precision)
    header, source = [], ['#include "sample.h"', "#include <math.h>"]
    for name, function in functions.items():
        size_in, size_out = function.numel_in(0), function.numel_out(0)
        header.append(f"void at_{name}(const {real} *x, {real} *y, int count);")
        source += [
            f"static void one_{name}(const {real} *x, {real} *y)",
            "{",
            "    (void)x;",
            *function_body(function, precision),
            "}",
            f"void at_{name}(const {real} *x, {real} *y, int count)",
            "{",
            "    int k;",
            "    for (k = 0; k < count; k++) {",
            f"        one_{name}(&x[k * {size_in}], &y[k * {size_out}]);",
            "    }",
            "}",
        ]
    sources = {"include/sample.h": "\n".join(header) + "\n", "sample.c": "\n".join(source) + "\n"}
    return compile_library(f"printed_{precision}", sources, ["include/sample.h"])


@pytest.fixture(scope="module")
def paper() -> Config:
    return builds.CONFIG


@pytest.fixture(scope="module")
def software() -> Software:
    return builds.paper().software


@pytest.fixture(scope="module")
def libraries() -> dict[Precision, Library]:
    functions = {name: function_of(expression) for name, expression in (EXACT | LIBRARY).items()}
    return {precision: compiled(functions, precision) for precision in PRECISIONS}


def call(library: Library, name: str, x: npt.NDArray[Any], size_out: int = 1) -> npt.NDArray[Any]:
    """Rows of results of a compiled function."""
    result = np.empty((len(x), size_out), dtype=x.dtype)
    pointer = "float *" if x.dtype == np.float32 else "double *"
    ffi = library.ffi
    x = np.ascontiguousarray(x)
    getattr(library.lib, f"at_{name}")(
        ffi.cast(pointer, ffi.from_buffer(x)), ffi.cast(pointer, ffi.from_buffer(result, require_writable=True)), len(x)
    )
    return result


def arguments(precision: Precision, seed: int = 5) -> npt.NDArray[Any]:
    """Numbers of ten decades and both signs, pairs of equal ones, zeros (of one sign: which zero a minimum of two takes is
    left open by the standard)."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(2_000, 3)) * 10.0 ** rng.uniform(-5.0, 5.0, size=(2_000, 3))
    x[::10, 1] = x[::10, 0]
    x[1::40, 0] = 0.0
    x[2::40, 1] = 0.0
    x[:, 2] = np.abs(x[:, 2])
    return x.astype(numpy_type(precision))


def machine(expression: Any, x: npt.NDArray[Any]) -> FloatArray:
    """The CasADi virtual machine over rows, in double."""
    return np.array(function_of(expression).map(len(x))(x.T.astype(np.float64))).T


def same_bits(left: npt.NDArray[Any], right: npt.NDArray[Any]) -> bool:
    """Equal as numbers, and zeros of equal sign; any NaN is as good as another."""
    return bool(np.array_equal(left, right, equal_nan=True) and np.array_equal(np.signbit(left), np.signbit(right)))


# --- operations ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*EXACT, *LIBRARY])
def test_double_has_the_bits_of_the_machine(libraries: dict[Precision, Library], name: str) -> None:
    x = arguments("double")
    assert same_bits(call(libraries["double"], name, x), machine((EXACT | LIBRARY)[name], x))


@pytest.mark.parametrize("name", EXACT)
def test_single_is_the_machine_rounded_once(libraries: dict[Precision, Library], name: str) -> None:
    """One operation on float32 arguments, done in double and rounded to float32, is the float32 operation itself: 53 digits are
    more than twice 24 plus two. Constants are rounded before."""
    x = arguments("single")
    if name == "times_negative_constant":
        expected = (np.float32(-1.7e-3) * x[:, :1]).astype(np.float32)
    else:
        with np.errstate(over="ignore"):
            expected = machine(EXACT[name], x).astype(np.float32)
    assert same_bits(call(libraries["single"], name, x), expected)


@pytest.mark.parametrize("name", LIBRARY)
def test_single_calls_the_single_function(libraries: dict[Precision, Library], name: str) -> None:
    x = arguments("single")
    expected = machine(LIBRARY[name], x)
    # One unit in the last place: the mathematical libraries in use promise less than that, not correct rounding.
    ulp = np.spacing(np.abs(expected).astype(np.float32)).astype(np.float64)
    assert np.all(np.abs(call(libraries["single"], name, x) - expected) <= ulp)


def test_every_operation_of_the_models_is_tested_here(paper: Config) -> None:
    def operations(function: Any) -> set[int]:
        return {function.instruction_id(k) for k in range(function.n_instructions())}

    tested = set().union(*(operations(function_of(expression)) for expression in (EXACT | LIBRARY).values()))
    loaded = parse({"tyre": {"front": {"stiffness_factor_b_per_rad": 18.0, "peak_load_sensitivity_p2": -0.1}}}, "test")
    for config in (paper, loaded):
        for model in (single_track(config, "linear"), single_track(config, "magic-formula"), two_track(config)):
            functions = [model.derivative, model.jacobian, *([] if model.output is None else [model.output])]
            assert set().union(*map(operations, functions)) <= tested


def test_values_that_are_overwritten_and_shared_keep_their_meaning() -> None:
    """CasADi reuses its work registers, and may store an output before it goes on."""
    s = A * B
    t = ca.sin(s) + P
    matrix = ca.vertcat(ca.horzcat(s, t, s + t), ca.horzcat(t * t, 1.5, s - t))
    matrix[0, 1] = A
    x = arguments("double")
    library = compiled({"matrix": function_of(matrix)}, "double")
    function = function_of(matrix)  # its results are stored by columns
    expected = np.array([np.array(function(row)).ravel(order="F") for row in x[:200]])
    assert same_bits(call(library, "matrix", x[:200], 6), expected)


# --- refusals ------------------------------------------------------------------------------------------------------

REFUSED: dict[str, Any] = {
    **{name: getattr(ca, name)(A) for name in ("tan", "asin", "acos", "exp", "log", "tanh", "fabs", "sign", "floor")},
    **{name: getattr(ca, name)(A, B) for name in ("atan2", "hypot", "fmod", "eq", "ne", "logic_and", "logic_or")},
    "power": P**B,
    "constant power": P**2.5,
}


@pytest.mark.parametrize("name", REFUSED)
def test_an_operation_without_a_c_form_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="no C form"):
        function_body(function_of(REFUSED[name]), "single")


@pytest.mark.parametrize(
    ("constant", "precision"), [(np.inf, "double"), (-np.inf, "single"), (np.nan, "single"), (1e300, "single")]
)
def test_a_constant_that_is_not_finite_is_refused(constant: float, precision: Precision) -> None:
    with pytest.raises(ValueError, match="no finite"):
        function_body(function_of(A * constant), precision)


# --- the generated dynamics ----------------------------------------------------------------------------------------


HALF_ULP = 2.0**-24
"""Largest relative error of one rounding to float32."""


def rounding_bounds(function: Any, *inputs: FloatArray) -> list[FloatArray]:
    """How far float32 may be from the exact value, (n, elements) for each output; inputs (n, elements) are exact in float32.

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


TYRE_MODELS = pytest.mark.parametrize("tyre_model", ["linear", "magic-formula"])


def c_name(tyre_model: TyreModel) -> str:
    return tyre_model.replace("-", "_")


@TYRE_MODELS
def test_generated_derivative_is_within_rounding_of_the_machine(
    software: Software, paper: Config, tyre_model: TyreModel
) -> None:
    x, u = dynamics_points(3_000)
    expected = machine_derivative(paper, tyre_model, x, u)
    (bound,) = rounding_bounds(single_track(paper, tyre_model).derivative, *as_double(x, u))
    assert np.all(np.abs(generated(software, c_name(tyre_model), x, u) - expected) <= bound)
    # The bound is tight: 3e-6 of the largest rate among these points, so 1e-4 rad/s for linear tyres at walking speed and
    # 1e-5 rad/s for those of the Magic Formula. Half of it is reached.
    assert np.all(bound.max(axis=0) < 3e-6 * np.abs(expected).max(axis=0))


@TYRE_MODELS
def test_generated_jacobian_is_within_rounding_of_the_machine(software: Software, paper: Config, tyre_model: TyreModel) -> None:
    x, u = dynamics_points(1_000)
    expected = machine_jacobian(paper, tyre_model, x, u)
    bound = by_rows(*rounding_bounds(single_track(paper, tyre_model).jacobian, *as_double(x, u)))
    assert np.all(np.abs(generated(software, f"{c_name(tyre_model)}_jacobian", x, u) - expected) <= bound)
    # 1.1e-5 of the largest value of an element; 5.4e-5 where lf Cf and lr Cr nearly cancel, in the car's neutral balance.
    assert np.all(bound.max(axis=0) <= 6e-5 * np.abs(expected).max(axis=0))


@TYRE_MODELS
def test_generated_code_in_double_has_the_bits_of_the_machine(paper: Config, tyre_model: TyreModel) -> None:
    software = builds.paper("double").software
    x, u = as_double(*dynamics_points(500))
    name = c_name(tyre_model)
    assert same_bits(generated(software, name, x, u), machine_derivative(paper, tyre_model, x, u))
    assert same_bits(generated(software, f"{name}_jacobian", x, u), machine_jacobian(paper, tyre_model, x, u))


@TYRE_MODELS
@pytest.mark.parametrize("what", ["", "_jacobian"])
def test_speeds_below_one_count_as_one(software: Software, tyre_model: TyreModel, what: str) -> None:
    name = c_name(tyre_model) + what
    x, u = dynamics_points(20)
    u[:, 0] = 1.0
    at_one = generated(software, name, x, u)
    for slower in (0.999, 0.1, 0.0, -0.0, -20.0, -np.inf, np.nan):
        u[:, 0] = slower
        assert same_bits(generated(software, name, x, u), at_one)
    u[:, 0] = np.float32(1.001)
    assert not np.any(np.all(generated(software, name, x, u) == at_one, axis=1))
