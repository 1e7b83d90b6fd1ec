"""for loops: turn by turn where they are short, else one turn for all."""

from __future__ import annotations

from typing import Any

from pycparser import c_ast

from codegen.verify.proof.c_types import Family, Scalar, leaves
from codegen.verify.proof.expressions import Expressions
from codegen.verify.proof.machine import Frame, sort_of
from codegen.verify.proof.memory import Key, Reference, State, Typed
from codegen.verify.proof.semantics import signed
from codegen.verify.proof.source import CannotJudge, place_of
from codegen.verify.proof.terms import Term

TURNS_MAX = 40
"""Of a loop that is run turn by turn."""
NESTED_TURNS_MAX = 4
"""Of one with another loop inside."""


class Loops(Expressions):
    """The part of a run that is inside loops."""

    def loop(self, frame: Frame, node: Any, state: State) -> State | None:
        """Raises CannotJudge: neither short nor of the kind that counts from a constant to a constant."""
        if node.cond is None:
            raise CannotJudge(place_of(node), "a loop without a condition")
        names = dict(frame.names)
        if node.init is not None:
            entered = self.statement(frame, node.init, state)
            assert entered is not None
            state = entered
        turns = self._turns(frame, node, state)
        if turns is not None and turns > (NESTED_TURNS_MAX if _holds_loop(node.stmt) else TURNS_MAX):
            end: State | None = self._summary(frame, node, state, turns)
        else:
            end = self._turn_by_turn(frame, node, state)
        frame.names = names
        return end

    def _turns(self, frame: Frame, node: Any, state: State) -> int | None:
        """How many turns a loop `counter < constant; counter++` takes, None for another one, or where types make it one."""
        condition, step = node.cond, node.next
        counts_up = isinstance(step, c_ast.UnaryOp) and step.op in ("p++", "++") and isinstance(step.expr, c_ast.ID)
        if not (counts_up and isinstance(condition, c_ast.BinaryOp) and condition.op == "<"):
            return None
        if not (isinstance(condition.left, c_ast.ID) and condition.left.name == step.expr.name):
            return None
        aside = state.fork()
        counter, bound = self.value(frame, condition.left, aside), self.value(frame, condition.right, aside)
        first, last = _constant(counter), _constant(bound)
        if first is None or last is None or not 0 <= first <= last < 1 << (counter.scalar.width - counter.scalar.signed):
            return None
        return last - first

    def _turn_by_turn(self, frame: Frame, node: Any, state: State) -> State | None:
        outer, frame.broken = frame.broken, []
        outer_continued, frame.continued = frame.continued, []
        now: State | None = state
        for _ in range(TURNS_MAX + 1):
            assert now is not None
            condition = self.condition(frame, node.cond, now)
            if not condition.is_const:
                raise CannotJudge(place_of(node), "a loop of which the number of turns is not constant")
            if not condition.data:
                break
            before = now.fork()
            end = self.statement(frame, node.stmt, now)
            now = self.meeting(before, [*frame.continued, *([] if end is None else [end])])
            frame.continued = []
            if now is None:
                break
            if node.next is not None:
                self.effect(frame, node.next, now)
        else:
            raise CannotJudge(place_of(node), f"a loop of more than {TURNS_MAX} turns that is no plain count")
        ends = [*frame.broken, *([] if now is None else [now])]
        frame.broken, frame.continued = outer, outer_continued
        return self.meeting(state, ends)

    def _summary(self, frame: Frame, node: Any, state: State, turns: int) -> State:
        """One turn from any values of what the turns change: what holds in it holds in all of them."""
        counter = self.place(frame, node.cond.left, state)
        start = self.read(state, counter, node).term.data
        changed = self._changed_by(frame, node, state, counter, (start, start + turns - 1))
        inside = state.fork()
        self._forget(inside, changed, node)
        self._count(inside, counter, start, start + turns - 1)
        if _constant(self.value(frame, node.cond.right, inside.fork())) != start + turns:
            raise CannotJudge(place_of(node), "a long loop that changes its bound")
        exits = len(frame.returned), len(frame.broken), len(frame.continued)
        end = self.statement(frame, node.stmt, inside)
        if end is None or exits != (len(frame.returned), len(frame.broken), len(frame.continued)):
            raise CannotJudge(place_of(node), "a long loop that is left from inside")
        if end.memory.get((counter.root, ())) is not inside.memory.get((counter.root, ())):
            raise CannotJudge(place_of(node), "a long loop that changes its counter")
        self._forget(state, changed, node)
        term = self.pool.whole(start + turns, self.read(state, counter, node).scalar.width)
        state.put((counter.root, ()), term, place_of(node))
        return state

    def _changed_by(self, frame: Frame, node: Any, state: State, counter: Reference, span: tuple[int, int]) -> set[Key]:
        """What a turn may write of what there was before, found by trying until nothing new appears."""
        kept = dict(self.obligations)
        changed: set[Key] = set()
        while True:
            trial = state.fork()
            self._forget(trial, changed, node)
            self._count(trial, counter, *span)
            before = dict(trial.memory)
            end = self.statement(frame, node.stmt, trial)
            after = {} if end is None else end.memory
            found = {key for key, payload in before.items() if after.get(key) is not payload} - {(counter.root, ())}
            if found <= changed:
                self.obligations = kept
                return changed
            changed |= found

    def _forget(self, state: State, keys: set[Key], node: Any) -> None:
        """Let them hold anything."""
        for key in sorted(keys, key=str):
            payload = state.memory[key]
            if not isinstance(payload, Term):
                raise CannotJudge(place_of(node), "a long loop that moves a pointer")
            state.put(key, self.pool.fresh("in a loop", payload.sort), place_of(node))

    def _count(self, state: State, counter: Reference, first: int, last: int) -> None:
        """Let the counter be any one of its turns."""
        (path, scalar) = leaves(counter.ctype)[0]
        assert isinstance(scalar, Scalar)
        term = self.pool.fresh("turn", sort_of(scalar))
        prefix = "s" if scalar.signed else "u"
        for low, high in ((self.pool.whole(first, scalar.width), term), (term, self.pool.whole(last, scalar.width))):
            within = self.pool.apply(f"{prefix}le", 0, low, high)
            state.path = self.pool.and_(state.path, within)
            state.scope.assume(within)
        state.put((counter.root, path), term, "")

    def statement(self, frame: Frame, node: Any, state: State) -> State | None:
        """Any statement."""
        raise NotImplementedError

    def meeting(self, base: State, states: list[State]) -> State | None:
        """Where several ways meet."""
        raise NotImplementedError


def _constant(value: Typed) -> int | None:
    """A whole number that is known."""
    ctype, payload = value.ctype, value.payload
    if not isinstance(ctype, Scalar) or ctype.family != Family.INT or not isinstance(payload, Term) or not payload.is_const:
        return None
    return signed(payload.data, ctype.width) if ctype.signed else int(payload.data)


def _holds_loop(node: Any) -> bool:
    return isinstance(node, c_ast.For) or any(_holds_loop(child) for _, child in node.children())
