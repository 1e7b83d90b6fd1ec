"""Compare the vehicle dynamics on an emulated core with this machine, although their libraries differ in the last bits.

The core has a library of its own. First its results are checked to be within `LIBRARY_ULPS` units in the last place of this
machine's. The bound for each result of the dynamics is the sum, over all library calls, of its change on this machine if that
call is wrong by as much, plus `ROUNDING_ULPS` for different rounding. Results without library calls must be bit-identical.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from codegen.arrays import FloatArray
from codegen.emit.render import render
from codegen.emit.text import Precision, c_type, literal, numpy_type
from codegen.verify.emulated_batches import Batch, Program, Real, Rows, Runner, real_of

LIBRARY_ULPS = 4
"""Allowed difference of a library function, in units in the last place."""

ROUNDING_ULPS = 4

STATE_AND_INPUT = ((-0.3, 0.3), (-1.5, 1.5), (-5.0, 70.0), (-0.7, 0.7), (-0.15, 0.15), (0.1, 1.2))
"""Ranges of sideslip angle, yaw rate, speed, front angle, rear angle and friction, SI units."""

LARGEST_ARGUMENT = 3.0
"""Largest argument of sin and cos in the tyre curve: its shape factor times a right angle. That of atan is unbounded."""

SUPPORTED = frozenset({"sin", "cos", "atan"})
HALF_PI_REST = 6.123233995736765886130e-17
"""Difference between half of pi and its value in double precision."""


def library(precision: Precision) -> dict[str, bytes]:
    """Return sources of sin, cos and atan for a bare core, and their header."""
    half_pi = float(numpy_type(precision)(0.5 * math.pi))

    def number(value: float) -> str:
        return literal(value, precision)

    def horner(coefficients: Sequence[float], variable: str) -> str:
        text = number(coefficients[-1])
        for coefficient in coefficients[-2::-1]:
            text = f"({number(coefficient)} + ({variable} * {text}))"
        return text

    names = {name: f"{name}{'f' if precision == 'single' else ''}" for name in sorted(SUPPORTED)}
    context = {
        **names,
        "real": c_type(precision),
        "number": number,
        "horner": horner,
        "precision": precision,
        "two_over_pi": 2.0 / math.pi,
        "half_pi": half_pi,
        "half_pi_rest": (0.5 * math.pi - half_pi) + HALF_PI_REST,
    }
    header = "".join(f"{c_type(precision)} {name}({c_type(precision)});\n" for name in names.values())
    return {"bare/libm.c": render("verify/libm.c.j2", context), "bare/math.h": header.encode()}


def compare(
    program: Program, here: Runner, there: Runner, count: int, generator: np.random.Generator
) -> tuple[list[str], dict[str, float]]:
    """Run the dynamics on both machines at `count` random points.

    Return a line for each result beyond its bound, and JSON values: `points`; `library_ulps`, the largest difference of
    a library function in units in the last place; `share_of_bound`, that of a result as a fraction of its bound.
    """
    names = [column.name for column in program.batches["library"].outputs]
    apart = _library_apart(program, here, there, count, generator)
    findings = [
        f"{there.name}: {name} of the library is {ulps} units in the last place from that of {here.name}"
        for name, ulps in zip(names, apart.tolist(), strict=True)
        if ulps > LIBRARY_ULPS
    ]
    batch = program.batches["dynamics"]
    rows = points(program, batch, count, generator)
    first = here.run(batch, rows)
    real = real_of(program.word)
    own, other = (_numbers(words, real) for words in (first, there.run(batch, rows)))
    bound = _bound(batch, rows, own, here, int(first[:, -1].max()), real)
    with np.errstate(invalid="ignore", divide="ignore"):
        difference = np.abs(own - other)
        share = np.where(difference == 0.0, 0.0, difference / bound)
    share = np.where(np.isnan(share), np.inf, share)
    for row, column in np.argwhere(share > 1.0)[:1]:
        point = _numbers(rows[row, 2:], real)
        inputs = ", ".join(f"{name} = {value:.9g}" for name, value in zip(batch.inputs[2:], point, strict=True))
        findings.append(
            f"{there.name}: dynamics, {batch.outputs[column].name} is {other[row, column]:.9g} and {own[row, column]:.9g} on "
            f"{here.name}, further apart than {bound[row, column]:.3g}; {inputs}"
        )
    return findings, {
        "points": len(rows),
        "library_ulps": int(apart.max(initial=0)),
        "share_of_bound": float(share.max()),
    }


def points(program: Program, batch: Batch, count: int, generator: np.random.Generator) -> Rows:
    """Draw rows for the batch "dynamics"."""
    low, high = np.array(STATE_AND_INPUT).T
    drawn = generator.uniform(low, high, (count, len(low)))
    drawn[: count // 8] *= 1e-3  # where the tyres are linear
    rows = np.zeros((count, len(batch.inputs)), dtype=program.word)
    rows[:, 2:] = drawn.astype(real_of(program.word)).view(program.word)
    return rows


def _numbers(words: Rows, real: Real) -> FloatArray:
    """Convert words to numbers in double precision."""
    result: FloatArray = np.ascontiguousarray(words).view(real).astype(np.float64)
    return result


def _library_apart(program: Program, here: Runner, there: Runner, count: int, generator: np.random.Generator) -> Rows:
    """Largest difference of each function, units in the last place, (functions,)."""
    batch = program.batches["library"]
    large = generator.uniform(-LARGEST_ARGUMENT, LARGEST_ARGUMENT, 4 * count)
    small = generator.choice([-1.0, 1.0], count) * 10.0 ** generator.uniform(-6.0, 0.0, count)
    x = np.concatenate([large, small])
    words = x.astype(real_of(program.word)).view(program.word)[:, None]
    signed = np.int32 if program.word is np.uint32 else np.int64
    results = [runner.run(batch, words).view(signed) for runner in (here, there)]
    apart: Rows = np.abs(np.subtract(*results)).max(axis=0, initial=0)
    return apart


def _bound(batch: Batch, rows: Rows, own: FloatArray, here: Runner, calls: int, real: Real) -> FloatArray:
    """Return the bound of the difference of each result, (rows, outputs)."""
    bound = np.zeros(own.shape)
    for call in range(1, calls + 1):
        changes = []
        for ulps in (LIBRARY_ULPS, -LIBRARY_ULPS):
            wrong = rows.copy()
            wrong[:, 0], wrong[:, 1] = call, np.array(ulps).astype(rows.dtype)
            changes.append(np.abs(_numbers(here.run(batch, wrong), real) - own))
        bound += np.maximum(*changes)
    needs_library = bound.max(axis=0) > 0.0
    spacing = np.spacing(np.abs(own).astype(real)).astype(np.float64)
    result: FloatArray = bound + np.where(needs_library, ROUNDING_ULPS, 0.0) * spacing
    return result
