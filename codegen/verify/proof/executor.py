"""A function run for all inputs: its statements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from pycparser import c_ast

from codegen.verify.proof.c_types import VOID, Family, Scalar, promoted
from codegen.verify.proof.loops import Loops
from codegen.verify.proof.machine import Frame
from codegen.verify.proof.memory import Reference, State, Typed, joined, learn_choice, merged
from codegen.verify.proof.obligations import Kind
from codegen.verify.proof.source import CannotJudge, Function, place_of
from codegen.verify.proof.terms import Term

Rule = Callable[["Executor", Frame, Any, State], State | None]

Contract = Callable[["Executor", list[Typed], State, Any], Typed]
"""What stands for a call of a function that was proven by itself: of arguments, state and the node of the call."""


class Executor(Loops):
    """Runs functions; each of its methods for a statement gives the state behind it, None where none goes on."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.contracts: dict[str, Contract] = {}
        self._judgements: dict[tuple[Any, ...], Term] = {}

    def judged(self, judge: Function, parameters: Typed, state: State) -> Term:
        """What a function without side effects says of parameters. That nothing undefined happens in it is shown apart."""
        root = parameters.reference.root
        memory = {key: payload for key, payload in state.memory.items() if key[0] == root}
        numbers = ((key[1], payload.number) for key, payload in memory.items() if isinstance(payload, Term))
        key = judge.name, parameters.reference.path, tuple(sorted(numbers, key=str))
        if root not in self.constant_roots and key in self._judgements:
            return self._judgements[key]
        aside = self.start(is_idle=True)
        aside.memory = memory
        kept, self.obligations = self.obligations, {}
        self._judgements[key] = self.run(judge, [parameters], aside, judge.node).term
        if any(each.kind == Kind.WRITTEN for each in self.obligations):
            raise CannotJudge(judge.place, "parameters of which some may not be written")
        self.obligations = kept
        return self._judgements[key]

    def call(self, function: Function, arguments: list[Typed], state: State, node: Any) -> Typed:
        contract = self.contracts.get(function.name)
        if contract is not None:
            return contract(self, arguments, state, node)
        return self.run(function, arguments, state, node)

    def run(self, function: Function, arguments: list[Typed], state: State, node: Any) -> Typed:
        """The body of a function; the state becomes the one behind it. Raises CannotJudge."""
        if len(arguments) != len(function.parameters):
            raise CannotJudge(place_of(node), f"{len(arguments)} arguments for {function.name}")
        frame = Frame(function.unit, function)
        first = self.objects_made
        for parameter, argument in zip(function.parameters, arguments, strict=True):
            local = self.new_object(parameter.name, parameter.ctype)
            self.write(state, local, self.converted(state, argument, parameter.ctype, node), function.place)
            frame.names[parameter.name] = local
        base = state.fork()
        end = self.block(frame, function.node.body, state)
        if end is not None:
            frame.returned.append((end, None))
        result = self._returned(frame, function, base, state)
        state.memory = {key: payload for key, payload in state.memory.items() if self.age_of(key[0]) <= first}
        return result

    def _returned(self, frame: Frame, function: Function, base: State, state: State) -> Typed:
        """All ways out of a function become one."""
        if not frame.returned:
            raise CannotJudge(function.place, f"{function.name} does not return")
        last, value = frame.returned[-1]
        for other, earlier in reversed(frame.returned[:-1]):
            condition, path = other.path, self.pool.or_(other.path, last.path)
            both = joined(self.pool, base, condition, other, last, path)
            value = self._either(condition, (other, earlier), (last, value), both, function)
            last = both
        last.path = base.path  # one of them is taken
        state.become(last)
        if function.result == VOID:
            return Typed(VOID, {})
        if value is None:
            raise CannotJudge(function.place, f"{function.name} may end without a value")
        return value

    def _either(
        self,
        condition: Term,
        yes: tuple[State, Typed | None],
        no: tuple[State, Typed | None],
        both: State,
        function: Function,
    ) -> Typed | None:
        (here, first), (there, second) = yes, no
        if first is None or second is None:
            return None if first is second else self._no_value(function)
        if isinstance(first.payload, Term) and isinstance(second.payload, Term):
            term = self.pool.ite(condition, first.payload, second.payload)
            learn_choice(both.scope, term, (here, first.payload), (there, second.payload))
            return Typed(first.ctype, term)
        if isinstance(first.payload, Reference) or isinstance(second.payload, Reference):
            raise CannotJudge(function.place, "a choice between pointers")
        parts = {}
        for path, payload in first.aggregate.items():
            other = second.aggregate.get(path)
            chosen = None if other is None else merged(self.pool, condition, payload, other)
            if chosen is not None:
                parts[path] = chosen
                if isinstance(chosen, Term) and isinstance(payload, Term) and isinstance(other, Term):
                    learn_choice(both.scope, chosen, (here, payload), (there, other))
        return Typed(first.ctype, parts)

    def _no_value(self, function: Function) -> Typed:
        raise CannotJudge(function.place, f"{function.name} may end without a value")

    # Statements.

    def statement(self, frame: Frame, node: Any, state: State) -> State | None:
        rule = STATEMENTS.get(type(node))
        if rule is not None:
            return rule(self, frame, node, state)
        self.effect(frame, node, state)
        return state

    def block(self, frame: Frame, node: Any, state: State) -> State | None:
        names = dict(frame.names)
        now: State | None = state
        for each in node.block_items or ():
            if now is None:
                raise CannotJudge(place_of(each), "a statement that is never reached")
            now = self.statement(frame, each, now)
        frame.names = names
        return now

    def declaration(self, frame: Frame, node: Any, state: State) -> State:
        declared = self.program.units[frame.unit].object_of(node)
        if "static" in node.storage:
            if not declared.is_const or frame.function is None:
                raise CannotJudge(place_of(node), "a static variable")
            root = f"{frame.unit}:{frame.function.name}:{declared.name}"
            frame.names[node.name] = self.constant_object(frame.unit, root, declared.ctype, declared.init)
            return state
        local = self.new_object(node.name, declared.ctype)
        if node.init is not None:
            self.initialise(frame, local, node.init, state)
        frame.names[node.name] = local
        return state

    def branch(self, frame: Frame, node: Any, state: State) -> State | None:
        """if."""
        condition = self.condition(frame, node.cond, state)
        if condition.is_const:
            chosen = node.iftrue if condition.data else node.iffalse
            return state if chosen is None else self.statement(frame, chosen, state)
        yes: State | None = state.branch(self.pool, condition, True)
        no: State | None = state.branch(self.pool, condition, False)
        exits = self._exits(frame)
        assert yes is not None
        assert no is not None
        yes = self.statement(frame, node.iftrue, yes)
        no = no if node.iffalse is None else self.statement(frame, node.iffalse, no)
        if yes is None or no is None:
            return yes or no
        path = state.path if self._exits(frame) == exits else self.pool.or_(yes.path, no.path)
        return joined(self.pool, state, condition, yes, no, path)

    @staticmethod
    def _exits(frame: Frame) -> int:
        return len(frame.returned) + len(frame.broken) + len(frame.continued)

    def meeting(self, base: State, states: list[State]) -> State | None:
        """Where several ways meet, of which the paths exclude one another."""
        if not states:
            return None
        last, later = states[-1], [states[-1].path]
        for other in reversed(states[:-1]):
            condition = self._apart(other.path, later)
            last = joined(self.pool, base, condition, other, last, self.pool.or_(other.path, last.path))
            later.append(other.path)
        return last

    def _apart(self, path: Term, others: list[Term]) -> Term:
        """What tells a path from others: its last condition, where they have the opposite of it, as behind a `break`."""
        last = path.args[1] if path.op == "and" else path
        opposite = self.pool.not_(last)
        return last if all(opposite in _members(each) for each in others) else path

    def choice_of_cases(self, frame: Frame, node: Any, state: State) -> State | None:
        """switch."""
        value = self.value(frame, node.cond, state)
        if not isinstance(value.ctype, Scalar) or value.ctype.family == Family.FLOAT:
            raise CannotJudge(place_of(node), "a switch of what is no whole number")
        value = self.converted(state, value, promoted(value.ctype), node)
        names = dict(frame.names)
        labels = [each for each in node.stmt.block_items or () if isinstance(each, c_ast.Case)]
        matches = {}
        for label in labels:
            constant = self.converted(state, self.value(frame, label.expr, state), value.ctype, label)
            if not constant.term.is_const:
                raise CannotJudge(place_of(label), "a case that is not constant")
            matches[id(label)] = self.pool.eq(value.term, constant.term)
        outer, frame.broken = frame.broken, []
        none = self.pool.not_(self.pool.or_(*matches.values()))
        now: State | None = None
        has_default = False
        for label in node.stmt.block_items or ():
            if not isinstance(label, c_ast.Case | c_ast.Default):
                raise CannotJudge(place_of(label), "a statement outside the cases")
            has_default |= isinstance(label, c_ast.Default)
            entered = state.branch(self.pool, matches.get(id(label), none), True)
            now = entered if now is None else self.meeting(state, [entered, now])
            for each in label.stmts or ():
                if now is None:
                    break  # behind the one that leaves
                now = self.statement(frame, each, now)
        ends = [*frame.broken, *([] if now is None else [now])]
        frame.broken, frame.names = outer, names
        if not has_default:
            ends.append(state.branch(self.pool, none, True))
        end = self.meeting(state, ends)
        if end is not None and not frame.returned and not frame.continued:
            end.path = state.path
        return end

    def leave(self, frame: Frame, node: Any, state: State) -> None:
        """return."""
        assert frame.function is not None
        value = None
        if node.expr is not None:
            value = self.converted(state, self.value(frame, node.expr, state), frame.function.result, node)
        frame.returned.append((state, value))

    def leave_loop(self, frame: Frame, _node: Any, state: State) -> None:
        """break."""
        frame.broken.append(state)

    def next_round(self, frame: Frame, _node: Any, state: State) -> None:
        """continue."""
        frame.continued.append(state)

    def nothing(self, _frame: Frame, _node: Any, state: State) -> State:
        return state

    def declarations(self, frame: Frame, node: Any, state: State) -> State:
        for each in node.decls:
            state = self.declaration(frame, each, state)
        return state

    def refuse(self, _frame: Frame, node: Any, _state: State) -> State:
        raise CannotJudge(place_of(node), f"the statement {type(node).__name__}")


def _members(path: Term) -> Iterator[Term]:
    """The conditions of a path, the last one first."""
    while path.op == "and":
        path, last = path.args
        yield last
    yield path


STATEMENTS: dict[type, Rule] = {
    c_ast.Compound: Executor.block,
    c_ast.Decl: Executor.declaration,
    c_ast.DeclList: Executor.declarations,
    c_ast.If: Executor.branch,
    c_ast.For: Executor.loop,
    c_ast.Switch: Executor.choice_of_cases,
    c_ast.Return: Executor.leave,
    c_ast.Break: Executor.leave_loop,
    c_ast.Continue: Executor.next_round,
    c_ast.EmptyStatement: Executor.nothing,
    **dict.fromkeys((c_ast.While, c_ast.DoWhile, c_ast.Goto, c_ast.Label), Executor.refuse),
}
