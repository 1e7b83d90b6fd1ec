"""What a run of a function for all inputs computes: terms over its inputs, each kept once.

A sort is a whole number: 0 for truth values, w > 0 for w bits, -w for floats of w bits. Bits have no sign; operations have one.
`a - b` of floats is `a + (-b)`, which is the same number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.semantics import Value, compute

BOOL = 0
TREE_MAX = 256
"""Leaves of a choice between constants that operations are pushed into: a search in an axis ends in one."""

FLOAT_OPERATIONS = ("fadd", "fmul", "fdiv")
COMMUTATIVE = ("fadd", "fmul", "add", "mul", "band", "bor", "bxor", "eq", "feq")

BY_CASES = "by cases"
"""Mark of a choice that an operation was pushed into: its values are worth a look each where it is chosen."""


@dataclass(frozen=True, eq=False)
class Table:
    """A constant array, read with an index that is not known.

    Attributes:
        name: in C, with its unit.
        lengths: of its dimensions.
        values: row by row.
        low, high: of any entry. For a free table, of what it may be recalibrated to; else of what it holds.
        is_free: whether the entries count as any numbers between the two.
        is_increasing: whether each of a free table is taken to be above the one before.
    """

    name: str
    lengths: tuple[int, ...]
    values: tuple[Value, ...]
    low: float
    high: float
    is_free: bool = False
    is_increasing: bool = False

    def at(self, indices: Iterable[int]) -> Value | None:
        """An entry, None where there is none."""
        position = 0
        for index, length in zip(indices, self.lengths, strict=True):
            if not 0 <= index < length:
                return None
            position = position * length + index
        return self.values[position]


class Term:
    """An operation on other terms; equal terms are the same object.

    Attributes:
        op: of `semantics`, or "const", "var", "entry", "ite".
        args: operands.
        sort: of the result.
        data: the value of a constant, the name of a variable, the table of an entry, or what the operation needs else.
        number: in the order in which they were made; operands come first.
        leaves: how many constants it chooses from, 0 where it is not such a choice.
    """

    __slots__ = ("args", "data", "leaves", "number", "op", "sort", "users")

    def __init__(self, op: str, args: tuple[Term, ...], sort: int, data: Any, number: int) -> None:
        self.op, self.args, self.sort, self.data, self.number = op, args, sort, data, number
        self.leaves = 1 if op == "const" else 0
        self.users: list[Term] = []
        if op == "ite" and args[1].leaves and args[2].leaves:
            leaves = args[1].leaves + args[2].leaves
            self.leaves = leaves if leaves <= TREE_MAX else 0
        for each in args:
            each.users.append(self)

    @property
    def is_const(self) -> bool:
        return self.op == "const"

    def __repr__(self) -> str:
        inside = ", ".join([*([repr(self.data)] if self.data is not None else []), *(f"#{each.number}" for each in self.args)])
        return f"#{self.number} {self.op}({inside})"


class Pool:
    """Makes terms, simplified."""

    def __init__(self) -> None:
        self._kept: dict[tuple[Any, ...], Term] = {}
        self._fresh = 0
        self._above: dict[tuple[int, int], bool] = {}
        self.true, self.false = self.boolean(True), self.boolean(False)

    def __len__(self) -> int:
        return len(self._kept)

    def boolean(self, value: bool) -> Term:
        return self._keep("const", (), BOOL, value)

    def whole(self, value: int, width: int) -> Term:
        """Of so many bits, wrapped around."""
        return self._keep("const", (), width, value & ((1 << width) - 1))

    def real(self, value: float, width: int) -> Term:
        return self._keep("const", (), -width, value)

    def variable(self, name: str, sort: int) -> Term:
        """The input of that name."""
        return self._keep("var", (), sort, name)

    def fresh(self, name: str, sort: int) -> Term:
        """An input that is no other one."""
        self._fresh += 1
        return self.variable(f"{name} #{self._fresh}", sort)

    def entry(self, table: Table, indices: tuple[Term, ...], sort: int) -> Term:
        """Of a table."""
        if len(indices) == 1 and indices[0].leaves and not table.is_free:
            return self._over_tree(indices[0], lambda leaf: self._entry_at(table, (leaf.data,), sort))
        if all(each.is_const for each in indices) and not table.is_free:
            return self._entry_at(table, tuple(each.data for each in indices), sort)
        return self._keep("entry", indices, sort, table)

    def is_above(self, index: Term, other: Term) -> bool:
        """Whether an index is above another one wherever it leads, by how the two were chosen."""
        if index.is_const and other.is_const:
            return bool(index.data > other.data)
        same = index.op == other.op == "ite" and index.args[0] is other.args[0]
        if not same and not (index.op == "ite" and other.is_const):
            return False
        key = (index.number, other.number)
        if key not in self._above:
            others = other.args[1:] if same else (other, other)
            self._above[key] = all(self.is_above(*pair) for pair in zip(index.args[1:], others, strict=True))
        return self._above[key]

    def _entry_at(self, table: Table, indices: tuple[int, ...], sort: int) -> Term:
        value = table.at(indices)
        return self._constant(0 if value is None else value, sort)  # one outside is an obligation that fails

    def apply(self, op: str, sort: int, *args: Term, data: Any = None) -> Term:
        """An operation of `semantics`."""
        if all(each.is_const for each in args):
            return self._constant(compute(op, sort, data, [each.sort for each in args], [each.data for each in args]), sort)
        if op in COMMUTATIVE and args[0].number > args[1].number:
            args = args[::-1]
        pushed = self._pushed(op, sort, args, data)
        return pushed if pushed is not None else self._keep(op, args, sort, data)

    def existing(self, op: str, sort: int, *args: Term) -> Term | None:
        """A term that was made before, of an operation that depends on the order of its operands."""
        return self._kept.get((op, sort, None, *(each.number for each in args)))

    def _constant(self, value: Value, sort: int) -> Term:
        if sort == BOOL:
            return self.boolean(bool(value))
        return self.whole(int(value), sort) if sort > 0 else self.real(float(value), -sort)

    def _keep(self, op: str, args: tuple[Term, ...], sort: int, data: Any) -> Term:
        # A float constant by its bits: 0 and -0 are two, a NaN is one.
        stored = FORMATS[-sort].bits(data) if op == "const" and sort < 0 else data
        key = (op, sort, stored, *(each.number for each in args))
        found = self._kept.get(key)
        if found is None:
            found = self._kept[key] = Term(op, args, sort, data, len(self._kept))
        return found

    def _pushed(self, op: str, sort: int, args: tuple[Term, ...], data: Any) -> Term | None:
        """The operation inside the choice that one operand is, or both are by the same condition."""
        trees = [place for place, each in enumerate(args) if each.leaves > 1]
        if not trees:
            return None
        if len(args) == 2 and all(each.op == "ite" for each in args) and args[0].args[0] is args[1].args[0]:
            (condition, left_yes, left_no), (_, right_yes, right_no) = args[0].args, args[1].args
            yes = self.apply(op, sort, left_yes, right_yes, data=data)
            return self._case(condition, yes, self.apply(op, sort, left_no, right_no, data=data))
        if len(trees) == 1 and (op in FLOAT_OPERATIONS or all(each.leaves for each in args)):
            place = trees[0]
            return self._over_tree(
                args[place], lambda leaf: self.apply(op, sort, *args[:place], leaf, *args[place + 1 :], data=data)
            )
        return None

    def _over_tree(self, tree: Term, change: Callable[[Term], Term]) -> Term:
        """The choice with each of its constants changed."""
        done: dict[Term, Term] = {}

        def walk(term: Term) -> Term:
            if term not in done:
                if term.is_const:
                    done[term] = change(term)
                else:
                    done[term] = self._case(term.args[0], walk(term.args[1]), walk(term.args[2]))
            return done[term]

        return walk(tree)

    def _case(self, condition: Term, yes: Term, no: Term) -> Term:
        is_known = yes.leaves and no.leaves
        return self.ite(condition, yes, no, None if is_known or yes.sort >= 0 else BY_CASES)

    def ite(self, condition: Term, yes: Term, no: Term, mark: str | None = None) -> Term:
        """yes where the condition is true, else no."""
        if condition.is_const or yes is no:
            return yes if condition.data or yes is no else no
        if condition.op == "not":
            return self.ite(condition.args[0], no, yes, mark)
        if yes.op == "ite" and yes.args[0] is condition:
            yes = yes.args[1]
        if no.op == "ite" and no.args[0] is condition:
            no = no.args[2]
        if yes is no:
            return yes
        if yes.sort == BOOL and (yes.is_const or no.is_const):
            return self._choice_of_truth(condition, yes, no)
        if yes.sort < BOOL and condition.op == "flt" and self._is_magnitude(condition, yes, no):
            return self.magnitude(no)
        return self._keep("ite", (condition, yes, no), yes.sort, mark)

    @staticmethod
    def _is_magnitude(condition: Term, yes: Term, no: Term) -> bool:
        """Whether it is `x < 0 ? -x : x`: the same number as |x|, where both zeros are one."""
        x, zero = condition.args
        return x is no and zero.is_const and bool(zero.data == 0.0) and yes.op == "fneg" and yes.args[0] is no

    def _choice_of_truth(self, condition: Term, yes: Term, no: Term) -> Term:
        if yes.is_const:
            return self.or_(condition, no) if yes.data else self.and_(self.not_(condition), no)
        return self.or_(self.not_(condition), yes) if no.data else self.and_(condition, yes)

    def not_(self, term: Term) -> Term:
        if term.is_const:
            return self.boolean(not term.data)
        return term.args[0] if term.op == "not" else self._keep("not", (term,), BOOL, None)

    def and_(self, *terms: Term) -> Term:
        return self._joined("and", terms, self.true, self.false)

    def or_(self, *terms: Term) -> Term:
        return self._joined("or", terms, self.false, self.true)

    def _joined(self, op: str, terms: tuple[Term, ...], neutral: Term, ruling: Term) -> Term:
        result = neutral
        for term in terms:
            if term is ruling or result is ruling or self.not_(term) is result:
                return ruling
            if term is neutral or term is result or self._holds_already(op, result, term):
                continue
            if self._holds_already(op, result, self.not_(term)):
                return ruling
            result = term if result is neutral else self._keep(op, (result, term), BOOL, None)
        return result

    @staticmethod
    def _holds_already(op: str, chain: Term, term: Term) -> bool:
        """Whether the last few members of a conjunction or disjunction have the term among them."""
        for _ in range(8):
            if chain.op != op:
                return chain is term
            if chain.args[1] is term:
                return True
            chain = chain.args[0]
        return False

    # Comparisons, false for NaN where they are of floats.

    def flt(self, a: Term, b: Term) -> Term:
        return self.apply("flt", BOOL, a, b)

    def fle(self, a: Term, b: Term) -> Term:
        return self.apply("fle", BOOL, a, b)

    def feq(self, a: Term, b: Term) -> Term:
        return self.apply("feq", BOOL, a, b)

    def eq(self, a: Term, b: Term) -> Term:
        """Of bits."""
        return self.true if a is b else self.apply("eq", BOOL, a, b)

    def is_number(self, a: Term) -> Term:
        """Not NaN."""
        return self.fle(a, a)

    def is_finite(self, a: Term) -> Term:
        """Neither NaN nor infinite."""
        return self.fle(self.magnitude(a), self.real(FORMATS[-a.sort].largest, -a.sort))

    def magnitude(self, a: Term) -> Term:
        return self.apply("fabs", a.sort, a)

    # Floats.

    def neg(self, a: Term) -> Term:
        return a.args[0] if a.op == "fneg" else self.apply("fneg", a.sort, a)

    def add(self, a: Term, b: Term) -> Term:
        return self.apply("fadd", a.sort, a, b)

    def sub(self, a: Term, b: Term) -> Term:
        return self.apply("fadd", a.sort, a, self.neg(b))

    # Bits.

    def wider(self, a: Term, width: int, signed: bool) -> Term:
        """Or cut, to so many bits."""
        if a.sort == width:
            return a
        if a.sort > width:
            return self.apply("trunc", width, a)
        return self.apply("sext" if signed else "zext", width, a)

    def of_truth(self, a: Term, width: int) -> Term:
        """1 or 0."""
        return self.ite(a, self.whole(1, width), self.whole(0, width))


def is_nan(term: Term) -> bool:
    """Whether it is the constant NaN."""
    return term.is_const and term.sort < 0 and math.isnan(term.data)


def inside(roots: Iterable[Term]) -> list[Term]:
    """The terms and all that they are made of, operands first."""
    found: set[Term] = set()
    waiting = list(roots)
    while waiting:
        term = waiting.pop()
        if term not in found:
            found.add(term)
            waiting.extend(term.args)
    return sorted(found, key=lambda term: term.number)
