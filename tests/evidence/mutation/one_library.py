"""One C source with every mutant of a unit, and the function that selects one by its number.

Each mutated function becomes a separate static function next to the original, and a function of the original name calls the
selected one. A mutated constant becomes a variable that the selection overwrites. Number 0 selects the original unit, so a unit
is compiled once for all of its mutants.
"""

import re
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

from pycparser import c_ast

from tests.evidence.mutation.mutants import Mutant
from tests.evidence.mutation.source import Unit, name_of, printed

SELECT = "mutant_select"
"""Name of the C function that selects a mutant: `void mutant_select(int number)`."""


def source_with(unit: Unit, mutants: Sequence[Mutant]) -> str:
    """Return the C of a unit with all of its mutants; mutant k of the sequence has number k + 1."""
    numbered: dict[int, list[tuple[int, Mutant]]] = defaultdict(list)
    for number, mutant in enumerate(mutants, 1):
        numbered[mutant.index].append((number, mutant))
    parts = [unit.includes, "static int mutant_number;\n"]
    selections: list[str] = []
    for index, node in enumerate(unit.nodes):
        if index not in numbered:
            parts.append(printed(node))
        elif isinstance(node, c_ast.FuncDef):
            parts.append(_function(node, numbered[index]))
        else:
            parts.append(_constant(node, numbered[index], selections))
    cases = "".join(f"    {line}\n" for line in selections)
    parts.append(
        f"void {SELECT}(int number);\nvoid {SELECT}(int number)\n{{\n    mutant_number = number;\n"
        f"    switch (number) {{\n{cases}    default: break;\n    }}\n}}\n"
    )
    return "".join(parts)


def _renamed(text: str, name: str, new: str) -> str:
    """Rename the definition of a top-level node: the first occurrence of its name."""
    return re.sub(rf"\b{name}\b", new, text, count=1)


def _static(text: str) -> str:
    return text if text.startswith("static ") else f"static {text}"


def _function(node: Any, numbered: Sequence[tuple[int, Mutant]]) -> str:
    name, text = name_of(node), printed(node)
    declarator = node.decl.type
    arguments = ", ".join(parameter.name for parameter in (declarator.args.params if declarator.args else ()) if parameter.name)
    is_void = isinstance(declarator.type, c_ast.TypeDecl) and declarator.type.type.names == ["void"]
    parts = [_static(_renamed(variant, name, f"{name}_mutant_{number}")) for number, variant in
             ((0, text), *((number, mutant.text) for number, mutant in numbered))]  # fmt: skip

    def call(number: int) -> str:
        calling = f"{name}_mutant_{number}({arguments});"
        return f"{calling} return;" if is_void else f"return {calling}"

    cases = "".join(f"    case {number}: {call(number)}\n" for number, _ in numbered)
    header = text.partition("\n{")[0]
    parts.append(f"{header}\n{{\n    switch (mutant_number) {{\n{cases}    default: {call(0)}\n    }}\n}}\n")
    return "".join(parts)


def _constant(node: Any, numbered: Sequence[tuple[int, Mutant]], selections: list[str]) -> str:
    name, text = name_of(node), printed(node)
    if "static" in node.storage:
        text = re.sub(r"\bconst ", "", text.partition("=")[0]) + "=" + text.partition("=")[2]
    else:  # its header declares it const; a writable section makes the change possible
        text = text.replace(" =", ' __attribute__((section(".data.mutants"))) =', 1)
    parts = [text]
    for number, mutant in numbered:
        parts.append(_static(_renamed(mutant.text, name, f"{name}_mutant_{number}")))
        selections.append(f"case {number}: __builtin_memcpy((void *)&{name}, &{name}_mutant_{number}, sizeof({name})); break;")
    return "".join(parts)
