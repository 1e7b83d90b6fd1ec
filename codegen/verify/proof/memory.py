"""What the variables hold at one place of a run for all inputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

from codegen.verify.proof import boxes
from codegen.verify.proof.c_types import Array, CType, Scalar, Struct, leaves
from codegen.verify.proof.ranges import Scope
from codegen.verify.proof.terms import Pool, Term

INDEX_WIDTH = 64
CHOICES_MAX = 4096
"""Elements among which one that is not known may be chosen."""

Step = str | Term
"""Into an object: a field, or an index of INDEX_WIDTH bits."""


@dataclass(frozen=True)
class Reference:
    """An object, or a part of it: what an lvalue names and what a pointer holds.

    Attributes:
        root: the object.
        path: into it; a pointer to an element of an array ends in its index.
        ctype: of what is there.
        in_union: whether it is a member of the union at that path, which is stored as bits.
    """

    root: str
    path: tuple[Step, ...]
    ctype: CType
    in_union: bool = False


Key = tuple[str, tuple[str | int, ...]]
Payload = Term | Reference
Aggregate = Mapping[tuple[str | int, ...], Payload]
"""A struct or an array by value; what was never written is missing."""


@dataclass(frozen=True)
class Typed:
    """A value of C."""

    ctype: CType
    payload: Payload | Aggregate

    @property
    def term(self) -> Term:
        """Of a number."""
        assert isinstance(self.payload, Term)
        return self.payload

    @property
    def scalar(self) -> Scalar:
        """Type of a number."""
        assert isinstance(self.ctype, Scalar)
        return self.ctype

    @property
    def reference(self) -> Reference:
        """Of a pointer."""
        assert isinstance(self.payload, Reference)
        return self.payload

    @property
    def aggregate(self) -> Aggregate:
        """Of a struct."""
        assert isinstance(self.payload, Mapping)
        return self.payload


@dataclass
class State:
    """One place of the run.

    Attributes:
        memory: numbers and pointers by where they are; what is not there was not written on every way here.
        path: what the inputs must fulfil for the run to come here.
        scope: what is known of the terms here.
        written: file and line of the last write, for messages.
        writes: how many there were.
    """

    memory: dict[Key, Payload]
    path: Term
    scope: Scope
    written: dict[Key, str] = field(default_factory=dict)
    writes: int = 0

    def fork(self) -> Self:
        return replace(self, memory=self.memory.copy(), scope=self.scope.fork(), written=self.written.copy())

    def branch(self, pool: Pool, condition: Term, holds: bool) -> Self:
        """A copy where the condition holds, or does not."""
        other = self.fork()
        other.path = pool.and_(self.path, condition if holds else pool.not_(condition))
        other.scope.assume(condition, holds)
        return other

    def put(self, key: Key, payload: Payload, place: str) -> None:
        self.memory[key] = payload
        self.written[key] = place
        self.writes += 1

    def become(self, other: State) -> None:
        """Go on from another place."""
        self.memory, self.path, self.scope = other.memory, other.path, other.scope
        self.written, self.writes = other.written, other.writes


def joined(pool: Pool, base: State, condition: Term, yes: State, no: State, path: Term) -> State:
    """Where two ways meet that parted at `base`: the first where the condition held."""
    scope = base.scope.fork()
    scope.join([yes.scope, no.scope])
    state = State({}, path, scope, {**no.written, **yes.written}, max(yes.writes, no.writes))
    for key, payload in yes.memory.items():
        other = no.memory.get(key)
        if other is payload:
            state.memory[key] = payload
        elif other is not None:
            both = merged(pool, condition, payload, other)
            if both is not None:
                state.memory[key] = both
                if isinstance(both, Term) and isinstance(payload, Term) and isinstance(other, Term):
                    learn_choice(scope, both, (yes, payload), (no, other))
    return state


def learn_choice(scope: Scope, both: Term, yes: tuple[State, Term], no: tuple[State, Term]) -> None:
    """Where a choice lies: where its values lay, each on its own way."""
    alive = [state.scope.box(term) for state, term in (yes, no) if not state.scope.is_dead]
    if alive:
        scope.learn(both, alive[0] if len(alive) == 1 else boxes.hull(*alive))


def merged(pool: Pool, condition: Term, yes: Payload, no: Payload) -> Payload | None:
    """The first where the condition holds, else the second; None for pointers to different objects."""
    if isinstance(yes, Term) and isinstance(no, Term):
        return pool.ite(condition, yes, no)
    if isinstance(yes, Reference) and isinstance(no, Reference) and yes.path and no.path:
        last, other = yes.path[-1], no.path[-1]
        same = (yes.root, yes.path[:-1], yes.ctype, yes.in_union) == (no.root, no.path[:-1], no.ctype, no.in_union)
        if same and isinstance(last, Term) and isinstance(other, Term):
            return replace(yes, path=(*yes.path[:-1], pool.ite(condition, last, other)))
    return yes if yes == no else None


def places(pool: Pool, path: tuple[Step, ...], root: CType) -> Iterator[tuple[Term, tuple[str | int, ...]]]:
    """Every place that a path may lead to, with the condition for it. The indices are inside: that is shown elsewhere."""
    if not path:
        yield pool.true, ()
        return
    step, *rest = path
    if isinstance(step, str):
        inner = root.field(step) if isinstance(root, Struct) else None
        assert inner is not None
        for condition, end in places(pool, tuple(rest), inner):
            yield condition, (step, *end)
        return
    assert isinstance(root, Array)
    indices = [step.data] if step.is_const else range(root.length or 0)
    for index in indices:
        here = pool.eq(step, pool.whole(index, INDEX_WIDTH))
        if here is not pool.false:
            for condition, end in places(pool, tuple(rest), root.element):
                yield pool.and_(here, condition), (index, *end)


def keys_below(reference: Reference, path: tuple[str | int, ...]) -> Iterator[tuple[tuple[str | int, ...], Key]]:
    """Of the numbers and pointers inside what is at a place: path inside it, and key."""
    for inner, _ in leaves(reference.ctype):
        yield inner, (reference.root, (*path, *inner))
