"""What every state that the code can leave behind fulfils: a box for each number, and which flags go with which status."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from codegen.verify.proof import boxes
from codegen.verify.proof.boxes import INF, Box, Real, Whole
from codegen.verify.proof.c_types import Array, CType, Family, Pointer, Scalar, Struct
from codegen.verify.proof.terms import BOOL as TRUTH
from codegen.verify.proof.terms import Pool, Term

Path = tuple[str | int, ...]
GROWTH = 16.0
"""Bounds that move with each step are tried at powers of this."""
LANDMARK_WIDTH = 8
"""Bits of counters that may end at a number that the program names; wider ones count as free."""
REACH = 2.0**16
"""Beyond, a number counts as unbounded: one that stops growing only because single precision misses the next step is that."""


@dataclass(frozen=True)
class Clause:
    """Where the status has a value, the flag has one."""

    status: Path
    value: int
    flag: Path
    holds: bool

    def term(self, pool: Pool, leaf: Callable[[Path], Term]) -> Term:
        status, flag = leaf(self.status), leaf(self.flag)
        other = pool.not_(pool.eq(status, pool.whole(self.value, status.sort)))
        return pool.or_(other, flag if self.holds else pool.not_(flag))

    def __str__(self) -> str:
        return f"{dotted(self.flag)} is {str(self.holds).lower()} where {dotted(self.status)} is {self.value}"


@dataclass(frozen=True)
class Same:
    """Two floats are the same number."""

    flag: Path
    other: Path

    def term(self, pool: Pool, leaf: Callable[[Path], Term]) -> Term:
        return pool.feq(leaf(self.flag), leaf(self.other))

    def __str__(self) -> str:
        return f"{dotted(self.flag)} is {dotted(self.other)}"


@dataclass
class Invariant:
    """Of a struct. What lies in another struct with an invariant of its own is left to that."""

    ctype: Struct
    boxes: dict[Path, Box] = field(default_factory=dict)
    clauses: list[Clause | Same] = field(default_factory=list)

    def holds(self, pool: Pool, leaf: Callable[[Path], Term]) -> Iterator[tuple[str, Path, Term]]:
        """Each part as a term: in words, of which number, and what has to hold."""
        for path, box in self.boxes.items():
            term = within(pool, leaf(path), box)
            if term is not pool.true:
                yield in_words(path, box), path, term
        for clause in self.clauses:
            yield str(clause), clause.flag, clause.term(pool, leaf)

    def words(self) -> list[str]:
        """For people, a part each."""
        whole = {path: in_words(path, box) for path, box in self.boxes.items() if not is_everything(box, self.scalar(path))}
        return [*whole.values(), *(str(clause) for clause in self.clauses)]

    def scalar(self, path: Path) -> Scalar:
        """Type of a number inside."""
        ctype: CType | None = self.ctype
        for step in path:
            ctype = ctype.field(str(step)) if isinstance(ctype, Struct) else ctype.element if isinstance(ctype, Array) else None
        assert isinstance(ctype, Scalar)
        return ctype


def within(pool: Pool, term: Term, box: Box) -> Term:
    """That a term lies in a box."""
    if isinstance(box, Real):
        width = -term.sort
        if box.low > box.high:
            return pool.not_(pool.is_number(term)) if box.may_be_nan else pool.false
        inside = pool.and_(pool.fle(pool.real(box.low, width), term), pool.fle(term, pool.real(box.high, width)))
        return pool.or_(pool.not_(pool.is_number(term)), inside) if box.may_be_nan else inside
    if isinstance(box, Whole):
        everything = boxes.any_of(term.sort)
        assert isinstance(everything, Whole)
        parts = []
        for op, low, high, least, most in (
            ("ule", box.low, box.high, everything.low, everything.high),
            ("sle", box.signed_low, box.signed_high, everything.signed_low, everything.signed_high),
        ):
            parts += [pool.apply(op, TRUTH, pool.whole(low, term.sort), term)] if low > least else []
            parts += [pool.apply(op, TRUTH, term, pool.whole(high, term.sort))] if high < most else []
        return pool.and_(*parts)
    if box.may_hold and box.may_fail:
        return pool.true
    return term if box.may_hold else pool.not_(term)


def own_leaves(ctype: CType, others: Mapping[str, Invariant], top: bool = True) -> Iterator[tuple[Path, Scalar | Pointer]]:
    """The numbers and pointers of a struct that are not in one with an invariant of its own."""
    if isinstance(ctype, Struct) and not ctype.is_union:
        if top or ctype.name not in others:
            for name, inner in ctype.fields:
                for path, leaf in own_leaves(inner, others, False):
                    yield (name, *path), leaf
    elif isinstance(ctype, Array):
        for index in range(ctype.length or 0):
            for path, leaf in own_leaves(ctype.element, others, False):
                yield (index, *path), leaf
    elif isinstance(ctype, Scalar | Pointer):
        yield (), ctype


def states_inside(ctype: CType, others: Mapping[str, Invariant], path: Path = ()) -> Iterator[tuple[Path, Invariant]]:
    """Structs with an invariant, the outermost first, each with its path."""
    if isinstance(ctype, Struct):
        if ctype.name in others:
            yield path, others[ctype.name]
        for name, inner in ctype.fields:
            yield from states_inside(inner, others, (*path, name))
    elif isinstance(ctype, Array):
        for index in range(ctype.length or 0):
            yield from states_inside(ctype.element, others, (*path, index))


def widened(old: Box | None, new: Box, scalar: Scalar, landmarks: list[int], turn: int) -> Box:
    """A box around both; from the second turn on, with bounds that moved set out to where they may stay."""
    if old is None:
        return new
    both = boxes.hull(old, new)
    if turn < 2 or both == old:
        return both
    if isinstance(both, Real) and isinstance(old, Real):
        low = both.low if both.low >= old.low else -_outward(-both.low, 0.0)
        return Real(low, both.high if both.high <= old.high else _outward(both.high, 0.0), both.may_be_nan)
    if isinstance(both, Whole) and isinstance(old, Whole):
        everything = boxes.any_of(scalar.width)
        assert isinstance(everything, Whole)
        if scalar.signed:
            low = both.signed_low if both.signed_low >= old.signed_low else everything.signed_low
            high = both.signed_high if both.signed_high <= old.signed_high else everything.signed_high
            return boxes.with_sign(low, high, scalar.width)
        low = both.low if both.low >= old.low else 0
        near = landmarks if scalar.width <= LANDMARK_WIDTH else []
        high = _landmark(both.high, everything.high, near) if both.high > old.high else both.high
        return boxes.unsigned(low, high, scalar.width)
    return both


def _landmark(value: int, most: int, landmarks: list[int]) -> int:
    return next((each for each in landmarks if value <= each <= most), most)


def _outward(value: float, beyond: float) -> float:
    """The next bound that is tried, upwards."""
    if value <= 0.0:
        return 0.0 if value > -1.0e-30 else -(GROWTH ** math.floor(math.log(-value, GROWTH)))
    power = GROWTH ** math.ceil(math.log(value, GROWTH) + beyond)
    return power if power <= REACH else INF


def is_everything(box: Box, scalar: Scalar) -> bool:
    """Whether it says nothing."""
    if scalar.family == Family.BOOL:
        return box == boxes.EITHER
    return box == boxes.any_of(-scalar.width if scalar.family == Family.FLOAT else scalar.width)


def in_words(path: Path, box: Box) -> str:
    """Of a box."""
    name = dotted(path)
    if isinstance(box, Real):
        absent = "not a number, or " if box.may_be_nan else ""
        if -box.low == box.high:
            return f"{name} is {absent}within +-{box.high:.6g}"
        return f"{name} is {absent}from {box.low:.6g} to {box.high:.6g}"
    if isinstance(box, Whole):
        low, high = (box.signed_low, box.signed_high) if box.signed_low < 0 else (box.low, box.high)
        return f"{name} is {low}" if low == high else f"{name} is from {low} to {high}"
    return f"{name} is {str(box.may_hold).lower()}"


def dotted(path: Path) -> str:
    """As C writes it."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")
