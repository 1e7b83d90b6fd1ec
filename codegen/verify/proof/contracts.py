"""What a call of a proven function does, without running it: its needs become obligations, its promises are taken."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from codegen.verify.proof.boxes import Box
from codegen.verify.proof.c_types import VOID, Pointer, Scalar, Struct, leaves
from codegen.verify.proof.claims import Call, Claims, Needs
from codegen.verify.proof.entries import INITIALISERS, OUTPUTS, base_of, named
from codegen.verify.proof.executor import Executor
from codegen.verify.proof.invariants import Invariant, Path, states_inside, within
from codegen.verify.proof.machine import Kind, sort_of
from codegen.verify.proof.memory import INDEX_WIDTH, Reference, State, Typed
from codegen.verify.proof.source import CannotJudge, Function, Parameter, place_of
from codegen.verify.proof.terms import Term


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
        given = {}
        for parameter, argument in zip(self.function.parameters, arguments, strict=True):
            given[parameter.name] = machine.converted(state, argument, parameter.ctype, node)
        for parameter in self.function.parameters:
            self._need(machine, parameter, given[parameter.name], state, node)
        for needs in self.needs:
            for text, goal in needs(machine, state, given):
                machine.need(Kind.CLAIM, state, goal, node, text)
        before = dict(state.memory)
        for parameter in self.function.parameters:
            self._change(machine, parameter, given[parameter.name], state, place_of(node))
        result, numbers = self._result(machine, state)

        def find(memory: Mapping[Any, Any], name: str, path: Path) -> Term:
            reference = given[name].reference
            found = memory[(reference.root, (*base_of(reference), *path))]
            assert isinstance(found, Term)
            return found

        call = Call(
            machine.pool,
            lambda name: given[name].term,
            lambda name, path: find(state.memory, name, path),
            lambda name, path: find(before, name, path),
            numbers,
        )
        self._take(machine, state, [term for claims in self.claims for _, term in claims(call)])
        return result

    def _take(self, machine: Executor, state: State, terms: Sequence[Term]) -> None:
        """Take to hold behind the call, where the run comes here."""
        for term in terms:
            self.taken.append(machine.pool.or_(machine.pool.not_(state.path), term))
            state.scope.assume(term)

    def _need(self, machine: Executor, parameter: Parameter, argument: Typed, state: State, node: Any) -> None:
        """A state keeps its invariant, parameters are valid, an array is as long as it is declared."""
        if not isinstance(parameter.ctype, Pointer):
            return
        target, reference = parameter.ctype.target, argument.reference
        if parameter.length is not None:
            last = machine.pool.whole(parameter.length - 1, INDEX_WIDTH)
            machine.element(state, reference, last, node)
        if parameter.is_const or not any(each in self.function.name for each in (*INITIALISERS, *OUTPUTS)):
            self._need_written(machine, parameter, reference, state, node)
        judge = self.judge(target)
        if judge is not None and judge != self.function:
            machine.need(Kind.CLAIM, state, machine.judged(judge, argument, state), node, "the parameters are valid")
        writes_only = not parameter.is_const and self.function.name.endswith(INITIALISERS)
        for inner, invariant in () if writes_only else states_inside(target, self.states):
            leaf = self._reader(state, reference, inner, node)
            for text, _, term in invariant.holds(machine.pool, leaf):
                machine.need(Kind.INVARIANT, state, term, node, text)

    @staticmethod
    def _need_written(machine: Executor, parameter: Parameter, reference: Reference, state: State, node: Any) -> None:
        """Whatever the function may read has to be there."""
        assert isinstance(parameter.ctype, Pointer)
        target = parameter.ctype.target
        if reference.root in machine.constant_roots or machine.is_table(reference.root):
            return
        for path in (
            [(index,) for index in range(parameter.length)] if parameter.length else [path for path, _ in leaves(target)]
        ):
            if (reference.root, (*base_of(reference), *path)) not in state.memory:
                machine.need(Kind.WRITTEN, state, machine.pool.false, node, f"{named(parameter, path)} is written")

    @staticmethod
    def _reader(state: State, reference: Reference, inner: Path, node: Any) -> Callable[[Path], Term]:
        def leaf(path: Path) -> Term:
            found = state.memory.get((reference.root, (*base_of(reference), *inner, *path)))
            if not isinstance(found, Term):
                raise CannotJudge(place_of(node), f"{'.'.join(map(str, path))} may not be written before this call")
            return found

        return leaf

    def _change(self, machine: Executor, parameter: Parameter, argument: Typed, state: State, place: str) -> None:
        """What the function may write holds anything that it promises."""
        if not isinstance(parameter.ctype, Pointer) or parameter.is_const:
            return
        reference, target = argument.reference, parameter.ctype.target
        for path, box in self.written.get(parameter.name, {}).items():
            scalar = self._scalar(target, path, parameter)
            term = machine.pool.fresh(f"{self.function.name}: {parameter.name}", sort_of(scalar))
            state.put((reference.root, (*base_of(reference), *path)), term, place)
            state.scope.learn(term, box)
            self._take(machine, state, [within(machine.pool, term, box)])
        for inner, invariant in states_inside(target, self.states):
            clauses = [clause.term(machine.pool, self._reader(state, reference, inner, None)) for clause in invariant.clauses]
            self._take(machine, state, clauses)

    @staticmethod
    def _scalar(target: Any, path: Path, parameter: Parameter) -> Scalar:
        if parameter.length is not None or not path:
            assert isinstance(target, Scalar)
            return target
        scalar = dict(leaves(target))[path]
        assert isinstance(scalar, Scalar)
        return scalar

    def _result(self, machine: Executor, state: State) -> tuple[Typed, dict[Path, tuple[Scalar, Term]]]:
        """Any that it promises."""
        ctype = self.function.result
        if ctype == VOID:
            return Typed(VOID, {}), {}
        numbers: dict[Path, tuple[Scalar, Term]] = {}
        for path, scalar in leaves(ctype):
            assert isinstance(scalar, Scalar)
            term = machine.pool.fresh(f"{self.function.name}()", sort_of(scalar))
            state.scope.learn(term, self.results[path])
            self._take(machine, state, [within(machine.pool, term, self.results[path])])
            numbers[path] = scalar, term
        if isinstance(ctype, Struct):
            return Typed(ctype, {path: term for path, (_, term) in numbers.items()}), numbers
        return Typed(ctype, numbers[()][1]), numbers
