"""The printer of CasADi functions: every operation against the CasADi virtual machine, in both precisions.

The dynamics that it prints are judged by `tests.sil.suite_dynamics`.
"""

from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt
import pytest

from codegen.emit.casadi_c import function_body
from codegen.emit.text import Precision, c_type, numpy_type
from codegen.sil.compile import Library, compile_library

FloatArray = npt.NDArray[np.float64]
PRECISIONS: tuple[Precision, ...] = ("single", "double")

X = ca.SX.sym("x", 3)
"""Arguments of every expression here: two numbers of any sign and one that is not negative."""
A, B, P = X[0], X[1], X[2]

EXACT: dict[str, Any] = {
    **{"add": A + B, "subtract": A - B, "multiply": A * B, "divide": A / B, "negate": -A, "square": A**2, "twice": 2 * A},
    **{"invert": 1 / A, "square_root": ca.sqrt(P), "minimum": ca.fmin(A, B), "maximum": ca.fmax(A, B)},
    **{"less": A < B, "less_or_equal": A <= B, "greater_or_equal": A >= B, "not": ca.logic_not(A < B)},
    **{"not_of_a_number": ca.logic_not(A), "choose": ca.if_else(A < B, P, B), "choose_by_a_number": ca.if_else(A, P, B)},
    **{"input": ca.SX(A), "constant": ca.SX(-0.1), "times_negative_constant": -1.7e-3 * A},
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
        one, every = (f"{of}_{name}(const {real} *x, {real} *y" for of in ("static void one", "void at"))
        header.append(f"{every}, int count);")
        source += [f"{one})", "{", "    (void)x;", *function_body(function, precision), "}"]
        call = f"one_{name}(&x[k * {size_in}], &y[k * {size_out}]);"
        source += [f"{every}, int count)", "{", f"    for (int k = 0; k < count; k++) {call}", "}"]
    sources = {"include/sample.h": "\n".join(header) + "\n", "sample.c": "\n".join(source) + "\n"}
    return compile_library(f"printed_{precision}", sources, ["include/sample.h"])


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


@pytest.mark.parametrize("name", [*EXACT, *LIBRARY])
def test_double_has_the_bits_of_the_machine(libraries: dict[Precision, Library], name: str) -> None:
    x = arguments("double")
    assert same_bits(call(libraries["double"], name, x), machine((EXACT | LIBRARY)[name], x))


@pytest.mark.parametrize("name", [*EXACT, *LIBRARY])
def test_single_is_the_machine_rounded_once(libraries: dict[Precision, Library], name: str) -> None:
    """One operation on float32 arguments, done in double and rounded to float32, is the float32 operation itself: 53 digits are
    more than twice 24 plus two. Constants are rounded before. Functions of the libraries in use may be one unit in the
    last place off."""
    x = arguments("single")
    if name in LIBRARY:
        expected = machine(LIBRARY[name], x)
        ulp = np.spacing(np.abs(expected).astype(np.float32)).astype(np.float64)
        assert np.all(np.abs(call(libraries["single"], name, x) - expected) <= ulp)
        return
    if name == "times_negative_constant":
        expected = (np.float32(-1.7e-3) * x[:, :1]).astype(np.float32)
    else:
        with np.errstate(over="ignore"):
            expected = machine(EXACT[name], x).astype(np.float32)
    assert same_bits(call(libraries["single"], name, x), expected)


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


def test_an_operation_without_a_c_form_and_a_constant_that_is_not_finite_are_refused() -> None:
    for expression in (ca.tan(A), ca.fabs(A), ca.atan2(A, B), ca.eq(A, B), P**B, P**2.5):
        with pytest.raises(ValueError, match="no C form"):
            function_body(function_of(expression), "single")
    for constant, precision in ((np.inf, "double"), (-np.inf, "single"), (np.nan, "single"), (1e300, "single")):
        with pytest.raises(ValueError, match="no finite"):
            function_body(function_of(A * constant), precision)
