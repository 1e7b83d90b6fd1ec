"""Terms as z3's bit vectors.

A float is a pair: whether it is NaN, and the whole number that orders it among the others (`floats.Format.key`), so that
comparing floats is comparing numbers. What an operation gives is a number of which the laws below hold and the facts found: not
its exact bits. What follows from these holds for the exact result too. Both zeros are one: what tells them apart, a division by
zero, is shown not to happen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import z3

from codegen.verify.proof.boxes import INF
from codegen.verify.proof.facts import Bounded, Fact, Facts
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.terms import BOOL, Table, Term, is_nan


class Float(NamedTuple):
    """A float in z3."""

    key: Any
    nan: Any


class Encoder:
    """Terms of one pool, each encoded once."""

    def __init__(self, facts: Facts) -> None:
        self.facts = facts
        self._done: dict[Term, Any] = {}
        self._laws: dict[Term, list[Any]] = {}

    def truth(self, term: Term) -> Any:
        """Of a term that is true or false."""
        assert term.sort == BOOL
        return self.of(term)

    def of(self, term: Term) -> Any:
        """A truth value, bits, or a `Float`."""
        waiting = [term]
        while waiting:
            top = waiting[-1]
            missing = [each for each in top.args if each not in self._done]
            if missing:
                waiting.extend(missing)
                continue
            waiting.pop()
            if top not in self._done:
                self._done[top] = self._encoded(top)
        return self._done[term]

    def laws(self, term: Term) -> list[Any]:
        """What holds of a term by what it is."""
        self.of(term)
        return self._laws.get(term, [])

    def known(self, term: Term) -> Iterator[Any]:
        """What was found of it."""
        return (self.fact(fact) for fact in self.facts.about(term))

    def fact(self, fact: Fact) -> Any:
        """As a formula."""
        premises = [*(self.truth(each) for each in fact.conditions), *(self._is_within(each) for each in fact.premises)]
        conclusion = self._is_within(fact.conclusion)
        if fact.conclusion.term.sort < 0:
            conclusion = z3.Or(self.of(fact.conclusion.term).nan, conclusion)
        return z3.Implies(z3.And(premises), conclusion)

    def _is_within(self, bounded: Bounded) -> Any:
        """Not NaN and between the bounds."""
        term, value = bounded.term, self.of(bounded.term)
        if term.sort < 0:
            form = FORMATS[-term.sort]
            parts = [z3.Not(value.nan)]
            parts += [] if bounded.low == -INF else [value.key >= form.key(bounded.low)]
            parts += [] if bounded.high == INF else [value.key <= form.key(bounded.high)]
            return z3.And(parts)
        width = term.sort
        least, most = (-(1 << (width - 1)), (1 << (width - 1)) - 1) if bounded.signed else (0, (1 << width) - 1)
        low, high = max(int(bounded.low), least), min(int(bounded.high), most)
        if low > high:  # also where the bounds are not numbers of the width: z3 would wrap them around
            return z3.BoolVal(False)
        if bounded.signed:
            return z3.And(value >= low, value <= high)
        return z3.And(z3.UGE(value, low), z3.ULE(value, high))

    def _encoded(self, term: Term) -> Any:
        args = [self._done[each] for each in term.args]
        if term.op == "const":
            return self._constant(term)
        if term.op in ("var", "entry"):
            return self._input(term)
        if term.op == "ite":
            condition, yes, no = args
            if term.sort < 0:
                return Float(z3.If(condition, yes.key, no.key), z3.If(condition, yes.nan, no.nan))
            return z3.If(condition, yes, no)
        if term.op in PLAIN:
            return PLAIN[term.op](term, *args)
        if term.op in OPERATIONS:
            result, laws = OPERATIONS[term.op](term, self._new(term), *args)
            self._laws[term] = [*self._laws.get(term, []), *laws]
            return result
        self._laws.setdefault(term, [])
        return self._free(term)

    def _constant(self, term: Term) -> Any:
        if term.sort == BOOL:
            return z3.BoolVal(term.data)
        if term.sort > 0:
            return z3.BitVecVal(term.data, term.sort)
        key = 0 if is_nan(term) else FORMATS[-term.sort].key(term.data)
        return Float(z3.BitVecVal(key, -term.sort), z3.BoolVal(is_nan(term)))

    def _new(self, term: Term) -> Any:
        """A name for a result: the key of a float, or bits."""
        return z3.BitVec(f"t{term.number}", abs(term.sort))

    def _free(self, term: Term) -> Any:
        """Any value."""
        if term.sort == BOOL:
            return z3.Bool(f"t{term.number}")
        value = self._new(term)
        if term.sort > 0:
            return value
        top = FORMATS[-term.sort].key(INF)
        self._laws[term] = [value >= -top, value <= top]
        return Float(value, z3.Bool(f"n{term.number}"))

    def _input(self, term: Term) -> Any:
        if term.op == "var":
            return self._free(term)
        table = term.data
        assert isinstance(table, Table)
        value = self._new(term)
        if term.sort < 0:
            form = FORMATS[-term.sort]
            self._laws[term] = [value >= form.key(table.low), value <= form.key(table.high)]
            return Float(value, z3.BoolVal(False))
        self._laws[term] = [z3.UGE(value, int(table.low)), z3.ULE(value, int(table.high))]
        return value


def _size(key: Any) -> Any:
    """Of the magnitude."""
    return z3.If(key < 0, -key, key)


def _key(term: Term, value: float) -> Any:
    return z3.BitVecVal(FORMATS[-term.sort].key(value), -term.sort)


def _sum(term: Term, c: Any, a: Float, b: Float) -> tuple[Float, list[Any]]:
    """Monotone: not beyond one operand against the other's sign; zero only where they cancel; exact near zero."""
    top = _key(term, INF)
    nan = z3.Or(a.nan, b.nan, z3.And(a.key == top, b.key == -top), z3.And(a.key == -top, b.key == top))
    opposite = -b.key
    laws = [
        z3.And(c >= -top, c <= top),
        z3.Implies(b.key >= 0, c >= a.key),
        z3.Implies(b.key <= 0, c <= a.key),
        z3.Implies(a.key >= 0, c >= b.key),
        z3.Implies(a.key <= 0, c <= b.key),
        (a.key > opposite) == (c > 0),
        (a.key < opposite) == (c < 0),
        z3.Implies(z3.Or(a.key == top, b.key == top), c == top),
        z3.Implies(z3.Or(a.key == -top, b.key == -top), c == -top),
    ]
    return Float(c, nan), [z3.Or(nan, z3.And(laws))]


