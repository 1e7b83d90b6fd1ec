"""A CasADi SX function as C99 in stages and for many lanes: each operation runs only when one of its arguments has changed.

Each operation belongs to the first stage that knows everything it depends on. What later stages need of an earlier one is held
in an array between them; to divide by a number of an earlier stage, its reciprocal is taken there, once.

Every number is one of a row over lanes, `name[index].at[lane]`: the lines of a stage are the body of a loop over `lane`, which
the compiler turns into vectors. Calls of the mathematical library that do not wait for each other stand together, so that the
processor works on them at the same time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from codegen.emit.casadi_c import LIBRARY, constant_text, expression_text
from codegen.emit.text import literal


@dataclass(frozen=True)
class Stage:
    """Code of one stage, which runs when its arguments have changed.

    Attributes:
        name: of the stage.
        body: lines of C, of a loop over `lane`.
        held: how many rows it leaves for later stages, in the array `held_<name>`.
    """

    name: str
    body: tuple[str, ...]
    held: int


@dataclass(frozen=True)
class _Value:
    """A result.

    Attributes:
        stage: where it is known; -1: always.
        text: its name there.
        depth: the most library calls on a way to it within its stage.
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
    """The stages as they grow."""

    names: Sequence[str]
    indent: str
    lines: list[list[_Line]] = field(default_factory=list)
    held: list[dict[str, str]] = field(default_factory=list)
    reciprocals: dict[str, _Value] = field(default_factory=dict)
    count: int = 0

    def define(self, stage: int, expression: str, depth: int, is_call: bool = False) -> _Value:
        """A new constant of a stage."""
        name = f"t{self.count}"
        self.count += 1
        self.lines[stage].append(_Line(depth, is_call, f"{self.indent}const double {name} = {expression};"))
        return _Value(stage, name, depth + is_call)

    def seen_from(self, stage: int, value: _Value) -> str:
        """The value as text in a stage; held in an array where it is a result of an earlier one."""
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
        """A result of the function, in the last stage."""
        last = len(self.names) - 1
        depth = value.depth if value.stage == last else 0
        self.lines[last].append(_Line(depth, False, f"{self.indent}{target} = {self.seen_from(last, value)};"))

    def finished(self) -> list[Stage]:
        """The stages, each in the order of the depth of its lines; a result comes before what is made of it."""
        ordered = [sorted(lines, key=lambda line: (line.depth, line.is_call)) for lines in self.lines]
        return [
            Stage(name, tuple(line.text for line in lines), len(held))
            for name, lines, held in zip(self.names, ordered, self.held, strict=True)
        ]


def staged_body(function: Any, stages: Mapping[str, Sequence[str]], indent: str = "        ") -> list[Stage]:
    """The stages of an SX function in double precision; the last one writes the results to arrays named as the outputs.

    Args:
        function: with column vectors as arguments.
        stages: name of the stage -> the arguments that are known from it on, in the order in which the stages run.
        indent: of each line.

    Raises:
        ValueError: the function uses an operation that has no C here, or `stages` does not name each argument once.
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
