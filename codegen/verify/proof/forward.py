"""The box of a term from those of its operands, with the facts that say why."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from codegen.verify.proof import boxes
from codegen.verify.proof.boxes import EITHER, FALSE, INF, TRUE, Box, Real, Truth
from codegen.verify.proof.facts import (
    Bounded,
    Fact,
    fraction_limit,
    fraction_parts,
    of_box,
    of_conversion,
    of_fraction,
    of_share,
    of_sum,
    of_whole_number,
    quotient_below_factor,
    quotient_below_one,
    share_parts,
    weighted,
    weighted_parts,
)
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.terms import BY_CASES, Table, Term

if TYPE_CHECKING:
    from codegen.verify.proof.ranges import Scope


def forward(scope: Scope, term: Term) -> Box:
    """Where a term lies. The operands' boxes are known to the scope."""
    rule = RULES.get(term.op)
    return boxes.any_of(term.sort) if rule is None else rule(scope, term)


def _constant(_scope: Scope, term: Term) -> Box:
    return boxes.single(term.data, term.sort)


def _entry(_scope: Scope, term: Term) -> Box:
    table = term.data
    assert isinstance(table, Table)
    if term.sort < 0:
        return Real(table.low, table.high, False)
    return boxes.unsigned(int(table.low), int(table.high), term.sort)


def _choice(scope: Scope, term: Term) -> Box:
    condition = scope.truth(term.args[0])
    if not condition.may_fail:
        return scope.box(term.args[1])
    if not condition.may_hold:
        return scope.box(term.args[2])
    if term.data == BY_CASES:
        return _by_cases(scope, term)
    return boxes.hull(scope.box(term.args[1]), scope.box(term.args[2]))


def _by_cases(scope: Scope, term: Term) -> Box:
    """Each value where it is chosen."""
    result = None
    for holds, value in ((True, term.args[1]), (False, term.args[2])):
        branch = scope.fork()
        branch.assume(term.args[0], holds)
        if not branch.is_dead:
            result = branch.box(value) if result is None else boxes.hull(result, branch.box(value))
    return boxes.any_of(term.sort) if result is None else result


def _not(scope: Scope, term: Term) -> Box:
    inner = scope.truth(term.args[0])
    return Truth(inner.may_fail, inner.may_hold)


def _and(scope: Scope, term: Term) -> Box:
    a, b = (scope.truth(each) for each in term.args)
    return Truth(a.may_hold and b.may_hold, a.may_fail or b.may_fail)


def _or(scope: Scope, term: Term) -> Box:
    a, b = (scope.truth(each) for each in term.args)
    return Truth(a.may_hold or b.may_hold, a.may_fail and b.may_fail)


def _comparison(scope: Scope, term: Term) -> Box:
    a, b = term.args
    if a is b:
        box = scope.real(a)
        return TRUE if term.op != "flt" and not box.may_be_nan else FALSE if term.op == "flt" else EITHER
    return boxes.compared(term.op, scope.real(a), scope.real(b))


def _whole_comparison(scope: Scope, term: Term) -> Box:
    return boxes.compared_whole(term.op, scope.whole(term.args[0]), scope.whole(term.args[1]))


def _sum(scope: Scope, term: Term) -> Box:
    a, b = (scope.real(each) for each in term.args)
    form = FORMATS[-term.sort]
    result = boxes.added(a, b, form)
    for fact in of_sum(term, a, b, result):
        scope.facts.add(fact)
    for x, less in (term.args, term.args[::-1]):
        if less.op == "fneg" and scope.order(less.args[0], x) is not None:
            result = Real(max(result.low, 0.0), result.high, result.may_be_nan)
        elif less.op == "fneg" and scope.order(x, less.args[0]) is not None:
            result = Real(result.low, min(result.high, 0.0), result.may_be_nan)
    for parts in weighted_parts(term):
        old, weight = scope.real(parts.old), scope.real(parts.weight)
        new = Real(0.0, 0.0, False) if parts.new is None else scope.real(parts.new)
        bounds = weighted(old, new, weight, form)
        if bounds is not None:
            named = [(parts.old, old), (parts.weight, weight), *([] if parts.new is None else [(parts.new, new)])]
            premises = tuple(Bounded(each, box.low, box.high) for each, box in named)
            scope.facts.add(Fact(premises, Bounded(term, bounds.low, bounds.high)))
            result = Real(max(result.low, bounds.low), min(result.high, bounds.high), result.may_be_nan)
    return _fraction(scope, term, result)


