"""Print a CasADi SX function as C99, instruction by instruction.

CasADi's own generator prints double literals and double libm names whatever `casadi_real` is. On a single-precision FPU that
requires a soft-float library. This printer emits straight-line code in one precision. Each instruction becomes one constant,
and every literal has the suffix of its type. Minimum and maximum become comparisons, so the only library functions are sin,
cos and atan. The tests compare the code with the CasADi virtual machine.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from codegen.emit.text import Precision, c_type, literal

LIBRARY = {ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_ATAN: "atan"}
_BINARY = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/"}


def function_body(function: Any, precision: Precision, indent: str = "    ") -> list[str]:
    """Return lines of C that evaluate an SX function.

    The arguments are arrays with the names of the function's inputs (matrices in column-major order). The results are written
    to arrays with the names of its outputs. The lines declare one `const` for each intermediate result, so they need a block
    of their own.

    Raises:
        ValueError: the function uses an operation that this printer does not support.
    """
    real = c_type(precision)
    value: dict[int, str] = {}
    lines: list[str] = []
    stores: list[str] = []
    count = 0
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        arguments = function.instruction_input(k)
        results = function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            stores.append(f"{indent}{function.name_out(results[0])}[{results[1]}] = {value[arguments[0]]};")
            continue
        if operation == ca.OP_CONST:
            value[results[0]] = constant_text(function.instruction_constant(k), precision)
            continue
        if operation == ca.OP_INPUT:
            value[results[0]] = f"{function.name_in(arguments[0])}[{arguments[1]}]"
            continue
        expression = expression_text(operation, [value[argument] for argument in arguments], precision)
        name = f"t{count}"
        count += 1
        lines.append(f"{indent}const {real} {name} = {expression};")
        value[results[0]] = name
    return [*lines, *stores]


def constant_text(number: float, precision: Precision) -> str:
    """Return a constant as an operand."""
    text = literal(number, precision)
    return f"({text})" if text.startswith("-") else text


def expression_text(operation: int, arguments: list[str], precision: Precision) -> str:
    """Return one CasADi operation on operands as C. Raises ValueError if the operation is not supported."""
    suffix = "f" if precision == "single" else ""
    zero, one, two = (literal(number, precision) for number in (0.0, 1.0, 2.0))
    first = arguments[0]
    second = arguments[1] if len(arguments) > 1 else ""
    if operation in _BINARY:
        return f"{first} {_BINARY[operation]} {second}"
    if operation in LIBRARY:
        return f"{LIBRARY[operation]}{suffix}({first})"
    simple = {
        ca.OP_NEG: f"-{first}",
        ca.OP_SQ: f"{first} * {first}",
        ca.OP_TWICE: f"{two} * {first}",
        ca.OP_INV: f"{one} / {first}",
        ca.OP_FMIN: f"({first} < {second}) ? {first} : {second}",
        ca.OP_FMAX: f"({first} > {second}) ? {first} : {second}",
        ca.OP_LE: f"({first} <= {second}) ? {one} : {zero}",
    }
    if operation not in simple:
        raise ValueError(f"CasADi operation {operation} has no C form here")
    return simple[operation]
