"""What a call of a proven function does, without running it: its needs become obligations, its promises are taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

from codegen.verify.proof.boxes import Box
from codegen.verify.proof.c_types import VOID, Pointer, Scalar, Struct, leaves
from codegen.verify.proof.calls import Call, Claims, stated
from codegen.verify.proof.claims import Needs
from codegen.verify.proof.entries import base_of, is_written_only, named
from codegen.verify.proof.executor import Executor
from codegen.verify.proof.invariants import Invariant, Path, states_inside, within
from codegen.verify.proof.machine import sort_of
from codegen.verify.proof.memory import INDEX_WIDTH, State, Typed
from codegen.verify.proof.obligations import Kind
from codegen.verify.proof.source import CannotJudge, Function, Parameter, place_of
from codegen.verify.proof.terms import Term

Base = tuple[str, Path]
"""An object, and where in it something begins."""


@dataclass(frozen=True)
class _Promised:
    """What is taken to hold behind one call: condition: where the run comes there, and the call's needs are met."""

    machine: Executor
    state: State
    condition: Term
    taken: list[Term]

    def take(self, terms: Sequence[Term]) -> None:
        pool = self.machine.pool
        for term in terms:
            self.taken.append(pool.or_(pool.not_(self.condition), term))
            self.state.scope.assume(term)


