"""The C printer of CasADi functions: every operation compared with the CasADi virtual machine, in double precision.

`tests.sil.suite_dynamics` tests the printed dynamics in both precisions.
"""

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from codegen.arrays import FloatArray
from codegen.emit.casadi_c import function_body
from codegen.sil.compile import Library, compile_library

X = ca.SX.sym("x", 3)
"""Arguments of every expression: two numbers of any sign and one nonnegative number."""
A, B, P = X[0], X[1], X[2]

EXACT: dict[str, Any] = {
    **{"add": A + B, "subtract": A - B, "multiply": A * B, "divide": A / B, "negate": -A, "square": A**2, "twice": 2 * A},
    **{"invert": 1 / A, "minimum": ca.fmin(A, B), "maximum": ca.fmax(A, B)},
    **{"less_or_equal": A <= B, "greater_or_equal": A >= B},
    **{"input": ca.SX(A), "constant": ca.SX(-0.1), "times_negative_constant": -1.7e-3 * A},
    "negative_of_negative": -(ca.SX(-2.5) - A),
}
"""Operations that IEEE 754 rounds correctly, or not at all."""
LIBRARY: dict[str, Any] = {"sine": ca.sin(A), "cosine": ca.cos(A), "arctangent": ca.atan(A)}


def function_of(expression: Any, name: str = "f") -> Any:
    return ca.Function(name, [X], [ca.densify(ca.SX(expression))], ["x"], ["y"])


def compiled(functions: dict[str, Any]) -> Library:
    """Return a library of C functions `name(const double *x, double *y, int count)` over rows of arguments."""
    header, source = [], ['#include "sample.h"', "#include <math.h>"]
    for name, function in functions.items():
        size_in, size_out = function.numel_in(0), function.numel_out(0)
        one, every = (f"{of}_{name}(const double *x, double *y" for of in ("static void one", "void at"))
        header.append(f"{every}, int count);")
        source += [f"{one})", "{", "    (void)x;", *function_body(function, "double"), "}"]
        call = f"one_{name}(&x[k * {size_in}], &y[k * {size_out}]);"
        source += [f"{every}, int count)", "{", f"    for (int k = 0; k < count; k++) {call}", "}"]
    sources = {"include/sample.h": "\n".join(header) + "\n", "sample.c": "\n".join(source) + "\n"}
    return compile_library("printed", sources, ["include/sample.h"])


@pytest.fixture(scope="module")
def library() -> Library:
    return compiled({name: function_of(expression) for name, expression in (EXACT | LIBRARY).items()})


def call(library: Library, name: str, x: FloatArray, size_out: int = 1) -> FloatArray:
    """Return the rows of results of a compiled function."""
    result, ffi = np.empty((len(x), size_out)), library.ffi
    given = ffi.from_buffer("double[]", np.ascontiguousarray(x))
    getattr(library.lib, f"at_{name}")(given, ffi.from_buffer("double[]", result, require_writable=True), len(x))
    return result


def arguments() -> FloatArray:
    """Return numbers of ten decades and both signs, pairs of equal ones, and zeros.

    The zeros have one sign, because the standard does not define which zero a minimum of two returns.
    """
    rng = np.random.default_rng(5)
    x = rng.normal(size=(2_000, 3)) * 10.0 ** rng.uniform(-5.0, 5.0, size=(2_000, 3))
    x[::10, 1] = x[::10, 0]
    x[1::40, 0] = 0.0
    x[2::40, 1] = 0.0
    x[:, 2] = np.abs(x[:, 2])
    return x


def machine(expression: Any, x: npt.NDArray[Any]) -> FloatArray:
    """Return the rows of results of the CasADi virtual machine."""
    return np.array(function_of(expression).map(len(x))(x.T)).T


def same_bits(left: npt.NDArray[Any], right: npt.NDArray[Any]) -> bool:
    """Return whether two arrays are equal, including the sign of zeros; any NaN equals another."""
    return bool(np.array_equal(left, right, equal_nan=True) and np.array_equal(np.signbit(left), np.signbit(right)))


@pytest.mark.parametrize("name", [*EXACT, *LIBRARY])
def test_an_operation_has_the_bits_of_the_machine(library: Library, name: str) -> None:
    x = arguments()
    assert same_bits(call(library, name, x), machine((EXACT | LIBRARY)[name], x))


def test_overwritten_and_shared_registers_keep_their_values() -> None:
    """CasADi reuses its work registers, and may store an output early."""
    s = A * B
    t = ca.sin(s) + P
    matrix = ca.vertcat(ca.horzcat(s, t, s + t), ca.horzcat(t * t, 1.5, s - t))
    matrix[0, 1] = A
    x = arguments()
    library = compiled({"matrix": function_of(matrix)})
    function = function_of(matrix)  # column-major results
    expected = np.array([np.array(function(row)).ravel(order="F") for row in x[:200]])
    assert same_bits(call(library, "matrix", x[:200], 6), expected)


def test_an_operation_without_a_c_form_and_a_constant_that_is_not_finite_are_refused() -> None:
    for expression in (ca.tan(A), ca.fabs(A), ca.atan2(A, B), ca.eq(A, B), A < B, ca.sqrt(P), P**B, P**2.5):
        with pytest.raises(ValueError, match="no C form"):
            function_body(function_of(expression), "single")
    for constant, precision in ((np.inf, "double"), (-np.inf, "single"), (np.nan, "single"), (1e300, "single")):
        with pytest.raises(ValueError, match="no finite"):
            function_body(function_of(A * constant), precision)