def _fraction(scope: Scope, term: Term, result: Real) -> Real:
    """What is left of a number without its whole part, even where that part is cut down to a last cell."""
    form = FORMATS[-term.sort]
    for x, whole in fraction_parts(term):
        n, own = whole.args[0], scope.real(x)
        is_cut = n.op == "ite" and n.args[1].is_const
        conversion = n.args[2] if is_cut else n
        if conversion.op != "of_real" or conversion.args[0] is not x:
            continue
        limit = fraction_limit(whole, conversion)
        if own.low < 0.0 or own.high > limit:
            continue
        if not is_cut:
            scope.facts.add(of_fraction(term, x, limit))
            return Real(max(result.low, 0.0), min(result.high, form.down(1.0)), result.may_be_nan)
        condition, constant, _ = n.args
        scope.facts.add(of_fraction(term, x, limit, (scope.pool.not_(condition),)))
        branch = scope.fork()
        branch.assume(condition)
        if branch.is_dead:
            return Real(max(result.low, 0.0), min(result.high, form.down(1.0)), result.may_be_nan)
        cut = branch.real(x)
        value = boxes.of_whole(branch.whole(constant), bool(whole.data), form)
        beyond = boxes.added(cut, boxes.negated(value), form)
        fact = Fact((Bounded(x, cut.low, cut.high),), Bounded(term, beyond.low, beyond.high), (condition,))
        scope.facts.add(fact)
        low, high = min(beyond.low, 0.0), max(beyond.high, form.down(1.0))
        return Real(max(result.low, low), min(result.high, high), result.may_be_nan)
    return result


def _product(scope: Scope, term: Term) -> Box:
    a, b = (scope.real(each) for each in term.args)
    result = boxes.multiplied(a, b, FORMATS[-term.sort])
    if term.args[0] is term.args[1]:
        result = Real(max(result.low, 0.0), result.high, result.may_be_nan)
    scope.facts.add(of_box(term, a, b, result))
    return result


def _quotient(scope: Scope, term: Term) -> Box:
    a, b = (scope.real(each) for each in term.args)
    result = boxes.divided(a, b, FORMATS[-term.sort])
    scope.facts.add(of_box(term, a, b, result))
    low, high = result.low, result.high
    for fact in quotient_below_one(term):
        if all(scope.real(each.term).low >= 0.0 for each in fact.premises):
            scope.facts.add(fact)
            low, high = max(low, 0.0), min(high, 1.0)
    for x, y in share_parts(term):
        order = scope.order(x, y)
        if order is not None and b.low >= 0.0:
            scope.facts.add(of_share(term, order))
            high = min(high, 1.0)
            low = max(low, 0.0) if a.low >= 0.0 else low
    for fact, factor in quotient_below_factor(term):
        bound = scope.real(factor).high
        if b.low >= 0.0 and bound < INF and not scope.truth(fact.conditions[0]).may_fail:
            premises = (*fact.premises, Bounded(factor, -INF, bound))
            scope.facts.add(Fact(premises, Bounded(term, -INF, bound), fact.conditions))
            high = min(high, bound)
    return Real(low, high, result.may_be_nan)


def _of_whole(scope: Scope, term: Term) -> Box:
    a = scope.whole(term.args[0])
    result = boxes.of_whole(a, bool(term.data), FORMATS[-term.sort])
    scope.facts.add(of_whole_number(term, a, result))
    return result


def _of_real(scope: Scope, term: Term) -> Box:
    a = scope.real(term.args[0])
    result = boxes.of_real(a, term.sort, bool(term.data))
    if result is None:
        return boxes.any_of(term.sort)
    scope.facts.add(of_conversion(term, a, result))
    return result


def _extended(scope: Scope, term: Term) -> Box:
    a = scope.whole(term.args[0])
    if term.op == "sext":
        return boxes.with_sign(a.signed_low, a.signed_high, term.sort)
    return boxes.unsigned(a.low, a.high, term.sort)


