"""Between which values every term lies at one place of the program: found forward from operands, narrowed by what was asked.

Nothing here is trusted: what is found serves to write facts down, and a fact holds by itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Self

from codegen.verify.proof import boxes
from codegen.verify.proof.boxes import FALSE, INF, TRUE, Box, Real, Truth, Whole
from codegen.verify.proof.facts import Bounded, Fact, Facts, largest_kept
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.forward import forward
from codegen.verify.proof.terms import Pool, Term

DEPTH_MAX = 4
"""Of choices that are looked into while one thing is taken to hold."""
COMPARISONS = ("flt", "fle", "feq")
WHOLE_COMPARISONS = ("eq", "ult", "ule", "slt", "sle")


class Scope:
    """What is known of the terms at one place.

    Attributes:
        is_dead: whether no run comes here.
        is_idle: whether it learns nothing: for a run of which only the terms count.
    """

    def __init__(self, pool: Pool, facts: Facts, is_idle: bool = False) -> None:
        self.pool, self.facts, self.is_idle = pool, facts, is_idle
        self.is_dead = False
        self._known: dict[Term, Box] = {}
        self._found: dict[Term, Box] = {}
        self._clauses: tuple[Term, ...] = ()

    @property
    def is_fresh(self) -> bool:
        """Whether nothing was learned yet."""
        return not (self._known or self._clauses or self.is_dead or self.is_idle)

    def fork(self) -> Self:
        """The same, to learn more apart."""
        other = type(self)(self.pool, self.facts, self.is_idle)
        if self.is_idle:
            return other
        other.is_dead, other._clauses = self.is_dead, self._clauses
        other._known, other._found = self._known.copy(), self._found.copy()
        return other

    def adopt(self, other: Scope) -> None:
        """Know what another one knows."""
        self.is_dead, self._known, self._found = other.is_dead, other._known, other._found

    def join(self, branches: Sequence[Scope]) -> None:
        """Know what all branches know that can be taken."""
        if self.is_idle:
            return
        alive = [branch for branch in branches if not branch.is_dead]
        if len(alive) < 2:
            if alive:
                self.adopt(alive[0])
            else:
                self.is_dead = True
            return
        known = self._joined_known(alive)
        first, *rest = alive
        found = {}
        for term, box in first._found.items():
            if all(other._found.get(term) is box for other in rest):
                found[term] = box
        self._known, self._found = known, found

    @staticmethod
    def _joined_known(branches: Sequence[Scope]) -> dict[Term, Box]:
        """What one branch learned counts with what the others find for it."""
        result: dict[Term, Box] = {}
        for branch in branches:
            for term, box in branch._known.items():
                if term not in result:
                    for other in branches:
                        if other is not branch and other._known.get(term) is not box:
                            box = boxes.hull(box, other.box(term))
                    result[term] = box
        return result

    def box(self, term: Term) -> Box:
        """Where the term lies."""
        if self.is_idle:
            return boxes.any_of(term.sort)
        found = self._found.get(term)
        waiting = [] if found is not None else [term]
        while waiting:
            top = waiting[-1]
            missing = [each for each in top.args if each not in self._found]
            if missing:
                waiting.extend(missing)
                continue
            waiting.pop()
            if top not in self._found:
                box, known = forward(self, top), self._known.get(top)
                self._found[top] = box if known is None else boxes.meet(box, known, top.sort)
        return self._found[term] if found is None else found

    def real(self, term: Term) -> Real:
        box = self.box(term)
        assert isinstance(box, Real)
        return box

    def whole(self, term: Term) -> Whole:
        box = self.box(term)
        assert isinstance(box, Whole)
        return box

    def truth(self, term: Term) -> Truth:
        box = self.box(term)
        assert isinstance(box, Truth)
        return box

    def order(self, low: Term, high: Term) -> Term | None:
        """What is taken to hold that says of two floats that one is not above the other, as far as both are numbers."""
        for op, a, b, wanted in (
            ("flt", low, high, TRUE),
            ("fle", low, high, TRUE),
            ("flt", high, low, FALSE),
            ("fle", high, low, FALSE),
        ):
            term = self.pool.existing(op, 0, a, b)
            if term is not None and self._known.get(term) == wanted:
                return term if wanted == TRUE else self.pool.not_(term)
        return None

    def learn(self, term: Term, box: Box) -> None:
        """That a term lies in a box too, because somebody knows."""
        if self.is_idle:
            return
        self._known[term] = box if term not in self._known else boxes.meet(self._known[term], box, term.sort)
        self._forget(term)

    def keep(self, clauses: Sequence[Term]) -> None:
        """Take these to hold, and look at them again wherever a choice is split."""
        for clause in clauses:
            self.assume(clause)
        self._clauses = (*self._clauses, *clauses)

    def _forget(self, term: Term) -> None:
        """What was found from it."""
        waiting = [term]
        while waiting:
            top = waiting.pop()
            if self._found.pop(top, None) is not None:
                waiting.extend(top.users)

    def assume(self, term: Term, holds: bool = True, depth: int = 0) -> None:
        """Take a truth value to be so."""
        if self.is_idle:
            return
        wanted, truth = (TRUE if holds else FALSE), self.truth(term)
        if not (truth.may_hold if holds else truth.may_fail):
            self.is_dead = True
        if self.is_dead or (term.is_const or self._known.get(term) == wanted):
            return
        self._known[term] = wanted
        self._forget(term)
        args = term.args
        if term.op == "not":
            self.assume(args[0], not holds, depth)
        elif term.op in ("and", "or"):
            if (term.op == "and") == holds:
                self.assume(args[0], holds, depth)
                self.assume(args[1], holds, depth)
            else:
                self._one_of([[(args[0], holds)], [(args[1], holds)]], depth)
        elif term.op == "ite":
            self._one_of([[(args[0], True), (args[1], holds)], [(args[0], False), (args[2], holds)]], depth)
        elif term.op in COMPARISONS:
            self._compare(term, holds, depth)
        elif term.op in WHOLE_COMPARISONS:
            self._compare_whole(term, holds, depth)

    def _one_of(self, choices: Sequence[Sequence[tuple[Term, bool]]], depth: int) -> None:
        possible = [each for each in choices if all(self._may_be(term, holds) for term, holds in each)]
        if len(possible) == 1:
            for term, holds in possible[0]:
                self.assume(term, holds, depth)
        elif not possible:
            self.is_dead = True
        elif depth < DEPTH_MAX:
            branches = []
            for choice in possible:
                branch = self.fork()
                for term, holds in choice:
                    branch.assume(term, holds, depth + 1)
                branch._look_at_clauses(depth + 1)
                branches.append(branch)
            self.join(branches)

    def _look_at_clauses(self, depth: int) -> None:
        for clause in self._clauses:
            if not self.is_dead and clause.op == "or":
                self._one_of([[(each, True)] for each in clause.args], max(depth, DEPTH_MAX))

    def _may_be(self, term: Term, holds: bool) -> bool:
        truth = self.truth(term)
        return truth.may_hold if holds else truth.may_fail

    def _compare(self, term: Term, holds: bool, depth: int) -> None:
        (a, b), form = term.args, FORMATS[-term.args[0].sort]
        x, y = self.real(a), self.real(b)
        if holds:
            below = form.down(y.high) if term.op == "flt" else y.high
            above = form.up(x.low) if term.op == "flt" else x.low
            self.narrow(a, Real(y.low if term.op == "feq" else -INF, below, False), depth)
            self.narrow(b, Real(above, x.high if term.op == "feq" else INF, False), depth)
            return
        if term.op == "feq":
            self._unequal(a, y, depth)
            self._unequal(b, x, depth)
            return
        # NaN, or the other way round.
        if not y.may_be_nan:
            self.narrow(a, Real(form.up(y.low) if term.op == "fle" else y.low, INF, True), depth)
        if not x.may_be_nan:
            self.narrow(b, Real(-INF, form.down(x.high) if term.op == "fle" else x.high, True), depth)

    def _unequal(self, term: Term, other: Real, depth: int) -> None:
        """Not the one value that the other is."""
        if other.low == other.high and not other.may_be_nan:
            form, box = FORMATS[-term.sort], self.real(term)
            low = form.up(box.low) if box.low == other.low else box.low
            self.narrow(term, Real(low, form.down(box.high) if box.high == other.low else box.high, box.may_be_nan), depth)

    def _compare_whole(self, term: Term, holds: bool, depth: int) -> None:
        a, b = term.args
        x, y, width = self.whole(a), self.whole(b), a.sort
        if term.op == "eq":
            if holds:
                self.narrow(a, y, depth)
                self.narrow(b, x, depth)
            return
        strict = (term.op in ("ult", "slt")) == holds  # a < b, a <= b, or b < a, b <= a
        if not holds:
            (a, b), (x, y) = (b, a), (y, x)
        step = 1 if strict else 0
        if term.op in ("ult", "ule"):
            self.narrow(a, boxes.unsigned(0, y.high - step, width), depth)
            self.narrow(b, boxes.unsigned(x.low + step, (1 << width) - 1, width), depth)
        else:
            self.narrow(a, boxes.with_sign(-(1 << (width - 1)), y.signed_high - step, width), depth)
            self.narrow(b, boxes.with_sign(x.signed_low + step, (1 << (width - 1)) - 1, width), depth)

    def narrow(self, term: Term, to: Box, depth: int = 0) -> None:
        """Take a term to lie in a box too, and its operands where only so it can."""
        before = self.box(term)
        box = boxes.meet(before, to, term.sort)
        if box.is_empty:
            self.is_dead = True
        if self.is_dead or box == before or term.is_const:
            return
        self.learn(term, box)
        backward = BACKWARD.get(term.op)
        if backward is not None:
            backward(self, term, box, depth)


def _through_sign(scope: Scope, term: Term, box: Box, depth: int) -> None:
    assert isinstance(box, Real)
    scope.narrow(term.args[0], boxes.negated(box), depth)


def _through_magnitude(scope: Scope, term: Term, box: Box, depth: int) -> None:
    assert isinstance(box, Real)
    scope.narrow(term.args[0], Real(-box.high, box.high, box.may_be_nan), depth)


def _through_choice(scope: Scope, term: Term, box: Box, depth: int) -> None:
    condition, *values = term.args
    possible = [
        (holds, value)
        for holds, value in zip((True, False), values, strict=True)
        if scope._may_be(condition, holds) and not boxes.meet(scope.box(value), box, term.sort).is_empty
    ]
    if len(possible) == 2 and depth >= DEPTH_MAX:
        return
    branches = []
    for holds, value in possible:
        branch = scope.fork()
        branch.assume(condition, holds, depth + 1)
        if not branch.is_dead:
            branch.narrow(value, box, depth + 1)
        branches.append(branch)
    scope.join(branches)


def _through_sum(scope: Scope, term: Term, box: Box, depth: int) -> None:
    """x + y <= h and y >= l: x is at most the last one of which the sum with l is not above h."""
    assert isinstance(box, Real)
    form = FORMATS[-term.sort]
    for x, y in (term.args, term.args[::-1]):
        other, own = scope.real(y), scope.real(x)
        if box.high < INF and other.low > -INF and not other.may_be_nan:
            last = largest_kept(other.low, box.high, form, box.high - other.low)
            if last is not None and last < own.high:
                beyond = form.up(last)
                sum_beyond = Bounded(term, form.add(beyond, other.low), INF)
                scope.facts.add(Fact((Bounded(x, beyond, INF), Bounded(y, other.low, INF)), sum_beyond))
                scope.narrow(x, Real(-INF, last, own.may_be_nan), depth)
        if box.low > -INF and other.high < INF and not other.may_be_nan:
            last = largest_kept(-other.high, -box.low, form, other.high - box.low)
            if last is not None and -last > own.low:
                beyond = -form.up(last)
                sum_beyond = Bounded(term, -INF, form.add(beyond, other.high))
                scope.facts.add(Fact((Bounded(x, -INF, beyond), Bounded(y, -INF, other.high)), sum_beyond))
                scope.narrow(x, Real(-last, INF, own.may_be_nan), depth)


def _through_product(scope: Scope, term: Term, box: Box, depth: int) -> None:
    """Of a constant factor above zero; and above zero itself, of factors of one sign."""
    assert isinstance(box, Real)
    form = FORMATS[-term.sort]
    for x, y in (term.args, term.args[::-1]):
        if box.low > 0.0 and not box.may_be_nan and scope.real(y).low >= 0.0:
            scope.narrow(x, Real(form.tiniest, INF, False), depth)
        if y.is_const and 0.0 < y.data < INF:
            own, factor = scope.real(x), Bounded(y, y.data, y.data)
            high = largest_kept(0.0, box.high, form, box.high / y.data, y.data) if box.high < INF else None
            low = largest_kept(0.0, -box.low, form, -box.low / y.data, y.data) if box.low > -INF else None
            if high is not None and high < own.high:
                beyond = form.up(high)
                scope.facts.add(Fact((Bounded(x, beyond, INF), factor), Bounded(term, form.mul(beyond, y.data), INF)))
                scope.narrow(x, Real(-INF, high, own.may_be_nan), depth)
            if low is not None and -low > own.low:
                beyond = -form.up(low)
                scope.facts.add(Fact((Bounded(x, -INF, beyond), factor), Bounded(term, -INF, form.mul(beyond, y.data))))
                scope.narrow(x, Real(-low, INF, own.may_be_nan), depth)


def _through_conversion(scope: Scope, term: Term, box: Box, depth: int) -> None:
    """From float to whole number: what is at least n > 0 came from at least n."""
    assert isinstance(box, Whole)
    low, high = (box.signed_low, box.signed_high) if term.data else (box.low, box.high)
    x, form = term.args[0], FORMATS[-term.args[0].sort]
    own = scope.real(x)
    if 0 < low < form.whole_below and own.low < low:
        scope.facts.add(Fact((Bounded(x, 0.0, form.down(float(low))),), Bounded(term, 0.0, float(low - 1), bool(term.data))))
        scope.narrow(x, Real(float(low), INF, own.may_be_nan), depth)
    most = (1 << (term.sort - (1 if term.data else 0))) - 1  # beyond, the conversion is not defined
    if 0 <= high < min(form.whole_below - 1, most) and own.high >= high + 1:
        top = min(own.high, form.down(float(most + 1)))
        premise = Bounded(x, float(high + 1), top)
        scope.facts.add(Fact((premise,), Bounded(term, float(high + 1), float(int(top)), bool(term.data))))
        scope.narrow(x, Real(-INF, form.down(float(high + 1)), own.may_be_nan), depth)


def _through_extension(scope: Scope, term: Term, box: Box, depth: int) -> None:
    assert isinstance(box, Whole)
    width = term.args[0].sort
    if term.op == "zext":
        scope.narrow(term.args[0], boxes.unsigned(max(box.low, 0), min(box.high, (1 << width) - 1), width), depth)
    else:
        half = 1 << (width - 1)
        scope.narrow(term.args[0], boxes.with_sign(max(box.signed_low, -half), min(box.signed_high, half - 1), width), depth)


BACKWARD: dict[str, Callable[[Scope, Term, Box, int], None]] = {
    "fneg": _through_sign,
    "fabs": _through_magnitude,
    "ite": _through_choice,
    "fadd": _through_sum,
    "fmul": _through_product,
    "of_real": _through_conversion,
    "zext": _through_extension,
    "sext": _through_extension,
}
