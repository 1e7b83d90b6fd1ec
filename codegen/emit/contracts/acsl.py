"""Contracts in ACSL, the specification language of Frama-C, translated from the conditions in C.

ACSL computes with real numbers and with integers of any size. The translation states what C computes: a cast rounds the result
of each operation on floats, floats are compared as in IEEE 754 (every comparison with NaN is false), and unsigned sums wrap. A
condition that calls a C function without a counterpart in ACSL is left out, with the reason.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

from pycparser import c_ast, c_parser

from codegen.emit.contracts.contract import Argument, Claim, Invariant, Unit
from codegen.emit.render import render

PREDICATES = ("lies_between", "lies_within", "is_flag")
FUNCTIONS = ("magnitude_of",)
"""Helpers of the contracts that the template defines in ACSL."""
ANY_INDEX = ("any_row", "any_column")
"""Constants of any value, over which ACSL quantifies."""
_COMPARISONS = {"<": "lt", "<=": "le", ">": "gt", ">=": "ge", "==": "eq", "!=": "ne"}
_REALS = ("float", "double")
_BEFORE = "_before"
_UNSIGNED = ("uint32_t", "unsigned")
_STRUCT = re.compile(r"^typedef struct \{\n(.*?)^\} (\w+);", re.S | re.M)
_MEMBER = re.compile(r"^ +(?:const )?(\w+) (\*?)(\w+)((?:\[\w+\])*);", re.M)
_ENUM = re.compile(r"^\} (\w+);", re.M)
_TABLE = re.compile(r"^extern const (\w+) (\w+)\[", re.M)
_HELPER = re.compile(r"^static inline bool (\w+)\(([^)]*)\)\n\{\n    return ([^;]*);\n\}", re.M)
_PARAMETER = re.compile(r"(?:const )?(\w+) (\*?)(\w+)")


class NotExpressibleError(Exception):
    """A condition has no counterpart in ACSL. The message is the part without one."""


class Layout(NamedTuple):
    """Type of a member, and whether it is a pointer."""

    ctype: str
    is_pointer: bool


@dataclass(frozen=True)
class Clause:
    """A clause of a contract; one that is not expressible has the reason instead of a condition."""

    text: str
    condition: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Contract:
    """The contract of a function: its declaration, clauses, and the reason if it is not proved."""

    prototype: str
    requires: tuple[Clause, ...]
    assigns: str
    ensures: tuple[Clause, ...]
    open: str


@dataclass(frozen=True)
class Predicate:
    """A predicate: the conditions hold, and those of `arrays` for each of its `points` indices `k`."""

    head: str
    conditions: tuple[str, ...]
    arrays: tuple[tuple[str, tuple[str, ...]], ...] = ()


def acsl_header(context: Mapping[str, Any], headers: Iterable[bytes]) -> bytes:
    """Return the header with the contracts in ACSL.

    Args:
        context: of the templates of a build, with its `contracts`.
        headers: of the build and of its contracts in C. They define the structs, tables and helpers that the conditions name.
    """
    contracts = context["contracts"]
    translation = Translation(context["real"], b"\n".join(headers).decode("ascii"), contracts.invariants)
    predicates = [*map(translation.predicate_of, contracts.invariants.values()), *translation.helpers()]
    functions = [translation.contract_of(unit) for unit in contracts.units if not unit.part]
    return render("contracts/acsl.h.j2", {**context, "predicates": predicates, "functions": functions})


class Translation:
    """Contracts in ACSL, with the types of structs and tables that the headers define."""

    def __init__(self, real: str, headers: str, invariants: dict[str, Invariant]) -> None:
        self.real = real
        self.invariants = invariants
        self.headers = headers
        self.tables = {name: ctype for ctype, name in _TABLE.findall(headers)}
        self.structs = {
            name: {member: Layout(ctype, bool(star)) for ctype, star, member, _ in _MEMBER.findall(body)}
            for body, name in _STRUCT.findall(headers)
        }
        self.parser = c_parser.CParser()
        names = {*_ENUM.findall(headers), *(f"{sign}int{bits}_t" for sign in ("u", "") for bits in (8, 16, 32)), "bool"}
        self.types = "".join(f"typedef int {name};" for name in sorted(names))
        self.predicates = {*PREDICATES, *(each.predicate for each in invariants.values())}

    def predicate_of(self, invariant: Invariant) -> Predicate:
        """Return the predicate of an invariant."""
        conditions = Conditions(self, {"value": invariant.ctype, "k": "integer"})
        arrays = tuple((points, conditions.conjunction(claims)) for points, claims in invariant.arrays)
        head = f"{invariant.predicate}{{L}}({invariant.ctype} *value)"
        return Predicate(head, conditions.conjunction(invariant.claims), arrays)

    def helpers(self) -> Iterator[Predicate]:
        """Yield the further predicates of the contracts in C that are one expression."""
        for name, parameters, condition in _HELPER.findall(self.headers):
            if name in PREDICATES:
                continue
            scope = {each: "integer" if ctype == "uint32_t" else ctype for ctype, _, each in _PARAMETER.findall(parameters)}
            given = ", ".join(f"{scope[each]} {star}{each}" for _, star, each in _PARAMETER.findall(parameters))
            try:
                translated = Conditions(self, scope).translated(condition)
            except NotExpressibleError:
                continue
            self.predicates.add(name)
            yield Predicate(f"{name}{{L}}({given})", (translated,))

    def contract_of(self, unit: Unit) -> Contract:
        """Return the contract of a function."""
        arguments = unit.arguments
        conditions = Conditions(self, {**{each.name: each.ctype for each in arguments}, "result": unit.result})
        written = [_object(each) for each in unit.written]
        requires = (*self._memory(unit), *conditions.clauses((*unit.invariants(self.invariants, True), *unit.requires)))
        ensures = conditions.clauses((*unit.invariants(self.invariants, False), *unit.ensures))
        return Contract(unit.prototype, requires, ", ".join(written) or r"\nothing", ensures, unit.open)

    def _memory(self, unit: Unit) -> Iterator[Clause]:
        """Yield what the proofs assume of pointers, including those in a state: valid objects that do not overlap."""
        pointers = [each for each in unit.arguments if each.is_pointer]
        names, places = {each.name for each in unit.arguments}, [_place(each) for each in pointers]
        for argument, place in zip(pointers, places, strict=True):
            # A received frame is read if it has all bytes.
            given = "length == 8 ==> " if argument.role == "bytes in" and "length" in names else ""
            yield Clause(f"{argument.name} is valid", rf"{given}\valid{'' if argument.is_written else '_read'}({place})")
        for state in unit.states:
            for name, member in self.structs.get(state.ctype, {}).items():
                if not member.is_pointer:
                    continue
                inner = f"{state.name}->{name}"
                places.append(inner)
                yield Clause(f"{inner} is valid", rf"\valid_read({inner})")
                if member.ctype in self.invariants:
                    yield Clause(f"{inner} is within its invariant", f"{self.invariants[member.ctype].predicate}({inner})")
        if unit.written and len(places) > 1:
            yield Clause("objects do not overlap", rf"\separated({', '.join(places)})")


def _object(argument: Argument) -> str:
    return f"{argument.name}[0 .. 7]" if argument.role.startswith("bytes") else f"*{argument.name}"


def _place(argument: Argument) -> str:
    return f"{argument.name} + (0 .. 7)" if argument.role.startswith("bytes") else argument.name


class _Term(NamedTuple):
    """An expression, its type, and whether it needs parentheses as an operand."""

    text: str
    ctype: str
    is_open: bool = False


class Conditions:
    """Conditions over the names of `scope`, with their types."""

    def __init__(self, known: Translation, scope: dict[str, str]) -> None:
        self.known = known
        self.scope = {**known.tables, **dict.fromkeys(ANY_INDEX, "integer"), **scope}

    def clauses(self, claims: Iterable[Claim]) -> tuple[Clause, ...]:
        """Return the clauses of claims."""
        return tuple(self._clause(claim) for claim in claims)

    def _clause(self, claim: Claim) -> Clause:
        try:
            return Clause(claim.text, self.translated(claim.condition))
        except NotExpressibleError as error:
            return Clause(claim.text, reason=str(error))

    def translated(self, condition: str) -> str:
        """Return a condition in ACSL."""
        text = self._predicate(self._parsed(condition))
        named = [name for name in ANY_INDEX if name in text]
        indices = " && ".join(f"{name} >= 0" for name in named)
        return rf"\forall integer {', '.join(named)}; {indices} ==> ({text})" if named else text

    def conjunction(self, conditions: Iterable[str]) -> tuple[str, ...]:
        """Return conditions in ACSL as operands of a conjunction."""
        return tuple(self._inner(self._parsed(each), "&&") for each in conditions)

    def _parsed(self, condition: str) -> Any:
        return self.known.parser.parse(f"{self.known.types}int condition = {condition};").ext[-1].init

    # Predicates

    def _predicate(self, node: Any, operator: str = "") -> str:
        match node:
            case c_ast.BinaryOp(op="||", left=c_ast.UnaryOp(op="!", expr=premise)) if operator != "||":
                return f"{self._inner(premise)} ==> {self._inner(node.right)}"
            case c_ast.BinaryOp(op="&&" | "||"):
                return f"{self._inner(node.left, node.op)} {node.op} {self._inner(node.right, node.op)}"
            case c_ast.BinaryOp(op=op) if op in _COMPARISONS:
                return self._comparison(node)
            case c_ast.UnaryOp(op="!"):
                return self._negated(node.expr)
            case c_ast.FuncCall() if node.name.name in self.known.predicates:
                return self._cases(_given(node), lambda *given: f"{node.name.name}({', '.join(map(self._argument, given))})")
            case c_ast.TernaryOp():
                condition, yes, no = (self._inner(each) for each in (node.cond, node.iftrue, node.iffalse))
                return f"({condition} ==> {yes}) && ({self._negated(node.cond)} ==> {no})"
        return f"{self._term(node).text} != 0"

    def _negated(self, node: Any) -> str:
        if not _is_condition(node):
            return f"{self._term(node).text} == 0"
        text = self._predicate(node)
        return f"!{text}" if re.fullmatch(r"\\?\w+\([^()]*\)", text) else f"!({text})"

    def _inner(self, node: Any, operator: str = "") -> str:
        """Return a predicate as an operand of another one; a chain of the same operator needs no parentheses."""
        text = self._predicate(node, operator)
        chained = isinstance(node, c_ast.BinaryOp) and node.op == operator
        return text if chained or not re.search(r"&&|\|\||==>", text) else f"({text})"

    def _comparison(self, node: Any) -> str:
        sides = (node.left, node.right)
        if any(_is_condition(each) for each in sides) and not any(isinstance(each, c_ast.TernaryOp) for each in sides):
            same = " <==> ".join(f"({self._predicate(each)})" for each in sides)
            return same if node.op == "==" else f"!({same})"
        return self._cases(sides, lambda left, right: self._compared(node.op, self._operand(left), self._operand(right)))

    def _compared(self, operator: str, left: _Term, right: _Term) -> str:
        if not {left.ctype, right.ctype} & {*_REALS}:
            return f"{left.text} {operator} {right.text}"
        if left == right and operator in ("==", "!="):
            return rf"{'!' if operator == '==' else ''}\is_NaN({left.text})"
        return rf"\{_COMPARISONS[operator]}_{self.known.real}({self._rounded(left)}, {self._rounded(right)})"

    def _rounded(self, term: _Term) -> str:
        """Return a number of the type of the build: a literal is a real number in ACSL."""
        return f"({self.known.real}){term.text}" if term.text.lstrip("-")[0].isdigit() else term.text

    def _cases(self, nodes: Iterable[Any], make: Callable[..., str]) -> str:
        """Return a predicate for each choice of the conditional expressions in its terms.

        The condition of a conditional expression is a term in ACSL, which a predicate is not.
        """
        cases = []
        for choices in product(*(list(self._choices(each)) for each in nodes)):
            guards = " && ".join(guard for given, _ in choices for guard in given)
            text = make(*(node for _, node in choices))
            cases.append(f"({guards} ==> {text})" if guards else text)
        return " && ".join(cases)

    def _choices(self, node: Any) -> Iterator[tuple[tuple[str, ...], Any]]:
        """Yield the guards and the expression of each choice in a term."""
        match node:
            case c_ast.TernaryOp():
                condition = self._inner(node.cond)
                yield from (((condition, *guards), each) for guards, each in self._choices(node.iftrue))
                yield from (((self._negated(node.cond), *guards), each) for guards, each in self._choices(node.iffalse))
            case c_ast.BinaryOp():
                for (first, left), (second, right) in product(self._choices(node.left), list(self._choices(node.right))):
                    yield (*first, *second), c_ast.BinaryOp(node.op, left, right)
            case c_ast.UnaryOp():
                yield from ((guards, c_ast.UnaryOp(node.op, each)) for guards, each in self._choices(node.expr))
            case c_ast.Cast():
                yield from ((guards, c_ast.Cast(node.to_type, each)) for guards, each in self._choices(node.expr))
            case _:
                yield (), node

    # Terms

    def _argument(self, node: Any) -> str:
        return self._term(node).text

    def _term(self, node: Any) -> _Term:
        if (root := _root(node)).endswith(_BEFORE) and root not in self.scope:
            return self._before(node, root)
        match node:
            case c_ast.Constant():
                return self._constant(node)
            case c_ast.ID(name=name):
                return self._named(name)
            case c_ast.StructRef():
                base = self._term(node.name)
                arrow = "." if base.text == r"\result" else node.type
                return _Term(f"{base.text}{arrow}{node.field.name}", self._member(base.ctype, node.field.name))
            case c_ast.ArrayRef():
                base = self._term(node.name)
                return _Term(f"{base.text}[{self._argument(node.subscript)}]", base.ctype)
            case c_ast.UnaryOp(op="*" | "&"):
                inner = self._term(node.expr)
                return _Term(f"{node.op}{inner.text}", inner.ctype)
            case c_ast.UnaryOp(op="-", expr=c_ast.Constant()):
                inner = self._constant(node.expr)
                return inner._replace(text=f"-{inner.text}")
            case c_ast.UnaryOp(op="-" | "~"):
                inner = self._operand(node.expr)
                return self._computed(node.op, f"{node.op}{inner.text}", inner.ctype)
            case c_ast.Cast():
                return self._cast(node)
            case c_ast.BinaryOp() if not _is_condition(node):
                left, right = self._operand(node.left), self._operand(node.right)
                kinds = (left.ctype, right.ctype)
                ctype = next((each for each in (*_REALS, "integer", *_UNSIGNED) if each in kinds), "int")
                return self._computed(node.op, f"{left.text} {node.op} {right.text}", ctype)
            case c_ast.FuncCall() if node.name.name in FUNCTIONS:
                return _Term(f"{node.name.name}({', '.join(map(self._argument, _given(node)))})", self.known.real)
            case c_ast.FuncCall():
                raise NotExpressibleError(f"{node.name.name}() is not a function of ACSL")
        raise NotExpressibleError("a condition in place of a number is not a term of ACSL")

    def _operand(self, node: Any) -> _Term:
        term = self._term(node)
        return _Term(f"({term.text})", term.ctype) if term.is_open else term

    def _computed(self, operator: str, text: str, ctype: str) -> _Term:
        """Round or wrap a result as C does."""
        if ctype in _REALS:
            return _Term(f"({self.known.real})({text})", ctype)
        if ctype in _UNSIGNED and operator not in "&|/%>>":
            return _Term(f"(uint32_t)({text})", ctype)
        return _Term(text, ctype, is_open=True)

    def _constant(self, node: Any) -> _Term:
        if node.type in _REALS:
            # ACSL reads a number without a suffix as a real number, which the nearest double may differ from.
            return _Term(node.value if node.value.endswith("f") else f"{node.value}d", self.known.real)
        return _Term(node.value, "unsigned" if node.value.endswith("u") else "int")

    def _named(self, name: str) -> _Term:
        if name in ("true", "false"):
            return _Term(str(int(name == "true")), "int")
        if name.isupper():
            return _Term(name, "int")
        if name not in self.scope:
            raise NotExpressibleError(f"{name} is not an argument")
        return _Term(r"\result" if name == "result" else name.removesuffix(_BEFORE), self.scope[name])

    def _member(self, struct: str, name: str) -> str:
        return self.known.structs[struct][name].ctype

    def _before(self, node: Any, root: str) -> _Term:
        """Return the value of an lvalue before the call; its indices must not depend on the state."""
        inner = Conditions(self.known, {root: self.scope[root.removesuffix(_BEFORE)], "k": "integer"})._term(node)
        return _Term(rf"\old({inner.text})", inner.ctype)

    def _cast(self, node: Any) -> _Term:
        ctype, inner = node.to_type.type.type.names[0], self._operand(node.expr)
        if (ctype in _REALS) != (inner.ctype in _REALS):
            raise NotExpressibleError("a conversion between floats and integers is not translated")
        return _Term(f"({ctype}){inner.text}", ctype)


def _is_condition(node: Any) -> bool:
    """Return whether an expression is true or false by its form."""
    match node:
        case c_ast.BinaryOp():
            return node.op in (*_COMPARISONS, "&&", "||")
        case c_ast.UnaryOp():
            return bool(node.op == "!")
        case c_ast.FuncCall():
            return node.name.name not in FUNCTIONS
    return False


def _given(call: Any) -> list[Any]:
    return list(call.args.exprs) if call.args else []


def _root(node: Any) -> str:
    """Return the name of the object that an lvalue is part of; "" for any other expression."""
    while isinstance(node, c_ast.StructRef | c_ast.ArrayRef) or (isinstance(node, c_ast.UnaryOp) and node.op in "*&"):
        node = node.expr if isinstance(node, c_ast.UnaryOp) else node.name
    return node.name if isinstance(node, c_ast.ID) else ""
