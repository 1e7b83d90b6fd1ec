"""Mutants of a unit of C: each has one change of a kind that programmers make by mistake.

- relational: a boundary on the wrong side, a reversed comparison; - arithmetic: another operator, a lost sign; - constant: one
more, one less, half of a large one; a real number changed by 1 %, zero to one; - logical: "and" for "or", a lost condition, a
lost "not", a decision that is always taken; - deletion: a lost statement.

Tables (arrays of numbers only) and declarations are unchanged.
"""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

from pycparser import c_ast, c_generator

from tests.evidence.mutation.source import Unit, name_of, printed

RELATIONAL = {"<": ("<=", ">="), "<=": ("<", ">"), ">": (">=", "<="), ">=": (">", "<"), "==": ("!=",), "!=": ("==",)}
ARITHMETIC = {"+": "-", "-": "+", "*": "/", "/": "*", "%": "*", "<<": ">>", ">>": "<<", "&": "|", "|": "&", "^": "|"}
COMPOUND = {"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "|=": "&=", "&=": "|=", "<<=": ">>=", ">>=": "<<=", "^=": "|="}
STEPS = {"p++": "p--", "p--": "p++", "++": "--", "--": "++"}
LOGICAL = {"&&": "||", "||": "&&"}
LARGEST = re.compile(r"U?INT\d+_MAX")
NUMBER = re.compile(r"(0[xX][0-9a-fA-F]+|\d+)([uUlL]*)")
HALVED_FROM = 16
"""Smallest number that is halved; the mutants by one cover smaller ones."""


@dataclass(frozen=True)
class Key:
    """Name of a mutant, independent of the lines around it.

    It has the path of the unit; the function or the defined constant that contains the mutant; kind and change, such as
    "relational: < to <="; the changed code as printed; and a number from 1 for mutants that are otherwise equal.
    """

    path: str
    function: str
    operator: str
    text: str
    occurrence: int = 1

    @property
    def kind(self) -> str:
        """Relational, arithmetic, constant, logical or deletion."""
        return self.operator.partition(":")[0]


@dataclass(frozen=True, eq=False)
class Mutant:
    """One change of a unit: its name, the line of the original, and the index and C of the changed top-level node."""

    key: Key
    line: int
    index: int
    text: str

    def source(self, unit: Unit) -> str:
        """Return the C of the whole changed unit."""
        parts = [self.text if index == self.index else printed(node) for index, node in enumerate(unit.nodes)]
        return unit.includes + "".join(parts)


class _Change(NamedTuple):
    """A change of one attribute of a node: the old and new value, the operator, and the node shown in the mutant's name."""

    parent: Any
    name: str
    old: Any
    new: Any
    operator: str
    shown: Any

    def put(self, node: Any) -> None:
        attribute, _, index = self.name.partition("[")
        if index:
            getattr(self.parent, attribute)[int(index.rstrip("]"))] = node
        else:
            setattr(self.parent, attribute, node)


def mutants_of(unit: Unit) -> list[Mutant]:
    """Return every mutant of a unit, in source order."""
    found: list[Mutant] = []
    seen: Counter[tuple[str, str, str]] = Counter()
    for index, node in enumerate(unit.nodes):
        name = name_of(node)
        for change in _changes(node):
            text = " ".join(c_generator.CGenerator().visit(change.shown).split())
            seen[name, change.operator, text] += 1
            key = Key(unit.path, name, change.operator, text, seen[name, change.operator, text])
            change.put(change.new)
            mutated = printed(node)
            change.put(change.old)
            found.append(Mutant(key, change.old.coord.line, index, mutated))
    return found


def definitions(unit: Unit) -> tuple[str, ...]:
    """Return all definitions of a unit as printed."""
    return tuple(printed(node) for node in unit.nodes)


def _changes(top: Any) -> Iterator[_Change]:
    if isinstance(top, c_ast.FuncDef):
        yield from _inside(top, "body", top.body, top.body)
    elif isinstance(top, c_ast.Decl) and top.init is not None and not _is_table(top):
        yield from _inside(top, "init", top.init, top)


def _is_table(declaration: Any) -> bool:
    return isinstance(declaration.type, c_ast.ArrayDecl) and _is_numbers(declaration.init)


def _is_numbers(node: Any) -> bool:
    if isinstance(node, c_ast.InitList):
        return all(_is_numbers(item) for item in node.exprs)
    if isinstance(node, c_ast.UnaryOp):
        return _is_numbers(node.expr)
    return isinstance(node, c_ast.Constant)


UNCHANGED = ((c_ast.StructRef, "field"), (c_ast.Cast, "to_type"), (c_ast.NamedInitializer, "name"), (c_ast.Case, "expr"))
"""Parts of nodes that stay unchanged."""


def _inside(parent: Any, name: str, node: Any, shown: Any) -> Iterator[_Change]:
    """Yield changes of a node and its descendants; `shown` is the expression around a number, for the mutant's name."""
    for new, operator, of in _at(name, node, shown):
        yield _Change(parent, name, node, new, operator, of or node)
    if isinstance(node, c_ast.Decl):
        if node.init is not None and not _is_table(node):
            yield from _inside(node, "init", node.init, node)
        return
    around = shown if isinstance(node, c_ast.Constant | c_ast.ID | c_ast.Cast | c_ast.InitList | c_ast.ExprList) else node
    for each, child in node.children():
        if not any(isinstance(node, kind) and each.startswith(left) for kind, left in UNCHANGED):
            yield from _inside(node, each, child, around)


def _at(name: str, node: Any, shown: Any) -> Iterator[tuple[Any, str, Any]]:
    """Yield replacements of the node itself: new node, operator, and the node to show if it differs."""
    if isinstance(node, c_ast.BinaryOp):
        others = [("relational", new) for new in RELATIONAL.get(node.op, ())]
        others += [
            (kind, table[node.op]) for kind, table in (("arithmetic", ARITHMETIC), ("logical", LOGICAL)) if node.op in table
        ]
        for kind, new in others:
            yield c_ast.BinaryOp(new, node.left, node.right), f"{kind}: {node.op} to {new}", None
        if node.op in LOGICAL:
            yield node.right, "logical: left condition lost", None
            yield node.left, "logical: right condition lost", None
    elif isinstance(node, c_ast.UnaryOp):
        if node.op in ("-", "~", "!"):
            yield node.expr, f"{'logical' if node.op == '!' else 'arithmetic'}: {node.op} lost", None
        elif node.op in STEPS:
            new = STEPS[node.op]
            yield c_ast.UnaryOp(new, node.expr), f"arithmetic: {node.op.strip('p')} to {new.strip('p')}", None
    elif isinstance(node, c_ast.Assignment) and node.op in COMPOUND:
        new = COMPOUND[node.op]
        yield c_ast.Assignment(new, node.lvalue, node.rvalue), f"arithmetic: {node.op} to {new}", None
    elif isinstance(node, c_ast.Constant):
        for value in _other_numbers(node.value):
            yield c_ast.Constant(node.type, value), f"constant: {node.value} to {value}", shown
    elif isinstance(node, c_ast.ID) and LARGEST.fullmatch(node.name):
        for value in (f"({node.name} - 1)", f"({node.name} / 2)"):
            yield c_ast.ID(value), f"constant: {node.name} to {value}", shown
    elif isinstance(node, c_ast.TernaryOp):
        yield node.iftrue, "logical: always taken", None
        yield node.iffalse, "logical: never taken", None
    elif isinstance(node, c_ast.If):
        yield c_ast.If(c_ast.ID("1"), node.iftrue, node.iffalse), "logical: always taken", node.cond
    if _is_deletable(name, node) and not _has_one_statement(node):
        yield c_ast.EmptyStatement(), "deletion", node.cond if isinstance(node, c_ast.If | c_ast.For) else None


def _is_deletable(name: str, node: Any) -> bool:
    """Return whether a node is a complete statement: no declaration, and no return, which would leave a value undefined."""
    kinds = c_ast.Assignment | c_ast.FuncCall | c_ast.If | c_ast.For | c_ast.UnaryOp | c_ast.Break | c_ast.Switch
    return name.startswith(("block_items", "stmts")) and isinstance(node, kinds)


def _has_one_statement(node: Any) -> bool:
    """Return whether an "if" without "else" contains one statement and no call: deleting it would repeat the deletion of the
    statement."""
    if not isinstance(node, c_ast.If) or node.iffalse is not None or not isinstance(node.iftrue, c_ast.Compound):
        return False
    return len(node.iftrue.block_items or ()) == 1 and not _calls(node.cond)


def _calls(node: Any) -> bool:
    return isinstance(node, c_ast.FuncCall) or any(_calls(child) for _, child in node.children())


def _other_numbers(text: str) -> list[str]:
    whole = NUMBER.fullmatch(text)
    if whole is None:
        value = float(text.rstrip("fF"))
        suffix = text[len(text.rstrip("fF")) :]
        return [f"{1.01 * value if value else 1.0!r}{suffix}"]
    number, suffix = int(whole[1], 0), whole[2]
    others = [number + 1, *([number - 1] if number > 0 else []), *([number // 2] if number >= HALVED_FROM else [])]
    return [f"{other:#x}{suffix}" if whole[1].lower().startswith("0x") else f"{other}{suffix}" for other in others]