def _cut(scope: Scope, term: Term) -> Box:
    a = scope.whole(term.args[0])
    half = 1 << (term.sort - 1)
    if a.high < 2 * half:
        return boxes.unsigned(a.low, a.high, term.sort)
    if -half <= a.signed_low and a.signed_high < half:
        return boxes.with_sign(a.signed_low, a.signed_high, term.sort)
    return boxes.any_of(term.sort)


def _whole_sum(scope: Scope, term: Term) -> Box:
    (a, b), width = (scope.whole(each) for each in term.args), term.sort
    half = 1 << (width - 1)
    if term.op == "add":
        low, high, signs = a.low + b.low, a.high + b.high, (a.signed_low + b.signed_low, a.signed_high + b.signed_high)
    else:
        low, high, signs = a.low - b.high, a.high - b.low, (a.signed_low - b.signed_high, a.signed_high - b.signed_low)
    result = boxes.any_of(width)
    if low >= 0 and high < 2 * half:
        result = boxes.meet(result, boxes.unsigned(low, high, width), width)
    if signs[0] >= -half and signs[1] < half:
        result = boxes.meet(result, boxes.with_sign(*signs, width), width)
    return result


def _whole_product(scope: Scope, term: Term) -> Box:
    a, b = (scope.whole(each) for each in term.args)
    high = a.high * b.high
    return boxes.unsigned(a.low * b.low, high, term.sort) if high < 1 << term.sort else boxes.any_of(term.sort)


def _masked(scope: Scope, term: Term) -> Box:
    a, b = (scope.whole(each) for each in term.args)
    return boxes.unsigned(0, min(a.high, b.high), term.sort)


def _bits_joined(scope: Scope, term: Term) -> Box:
    a, b = (scope.whole(each) for each in term.args)
    return boxes.unsigned(0, (1 << max(a.high.bit_length(), b.high.bit_length())) - 1, term.sort)


def _shifted(scope: Scope, term: Term) -> Box:
    a, b = (scope.whole(each) for each in term.args)
    if b.low != b.high or b.high >= term.sort:
        return boxes.any_of(term.sort)
    if term.op == "shl":
        high = a.high << b.high
        return boxes.unsigned(a.low << b.low, high, term.sort) if high < 1 << term.sort else boxes.any_of(term.sort)
    if term.data and a.signed_low < 0:
        return boxes.with_sign(a.signed_low >> b.high, a.signed_high >> b.high, term.sort)
    return boxes.unsigned(a.low >> b.high, a.high >> b.high, term.sort)


def _divided(scope: Scope, term: Term) -> Box:
    a, b = (scope.whole(each) for each in term.args)
    what, is_signed = term.data
    if b.low < 1 or (is_signed and (a.signed_low < 0 or b.signed_low < 1)):
        return boxes.any_of(term.sort)
    high = a.high // b.low if what == "quotient" else min(a.high, b.high - 1)
    return boxes.unsigned(0, high, term.sort)


def _negated(scope: Scope, term: Term) -> Box:
    return boxes.negated(scope.real(term.args[0]))


def _magnitude(scope: Scope, term: Term) -> Box:
    return boxes.magnitude(scope.real(term.args[0]))


def _library(_scope: Scope, term: Term) -> Box:
    return boxes.any_of(term.sort)


RULES: dict[str, Callable[[Scope, Term], Box]] = {
    "const": _constant,
    "entry": _entry,
    "ite": _choice,
    "not": _not,
    "and": _and,
    "or": _or,
    **dict.fromkeys(("flt", "fle", "feq"), _comparison),
    **dict.fromkeys(("eq", "ult", "ule", "slt", "sle"), _whole_comparison),
    "fneg": _negated,
    "fabs": _magnitude,
    "fadd": _sum,
    "fmul": _product,
    "fdiv": _quotient,
    "of_whole": _of_whole,
    "of_real": _of_real,
    "zext": _extended,
    "sext": _extended,
    "trunc": _cut,
    "add": _whole_sum,
    "sub": _whole_sum,
    "mul": _whole_product,
    "band": _masked,
    "bor": _bits_joined,
    "bxor": _bits_joined,
    "shl": _shifted,
    "shr": _shifted,
    "div": _divided,
}
