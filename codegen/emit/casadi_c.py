"""Print a CasADi SX function as C99, instruction by instruction.

CasADi's own generator prints double literals and double libm names whatever `casadi_real` is. On a single-precision FPU that
requires a soft-float library. This printer emits straight-line code in one precision. Each instruction becomes one constant,
and every literal has the suffix of its type. Minimum and maximum become comparisons, so the only library functions are sin,
cos and atan. The tests compare the code with the CasADi virtual machine.

In stages and for many lanes, an operation runs only when one of its arguments has changed. Each operation belongs to the first
stage in which all its arguments are known. An array holds the results that later stages need. To divide by a result of an
earlier stage, that stage computes the reciprocal once. Every number is an element of a row over lanes, `name[index].at[lane]`.
The lines of a stage are the body of a loop over `lane`, which the compiler vectorises. Independent calls of the mathematical
library are adjacent, so that the processor can overlap them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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


def library_calls(function: Any, precision: Precision) -> set[str]:
    """Return the names of the mathematical functions that the C of an SX function calls."""
    operations = (function.instruction_id(k) for k in range(function.n_instructions()))
    return {LIBRARY[each] + ("f" if precision == "single" else "") for each in operations if each in LIBRARY}


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


@dataclass(frozen=True)
class Stage:
    """Code of one stage, which runs when its arguments have changed.

    Attributes:
        name: name of the stage.
        body: lines of C, the body of a loop over `lane`.
        held: number of rows in the array `held_<name>` that the stage computes for later stages.
    """

    name: str
    body: tuple[str, ...]
    held: int


@dataclass(frozen=True)
class _Value:
    """Result of an operation.

    Attributes:
        stage: index of the stage that computes it; -1 for a constant.
        text: C text of the value in that stage.
        depth: largest number of library calls on a path to the value within its stage.
    """

    stage: int
    text: str
    depth: int = 0


@dataclass(frozen=True)
class _Line:
    depth: int
    is_call: bool
    text: str


@dataclass
class _Printer:
    """Stages under construction."""

    names: Sequence[str]
    indent: str
    lines: list[list[_Line]] = field(default_factory=list)
    held: list[dict[str, str]] = field(default_factory=list)
    reciprocals: dict[str, _Value] = field(default_factory=dict)
    count: int = 0

    def define(self, stage: int, expression: str, depth: int, is_call: bool = False) -> _Value:
        """Add a constant to a stage and return it."""
        name = f"t{self.count}"
        self.count += 1
        self.lines[stage].append(_Line(depth, is_call, f"{self.indent}const double {name} = {expression};"))
        return _Value(stage, name, depth + is_call)

    def seen_from(self, stage: int, value: _Value) -> str:
        """Return a value as C text in a stage. A result of an earlier stage is stored in the array of held rows."""
        if value.stage in (-1, stage) or value.text.endswith("[lane]"):
            return value.text
        held = self.held[value.stage]
        if value.text not in held:
            held[value.text] = f"held_{self.names[value.stage]}[{len(held)}].at[lane]"
            self.lines[value.stage].append(_Line(value.depth, False, f"{self.indent}{held[value.text]} = {value.text};"))
        return held[value.text]

    def reciprocal(self, value: _Value) -> _Value:
        """Return the reciprocal of a value, in the stage of the value."""
        if value.text not in self.reciprocals:
            self.reciprocals[value.text] = self.define(value.stage, f"{literal(1.0, 'double')} / {value.text}", value.depth)
        return self.reciprocals[value.text]

    def operation(self, operation: int, arguments: list[_Value]) -> _Value:
        """Add one instruction."""
        stage = max(0, *(argument.stage for argument in arguments))
        if operation == ca.OP_DIV and -1 < arguments[1].stage < stage:
            arguments = [arguments[0], self.reciprocal(arguments[1])]
            operation = ca.OP_MUL
        depth = max(argument.depth for argument in arguments if argument.stage in (-1, stage))
        text = expression_text(operation, [self.seen_from(stage, argument) for argument in arguments], "double")
        return self.define(stage, text, depth, operation in LIBRARY)

    def store(self, target: str, value: _Value) -> None:
        """Assign a result of the function to `target` in the last stage."""
        last = len(self.names) - 1
        depth = value.depth if value.stage == last else 0
        self.lines[last].append(_Line(depth, False, f"{self.indent}{target} = {self.seen_from(last, value)};"))

    def finished(self) -> list[Stage]:
        """Return the stages, their lines sorted by depth. The sort is stable, so a value is defined before it is used."""
        ordered = [sorted(lines, key=lambda line: (line.depth, line.is_call)) for lines in self.lines]
        return [
            Stage(name, tuple(line.text for line in lines), len(held))
            for name, lines, held in zip(self.names, ordered, self.held, strict=True)
        ]


def staged_body(function: Any, stages: Mapping[str, Sequence[str]], indent: str = "        ") -> list[Stage]:
    """Return the stages of an SX function in double precision. The last stage writes the results to arrays with the names of
    the outputs.

    Args:
        function: SX function with column vectors as arguments.
        stages: name of each stage -> arguments that are known from that stage on. The stages run in this order.
        indent: indent of each line.

    Raises:
        ValueError: the function uses an unsupported operation, or `stages` does not name each argument once.
    """
    stage_of = {argument: index for index, arguments in enumerate(stages.values()) for argument in arguments}
    if sorted(function.name_in()) != sorted(argument for arguments in stages.values() for argument in arguments):
        raise ValueError(f"the stages do not name each of {', '.join(function.name_in())} once")
    printer = _Printer(tuple(stages), indent, [[] for _ in stages], [{} for _ in stages])
    value: dict[int, _Value] = {}
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        arguments, results = function.instruction_input(k), function.instruction_output(k)
        if operation == ca.OP_OUTPUT:
            printer.store(f"{function.name_out(results[0])}[{results[1]}].at[lane]", value[arguments[0]])
        elif operation == ca.OP_CONST:
            value[results[0]] = _Value(-1, constant_text(function.instruction_constant(k), "double"))
        elif operation == ca.OP_INPUT:
            name = function.name_in(arguments[0])
            value[results[0]] = _Value(stage_of[name], f"{name}[{arguments[1]}].at[lane]")
        else:
            value[results[0]] = printer.operation(operation, [value[argument] for argument in arguments])
    return printer.finished()