def _product(term: Term, c: Any, a: Float, b: Float) -> tuple[Float, list[Any]]:
    """The sign of both; not larger than one operand where the other is at most 1, not smaller where it is at least 1."""
    top, one = _key(term, INF), _key(term, 1.0)
    x, y, z = _size(a.key), _size(b.key), _size(c)
    nan = z3.Or(a.nan, b.nan, z3.And(a.key == 0, y == top), z3.And(b.key == 0, x == top))
    laws = [
        z3.And(c >= -top, c <= top),
        *_signs(a.key, b.key, c),
        *(z3.Implies(w <= one, z <= v) for v, w in ((x, y), (y, x))),
        *(z3.Implies(w >= one, z >= v) for v, w in ((x, y), (y, x))),
        z3.Implies(z3.Or(x == top, y == top), z == top),
    ]
    return Float(c, nan), [z3.Or(nan, z3.And(laws))]


def _quotient(term: Term, c: Any, a: Float, b: Float) -> tuple[Float, list[Any]]:
    """As a product with the reciprocal; at most 1 where the divisor is not the smaller one."""
    top, one = _key(term, INF), _key(term, 1.0)
    x, y, z = _size(a.key), _size(b.key), _size(c)
    nan = z3.Or(a.nan, b.nan, z3.And(a.key == 0, b.key == 0), z3.And(x == top, y == top))
    laws = [
        z3.And(c >= -top, c <= top),
        z3.Implies(y == 0, z == top),
        z3.Implies(y != 0, z3.And(_signs(a.key, b.key, c))),
        z3.Implies(y >= one, z <= x),
        z3.Implies(y <= one, z >= x),
        z3.Implies(x <= y, z <= one),
        z3.Implies(x >= y, z >= one),
        z3.Implies(x == top, z == top),
        z3.Implies(y == top, z == 0),
    ]
    return Float(c, nan), [z3.Or(nan, z3.And(laws))]


