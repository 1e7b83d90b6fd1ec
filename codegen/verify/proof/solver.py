"""Asks z3 whether obligations hold, and what breaks them where they do not.

z3 sees each operation on floats through its laws and the facts. Where it answers with numbers that break an obligation, the terms
are computed from its inputs: either the obligation is broken indeed, or some operation does not give what z3 made of it. Then the
operation's true result at that point becomes a fact, with what follows by monotonicity, and z3 is asked again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import z3

from codegen.verify.proof.boxes import INF
from codegen.verify.proof.concrete import computed, value_of
from codegen.verify.proof.encode import Encoder, Float
from codegen.verify.proof.facts import Bounded, Fact
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.machine import Obligation
from codegen.verify.proof.semantics import Value, signed
from codegen.verify.proof.terms import BOOL, Pool, Term, inside

ROUNDS_MAX = 40
"""Of asking again, for one obligation."""
REFINED_MAX = 12
"""Operations of which more is found out in one round."""
EFFORT_MAX = 400_000_000
"""For one question, in z3's own steps, which are the same on every machine: half a minute or so."""


class Answer(StrEnum):
    """Of an obligation."""

    PROVED = "proved"
    COUNTEREXAMPLE = "counterexample"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class Verdict:
    """What came of an obligation.

    Attributes:
        inputs: of a counterexample, or of what z3 could not exclude: by name.
    """

    obligation: Obligation
    answer: Answer
    inputs: tuple[tuple[str, Value], ...] = ()


class Prover:
    """For one pool of terms."""

    def __init__(self, pool: Pool, encoder: Encoder) -> None:
        self._pool, self.encoder = pool, encoder
        self.questions = 0

    def prove(self, assumptions: Sequence[Term], obligations: Iterable[Obligation]) -> list[Verdict]:
        """All of them together first; then those alone that are left."""
        waiting = list(obligations)
        verdicts: dict[Obligation, Verdict] = {}
        while waiting:
            broken = self._broken_together(assumptions, waiting)
            if broken == []:
                verdicts |= {each: Verdict(each, Answer.PROVED) for each in waiting}
                break
            alone = waiting if broken is None else broken
            verdicts |= {each: self._alone(assumptions, each) for each in alone}
            waiting = [each for each in waiting if each not in verdicts]
        return list(verdicts.values())

    def may_hold(self, assumptions: Sequence[Term]) -> bool:
        """Whether z3 does not exclude them together."""
        return bool(self._ask(assumptions)[0] != z3.unsat)

    def broken_among(self, assumptions: Sequence[Term], goals: Sequence[Term]) -> set[Term]:
        """Those of which z3 finds one after the other that they need not hold."""
        broken = {goal for goal in goals if goal is self._pool.false}
        left = [goal for goal in dict.fromkeys(goals) if goal not in broken and goal is not self._pool.true]
        question = _Question(self, [*assumptions, self._pool.not_(self._pool.and_(*left))]) if left else None
        while question is not None and left:
            answer, model = question.ask()
            if answer == z3.unsat:
                return broken
            if model is None:
                return broken | set(left)
            seen = {goal for goal in left if z3.is_false(model.eval(self.encoder.truth(goal), model_completion=True))}
            broken |= seen
            left = [goal for goal in left if goal not in seen]
            question.add(self._pool.not_(self._pool.and_(*left)))
        return broken

    def _broken_together(self, assumptions: Sequence[Term], obligations: list[Obligation]) -> list[Obligation] | None:
        """Those that one answer of z3 breaks, none where all hold; None where z3 gives up."""
        violated = [self._pool.and_(each.path, self._pool.not_(each.goal)) for each in obligations]
        answer, model = self._ask([*assumptions, self._pool.or_(*violated)])
        if answer == z3.unsat:
            return []
        if model is None:
            return None
        seen = [z3.is_true(model.eval(self.encoder.truth(each), model_completion=True)) for each in violated]
        return [each for each, is_broken in zip(obligations, seen, strict=True) if is_broken] or None

    def _ask(self, terms: Sequence[Term]) -> tuple[Any, Any]:
        """Whether all can hold, and z3's numbers where they can."""
        return _Question(self, terms).ask()

    def cone(self, terms: Sequence[Term]) -> list[Term]:
        """The terms inside, and those that the facts about them are made of."""
        found = inside(terms)
        seen = set(found)
        waiting = list(found)
        while waiting:
            term = waiting.pop()
            beside = [each for fact in self.encoder.facts.about(term) for each in _named(fact) if each not in seen]
            for each in inside(beside):
                if each not in seen:
                    seen.add(each)
                    waiting.append(each)
        return sorted(seen, key=lambda term: term.number)

    def _alone(self, assumptions: Sequence[Term], obligation: Obligation) -> Verdict:
        terms = [*assumptions, obligation.path, self._pool.not_(obligation.goal)]
        question = _Question(self, terms)
        inputs: dict[Term, Value] = {}
        for _ in range(ROUNDS_MAX):
            answer, model = question.ask()
            if answer == z3.unsat:
                return Verdict(obligation, Answer.PROVED)
            if model is None:
                break
            cone = inside(terms)
            believed = {term: self._believed(model, term) for term in cone}
            inputs = {term: believed[term] for term in cone if term.op in ("var", "entry")}
            true = computed(terms, inputs)
            if all(true[each] for each in terms):
                return Verdict(obligation, Answer.COUNTEREXAMPLE, _named_inputs(obligation, inputs))
            refined = _refined(cone, believed, inputs)
            if not refined:
                break
            question.learn(refined)
        return Verdict(obligation, Answer.UNKNOWN, _named_inputs(obligation, inputs))

    def _believed(self, model: Any, term: Term) -> Value:
        """The value that z3 gives to a term."""
        encoded = self.encoder.of(term)
        if isinstance(encoded, Float):
            if z3.is_true(model.eval(encoded.nan, model_completion=True)):
                return math.nan
            key = signed(model.eval(encoded.key, model_completion=True).as_long(), -term.sort)
            return FORMATS[-term.sort].from_key(key)
        value = model.eval(encoded, model_completion=True)
        return bool(z3.is_true(value)) if term.sort == BOOL else int(value.as_long())


