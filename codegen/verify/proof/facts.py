"""Facts of floating-point arithmetic about single terms, each true by itself, whatever path the program took.

A fact says: where the conditions hold and each of the terms of the premises is a number in its bounds, the term of the
conclusion is NaN or lies in its own. When a result is NaN is known exactly, so that no fact has to say it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from codegen.verify.proof.boxes import INF, Real, Whole
from codegen.verify.proof.floats import FORMATS, Format
from codegen.verify.proof.terms import Term

Bounds = tuple[float, float]
"""Of a float; of bits with a sign or without, as the operation reads them."""


@dataclass(frozen=True)
class Bounded:
    """A term between bounds, which it may reach. signed: how the bits of a whole number are read."""

    term: Term
    low: float
    high: float
    signed: bool = False


@dataclass(frozen=True)
class Fact:
    """See the module."""

    premises: tuple[Bounded, ...]
    conclusion: Bounded
    conditions: tuple[Term, ...] = ()


class Facts:
    """What was found, by the term that it is about."""

    def __init__(self) -> None:
        self._kept: dict[Term, dict[Fact, None]] = {}

    def add(self, fact: Fact) -> None:
        low, high = fact.conclusion.low, fact.conclusion.high
        if fact.conclusion.term.sort > 0 or low > -INF or high < INF:
            self._kept.setdefault(fact.conclusion.term, {})[fact] = None

    def about(self, term: Term) -> tuple[Fact, ...]:
        return tuple(self._kept.get(term, ()))


def of_sum(term: Term, a: Real, b: Real, result: Real) -> Iterator[Fact]:
    """Rounding is monotone: a side at a time. Nothing of boxes without a number in them: of their bounds, none holds."""
    x, y = term.args
    if a.low > a.high or b.low > b.high:
        return
    if result.high < INF:
        yield Fact((Bounded(x, -INF, a.high), Bounded(y, -INF, b.high)), Bounded(term, -INF, result.high))
    if result.low > -INF:
        yield Fact((Bounded(x, a.low, INF), Bounded(y, b.low, INF)), Bounded(term, result.low, INF))


def of_box(term: Term, a: Real, b: Real, result: Real) -> Fact:
    """Of a product or a quotient: its bounds are those of the operands' corners."""
    x, y = term.args
    return Fact((Bounded(x, a.low, a.high), Bounded(y, b.low, b.high)), Bounded(term, result.low, result.high))


def weighted(old: Real, new: Real, weight: Real, form: Format) -> Real | None:
    """`old + weight (new - old)`, rounded three times; None for bounds that say nothing.

    The exact value is largest and smallest in corners. Each rounding adds at most half a unit of its result, none of them
    above |old| + |new| times the weight. Of one sign and weighted with 0 to 1, they give none of the other: |weight d| <= |d|,
    and d = new - old, rounded, is not beyond -old.
    """
    reach = (old.largest + new.largest) * max(1.0, weight.largest)
    if not (old.is_finite and new.is_finite and weight.is_finite and reach < form.largest / 4.0):
        return None
    corners = [
        (1.0 - k) * x + k * y for k in (weight.low, weight.high) for x in (old.low, old.high) for y in (new.low, new.high)
    ]
    slack = 16.0 * form.unit_roundoff * reach + 8.0 * form.tiniest
    low, high = min(corners) - slack, max(corners) + slack
    if weight.low >= 0.0 and weight.high <= 1.0:
        low = max(low, 0.0) if min(old.low, new.low) >= 0.0 else low
        high = min(high, 0.0) if max(old.high, new.high) <= 0.0 else high
    return Real(form.at_most(low), form.at_least(high), False)


@dataclass(frozen=True)
class Weighted:
    """The operands of a term `old + weight (new - old)`; new: None for `old - weight old`, which is towards zero."""

    old: Term
    new: Term | None
    weight: Term


def weighted_parts(term: Term) -> Iterator[Weighted]:
    """How a sum may be read so."""
    for old, moved in (term.args, term.args[::-1]):
        if moved.op == "fneg" and moved.args[0].op == "fmul":
            for same, weight in (moved.args[0].args, moved.args[0].args[::-1]):
                if same is old:
                    yield Weighted(old, None, weight)
        if moved.op == "fmul":
            for distance, weight in (moved.args, moved.args[::-1]):
                if distance.op == "fadd":
                    for new, less in (distance.args, distance.args[::-1]):
                        if are_opposite(less, old):
                            yield Weighted(old, new, weight)


