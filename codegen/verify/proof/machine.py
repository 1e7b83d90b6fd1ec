"""Objects of a run for all inputs: read, written, found by name; and what has to hold where they are used."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pycparser import c_ast

from codegen.verify.proof.c_types import (
    UNSIGNED,
    Array,
    CType,
    Family,
    Pointer,
    Scalar,
    Struct,
    leaves,
    union_bits,
)
from codegen.verify.proof.facts import Facts
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.memory import (
    INDEX_WIDTH,
    Aggregate,
    Key,
    Payload,
    Reference,
    State,
    Typed,
    keys_below,
    learn_choice,
    places,
)
from codegen.verify.proof.obligations import Kind, Obligation, Widened
from codegen.verify.proof.ranges import Scope
from codegen.verify.proof.source import CannotJudge, Function, ParsedProgram, holds_call, place_of
from codegen.verify.proof.terms import BOOL as TRUTH
from codegen.verify.proof.terms import Pool, Table, Term


@dataclass
class Frame:
    """Of one call of a function, or of none: the names that it sees beside those of its unit, and what it returned so far."""

    unit: str
    function: Function | None = None
    names: dict[str, Reference] = field(default_factory=dict)
    returned: list[tuple[State, Typed | None]] = field(default_factory=list)
    broken: list[State] = field(default_factory=list)
    continued: list[State] = field(default_factory=list)


class Machine:
    """What all runs of one build share, and the obligations of the present one."""

    def __init__(self, program: ParsedProgram, free_tables: dict[str, Widened]) -> None:
        self.program = program
        self.pool, self.facts = Pool(), Facts()
        self.obligations: dict[Obligation, None] = {}
        self.asked: list[Term] = []  # goals in the order of the run, again where they come again
        self._free_tables = free_tables
        self._read_entries: dict[Table, dict[Term, None]] = {}
        self.axioms: dict[Term, None] = {}  # what is taken of tables
        self._roots: dict[str, CType] = {}
        self._lengths: dict[str, Term] = {}
        self._tables: dict[str, Table] = {}
        self._constants: dict[str, dict[Key, Payload]] = {}
        self.objects_made = 0

    def start(self, is_idle: bool = False) -> State:
        """Before any run: nothing written, everything possible. is_idle: of a run that is only for its terms."""
        return State({}, self.pool.true, Scope(self.pool, self.facts, is_idle))

    def new_object(self, name: str, ctype: CType, length: Term | None = None) -> Reference:
        """An object of which nothing is written. length: of an array, where only the program knows it."""
        self.objects_made += 1
        root = f"{name}~{self.objects_made}"
        self._roots[root] = ctype
        if length is not None:
            self._lengths[root] = length
        return Reference(root, (), ctype)

    @staticmethod
    def age_of(root: str) -> int:
        """Of an object: how many were made before it; constants are older than all."""
        return int(root.rpartition("~")[2]) if "~" in root else 0

    def need(self, kind: Kind, state: State, goal: Term, node: Any, text: str = "") -> None:
        """Make it an obligation, and go on as if it held."""
        if goal is not self.pool.true and state.path is not self.pool.false:
            self.asked.append(goal)
            place = node if isinstance(node, str) else place_of(node)
            self.obligations[Obligation(kind, place, state.path, goal, text)] = None
            state.scope.assume(goal)

    # Objects.

    def global_object(self, unit: str, name: str, node: Any) -> Reference:
        """A constant of the program. Raises CannotJudge: no such object, or one that changes."""
        found = self.program.object_seen(unit, name)
        if found is None:
            raise CannotJudge(place_of(node), f"the name {name}")
        home, declared = found
        if not declared.is_const:
            raise CannotJudge(declared.place, f"{name}: a variable outside the functions")
        return self.constant_object(home, f"{home}:{name}", declared.ctype, declared.init)

    def constant_object(self, unit: str, root: str, ctype: CType, init: Any) -> Reference:
        """A constant with its initialiser; an array of numbers becomes a table."""
        if root not in self._roots:
            self._roots[root] = ctype
            reference = Reference(root, (), ctype)
            state = self.start(is_idle=True)
            self.initialise(Frame(unit), reference, init, state)
            values = {key: payload for key, payload in state.memory.items() if key[0] == root}
            if isinstance(ctype, Array) and isinstance(_innermost(ctype), Scalar):
                self._tables[root] = self._table(root, ctype, values)
            else:
                self._constants[root] = values
        return Reference(root, (), ctype)

    def _table(self, root: str, ctype: Array, values: dict[Key, Payload]) -> Table:
        flat = []
        for path, _ in leaves(ctype):
            term = values[(root, path)]
            if not (isinstance(term, Term) and term.is_const):
                raise CannotJudge(root.partition(":")[0], f"{root}: an entry that is not constant")
            flat.append(term.data)
        lengths: list[int] = []
        inner: CType = ctype
        while isinstance(inner, Array):
            lengths.append(inner.length or 0)
            inner = inner.element
        widened = self._free_tables.get(root.rpartition(":")[2])
        if widened is None:
            return Table(root, tuple(lengths), tuple(flat), min(flat), max(flat))
        return Table(root, tuple(lengths), tuple(flat), widened.low, widened.high, True, widened.is_increasing)

    @property
    def constant_roots(self) -> Collection[str]:
        """Of constants that are no tables."""
        return self._constants

    def constant_at(self, root: str, path: tuple[str | int, ...]) -> Payload | None:
        """A number inside a constant."""
        return self._constants[root].get((root, path))

    def is_table(self, root: str) -> bool:
        """Whether an object is a constant array of numbers."""
        return root in self._tables

    @property
    def tables(self) -> list[Table]:
        """That were read."""
        return list(self._tables.values())

    def initialise(self, frame: Frame, reference: Reference, init: Any, state: State) -> None:
        """Write an object as its initialiser says; what it leaves out is zero (C99 6.7.8)."""
        place = place_of(init)
        if not isinstance(init, c_ast.InitList):
            self.write(state, reference, self.converted(state, self.value(frame, init, state), reference.ctype, init), place)
            return
        ctype = reference.ctype
        if isinstance(ctype, Struct) and not ctype.is_union:
            parts: list[Reference] = [self.field(reference, name, init) for name, _ in ctype.fields]
            names = [name for name, _ in ctype.fields]
        elif isinstance(ctype, Struct):
            parts, names = [self.field(reference, ctype.fields[0][0], init)], [ctype.fields[0][0]]
        elif isinstance(ctype, Array) and ctype.length is not None:
            steps = [self.pool.whole(index, INDEX_WIDTH) for index in range(ctype.length)]
            parts, names = [Reference(reference.root, (*reference.path, step), ctype.element) for step in steps], []
        else:
            parts, names = [reference], []
        given: dict[int, Any] = {}
        position = 0
        for each in init.exprs:
            if isinstance(each, c_ast.NamedInitializer):
                if len(each.name) != 1 or not isinstance(each.name[0], c_ast.ID) or each.name[0].name not in names:
                    raise CannotJudge(place_of(each), "this designator")
                position, each = names.index(each.name[0].name), each.expr
            if position >= len(parts):
                raise CannotJudge(place_of(each), "an initialiser too many")
            given[position] = each
            position += 1
        calls = len(given) > 1 and any(holds_call(each) for each in given.values())
        before, made = state.memory.copy() if calls else {}, self.objects_made
        for index, part in enumerate(parts):
            if index in given:
                self.initialise(frame, part, given[index], state)
            else:
                self._write_zero(state, part, place)
        own = {key: payload for key, payload in state.memory.items() if key[0] == reference.root} if calls else {}
        if calls and self.differs({**before, **own}, state, made):
            raise CannotJudge(place, "a side effect in an initialiser: C leaves open which part comes first")

    def differs(self, memory: Mapping[Key, Payload], state: State, made: int) -> bool:
        """Whether something was written since, of objects that were there then."""
        keys = memory.keys() | state.memory.keys()
        return any(memory.get(key) is not state.memory.get(key) and self.age_of(key[0]) <= made for key in keys)

    def _write_zero(self, state: State, reference: Reference, place: str) -> None:
        if isinstance(reference.ctype, Scalar) and reference.in_union:
            self.write(state, reference, Typed(reference.ctype, self.zero(reference.ctype)), place)
            return
        ((_, path),) = places(self.pool, reference.path, self._roots[reference.root])
        for inner, leaf in leaves(reference.ctype):
            if isinstance(leaf, Pointer):
                raise CannotJudge(place, "a null pointer")
            state.put((reference.root, (*path, *inner)), self.zero(leaf), place)

    def zero(self, scalar: Scalar) -> Term:
        if scalar.family == Family.BOOL:
            return self.pool.false
        return self.pool.real(0.0, scalar.width) if scalar.family == Family.FLOAT else self.pool.whole(0, scalar.width)

    # Parts of objects.

    def field(self, reference: Reference, name: str, node: Any) -> Reference:
        """Of a struct or a union. Raises CannotJudge: no such field."""
        ctype = reference.ctype.field(name) if isinstance(reference.ctype, Struct) else None
        if ctype is None or reference.in_union:
            raise CannotJudge(place_of(node), f"the field {name}")
        if isinstance(reference.ctype, Struct) and reference.ctype.is_union:
            return replace(reference, ctype=ctype, in_union=True)
        return replace(reference, ctype=ctype, path=(*reference.path, name))

    def element(self, state: State, pointer: Reference, index: Term, node: Any) -> Reference:
        """The element so far behind the one that is pointed to; that there is one becomes an obligation."""
        if not pointer.path or not isinstance(pointer.path[-1], Term):
            if index.is_const and index.data == 0:
                return pointer  # what is no element of an array counts as the only one
            raise CannotJudge(place_of(node), "an index into what is no array")
        step = self.pool.apply("add", INDEX_WIDTH, pointer.path[-1], index)
        array = self._type_at(pointer.root, pointer.path[:-1])
        assert isinstance(array, Array)
        assert array.length is not None
        length = self.pool.whole(array.length, INDEX_WIDTH)
        text = f"of {array.length}"
        goal = self.pool.apply("ult", TRUTH, step, length)
        if pointer.root in self._lengths and len(pointer.path) == 1:
            goal = self.pool.and_(goal, self.pool.apply("ult", TRUTH, step, self._lengths[pointer.root]))
        self.need(Kind.INDEX, state, goal, node, text)
        return replace(pointer, path=(*pointer.path[:-1], step))

    def _type_at(self, root: str, path: tuple[Any, ...]) -> CType:
        ctype = self._roots[root]
        for step in path:
            inner = ctype.field(step) if isinstance(ctype, Struct) and isinstance(step, str) else None
            if isinstance(ctype, Array):
                inner = ctype.element
            assert inner is not None
            ctype = inner
        return ctype

    # Reading and writing.

    def read(self, state: State, reference: Reference, node: Any) -> Typed:
        """What an lvalue holds; an array becomes a pointer to its first element."""
        ctype = reference.ctype
        if isinstance(ctype, Array):
            first = self.pool.whole(0, INDEX_WIDTH)
            return Typed(Pointer(ctype.element), replace(reference, path=(*reference.path, first), ctype=ctype.element))
        if reference.root in self._tables:
            assert isinstance(ctype, Scalar)
            steps = tuple(step for step in reference.path if isinstance(step, Term))
            term = self.pool.entry(self._tables[reference.root], steps, sort_of(ctype))
            state.scope.box(term)
            self._order(state, term)
            return Typed(ctype, term)
        if isinstance(ctype, Struct) and not ctype.is_union:
            return Typed(ctype, self._read_struct(state, reference, node))
        stored = union_bits(ctype) if isinstance(ctype, Struct) else ctype
        if reference.in_union:
            assert isinstance(ctype, Scalar)
            stored = Scalar(Family.INT, ctype.width)
        payload = self._read_leaf(state, reference, stored, node)
        if reference.in_union and isinstance(payload, Term) and isinstance(ctype, Scalar) and ctype.family == Family.FLOAT:
            payload = self.float_of_bits(payload)
        return Typed(ctype, payload)

    def _order(self, state: State, entry: Term) -> None:
        """Take an entry of an increasing table to be above those before it that were read, and below those behind it; and above
        the least number that one may hold, if it is not the first."""
        if entry.op != "entry" or not entry.data.is_increasing:
            return
        others = self._read_entries.setdefault(entry.data, {})
        pairs = [(other, entry) for other in others if self.pool.is_above(entry.args[0], other.args[0])]
        pairs += [(entry, other) for other in others if self.pool.is_above(other.args[0], entry.args[0])]
        if self.pool.is_above(entry.args[0], self.pool.whole(0, INDEX_WIDTH)):
            pairs.append((self.pool.real(entry.data.low, -entry.sort), entry))
        for low, high in pairs:
            order = self.pool.apply("flt", TRUTH, low, high)
            self.axioms[order] = None
            state.scope.assume(order)
        others[entry] = None

    def _read_leaf(self, state: State, reference: Reference, stored: CType, node: Any) -> Payload:
        found = list(self._found(state, reference))
        missing = self.pool.or_(*(condition for condition, payload in found if payload is None))
        self.need(Kind.WRITTEN, state, self.pool.not_(missing), node)
        known = [(condition, payload) for condition, payload in found if payload is not None]
        if not known:
            if not isinstance(stored, Scalar):
                raise CannotJudge(place_of(node), "a pointer that may not be set, or may be set to different objects")
            return self.pool.fresh("never written", sort_of(stored))
        result = known[-1][1]
        for condition, payload in reversed(known[:-1]):
            if isinstance(payload, Term) and isinstance(result, Term):
                result = self.pool.ite(condition, payload, result)
            elif payload != result:
                raise CannotJudge(place_of(node), "one of several pointers")
        return result

    def _found(self, state: State, reference: Reference) -> list[tuple[Term, Payload | None]]:
        memory = self._constants.get(reference.root, state.memory)
        choices = places(self.pool, reference.path, self._roots[reference.root])
        return [(condition, memory.get((reference.root, path))) for condition, path in choices]

    def _read_struct(self, state: State, reference: Reference, node: Any) -> Aggregate:
        parts: dict[tuple[str | int, ...], Payload] = {}
        memory = self._constants.get(reference.root, state.memory)
        choices = list(places(self.pool, reference.path, self._roots[reference.root]))
        if len(choices) != 1:
            raise CannotJudge(place_of(node), "one of several structs by value")
        for inner, key in keys_below(reference, choices[0][1]):
            if key in memory:
                parts[inner] = memory[key]
        return parts

    def write(self, state: State, reference: Reference, value: Typed, place: str) -> None:
        """Store a value of the right type. Raises CannotJudge: in a constant."""
        if reference.root in self._tables or reference.root in self._constants:
            raise CannotJudge(place, "a write to a constant")
        choices = list(places(self.pool, reference.path, self._roots[reference.root]))
        if isinstance(value.payload, dict):
            ((_, path),) = choices
            for inner, key in keys_below(reference, path):
                if inner in value.payload:
                    state.put(key, value.payload[inner], place)
                else:
                    state.memory.pop(key, None)
            return
        payload = value.payload
        if reference.in_union and isinstance(payload, Term) and value.scalar.family == Family.FLOAT:
            payload = self.bits_of_float(payload)
        for condition, path in choices:
            self._write_leaf(state, (reference.root, path), condition, payload, place)

    def _write_leaf(self, state: State, key: Key, condition: Term, payload: Any, place: str) -> None:
        if condition is self.pool.true:
            state.put(key, payload, place)
            return
        before = state.memory.get(key)
        if isinstance(before, Term) and isinstance(payload, Term):  # what was never written stays so
            both = self.pool.ite(condition, payload, before)
            learn_choice(state.scope, both, (state, payload), (state, before))
            state.put(key, both, place)

    # Conversions.

    def float_of_bits(self, bits: Term) -> Term:
        if bits.op == "bits":
            return bits.args[0]
        if bits.op == "band":
            masks = [each.data for each in bits.args if each.is_const]
            numbers = [each.args[0] for each in bits.args if each.op == "bits"]
            if numbers and masks == [(1 << (bits.sort - 1)) - 1]:  # all but the sign
                return self.pool.magnitude(numbers[0])
        return self.pool.apply("of_bits", -bits.sort, bits)

    def bits_of_float(self, value: Term) -> Term:
        return self.pool.apply("bits", -value.sort, value)

    def truth(self, value: Typed, node: Any) -> Term:
        """Whether it is not zero. Raises CannotJudge: of a pointer or a struct."""
        if not isinstance(value.ctype, Scalar):
            raise CannotJudge(place_of(node), "the truth of what is no number")
        if value.ctype.family == Family.BOOL:
            return value.term
        zero = self.zero(value.ctype)
        equal = self.pool.feq if value.ctype.family == Family.FLOAT else self.pool.eq
        return self.pool.not_(equal(value.term, zero))

    def converted(self, state: State, value: Typed, to: CType, node: Any) -> Typed:
        """A value as another type. Raises CannotJudge: neither number to number nor the same."""
        if not isinstance(to, Scalar) or not isinstance(value.ctype, Scalar):
            if to == value.ctype:
                return Typed(to, value.payload)
            raise CannotJudge(place_of(node), "a conversion of what is no number, or between pointers to different types")
        return Typed(to, self._number_as(state, value, to, node))

    def _number_as(self, state: State, value: Typed, to: Scalar, node: Any) -> Term:
        have, term = value.scalar, value.term
        if to.enumerators is not None and to != have:
            return self._enumerator(state, value, to, node)
        if to.family == Family.BOOL:
            return self.truth(value, node)
        if have.family == Family.BOOL:
            if to.family == Family.INT:
                return self.pool.of_truth(term, to.width)
            return self.pool.ite(term, self.pool.real(1.0, to.width), self.pool.real(0.0, to.width))
        if have.family == Family.INT and to.family == Family.INT:
            return self.pool.wider(term, to.width, have.signed)
        if have.family == Family.FLOAT and to.family == Family.INT:
            self.need(Kind.CONVERSION, state, self._is_convertible(term, to), node, f"to {to}")
            result = self.pool.apply("of_real", to.width, term, data=to.signed)
        elif have.family == Family.INT:
            if have.width > UNSIGNED.width:
                raise CannotJudge(place_of(node), f"{have} as a float")
            result = self.pool.apply("of_whole", -to.width, term, data=have.signed)
        else:
            result = term if have.width == to.width else self.pool.apply("fconvert", -to.width, term)
        state.scope.box(result)
        return result

    def _enumerator(self, state: State, value: Typed, to: Scalar, node: Any) -> Term:
        """A number as an enum: how wide that is and whether it has a sign, the compiler chooses (C99 6.7.2.2)."""
        assert to.enumerators is not None
        if value.scalar.family == Family.FLOAT:
            raise CannotJudge(place_of(node), "a float as an enum")
        wide = INDEX_WIDTH + 1
        exact = self._number_as(state, value, Scalar(Family.INT, wide, True), node)
        low, high = (self.pool.whole(each, wide) for each in to.enumerators)
        inside = self.pool.and_(self.pool.apply("sle", TRUTH, low, exact), self.pool.apply("sle", TRUTH, exact, high))
        self.need(Kind.CONVERSION, state, inside, node, "to an enum, between its enumerators")
        return self.pool.wider(exact, to.width, True)

    def _is_convertible(self, term: Term, to: Scalar) -> Term:
        """Whether the whole part is a number of the type (C99 6.3.1.4)."""
        form = FORMATS[-term.sort]
        low = float(-(1 << (to.width - 1)) - 1) if to.signed else -1.0
        high = float(1 << (to.width - 1 if to.signed else to.width))
        above = self.pool.real(form.at_most(low), form.width)
        # Where low itself has no float, the next one below is out of range, the next one above is not.
        is_exact = form.at_most(low) == low
        lower = self.pool.flt(above, term) if is_exact else self.pool.fle(self.pool.real(form.up(above.data), form.width), term)
        return self.pool.and_(lower, self.pool.flt(term, self.pool.real(high, form.width)))

    def value(self, frame: Frame, node: Any, state: State) -> Typed:
        """Of an expression."""
        raise NotImplementedError


def sort_of(scalar: Scalar) -> int:
    """Of the terms of a type."""
    if scalar.family == Family.BOOL:
        return TRUTH
    return -scalar.width if scalar.family == Family.FLOAT else scalar.width


def _innermost(ctype: CType) -> CType:
    return _innermost(ctype.element) if isinstance(ctype, Array) else ctype
