"""Rounding error bounds in single precision: running error analysis of a CasADi function.

N. J. Higham, Accuracy and Stability of Numerical Algorithms, section 3.3: each value carries an error bound, which grows by the
derivatives of each operation and by that operation's own rounding.
"""

from typing import Any

import casadi as ca
import numpy as np

from codegen.arrays import FloatArray

Bounded = tuple[FloatArray, FloatArray]
"""Values and the bounds of their errors."""

ROUNDING = 2.0**-24
"""Largest relative error of one rounding to single precision."""


def rounding_bounds(function: Any, *inputs: FloatArray) -> list[FloatArray]:
    """Return bounds of the errors, (n, elements) for each output; inputs (n, elements) are exact in single precision."""
    count = len(inputs[0])
    work: dict[int, Bounded] = {}
    results = [np.empty((count, function.nnz_out(k))) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        operation, source, target = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            results[target[0]][:, target[1]] = work[source[0]][1]
        elif operation == ca.OP_INPUT:
            work[target[0]] = inputs[source[0]][:, source[1]], np.zeros(count)
        elif operation == ca.OP_CONST:
            constant = np.full(count, function.instruction_constant(k))
            work[target[0]] = constant, np.abs(constant) * ROUNDING
        else:
            work[target[0]] = _propagated(operation, work[source[0]], work[source[-1]])
    return results


def _propagated(operation: int, first: Bounded, second: Bounded) -> Bounded:
    (a, of_a), (b, of_b) = first, second
    roundings = 1
    if operation == ca.OP_NEG:
        return -a, of_a
    if operation == ca.OP_TWICE:
        return 2.0 * a, 2.0 * of_a
    if operation in (ca.OP_ADD, ca.OP_SUB):
        result, error = (a + b if operation == ca.OP_ADD else a - b), of_a + of_b
    elif operation in (ca.OP_MUL, ca.OP_SQ):
        result, error = a * b, np.abs(a) * of_b + np.abs(b) * of_a + of_a * of_b
    elif operation == ca.OP_DIV:
        result = a / b
        error = (of_a + np.abs(result) * of_b) / (np.abs(b) - of_b)
    elif operation == ca.OP_INV:
        result = 1.0 / a
        error = np.abs(result) * of_a / (np.abs(a) - of_a)
    else:
        # The C library's functions are accurate to one unit in the last place, which is two roundings.
        roundings = 2
        if operation in (ca.OP_SIN, ca.OP_COS):
            result, error = (np.sin(a) if operation == ca.OP_SIN else np.cos(a)), of_a
        elif operation == ca.OP_ATAN:
            result, error = np.arctan(a), of_a / (1.0 + np.maximum(np.abs(a) - of_a, 0.0) ** 2)
        else:
            raise AssertionError(f"operation {operation} has no rule here")
    return result, error + (np.abs(result) + error) * roundings * ROUNDING
