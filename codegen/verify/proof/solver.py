"""Asks z3 whether obligations hold, and what breaks them where they do not.

z3 sees each operation on floats through its laws and the facts. Where it answers with numbers that break an obligation, the
terms are computed from its inputs: either the obligation is broken, or some operation does not give what z3 made of it. The
operation's true result at that point then becomes a fact, with what follows by monotonicity, and z3 is asked again.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import z3

from codegen.verify.proof.concrete import computed
from codegen.verify.proof.encode import Encoder, Float
from codegen.verify.proof.facts import Fact
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.obligations import Obligation
from codegen.verify.proof.refine import refinements
from codegen.verify.proof.semantics import Value, signed
from codegen.verify.proof.terms import BOOL, Pool, Term, inside

ROUNDS_MAX = 100
"""Of asking again, for one obligation."""
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
        is_typical: whether the parameters are the build's own, and left out of the inputs.
    """

    obligation: Obligation
    answer: Answer
    inputs: tuple[tuple[str, Value], ...] = ()
    is_typical: bool = False


class Prover:
    """For one pool of terms."""

    def __init__(self, pool: Pool, encoder: Encoder) -> None:
        self._pool, self.encoder = pool, encoder
        self.questions = 0
        self._inputs: dict[Term, frozenset[Term]] = {}

    def prove(
        self, assumptions: Sequence[Term], obligations: Iterable[Obligation], typical: Sequence[Term] = ()
    ) -> list[Verdict]:
        """All of them together first; then those alone that are left.

        Of one that does not hold, what follows is not told again: the others are asked as if it held. An input that breaks any
        breaks one that is told.

        Args:
            assumptions: what the inputs fulfil.
            obligations: what has to hold then.
            typical: what inputs may fulfil too that make a counterexample easier to find and to read.
        """
        waiting = list(obligations)
        verdicts: dict[Obligation, Verdict] = {}
        assumed = list(assumptions)
        while waiting:
            broken = self._broken_together(assumed, waiting)
            if broken == []:
                verdicts |= {each: Verdict(each, Answer.PROVED) for each in waiting}
                break
            alone = waiting if broken is None else broken
            for each in alone:
                verdicts[each] = self._alone(assumed, each, typical)
                if verdicts[each].answer is not Answer.PROVED:
                    assumed.append(self._pool.or_(self._pool.not_(each.path), each.goal))
            waiting = [each for each in waiting if each not in verdicts]
        return list(verdicts.values())

    def may_hold(self, assumptions: Sequence[Term]) -> bool:
        """Whether z3 does not exclude them together."""
        return bool(self._ask(assumptions)[0] != z3.unsat)

    def broken_among(self, assumptions: Sequence[Term], goals: Sequence[Term]) -> set[Term]:
        """Those of which z3 finds one after the other that they need not hold."""
        broken = {goal for goal in goals if goal is self._pool.false}
        left = [goal for goal in dict.fromkeys(goals) if goal not in broken and goal is not self._pool.true]
        question = _Question(self, [*self.about(assumptions, left), self._pool.not_(self._pool.and_(*left))]) if left else None
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
        answer, model = self._ask([*self.about(assumptions, violated), self._pool.or_(*violated)])
        if answer == z3.unsat:
            return []
        if model is None:
            return None
        seen = [z3.is_true(model.eval(self.encoder.truth(each), model_completion=True)) for each in violated]
        return [each for each, is_broken in zip(obligations, seen, strict=True) if is_broken] or None

    def about(self, assumptions: Sequence[Term], terms: Sequence[Term]) -> list[Term]:
        """Of the assumptions, part by part, those that share inputs with the terms, or with others that do.

        To leave one out is never wrong: less is assumed. Those left out here change no answer either, where all assumptions
        can hold together: that a map is valid, its thousands of numbers, says nothing of what is computed from three of them
        that are taken by their bounds.
        """
        waiting = {part: self._inputs_of(part) for each in assumptions for part in _conjuncts(each)}
        reached = frozenset[Term]().union(*(self._inputs_of(each) for each in terms))
        kept: set[Term] = set()
        while True:
            near = {part for part, inputs in waiting.items() if not inputs or not inputs.isdisjoint(reached)}
            if not near:
                return [part for each in assumptions for part in _conjuncts(each) if part in kept]
            kept |= near
            reached = reached.union(*(waiting.pop(part) for part in near))

    def _inputs_of(self, term: Term) -> frozenset[Term]:
        """Variables and entries of tables, in the term and in the facts about it."""
        if term not in self._inputs:
            self._inputs[term] = frozenset(each for each in self.cone([term]) if each.op in ("var", "entry"))
        return self._inputs[term]

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

    def _alone(self, assumptions: Sequence[Term], obligation: Obligation, typical: Sequence[Term]) -> Verdict:
        violated = [obligation.path, self._pool.not_(obligation.goal)]
        terms = [*self.about(assumptions, violated), *violated]
        if typical:
            verdict = self._searched([*terms, *typical], obligation)
            if verdict.answer == Answer.COUNTEREXAMPLE:
                fixed = {str(variable.data) for term in typical for variable in term.args if variable.op == "var"}
                inputs = tuple((name, value) for name, value in verdict.inputs if name not in fixed)
                return replace(verdict, inputs=inputs, is_typical=True)
        return self._searched(terms, obligation)

    def _searched(self, terms: Sequence[Term], obligation: Obligation) -> Verdict:
        """Round by round, until z3 has nothing more against it, or something that is true."""
        question, cone = _Question(self, terms), inside(terms)
        inputs: dict[Term, Value] = {}
        for _ in range(ROUNDS_MAX):
            answer, model = question.ask()
            if answer == z3.unsat:
                return Verdict(obligation, Answer.PROVED)
            if model is None:
                break
            believed = {term: self._believed(model, term) for term in cone}
            inputs = {term: believed[term] for term in cone if term.op in ("var", "entry")}
            true = computed(terms, inputs)
            if all(true[each] for each in terms):
                return Verdict(obligation, Answer.COUNTEREXAMPLE, _named_inputs(obligation, inputs))
            refined = refinements(cone, believed, inputs)
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


def _conjuncts(term: Term) -> list[Term]:
    """What holds where the term does, part by part."""
    found: list[Term] = []
    waiting, seen = [term], set[Term]()
    while waiting:
        each = waiting.pop()
        if each in seen:
            continue
        seen.add(each)
        if each.op == "and":
            waiting.extend(reversed(each.args))
        else:
            found.append(each)
    return found


def _named(fact: Fact) -> list[Term]:
    return [*fact.conditions, *(each.term for each in fact.premises)]


def _named_inputs(obligation: Obligation, inputs: dict[Term, Value]) -> tuple[tuple[str, Value], ...]:
    """Those that the obligation depends on, by name, in the order in which they came up."""
    cone = inside([obligation.path, obligation.goal])
    return tuple((str(term.data), inputs[term]) for term in cone if term.op == "var" and term in inputs)
