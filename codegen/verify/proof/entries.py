"""A function called with everything that may come: any numbers, valid parameters, any state that keeps its invariant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from codegen.verify.proof.c_types import Array, CType, Pointer, Scalar, Struct, leaves
from codegen.verify.proof.claims import preconditions_of
from codegen.verify.proof.executor import Executor
from codegen.verify.proof.invariants import Invariant, Path, dotted, states_inside, within
from codegen.verify.proof.machine import sort_of
from codegen.verify.proof.memory import INDEX_WIDTH, Key, Payload, Reference, State, Typed
from codegen.verify.proof.obligations import Obligation
from codegen.verify.proof.ranges import Scope
from codegen.verify.proof.source import CannotJudge, Function, Parameter
from codegen.verify.proof.terms import BOOL, Term

INITIALISERS = ("_init", "_start")
"""Ends of the names of functions that write a whole state, whatever it held."""
OUTPUTS = ("_pack_", "_unpack_", "_10ms")
"""In names of functions that write what they are given a pointer to, whatever it held."""
FRAME_LENGTH_MAX = 255
"""Of data whose length is a parameter of eight bits."""


@dataclass
class Entry:
    """One call for all inputs, before and behind it.

    Attributes:
        arguments: by the names of the parameters.
        assumptions: what the inputs fulfil.
        typical: that the parameters are the build's own, where it has such.
        obligations: what has to hold inside.
        before: what was in memory before the call.
        state: behind the call.
        result: of the call.
    """

    function: Function
    arguments: dict[str, Typed]
    assumptions: list[Term] = field(default_factory=list)
    typical: list[Term] = field(default_factory=list)
    obligations: list[Obligation] = field(default_factory=list)
    before: dict[Key, Payload] = field(default_factory=dict)
    state: State | None = None
    result: Typed | None = None

    def key(self, name: str, path: Path) -> Key:
        """Of a number in what a parameter points to."""
        reference = self.arguments[name].reference
        return reference.root, (*base_of(reference, bool(reference.path), self.function.place), *path)

    def behind(self, name: str, path: Path) -> Term:
        """A number behind the call."""
        assert self.state is not None
        found = self.state.memory[self.key(name, path)]
        assert isinstance(found, Term)
        return found

    def earlier(self, name: str, path: Path) -> Term:
        """A number before the call."""
        found = self.before[self.key(name, path)]
        assert isinstance(found, Term)
        return found


def named(parameter: Parameter, path: Path) -> str:
    """A number that a parameter points to, as C writes it."""
    if parameter.length is not None:
        return f"{parameter.name}{dotted(path)}"
    return f"{parameter.name}->{dotted(path)}" if path else f"*{parameter.name}"


def base_of(reference: Reference, is_array: bool, place: str) -> Path:
    """Where an object begins: of a pointer to the first element of an array, the array.

    Raises CannotJudge: a part of an array, or an element of which only the program knows which one.
    """
    path = reference.path
    if any(isinstance(step, Term) and not step.is_const for step in path):
        raise CannotJudge(place, "a pointer to one of several elements")
    if is_array:
        if not path or not isinstance(path[-1], Term) or path[-1].data != 0:
            raise CannotJudge(place, "a pointer to what is no array, or to a part of one")
        path = path[:-1]
    return tuple(int(step.data) if isinstance(step, Term) else step for step in path)


def is_written_only(function: Function, parameter: Parameter, is_state: bool) -> bool:
    """Whether what a parameter points to need not be written before the call."""
    if parameter.is_const:
        return False
    if is_state or parameter.name == "self":
        return is_state and function.name.endswith(INITIALISERS)
    return any(each in function.name for each in OUTPUTS)


class Caller:
    """Makes calls.

    Attributes:
        states: the invariants of the structs that the code keeps, as far as they are known.
    """

    def __init__(self, machine: Executor, states: Mapping[str, Invariant], prefix: str) -> None:
        self.machine, self.states, self.prefix = machine, states, prefix
        self._prepared: dict[Term, Scope] = {}  # what follows for parameters from that they are valid

    def state_of(self, parameter: Parameter) -> Invariant | None:
        """The invariant of what a parameter points to."""
        target = parameter.ctype.target if isinstance(parameter.ctype, Pointer) else None
        return self.states.get(target.name) if isinstance(target, Struct) else None

    def call(self, function: Function) -> Entry:
        """Raises CannotJudge."""
        machine = self.machine
        state = machine.start()
        entry = Entry(function, {})
        for parameter in sorted(function.parameters, key=self._order):
            entry.arguments[parameter.name] = self._argument(entry, parameter, state)
        self._assume_preconditions(entry, state)
        entry.before = dict(state.memory)
        arguments = [entry.arguments[parameter.name] for parameter in function.parameters]
        entry.result = machine.run(function, arguments, state, function.node)
        entry.state = state
        self._refuse_hidden_writes(entry, state)
        return entry

    def _assume_preconditions(self, entry: Entry, state: State) -> None:
        """Take the arguments to be in the ranges that the function requires."""
        for _, term, box in preconditions_of(entry.function, self.prefix, self.machine, state, entry.arguments):
            state.scope.learn(term, box)
            entry.assumptions.append(within(self.machine.pool, term, box))

    @staticmethod
    def _refuse_hidden_writes(entry: Entry, state: State) -> None:
        """A contract tells of what a pointer to what is not constant leads to: nothing else may be written."""
        function = entry.function
        pointers = [each for each in function.parameters if isinstance(each.ctype, Pointer) and not each.is_const]
        roots = {entry.arguments[each.name].reference.root for each in pointers}
        for key, payload in entry.before.items():
            if key[0] not in roots and state.memory.get(key) is not payload:
                raise CannotJudge(function.place, f"{function.name} writes what it is given as constant: {dotted(key[1])}")

    def _order(self, parameter: Parameter) -> int:
        """A length before its data, and parameters first of what is pointed to."""
        if not isinstance(parameter.ctype, Pointer):
            return 0
        return 1 if self.judge_of(parameter.ctype.target) is not None else 2

    def _argument(self, entry: Entry, parameter: Parameter, state: State) -> Typed:
        if isinstance(parameter.ctype, Scalar):
            return Typed(parameter.ctype, self.machine.pool.variable(parameter.name, sort_of(parameter.ctype)))
        if not isinstance(parameter.ctype, Pointer):
            raise CannotJudge(entry.function.place, f"the parameter {parameter.name}")
        target, length = parameter.ctype.target, None
        if isinstance(target, Scalar) and (parameter.length is not None or "length" in entry.arguments):
            target = Array(target, parameter.length or FRAME_LENGTH_MAX)
            if parameter.length is None:
                length = entry.arguments["length"].term
        made = self.machine.new_object(parameter.name, target, self._wide(length))
        self._fill(entry, parameter, made, target, state)
        if isinstance(target, Array):
            first = self.machine.pool.whole(0, INDEX_WIDTH)
            made = Reference(made.root, (first,), target.element)
        return Typed(parameter.ctype, made)

    def _wide(self, length: Term | None) -> Term | None:
        return None if length is None else self.machine.pool.wider(length, INDEX_WIDTH, False)

    def _fill(self, entry: Entry, parameter: Parameter, made: Reference, target: CType, state: State) -> None:
        """Give what is pointed to its numbers, if it has any before the call."""
        name, function = parameter.name, entry.function
        if is_written_only(function, parameter, self.state_of(parameter) is not None):
            return
        self.give_numbers(entry, made, target, f"{name}->", state)
        if isinstance(target, Struct):
            entry.assumptions += self.assume_invariants(made, target, state)
            if parameter.is_const:
                entry.assumptions += self.assume_valid(made, target, state, function)
                entry.typical += self.typical_of(made, target, state, function)

    def give_numbers(self, entry: Entry, made: Reference, target: CType, prefix: str, state: State) -> None:
        """A variable for each number; for each pointer, valid parameters."""
        for path, leaf in leaves(target):
            if isinstance(leaf, Scalar):
                name = prefix + dotted(path) if isinstance(target, Struct) else f"{prefix.removesuffix('->')}{dotted(path)}"
                state.memory[(made.root, path)] = self.machine.pool.variable(name, sort_of(leaf))
                continue
            pointed = self.machine.new_object(dotted(path), leaf.target)
            state.memory[(made.root, path)] = pointed
            self.give_numbers(entry, pointed, leaf.target, f"{prefix}{dotted(path)}->", state)
            if isinstance(leaf.target, Struct):
                entry.assumptions += self.assume_valid(pointed, leaf.target, state, entry.function)
                entry.typical += self.typical_of(pointed, leaf.target, state, entry.function)

    def assume_invariants(self, made: Reference, target: CType, state: State) -> list[Term]:
        """Take all invariants inside to hold; as terms."""
        taken: list[Term] = []
        for inner, invariant in states_inside(target, self.states):
            leaf = self._reader(made, inner, state)
            for path, box in invariant.boxes.items():
                state.scope.learn(leaf(path), box)
            clauses = [clause.term(self.machine.pool, leaf) for clause in invariant.clauses]
            state.scope.keep(clauses)
            taken += [term for _, _, term in invariant.holds(self.machine.pool, leaf)]
        return taken

    @staticmethod
    def _reader(made: Reference, inner: Path, state: State) -> Callable[[Path], Term]:
        def leaf(path: Path) -> Term:
            found = state.memory[(made.root, (*inner, *path))]
            assert isinstance(found, Term)
            return found

        return leaf

    def assume_valid(self, made: Reference, target: Struct, state: State, function: Function) -> list[Term]:
        """Take parameters to be valid: as the function of the program says that judges them, which itself takes any."""
        judge = self.judge_of(target)
        if judge is None or judge == function:
            return []
        valid = self.machine.judged(judge, Typed(Pointer(target), made), state)
        if not state.scope.is_fresh:
            state.scope.assume(valid)
        else:
            if valid not in self._prepared:
                self._prepared[valid] = self.machine.start().scope
                self._prepared[valid].assume(valid)
            state.scope.adopt(self._prepared[valid].fork())
        return [valid]

    def typical_of(self, made: Reference, target: Struct, state: State, function: Function) -> list[Term]:
        """That parameters are those that the build was made with."""
        machine, pool = self.machine, self.machine.pool
        default = next((each for each in machine.program.objects if each.name.endswith("_parameters_default")), None)
        if default is None or self.judge_of(target) is None:
            return []
        root = machine.global_object(function.unit, default.name, None)
        inner = next((path for path, ctype in _structs(default.ctype) if ctype == target), None)
        found = []
        for path, _ in () if inner is None else leaves(target):
            term, value = state.memory[(made.root, path)], machine.constant_at(root.root, (*(inner or ()), *path))
            if isinstance(term, Term) and isinstance(value, Term) and term.sort != BOOL:
                found.append(pool.feq(term, value) if term.sort < 0 else pool.eq(term, value))
        return found

    def judge_of(self, target: CType) -> Function | None:
        """The function that says whether parameters are valid."""
        if not isinstance(target, Struct) or not target.name.endswith("parameters_t"):
            return None
        return self.machine.program.public(f"{target.name.removesuffix('_t')}_valid")


def _structs(ctype: CType, path: Path = ()) -> Iterator[tuple[Path, CType]]:
    """A struct and those inside it."""
    if isinstance(ctype, Struct):
        yield path, ctype
        for name, inner in ctype.fields:
            yield from _structs(inner, (*path, name))