def _signs(a: Any, b: Any, c: Any) -> list[Any]:
    return [
        z3.Implies(z3.Or(z3.And(a >= 0, b >= 0), z3.And(a <= 0, b <= 0)), c >= 0),
        z3.Implies(z3.Or(z3.And(a >= 0, b <= 0), z3.And(a <= 0, b >= 0)), c <= 0),
    ]


def _of_whole(term: Term, c: Any, a: Any) -> tuple[Float, list[Any]]:
    """The sign; zero only of zero. How large it is, the facts say."""
    negative = a < 0 if term.data else z3.BoolVal(False)
    return Float(c, z3.BoolVal(False)), [(a == 0) == (c == 0), negative == (c < 0)]


def _of_real(term: Term, c: Any, a: Float) -> tuple[Any, list[Any]]:
    """0 for what is between 0 and 1. What it is beyond that, the facts say."""
    one = FORMATS[-term.args[0].sort].key(1.0)
    return c, [z3.Implies(z3.And(z3.Not(a.nan), a.key >= 0, a.key < one), c == 0)]


def _bits(term: Term, c: Any, a: Float) -> tuple[Any, list[Any]]:
    """Bits of which the float is that one: either zero, any NaN."""
    back = _float_of(c, term.sort)
    return c, [back.nan == a.nan, z3.Or(a.nan, back.key == a.key)]


def _float_of(bits: Any, width: int) -> Float:
    rest = z3.BitVecVal((1 << (width - 1)) - 1, width)
    size, top = bits & rest, FORMATS[width].key(INF)
    return Float(z3.If(bits < 0, -size, size), size > top)


def _converted(term: Term, c: Any, a: Float) -> tuple[Float, list[Any]]:
    """To a float of another width: the sign."""
    top = _key(term, INF)
    return Float(c, a.nan), [z3.And(c >= -top, c <= top), z3.Implies(a.key >= 0, c >= 0), z3.Implies(a.key <= 0, c <= 0)]


def _both_numbers(compare: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda _t, a, b: z3.And(z3.Not(a.nan), z3.Not(b.nan), compare(a.key, b.key))


def _divided(term: Term, a: Any, b: Any) -> Any:
    what, is_signed = term.data
    if what == "quotient":
        return a / b if is_signed else z3.UDiv(a, b)
    return z3.SRem(a, b) if is_signed else z3.URem(a, b)


OPERATIONS: dict[str, Callable[..., tuple[Any, list[Any]]]] = {
    "fadd": _sum,
    "fmul": _product,
    "fdiv": _quotient,
    "of_whole": _of_whole,
    "of_real": _of_real,
    "bits": _bits,
    "fconvert": _converted,
}
"""Of term, name of the result and operands: the result and its laws."""

PLAIN: dict[str, Callable[..., Any]] = {
    "not": lambda _t, a: z3.Not(a),
    "and": lambda _t, a, b: z3.And(a, b),
    "or": lambda _t, a, b: z3.Or(a, b),
    "flt": _both_numbers(lambda a, b: a < b),
    "fle": _both_numbers(lambda a, b: a <= b),
    "feq": _both_numbers(lambda a, b: a == b),
    "fneg": lambda _t, a: Float(-a.key, a.nan),
    "fabs": lambda _t, a: Float(_size(a.key), a.nan),
    "of_bits": lambda t, a: _float_of(a, -t.sort),
    "eq": lambda _t, a, b: a == b,
    "ult": lambda _t, a, b: z3.ULT(a, b),
    "ule": lambda _t, a, b: z3.ULE(a, b),
    "slt": lambda _t, a, b: a < b,
    "sle": lambda _t, a, b: a <= b,
    "add": lambda _t, a, b: a + b,
    "sub": lambda _t, a, b: a - b,
    "mul": lambda _t, a, b: a * b,
    "band": lambda _t, a, b: a & b,
    "bor": lambda _t, a, b: a | b,
    "bxor": lambda _t, a, b: a ^ b,
    "shl": lambda _t, a, b: a << b,
    "shr": lambda t, a, b: a >> b if t.data else z3.LShR(a, b),
    "div": _divided,
    "zext": lambda t, a: z3.ZeroExt(t.sort - a.size(), a),
    "sext": lambda t, a: z3.SignExt(t.sort - a.size(), a),
    "trunc": lambda t, a: z3.Extract(t.sort - 1, 0, a),
}
"""Of term and operands: exactly what the operation is."""