class _Question:
    """Whether some terms can all hold. The laws of the operations come in only where the facts alone do not say no."""

    def __init__(self, prover: Prover, terms: Sequence[Term]) -> None:
        self._prover, encoder = prover, prover.encoder
        self._solver = z3.SolverFor("QF_FD")
        self._solver.set("rlimit", EFFORT_MAX)
        self._solver.add(*(encoder.truth(term) for term in terms))
        self._laws: list[Any] = []
        for term in prover.cone(terms):
            self._solver.add(*encoder.known(term))
            self._laws += encoder.laws(term)

    def ask(self) -> tuple[Any, Any]:
        """z3's answer, and its numbers where there are such."""
        answer = self._check()
        if answer == z3.sat and self._laws:
            self._solver.add(*self._laws)
            self._laws = []
            answer = self._check()
        return answer, self._solver.model() if answer == z3.sat else None

    def _check(self) -> Any:
        self._prover.questions += 1
        return self._solver.check()

    def add(self, term: Term) -> None:
        """Ask for this too, of what the question has inside already."""
        self._solver.add(self._prover.encoder.truth(term))

    def learn(self, facts: Iterable[Fact]) -> None:
        """More of what is known."""
        self._solver.add(*(self._prover.encoder.fact(each) for each in facts))


def _named(fact: Fact) -> list[Term]:
    return [*fact.conditions, *(each.term for each in fact.premises)]


def _named_inputs(obligation: Obligation, inputs: dict[Term, Value]) -> tuple[tuple[str, Value], ...]:
    """Those that the obligation depends on, by name, in the order in which they came up."""
    cone = inside([obligation.path, obligation.goal])
    return tuple((str(term.data), inputs[term]) for term in cone if term.op == "var" and term in inputs)


def _refined(cone: Sequence[Term], believed: dict[Term, Value], inputs: dict[Term, Value]) -> list[Fact]:
    """What operations truly give for the operands that z3 chose, where it made something else of them."""
    found: list[Fact] = []
    terms = 0
    for term in cone:
        rule = REFINEMENTS.get(term.op)
        if rule is not None and terms < REFINED_MAX:
            args = [believed[each] for each in term.args]
            true = value_of(term, args, inputs)
            if true != believed[term] and not (true != true and believed[term] != believed[term]):
                found += rule(term, args, true)
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
    return [
        Fact((_toward_zero(a, x), _toward_zero(b, y)), _toward_zero(term, true)),
        Fact((_away(a, x), _away(b, y)), _away(term, true)),
    ]


def _of_quotient(term: Term, args: list[Any], true: Any) -> list[Fact]:
    (a, b), (x, y) = term.args, args
    tiny = math.copysign(FORMATS[-term.sort].tiniest, y)
    beside = Bounded(b, min(tiny, y), max(tiny, y)) if y != 0.0 else Bounded(b, y, y)
    return [
        Fact((_toward_zero(a, x), _away(b, y)), _toward_zero(term, true)),
        Fact((_away(a, x), beside), _away(term, true)),
    ]


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