def are_opposite(a: Term, b: Term) -> bool:
    """Whether one is the other with its sign turned, by how they are made."""
    if a.is_const and b.is_const:
        return bool(a.data == -b.data)
    return (a.op == "fneg" and a.args[0] is b) or (b.op == "fneg" and b.args[0] is a)


def fraction_parts(term: Term) -> Iterator[tuple[Term, Term]]:
    """Where a sum is `x - (float)n`: x and (float)n."""
    for x, less in (term.args, term.args[::-1]):
        if less.op == "fneg" and less.args[0].op == "of_whole":
            yield x, less.args[0]


def fraction_limit(whole: Term, conversion: Term) -> float:
    """The largest x of which the whole part fits into the conversion's type, is read back as it was, and is a float."""
    bits = conversion.sort - (1 if whole.data or conversion.data else 0)
    form = FORMATS[-whole.sort]
    return form.down(float(min(form.whole_below, 1 << bits)))


def of_fraction(term: Term, x: Term, limit: float, condition: tuple[Term, ...] = ()) -> Fact:
    """`x - (float)(whole)x` is exact, and from 0 to below 1, up to the limit of `fraction_limit`."""
    return Fact((Bounded(x, 0.0, limit),), Bounded(term, 0.0, FORMATS[-term.sort].down(1.0)), condition)


def quotient_below_one(term: Term) -> Iterator[Fact]:
    """`a / (a + b)` of what is not negative: a + b, rounded, is not below a."""
    a, divisor = term.args
    if divisor.op == "fadd" and a in divisor.args:
        b = divisor.args[1] if divisor.args[0] is a else divisor.args[0]
        yield Fact((Bounded(a, 0.0, INF), Bounded(b, 0.0, INF)), Bounded(term, 0.0, 1.0))


def share_parts(term: Term) -> Iterator[tuple[Term, Term]]:
    """Where a quotient is `(x - a) / (y - a)`: x and y; of `x / y` too, where a is zero."""
    above, below = term.args
    yield above, below
    if above.op == below.op == "fadd":
        for x, less in (above.args, above.args[::-1]):
            for y, other in (below.args, below.args[::-1]):
                if less is other:
                    yield x, y


def of_share(term: Term, order: Term) -> Fact:
    """`(x - a) / (y - a)` is at most 1 where x is not above y, and y - a above zero: rounding keeps the order."""
    divisor = term.args[1]
    return Fact((Bounded(divisor, FORMATS[-divisor.sort].tiniest, INF),), Bounded(term, -INF, 1.0), (order,))


def quotient_below_factor(term: Term) -> Iterator[tuple[Fact, Term]]:
    """`c / b` where `a b > c`, rounded, and b > 0: then a b is above c exactly too, and c / b at most a. With the term a.

    The bound of a is open: whoever uses the fact sets it.
    """
    c, b = term.args
    form = FORMATS[-term.sort]
    for comparison in c.users:
        if comparison.op == "flt" and comparison.args[0] is c and comparison.args[1].op == "fmul":
            product = comparison.args[1]
            if b in product.args:
                a = product.args[1] if product.args[0] is b else product.args[0]
                yield Fact((Bounded(b, form.tiniest, INF),), Bounded(term, -INF, INF), (comparison,)), a


def of_conversion(term: Term, a: Real, result: Whole) -> Fact:
    """Float to whole number, toward zero: monotone."""
    low, high = (result.signed_low, result.signed_high) if term.data else (result.low, result.high)
    return Fact((Bounded(term.args[0], a.low, a.high),), Bounded(term, low, high, bool(term.data)))


def of_whole_number(term: Term, a: Whole, result: Real) -> Fact:
    """Whole number to float: monotone."""
    low, high = (a.signed_low, a.signed_high) if term.data else (a.low, a.high)
    return Fact((Bounded(term.args[0], low, high, bool(term.data)),), Bounded(term, result.low, result.high))


def largest_kept(grows: float, limit: float, form: Format, guess: float, factor: float | None = None) -> float | None:
    """The largest x for which `x + grows`, or `x factor` for a factor above zero, rounded, is not above a limit; else None."""

    def result(x: float) -> float:
        return form.add(x, grows) if factor is None else form.mul(x, factor)

    x = form.round(guess)
    if math.isnan(x) or math.isinf(x):
        return None
    for _ in range(64):
        if result(x) <= limit:
            break
        x = form.down(x)
    else:
        return None
    for _ in range(64):
        if result(form.up(x)) > limit:
            return x
        x = form.up(x)
    return x