@dataclass
class Contract:
    """Of a public function that was proven.

    Attributes:
        function: whose.
        states: invariants of the structs that it is given.
        results: boxes of the numbers that it returns.
        written: boxes of the numbers that it leaves in what it is given a pointer to, by parameter.
        claims: what else it promises.
        needs: what else it asks for.
        judge: of the parameters of a type: the function that says whether they are valid.
        taken: assumptions of the present proof, which grow with each call.
    """

    function: Function
    states: Mapping[str, Invariant]
    results: dict[Path, Box]
    written: dict[str, dict[Path, Box]]
    claims: Sequence[Claims]
    needs: Sequence[Needs]
    judge: Callable[[Any], Function | None]
    taken: list[Term] = field(default_factory=list)

    def __call__(self, machine: Executor, arguments: list[Typed], state: State, node: Any) -> Typed:
        """Raises CannotJudge."""
        if len(arguments) != len(self.function.parameters):
            raise CannotJudge(place_of(node), f"{len(arguments)} arguments for {self.function.name}")
        given = {}
        for parameter, argument in zip(self.function.parameters, arguments, strict=True):
            given[parameter.name] = machine.converted(state, argument, parameter.ctype, node)
        bases = self._bases(given, place_of(node))
        asked = len(machine.asked)
        for parameter in self.function.parameters:
            self._need(machine, parameter, given[parameter.name], bases, state, node)
        for needs in self.needs:
            for text, goal in needs(machine, state, given):
                machine.need(Kind.CLAIM, state, goal, node, text)
        # Nothing is promised to a call that does not see to what it has to: a promise must not serve to show a need.
        needs_met = machine.pool.and_(*dict.fromkeys(machine.asked[asked:]))
        promised = _Promised(machine, state, machine.pool.and_(state.path, needs_met), self.taken)
        before = dict(state.memory)
        for parameter in self.function.parameters:
            self._change(promised, parameter, bases, node)
        result, numbers = self._result(promised)

        def find(memory: Mapping[Any, Any], name: str, path: Path) -> Term:
            root, base = bases[name]
            found = memory[(root, (*base, *path))]
            assert isinstance(found, Term)
            return found

        call = Call(
            machine.pool,
            lambda name: given[name].term,
            lambda name, path: find(state.memory, name, path),
            lambda name, path: find(before, name, path),
            numbers,
        )
        promised.take([term for claims in self.claims for _, term in stated(claims, call)[0]])
        return result

    def _bases(self, given: Mapping[str, Typed], place: str) -> dict[str, Base]:
        """Where what the pointers lead to begins.

        Raises CannotJudge: what one of them may write, another one may lead to as well; or it holds pointers itself.
        """
        pointers = [(each, each.ctype.target) for each in self.function.parameters if isinstance(each.ctype, Pointer)]
        bases: dict[str, Base] = {}
        for parameter, target in pointers:
            is_sized = any(each.name == "length" for each in self.function.parameters)  # data of any length: see `Caller`
            if any(isinstance(leaf, Pointer) for _, leaf in leaves(target)):
                raise CannotJudge(place, f"a call of {self.function.name}, which is given pointers inside a struct")
            if is_sized and isinstance(target, Scalar) and parameter.length is None:
                raise CannotJudge(place, f"a call of {self.function.name} with data of any length")
            reference = given[parameter.name].reference
            bases[parameter.name] = reference.root, base_of(reference, parameter.length is not None, place)
        for (one, _), (other, _) in combinations(pointers, 2):
            (root, base), (other_root, other_base) = bases[one.name], bases[other.name]
            overlap = root == other_root and all(a == b for a, b in zip(base, other_base, strict=False))
            if overlap and not (one.is_const and other.is_const):
                raise CannotJudge(place, f"{one.name} and {other.name} of {self.function.name} may overlap")
        return bases

    def _need(
        self,
        machine: Executor,
        parameter: Parameter,
        argument: Typed,
        bases: Mapping[str, Base],
        state: State,
        node: Any,
    ) -> None:
        """A state keeps its invariant, parameters are valid, an array is as long as it is declared."""
        if not isinstance(parameter.ctype, Pointer):
            return
        target, reference = parameter.ctype.target, argument.reference
        if parameter.length is not None:
            last = machine.pool.whole(parameter.length - 1, INDEX_WIDTH)
            machine.element(state, reference, last, node)
        base = bases[parameter.name]
        is_state = isinstance(target, Struct) and target.name in self.states
        writes_only = is_written_only(self.function, parameter, is_state)
        if not writes_only:
            self._need_written(machine, parameter, base, state, node)
        judge = self.judge(target)
        if judge is not None and judge != self.function:
            machine.need(Kind.CLAIM, state, machine.judged(judge, argument, state), node, "the parameters are valid")
        for inner, invariant in () if writes_only else states_inside(target, self.states):
            leaf = self._reader(state, base, inner, node)
            for text, _, term in invariant.holds(machine.pool, leaf):
                machine.need(Kind.INVARIANT, state, term, node, text)

    @staticmethod
    def _need_written(machine: Executor, parameter: Parameter, base: Base, state: State, node: Any) -> None:
        """Whatever the function may read has to be there."""
        assert isinstance(parameter.ctype, Pointer)
        target = parameter.ctype.target
        if base[0] in machine.constant_roots or machine.is_table(base[0]):
            return
        for path in (
            [(index,) for index in range(parameter.length)] if parameter.length else [path for path, _ in leaves(target)]
        ):
            if (base[0], (*base[1], *path)) not in state.memory:
                machine.need(Kind.WRITTEN, state, machine.pool.false, node, f"{named(parameter, path)} is written")

    @staticmethod
    def _reader(state: State, base: Base, inner: Path, node: Any) -> Callable[[Path], Term]:
        def leaf(path: Path) -> Term:
            found = state.memory.get((base[0], (*base[1], *inner, *path)))
            if not isinstance(found, Term):
                raise CannotJudge(place_of(node), f"{'.'.join(map(str, path))} may not be written before this call")
            return found

        return leaf

    def _change(self, promised: _Promised, parameter: Parameter, bases: Mapping[str, Base], node: Any) -> None:
        """What the function may write holds anything that it promises."""
        if not isinstance(parameter.ctype, Pointer) or parameter.is_const:
            return
        (root, base), target = bases[parameter.name], parameter.ctype.target
        pool, state = promised.machine.pool, promised.state
        for path, box in self.written.get(parameter.name, {}).items():
            scalar = self._scalar(target, path, parameter)
            term = pool.fresh(f"{self.function.name}: {parameter.name}", sort_of(scalar))
            state.put((root, (*base, *path)), term, place_of(node))
            state.scope.learn(term, box)
            promised.take([within(pool, term, box)])
        for inner, invariant in states_inside(target, self.states):
            leaf = self._reader(state, (root, base), inner, node)
            promised.take([clause.term(pool, leaf) for clause in invariant.clauses])

    @staticmethod
    def _scalar(target: Any, path: Path, parameter: Parameter) -> Scalar:
        if parameter.length is not None or not path:
            assert isinstance(target, Scalar)
            return target
        scalar = dict(leaves(target))[path]
        assert isinstance(scalar, Scalar)
        return scalar

    def _result(self, promised: _Promised) -> tuple[Typed, dict[Path, tuple[Scalar, Term]]]:
        """Any that it promises."""
        machine, state = promised.machine, promised.state
        ctype = self.function.result
        if ctype == VOID:
            return Typed(VOID, {}), {}
        numbers: dict[Path, tuple[Scalar, Term]] = {}
        for path, scalar in leaves(ctype):
            assert isinstance(scalar, Scalar)
            term = machine.pool.fresh(f"{self.function.name}()", sort_of(scalar))
            state.scope.learn(term, self.results[path])
            promised.take([within(machine.pool, term, self.results[path])])
            numbers[path] = scalar, term
        if isinstance(ctype, Struct):
            return Typed(ctype, {path: term for path, (_, term) in numbers.items()}), numbers
        return Typed(ctype, numbers[()][1]), numbers
