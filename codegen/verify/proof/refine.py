"""What an operation truly gives where z3 believed something else, as facts that rule the belief out, and more like it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from codegen.verify.proof.boxes import INF
from codegen.verify.proof.concrete import value_of
from codegen.verify.proof.facts import Bounded, Fact
from codegen.verify.proof.floats import FORMATS, Format
from codegen.verify.proof.semantics import Value, signed
from codegen.verify.proof.terms import Term

REFINED_MAX = 12
"""Operations of which more is found out in one round."""


def refinements(cone: Sequence[Term], believed: dict[Term, Value], inputs: dict[Term, Value]) -> list[Fact]:
    """What operations truly give for the operands that z3 chose, where it made something else of them."""
    found: list[Fact] = []
    terms = 0
    for term in cone:
        rule = REFINEMENTS.get(term.op)
        if rule is not None and terms < REFINED_MAX:
            args = [believed[each] for each in term.args]
            true = value_of(term, args, inputs)
            if true != believed[term] and true == true:  # when a result is NaN is encoded exactly
                found += rule(term, args, true)
                if term.op in ("fadd", "fmul"):
                    found += _as_far_as_wrong(term, args, believed[term])
                terms += 1
    return found


def _of_sum(term: Term, args: list[Any], true: Any) -> list[Fact]:
    (a, b), (x, y) = term.args, args
    return [
        Fact((Bounded(a, -INF, x), Bounded(b, -INF, y)), Bounded(term, -INF, true)),
        Fact((Bounded(a, x, INF), Bounded(b, y, INF)), Bounded(term, true, INF)),
    ]


def _of_product(term: Term, args: list[Any], true: Any) -> list[Fact]:
    """Farther from zero, each in its direction, and nearer."""
    (a, b), (x, y) = term.args, args
    found = [Fact((_toward_zero(a, x), _toward_zero(b, y)), _toward_zero(term, true))]
    if true != 0.0 or 0.0 in (x, y):  # one that is too small for a float says nothing of larger ones
        found.append(Fact((_away(a, x), _away(b, y)), _away(term, true)))
    return found


def _of_quotient(term: Term, args: list[Any], true: Any) -> list[Fact]:
    (a, b), (x, y) = term.args, args
    if y == 0.0:
        return []  # of which sign the quotient is, depends on that of the zero
    tiny = math.copysign(FORMATS[-term.sort].tiniest, y)
    found = [Fact((_toward_zero(a, x), _away(b, y)), _toward_zero(term, true))]
    if true != 0.0 or x == 0.0:
        found.append(Fact((_away(a, x), Bounded(b, min(tiny, y), max(tiny, y))), _away(term, true)))
    return found


def _as_far_as_wrong(term: Term, args: list[Any], believed: Any) -> list[Fact]:
    """One operand moved as far as the result still is not what z3 made of it, the other one held: of one answer, many."""
    found = []
    for place in (0, 1):
        own, other = args[place], args[1 - place]
        form = FORMATS[-term.sort]
        if math.isnan(believed) or math.isnan(own) or math.isnan(other) or math.isinf(other):
            continue

        def result(x: float, other: float = other, form: Format = form) -> float:
            return form.add(x, other) if term.op == "fadd" else form.mul(x, other)

        if math.isnan(result(own)):
            continue
        rises = term.op == "fadd" or other > 0.0
        is_below = result(own) < believed  # what is true is below what was believed
        goes_up = is_below == rises
        if term.op == "fmul" and other == 0.0:
            continue
        last = _last_wrong(result, own, believed, is_below, goes_up, form)
        low, high = (-INF, last) if goes_up else (last, INF)
        low, high = (max(low, -form.largest), min(high, form.largest))
        bounds = (-INF, result(last)) if is_below else (result(last), INF)
        held = Bounded(term.args[1 - place], other, other)
        found.append(Fact((Bounded(term.args[place], low, high), held), Bounded(term, *bounds)))
    return found


def _last_wrong(
    result: Callable[[float], float], start: float, believed: float, is_below: bool, goes_up: bool, form: Format
) -> float:
    """The last operand, from a start, up or down, of which the result stays on its side of what was believed."""
    near, far = form.key(start), form.key(form.largest if goes_up else -form.largest)

    def is_wrong(key: int) -> bool:
        value = result(form.from_key(key))
        return value < believed if is_below else value > believed

    if is_wrong(far):
        return form.from_key(far)
    while abs(far - near) > 1:
        middle = (near + far) // 2
        near, far = (middle, far) if is_wrong(middle) else (near, middle)
    return form.from_key(near)


def _toward_zero(term: Term, value: float) -> Bounded:
    return Bounded(term, min(value, 0.0), max(value, 0.0))


def _away(term: Term, value: float) -> Bounded:
    if value == 0.0:
        return Bounded(term, 0.0, 0.0)
    return Bounded(term, value, INF) if value > 0.0 else Bounded(term, -INF, value)


def _of_whole(term: Term, args: list[Any], true: Any) -> list[Fact]:
    width, (a,) = term.args[0].sort, term.args
    value = signed(args[0], width) if term.data else args[0]
    low, high = (-(1 << (width - 1)), (1 << (width - 1)) - 1) if term.data else (0, (1 << width) - 1)
    return [
        Fact((Bounded(a, low, value, bool(term.data)),), Bounded(term, -INF, true)),
        Fact((Bounded(a, value, high, bool(term.data)),), Bounded(term, true, INF)),
    ]


def _of_real(term: Term, args: list[Any], true: Any) -> list[Fact]:
    value = signed(true, term.sort) if term.data else true
    form, x = FORMATS[-term.args[0].sort], args[0]
    if x != x or abs(value) >= form.whole_below or (value == 0 and abs(x) >= 1.0):
        return []
    low, high = (float(value), form.down(float(value + 1))) if value > 0 else (form.up(float(value - 1)), float(value))
    low, high = (low, high) if value else (form.up(-1.0), form.down(1.0))
    return [Fact((Bounded(term.args[0], low, high),), Bounded(term, value, value, bool(term.data)))]


REFINEMENTS = {"fadd": _of_sum, "fmul": _of_product, "fdiv": _of_quotient, "of_whole": _of_whole, "of_real": _of_real}
