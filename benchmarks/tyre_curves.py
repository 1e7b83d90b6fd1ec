"""Ways to compute a tyre's curve, sin(C atan(x - E (x - atan x))), in C: the generated table, and what one would take instead.

Each is C with a function `float curve(float x)`, which takes any finite number. Polynomials are the best ones of their degree:
the coefficients, by linear programming, are those that make the largest error on a dense grid smallest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from codegen.arrays import FloatArray
from codegen.emit.text import literal
from codegen.verify.target import CORTEX_M4F, source_tree, zig

GRID = 400
COMPRESSIONS = (0.5, 1.0, 2.0, 4.0, 8.0)

GUARD = """float curve(float x);
float curve(float x)
{
    const float sign = (x < 0.0f) ? -1.0f : 1.0f;

    return sign * half(sign * x);
}
"""
"""Makes an odd function of one for what is not negative, as the generated one does."""

LIBM = """const std = @import("std");
export fn atanf(x: f32) f32 {
    return std.math.atan(x);
}
"""


@dataclass(frozen=True)
class Candidate:
    """A way to compute the curve.

    Attributes:
        name: for the table.
        sources: C and objects.
    """

    name: str
    sources: Mapping[str, str | bytes]


@dataclass(frozen=True)
class Shape:
    """The curve: factors C and E of the Magic Formula."""

    C: float
    E: float

    def __call__(self, x: FloatArray) -> FloatArray:
        """Evaluate in double precision."""
        result: FloatArray = np.sin(self.C * np.arctan(x - self.E * (x - np.arctan(x))))
        return result


def candidates(shape: Shape, files: Mapping[str, bytes], prefix: str = "ars") -> tuple[Candidate, ...]:
    """Return all approximations; `files` are a build with the curve as the table of its front tyre."""
    return (
        generated(files, prefix),
        *(_polynomial_of_place(shape, degree) for degree in (6, 8, 10)),
        Candidate("atan and sin by polynomials, 3 and 3 terms", _polynomials(shape, 3, 3)),
        Candidate("atan and sin by polynomials, 5 and 4 terms", _polynomials(shape, 5, 4)),
        Candidate("atan and sin by polynomials, 8 and 6 terms", _polynomials(shape, 8, 6)),
        Candidate("atanf and sinf of a libm (musl's, by Zig)", _library(shape)),
    )


def generated(files: Mapping[str, bytes], prefix: str = "ars") -> Candidate:
    """Return the table of the front tyre of a build whose car has a relaxation length."""
    call = "float curve(float x);\nfloat curve(float x)\n{\n    return front_curve(x);\n}\n"
    headers = {name: text for name, text in files.items() if name.startswith("include/")}
    source = files[f"src/{prefix}_reference_model.c"].decode("ascii") + call
    return Candidate("table in x/(x + c), as generated", {**headers, "curve.c": source})


def _library(shape: Shape) -> dict[str, str | bytes]:
    with source_tree({"libm.zig": LIBM}) as tree:
        _, triple, cpu = CORTEX_M4F.flags
        target = ["-target", triple, "-mcpu", cpu.removeprefix("-mcpu=")]
        zig(
            [
                "build-obj",
                "libm.zig",
                "-fcompiler-rt",
                "-ffunction-sections",
                "-fdata-sections",
                "-O",
                "ReleaseFast",
                *target,
                "-femit-bin=libm.o",
            ],
            tree,
        )
        library = (tree / "libm.o").read_bytes()
    text = f"""#include <math.h>
static float half(float x)
{{
    return sinf({_f(shape.C)} * atanf(({_f(1.0 - shape.E)} * x) + ({_f(shape.E)} * atanf(x))));
}}
"""
    return {"curve.c": text + GUARD, "libm.o": library}


def _polynomials(shape: Shape, atan_terms: int, sin_terms: int) -> dict[str, str | bytes]:
    end = shape.C * 0.5 * math.pi
    atan = _odd_fit(np.arctan, 1.0, atan_terms)
    sin = _odd_fit(np.sin, end, sin_terms)
    text = f"""static float arc(float x)
{{
    const float z = (x > 1.0f) ? (1.0f / x) : x;
    const float q = z * z;
    const float p = z * {_horner(atan, "q")};
    return (x > 1.0f) ? ({_f(0.5 * math.pi)} - p) : p;
}}
static float half(float x)
{{
    const float v = {_f(shape.C)} * arc(({_f(1.0 - shape.E)} * x) + ({_f(shape.E)} * arc(x)));
    const float q = v * v;
    return v * {_horner(sin, "q")};
}}
"""
    return {"curve.c": text + GUARD}


def _polynomial_of_place(shape: Shape, degree: int) -> Candidate:
    """Return a polynomial in s = x/(x + c) without constant term, with the best compression c."""
    s = 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, GRID))
    fits = []
    for compression in COMPRESSIONS:
        x = compression * s / np.maximum(1.0 - s, 1e-9)
        fits.append((*_fit(np.power.outer(s, np.arange(1, degree + 1)), shape(x)), compression))
    _, coefficients, compression = min(fits, key=lambda fit: fit[0])
    text = f"""static float half(float x)
{{
    const float s = x / (x + {_f(compression)});
    return s * {_horner(coefficients, "s")};
}}
"""
    return Candidate(f"polynomial in x/(x + c), degree {degree}", {"curve.c": text + GUARD})


def _odd_fit(function: np.ufunc, end: float, terms: int) -> FloatArray:
    x = end * (0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, GRID)))
    return _fit(np.power.outer(x, np.arange(1, 2 * terms, 2)), function(x))[1]


def _fit(basis: FloatArray, values: FloatArray) -> tuple[float, FloatArray]:
    """Return the smallest maximum error and its coefficients (n,), for a basis (m, n)."""
    ones = np.ones((len(values), 1))
    result = linprog(
        np.append(np.zeros(basis.shape[1]), 1.0),
        A_ub=np.block([[basis, -ones], [-basis, -ones]]),
        b_ub=np.concatenate([values, -values]),
        bounds=(None, None),
    )
    return float(result.x[-1]), result.x[:-1]


def _horner(coefficients: FloatArray, variable: str) -> str:
    text = _f(coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        text = f"({_f(coefficient)} + ({variable} * {text}))"
    return text


def _f(value: float) -> str:
    return literal(float(value), "single")
