"""The proof of a build: one public function after the other, callees first; those that keep a state together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from codegen.errors import one_line
from codegen.verify.proof import boxes
from codegen.verify.proof.boxes import Box
from codegen.verify.proof.c_types import Array, CType, Family, Pointer, Scalar, Struct, leaves
from codegen.verify.proof.calls import Call, Claims, stated
from codegen.verify.proof.claims import needs_of, of_function
from codegen.verify.proof.contracts import Contract
from codegen.verify.proof.encode import Encoder
from codegen.verify.proof.entries import INITIALISERS, Caller, Entry, named
from codegen.verify.proof.executor import Executor
from codegen.verify.proof.invariants import (
    Clause,
    Invariant,
    Path,
    Same,
    dotted,
    own_leaves,
    states_inside,
    widened,
    within,
)
from codegen.verify.proof.obligations import Kind, Obligation
from codegen.verify.proof.solver import Prover, Verdict
from codegen.verify.proof.source import CannotJudge, Function, Parameter, ParsedProgram
from codegen.verify.proof.terms import Term

UNFORESEEN = (AssertionError, AttributeError, LookupError, RecursionError, TypeError, ValueError)
"""What C that nobody thought of may come to; then nothing is proved of it."""
TURNS_MAX = 24
"""Of looking for an invariant."""


@dataclass
class ProofResult:
    """What came of a proof.

    Attributes:
        verdicts: of every obligation, with the function that it is of.
        invariants: by the name of the struct.
        troubles: what keeps it from being judged, with file and line.
        questions: to z3.
    """

    verdicts: list[tuple[str, Verdict]] = field(default_factory=list)
    invariants: dict[str, Invariant] = field(default_factory=dict)
    troubles: list[str] = field(default_factory=list)
    questions: int = 0


class Session:
    """Of one program. sampling_time: with which it is called, in s."""

    def __init__(self, machine: Executor, prefix: str, sampling_time: float) -> None:
        self.machine, self.prefix, self.sampling_time = machine, prefix, sampling_time
        self.states: dict[str, Invariant] = {}
        self.report = ProofResult()
        self._caller = Caller(machine, self.states, prefix)
        self._prover = Prover(machine.pool, Encoder(machine.facts))
        self._landmarks = sorted(_landmarks(machine.program))
        self._taken: list[Term] = []

    def run(self) -> ProofResult:
        """Raises CannotJudge: the whole of it cannot be judged."""
        for functions in self._groups():
            try:
                self._prove_group(functions)
            except CannotJudge as error:
                self.report.troubles.append(f"{error.place}: cannot be judged: {error.what}")
            except UNFORESEEN as error:
                what = f"{type(error).__name__}: {one_line(str(error))}"
                self.report.troubles.append(f"{functions[0].place}: {functions[0].name}: cannot be judged: {what}")
        self.report.invariants = dict(self.states)
        self.report.questions = self._prover.questions
        return self.report

    def _groups(self) -> Iterator[list[Function]]:
        """Public functions, those of one kind of state together, behind all that they call."""
        public = [function for function in self.machine.program.callees_first() if not function.is_static]
        kept: dict[str, list[Function]] = {}
        for function in public:
            target = _self_of(function)
            if target is not None:
                kept.setdefault(target.name, []).append(function)
        for function in public:
            of_state = next((group for group in kept.values() if function in group), [function])
            if function is of_state[-1]:
                yield of_state

    def _prove_group(self, functions: Sequence[Function]) -> None:
        target = _self_of(functions[0])
        if target is None:
            entry = self._called(functions[0])
            self._prove(entry)
            self._promise(entry)
            return
        entries = self._with_invariant(target, functions)
        for entry in entries:
            self._prove(entry)
            self._promise(entry)

    def _called(self, function: Function) -> Entry:
        self.machine.obligations, self._taken = {}, []
        for contract in self.machine.contracts.values():
            if isinstance(contract, Contract):
                contract.taken = self._taken
        entry = self._caller.call(function)
        entry.assumptions += [*self._taken, *self.machine.axioms]
        entry.obligations = list(self.machine.obligations)
        return entry

    # Invariants.

    def _with_invariant(self, target: Struct, functions: Sequence[Function]) -> list[Entry]:
        """Search: start from what the initialisers leave, let it grow by what every other function leaves, until it stays."""
        initialisers = [each for each in functions if each.name.endswith(INITIALISERS)]
        if not initialisers:
            raise CannotJudge(functions[0].place, f"nothing initialises {target.name}")
        invariant = Invariant(target)
        self.states[target.name] = invariant  # so that an initialiser is given nothing that was written
        first = [self._called(each) for each in initialisers]
        others = {name: each for name, each in self.states.items() if name != target.name}
        for entry in first:
            self._grow(invariant, entry, others, 0)
        invariant.clauses = self._surviving(_candidates(target, others), first)
        rest = [each for each in functions if each not in initialisers]
        for turn in range(1, TURNS_MAX):
            before = dict(invariant.boxes)
            entries = [self._called(each) for each in rest]
            for entry in entries:
                self._grow(invariant, entry, others, turn)
            if before == invariant.boxes:
                surviving = self._surviving(invariant.clauses, entries)
                if surviving == invariant.clauses:
                    return [*first, *entries]
                invariant.clauses = surviving
        raise CannotJudge(functions[0].place, f"no invariant of {target.name} found")

    def _grow(self, invariant: Invariant, entry: Entry, others: dict[str, Invariant], turn: int) -> None:
        """Around what a function left."""
        assert entry.state is not None
        parameter = entry.function.parameters[0]
        if parameter.is_const:
            return
        for path, leaf in own_leaves(invariant.ctype, others):
            if isinstance(leaf, Scalar):
                term = entry.state.memory.get(entry.key(parameter.name, path))
                old = invariant.boxes.get(path)
                new = entry.state.scope.box(term) if isinstance(term, Term) else boxes.any_of(_sort(leaf))
                invariant.boxes[path] = widened(old, new, leaf, self._landmarks, turn)

    def _surviving(self, clauses: list[Clause | Same], entries: Sequence[Entry]) -> list[Clause | Same]:
        """Those that the functions keep, if all that are left held before."""
        for entry in entries:
            parameter = entry.function.parameters[0]
            if not parameter.is_const:
                goals = {each: self._behind_or_false(each, entry, parameter.name) for each in clauses}
                broken = self._prover.broken_among(entry.assumptions, list(goals.values()))
                clauses = [each for each in clauses if goals[each] not in broken]
        return clauses

    def _behind_or_false(self, clause: Clause | Same, entry: Entry, name: str) -> Term:
        try:
            return clause.term(self.machine.pool, lambda path: entry.behind(name, path))
        except KeyError:
            return self.machine.pool.false

    # Obligations.

    def _prove(self, entry: Entry) -> None:
        obligations = [*entry.obligations, *self._behind(entry)]
        if not self._prover.may_hold(entry.assumptions):
            self.report.troubles.append(f"{entry.function.place}: no input fulfils what {entry.function.name} is given")
        for verdict in self._prover.prove(entry.assumptions, obligations, entry.typical):
            self.report.verdicts.append((entry.function.name, verdict))

    def _behind(self, entry: Entry) -> Iterator[Obligation]:
        """What has to hold behind a call: invariants, claims, that all was written, and the bounds that callers rely on."""
        function, pool = entry.function, self.machine.pool
        call, unwritten = self._call(entry)
        for path in unwritten:
            text = f"{dotted(path) or 'a value'} of the result is written"
            yield Obligation(Kind.WRITTEN, function.place, pool.true, pool.false, text)
        for claims in self._claims(function):
            shown, missing = stated(claims, call)
            for text, goal in shown:
                yield Obligation(Kind.CLAIM, function.place, pool.true, goal, text)
            for text in missing:
                yield Obligation(Kind.CLAIM, function.place, pool.true, pool.false, text)
        for parameter in function.parameters:
            yield from self._state_behind(entry, parameter)
            for path, term in _numbers(entry, parameter):
                name = named(parameter, path)
                if term is None:
                    yield Obligation(Kind.WRITTEN, function.place, pool.true, pool.false, f"{name} is written")
                elif self._caller.state_of(parameter) is None:
                    assert entry.state is not None
                    goal = within(pool, term, entry.state.scope.box(term))
                    yield Obligation(Kind.CLAIM, function.place, pool.true, goal, f"bounds of {name}")
        for path, (_, term) in call.results.items():
            assert entry.state is not None
            goal = within(pool, term, entry.state.scope.box(term))
            yield Obligation(Kind.CLAIM, function.place, pool.true, goal, f"bounds of the result {dotted(path)}".rstrip())

    def _state_behind(self, entry: Entry, parameter: Parameter) -> Iterator[Obligation]:
        invariant = self._caller.state_of(parameter)
        if invariant is None or parameter.is_const:
            return
        assert entry.state is not None
        pool, state = self.machine.pool, entry.state
        for inner, each in states_inside(invariant.ctype, self.states):

            def leaf(path: Path, inner: Path = inner) -> Term:
                return entry.behind(parameter.name, (*inner, *path))

            try:
                for text, path, goal in each.holds(pool, leaf):
                    place = state.written.get(entry.key(parameter.name, (*inner, *path)), entry.function.place)
                    yield Obligation(Kind.INVARIANT, place or entry.function.place, pool.true, goal, text)
                for path, scalar in own_leaves(each.ctype, self.states):
                    is_real = isinstance(scalar, Scalar) and scalar.family == Family.FLOAT
                    if is_real and not self._may_be_absent(invariant, path):
                        place = state.written.get(entry.key(parameter.name, (*inner, *path)), entry.function.place)
                        text = f"{dotted((*inner, *path))} stays finite"
                        yield Obligation(Kind.CLAIM, place or entry.function.place, pool.true, pool.is_finite(leaf(path)), text)
            except KeyError as error:
                text = f"{dotted(error.args[0][1])} is written"
                yield Obligation(Kind.WRITTEN, entry.function.place, pool.true, pool.false, text)

    def _may_be_absent(self, invariant: Invariant, path: Path) -> bool:
        """Whether a float may be NaN: a task keeps signals as received, a controller the optional ones of a sample."""
        return invariant.ctype.name == f"{self.prefix}_task_t" or path in (("sample", "rear_angle"), ("sample", "friction"))

    def _claims(self, function: Function) -> list[Claims]:
        return of_function(self.machine.program, function, self.prefix, self.sampling_time)

    def _call(self, entry: Entry) -> tuple[Call, list[Path]]:
        """The call, and what of its result was never written."""
        result = entry.result
        assert result is not None
        numbers: dict[Path, tuple[Scalar, Term]] = {}
        unwritten: list[Path] = []
        for path, scalar in leaves(result.ctype):
            if not isinstance(scalar, Scalar):
                raise CannotJudge(entry.function.place, "a pointer as a result")
            term = result.payload if isinstance(result.payload, Term) else result.aggregate.get(path)
            if not isinstance(term, Term):
                unwritten.append(path)
                term = self.machine.pool.fresh("never written", _sort(scalar))
            numbers[path] = scalar, term
        scalars = {name: argument.term for name, argument in entry.arguments.items() if isinstance(argument.ctype, Scalar)}
        return Call(self.machine.pool, scalars.__getitem__, entry.behind, entry.earlier, numbers), unwritten

    def _promise(self, entry: Entry) -> None:
        """Let other functions take the proven one by its contract."""
        function = entry.function
        if function.name.endswith("_valid"):
            return  # what it says is worth more than that it says something
        assert entry.state is not None
        scope = entry.state.scope
        written: dict[str, dict[Path, Box]] = {}
        for parameter in function.parameters:
            invariant = self._caller.state_of(parameter)
            if invariant is not None and not parameter.is_const:
                inside = states_inside(invariant.ctype, self.states)
                written[parameter.name] = {(*path, *end): box for path, each in inside for end, box in each.boxes.items()}
            else:
                numbers = _numbers(entry, parameter)
                written[parameter.name] = {path: scope.box(term) for path, term in numbers if term is not None}
        self.machine.contracts[function.name] = Contract(
            function,
            self.states,
            {path: scope.box(term) for path, (_, term) in self._call(entry)[0].results.items()},
            written,
            self._claims(function),
            needs_of(function, self.prefix),
            self._caller.judge_of,
        )


def _self_of(function: Function) -> Struct | None:
    """The kind of state that a function works on."""
    first = function.parameters[0] if function.parameters else None
    if first is None or first.name != "self" or not isinstance(first.ctype, Pointer):
        return None
    return first.ctype.target if isinstance(first.ctype.target, Struct) else None


def _numbers(entry: Entry, parameter: Parameter) -> Iterator[tuple[Path, Term | None]]:
    """What a call left in what a parameter that is no state points to; None for what it did not write."""
    if not isinstance(parameter.ctype, Pointer) or parameter.is_const or _self_of(entry.function) == parameter.ctype.target:
        return
    assert entry.state is not None
    target: CType = parameter.ctype.target
    if parameter.length is not None:
        target = Array(target, parameter.length)
    for path, leaf in leaves(target):
        if isinstance(leaf, Scalar):
            found = entry.state.memory.get(entry.key(parameter.name, path))
            yield path, found if isinstance(found, Term) else None


def _candidates(target: Struct, others: dict[str, Invariant]) -> list[Clause | Same]:
    """Every flag with every value of every status; every float with one of the same name in a state inside."""
    own = [(path, leaf) for path, leaf in own_leaves(target, others) if isinstance(leaf, Scalar)]
    flags = [path for path, leaf in own if leaf.family == Family.BOOL]
    statuses = [path for path, leaf in own if path[-1] == "status"]
    floats = [path for path, leaf in own if leaf.family == Family.FLOAT]
    inside = [
        (*inner, *path)
        for inner, each in states_inside(target, others)
        for path, leaf in own_leaves(each.ctype, others)
        if isinstance(leaf, Scalar) and leaf.family == Family.FLOAT
    ]
    return [
        *(
            Clause(status, value, flag, holds)
            for status in statuses
            for value in range(5)
            for flag in flags
            for holds in (True, False)
        ),
        *(Same(path, other) for path in floats for other in inside if path[-1] == other[-1]),
    ]


def _sort(scalar: Scalar) -> int:
    return 0 if scalar.family == Family.BOOL else -scalar.width if scalar.family == Family.FLOAT else scalar.width


def _landmarks(program: ParsedProgram) -> set[int]:
    """Whole numbers that the program names: where counts may end."""
    found = {0, 1}
    for unit in program.units.values():
        found |= {value for value in unit.constants.values() if value >= 0}
        for each in unit.objects.values():
            text = getattr(each.init, "value", "")
            if text.rstrip("uU").isdigit():
                found.add(int(text.rstrip("uU")))
    return found
