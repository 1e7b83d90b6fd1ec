"""Expressions of C, evaluated for all inputs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any

from pycparser import c_ast

from codegen.verify.proof.boxes import FALSE, TRUE
from codegen.verify.proof.c_types import (
    BOOL,
    DOUBLE,
    FLOAT,
    INT,
    UNSIGNED,
    VOID,
    CType,
    Family,
    Pointer,
    Scalar,
    common,
    promoted,
    size_of,
)
from codegen.verify.proof.floats import FORMATS
from codegen.verify.proof.machine import Frame, Machine
from codegen.verify.proof.memory import INDEX_WIDTH, Reference, State, Typed, joined, learn_choice, merged
from codegen.verify.proof.obligations import Kind
from codegen.verify.proof.source import CannotJudge, holds_call, place_of, whole_of
from codegen.verify.proof.terms import BOOL as TRUTH
from codegen.verify.proof.terms import Term

STEPS = ("p++", "p--", "++", "--")
COMPARISONS = ("<", "<=", ">", ">=", "==", "!=")


class Expressions(Machine):
    """The part of a run that is inside expressions."""

    def value(self, frame: Frame, node: Any, state: State) -> Typed:
        """Of an expression; its side effects go to the state. Raises CannotJudge."""
        rule = RULES.get(type(node))
        if rule is None:
            raise CannotJudge(place_of(node), f"the expression {type(node).__name__}")
        return rule(self, frame, node, state)

    def condition(self, frame: Frame, node: Any, state: State) -> Term:
        """Whether an expression is not zero."""
        return self.truth(self.value(frame, node, state), node)

    def effect(self, frame: Frame, node: Any, state: State) -> None:
        """Of an expression that is a statement, or in the head of a loop: only there something may be assigned."""
        if isinstance(node, c_ast.Assignment):
            self.assignment(frame, node, state)
        elif isinstance(node, c_ast.UnaryOp) and node.op in STEPS:
            self._stepped(frame, node, state)
        elif isinstance(node, c_ast.ExprList):
            for each in node.exprs:
                self.effect(frame, each, state)
        else:
            self.value(frame, node, state)

    def operands(self, frame: Frame, nodes: Sequence[Any], state: State) -> list[Typed]:
        """Values of expressions of which C does not say which one comes first (C99 6.5).

        Raises CannotJudge: what one of them changes, another one sees.
        """
        if len(nodes) < 2 or not any(holds_call(node) for node in nodes):
            return [self.value(frame, node, state) for node in nodes]
        before, values, changing = state.fork(), [], []
        for number, node in enumerate(nodes):
            memory, made = state.memory.copy(), self.objects_made
            values.append(self.value(frame, node, state))
            if self.differs(memory, state, made):
                changing.append(number)
        kept = dict(self.obligations)
        for number, node in enumerate(nodes) if changing else ():
            if number != changing[0]:
                aside = before.fork() if number > changing[0] else state.fork()
                if len(changing) > 1 or self.value(frame, node, aside).payload != values[number].payload:
                    raise CannotJudge(
                        place_of(node), "a side effect that another operand sees: C leaves open which comes first"
                    )
        self.obligations = kept
        return values

    def place(self, frame: Frame, node: Any, state: State) -> Reference:
        """What an lvalue names. Raises CannotJudge: it is none."""
        if isinstance(node, c_ast.ID):
            return frame.names[node.name] if node.name in frame.names else self.global_object(frame.unit, node.name, node)
        if isinstance(node, c_ast.StructRef):
            if node.type == "->":
                return self.field(self._pointer(frame, node.name, state), node.field.name, node)
            return self.field(self.place(frame, node.name, state), node.field.name, node)
        if isinstance(node, c_ast.ArrayRef):
            array, subscript = self.operands(frame, [node.name, node.subscript], state)
            return self.element(state, self._lead(array, node), self._index(state, subscript, node), node)
        if isinstance(node, c_ast.UnaryOp) and node.op == "*":
            base = self._pointer(frame, node.expr, state)
            return self.element(state, base, self.pool.whole(0, INDEX_WIDTH), node)
        raise CannotJudge(place_of(node), "an lvalue of another kind")

    def _pointer(self, frame: Frame, node: Any, state: State) -> Reference:
        return self._lead(self.value(frame, node, state), node)

    def _lead(self, value: Typed, node: Any) -> Reference:
        if not isinstance(value.ctype, Pointer) or not isinstance(value.payload, Reference):
            raise CannotJudge(place_of(node), "a pointer that is none")
        return value.payload

    def _index(self, state: State, value: Typed, node: Any) -> Term:
        if not isinstance(value.ctype, Scalar) or value.ctype.family == Family.FLOAT:
            raise CannotJudge(place_of(node), "an index that is no whole number")
        number = self.converted(state, value, promoted(value.ctype), node)
        return self.pool.wider(number.term, INDEX_WIDTH, number.scalar.signed)

    def named(self, frame: Frame, node: Any, state: State) -> Typed:
        constants = self.program.units[frame.unit].constants
        if node.name not in frame.names and node.name in constants:
            return Typed(INT, self.pool.whole(constants[node.name], INT.width))
        return self.read(state, self.place(frame, node, state), node)

    def of_place(self, frame: Frame, node: Any, state: State) -> Typed:
        if isinstance(node, c_ast.StructRef) and node.type == "." and isinstance(node.name, c_ast.FuncCall):
            whole = self.value(frame, node.name, state)  # a field of what a function returns
            kept = self.new_object("returned", whole.ctype)
            self.write(state, kept, whole, place_of(node))
            return self.read(state, self.field(kept, node.field.name, node), node)
        return self.read(state, self.place(frame, node, state), node)

    def constant(self, _frame: Frame, node: Any, _state: State) -> Typed:
        if node.type in ("float", "double"):
            ctype = FLOAT if node.value[-1] in "fF" else DOUBLE
            text = node.value.rstrip("fFlL")
            exact = Fraction(float.fromhex(text)) if text[:2] in ("0x", "0X") else Fraction(text)
            return Typed(ctype, self.pool.real(FORMATS[ctype.width].nearest(exact), ctype.width))
        if node.type in ("int", "unsigned int"):
            value = whole_of(node.value, place_of(node))
            signed = node.type == "int" and value < 1 << 31
            if value < 1 << 32 and (
                signed or node.type != "int" or node.value[0] == "0"
            ):  # octal and hexadecimal ones become unsigned
                return Typed(INT if signed else UNSIGNED, self.pool.whole(value, INT.width))
        raise CannotJudge(place_of(node), f"the constant {node.value}")

    def cast(self, frame: Frame, node: Any, state: State) -> Typed:
        to = self.program.units[frame.unit].type_of(node.to_type)
        if isinstance(to, Pointer):
            raise CannotJudge(place_of(node), "a cast to a pointer")
        value = self.value(frame, node.expr, state)
        return Typed(VOID, {}) if to == VOID else self.converted(state, value, to, node)

    def assignment(self, frame: Frame, node: Any, state: State) -> Typed:
        target = self.place(frame, node.lvalue, state)
        old = None if node.op == "=" else self.read(state, target, node)
        if isinstance(node.rvalue, c_ast.Assignment):
            value = self.assignment(frame, node.rvalue, state)
        else:
            value = self.value(frame, node.rvalue, state)
        sees = holds_call(node.lvalue) or self.place(frame, node.lvalue, state) != target
        if sees or (old is not None and self.read(state, target, node).payload != old.payload):
            raise CannotJudge(place_of(node), "a side effect that the left side sees: C leaves open which comes first")
        if old is not None:
            value = self.binary(state, node.op[:-1], old, value, node)
        value = self.converted(state, value, target.ctype, node)
        self.write(state, target, value, place_of(node))
        return value

    def unary(self, frame: Frame, node: Any, state: State) -> Typed:
        if node.op == "&":
            target = self.place(frame, node.expr, state)
            if target.in_union:
                raise CannotJudge(place_of(node), "a pointer into a union")
            return Typed(Pointer(target.ctype), target)
        if node.op == "*":
            return self.of_place(frame, node, state)
        if node.op == "sizeof":
            return Typed(UNSIGNED, self.pool.whole(self._size(frame, node), UNSIGNED.width))
        if node.op in STEPS:
            raise CannotJudge(place_of(node), f"{node.op.removeprefix('p')} inside an expression")
        value = self.value(frame, node.expr, state)
        if node.op == "!":
            return Typed(BOOL, self.pool.not_(self.truth(value, node)))
        if not isinstance(value.ctype, Scalar):
            raise CannotJudge(place_of(node), f"{node.op} of what is no number")
        self._refuse_enum(node.op, node, value.ctype)
        value = self.converted(state, value, promoted(value.ctype), node)
        if node.op == "-":
            if value.scalar.family == Family.FLOAT:
                return Typed(value.ctype, self.pool.neg(value.term))
            return self.binary(state, "-", Typed(value.ctype, self.zero(value.scalar)), value, node)
        if node.op == "~" and value.scalar.family == Family.INT:
            ones = self.pool.whole(-1, value.scalar.width)
            return Typed(value.ctype, self.pool.apply("bxor", value.scalar.width, value.term, ones))
        if node.op == "+":
            return value
        raise CannotJudge(place_of(node), f"the operator {node.op}")

    def _size(self, frame: Frame, node: Any) -> int:
        unit = self.program.units[frame.unit]
        try:
            if isinstance(node.expr, c_ast.Typename):
                return size_of(unit.type_of(node.expr))
            if isinstance(node.expr, c_ast.ID) and node.expr.name in frame.names:
                return size_of(frame.names[node.expr.name].ctype)
        except TypeError as error:
            raise CannotJudge(place_of(node), str(error)) from None
        raise CannotJudge(place_of(node), "sizeof of what is no variable")

    def _stepped(self, frame: Frame, node: Any, state: State) -> Typed:
        target = self.place(frame, node.expr, state)
        before = self.read(state, target, node)
        one = Typed(INT, self.pool.whole(1, INT.width))
        after = self.binary(state, node.op[-1], before, one, node)
        after = self.converted(state, after, target.ctype, node)
        self.write(state, target, after, place_of(node))
        return before if node.op.startswith("p") else after

    def binary_node(self, frame: Frame, node: Any, state: State) -> Typed:
        if node.op in ("&&", "||"):
            return self._short_circuit(frame, node, state)
        left, right = self.operands(frame, [node.left, node.right], state)
        return self.binary(state, node.op, left, right, node)

    def _short_circuit(self, frame: Frame, node: Any, state: State) -> Typed:
        """The right side is evaluated only where the left one does not decide."""
        left = self.condition(frame, node.left, state)
        goes_on = node.op == "&&"
        if left.is_const and bool(left.data) != goes_on:
            return Typed(BOOL, left)
        aside = state.branch(self.pool, left, goes_on)
        right = self.condition(frame, node.right, aside)
        if aside.writes != state.writes:
            other = state.branch(self.pool, left, not goes_on)
            yes, no = (aside, other) if goes_on else (other, aside)
            state.become(joined(self.pool, state, left, yes, no, state.path))
        return Typed(BOOL, self.pool.and_(left, right) if goes_on else self.pool.or_(left, right))

    def choice(self, frame: Frame, node: Any, state: State) -> Typed:
        """`condition ? yes : no`."""
        condition = self.condition(frame, node.cond, state)
        if condition.is_const:
            return self.value(frame, node.iftrue if condition.data else node.iffalse, state)
        yes, no = (state.branch(self.pool, condition, holds) for holds in (True, False))
        left = self.value(frame, node.iftrue, yes)
        right = self.value(frame, node.iffalse, no)
        ctype: CType = left.ctype
        if isinstance(left.ctype, Scalar) and isinstance(right.ctype, Scalar):
            ctype = common(left.ctype, right.ctype) if left.ctype != right.ctype else promoted(left.ctype)
        left, right = self.converted(yes, left, ctype, node), self.converted(no, right, ctype, node)
        if not isinstance(left.payload, Term | Reference) or not isinstance(right.payload, Term | Reference):
            raise CannotJudge(place_of(node), "a choice between structs")
        payload = merged(self.pool, condition, left.payload, right.payload)
        if payload is None:
            raise CannotJudge(place_of(node), "a choice between pointers to different objects")
        state.become(joined(self.pool, state, condition, yes, no, state.path))
        if isinstance(payload, Term):
            learn_choice(state.scope, payload, (yes, left.term), (no, right.term))
        return Typed(ctype, payload)

    def binary(self, state: State, op: str, left: Typed, right: Typed, node: Any) -> Typed:
        """Arithmetic, comparison, bits; or an index added to a pointer."""
        if isinstance(left.payload, Reference) and op in "+" and isinstance(right.ctype, Scalar):
            number = self.converted(state, right, promoted(right.ctype), node)
            index = self.pool.wider(number.term, INDEX_WIDTH, number.scalar.signed)
            return Typed(left.ctype, self.element(state, left.payload, index, node))
        if not isinstance(left.ctype, Scalar) or not isinstance(right.ctype, Scalar):
            raise CannotJudge(place_of(node), f"{op} of what are no numbers")
        if op in COMPARISONS:
            self._refuse_order(op, left, right, node)
        else:
            self._refuse_enum(op, node, left.ctype, right.ctype)
        if op in ("<<", ">>"):
            return self._shift(state, op, left, right, node)
        ctype = common(left.ctype, right.ctype)
        a, b = (self.converted(state, each, ctype, node).term for each in (left, right))
        if op in COMPARISONS:
            compared = self._compared(op, a, b, ctype)
            box = state.scope.box(compared)
            if box in (TRUE, FALSE):
                compared = self.pool.true if box == TRUE else self.pool.false
            return Typed(BOOL, compared)
        if ctype.family == Family.FLOAT:
            result = self._of_floats(state, op, a, b, node)
        else:
            result = self._of_wholes(state, op, a, b, ctype, node)
        state.scope.box(result)
        return Typed(ctype, result)

    @staticmethod
    def _refuse_enum(op: str, node: Any, *operands: CType) -> None:
        """Whether an enum is promoted to a number with a sign, the compiler chooses."""
        if any(isinstance(each, Scalar) and each.enumerators is not None for each in operands):
            raise CannotJudge(place_of(node), f"{op} of an enum")

    @staticmethod
    def _refuse_order(op: str, left: Typed, right: Typed, node: Any) -> None:
        """An enum compares as the compiler chooses, but with its like and with a constant that is not negative."""
        for one, other in ((left.scalar, right), (right.scalar, left)):
            is_safe = other.term.is_const and other.scalar.family == Family.INT and other.term.data < 1 << (INT.width - 1)
            if one.enumerators is not None and op not in ("==", "!=") and other.ctype != one and not is_safe:
                raise CannotJudge(place_of(node), f"{op} of an enum and a number that is not known")

    def _compared(self, op: str, a: Term, b: Term, ctype: Scalar) -> Term:
        if op in ("==", "!="):
            equal = self.pool.feq(a, b) if ctype.family == Family.FLOAT else self.pool.eq(a, b)
            return equal if op == "==" else self.pool.not_(equal)
        if op in (">", ">="):
            a, b = b, a
        prefix = "f" if ctype.family == Family.FLOAT else "s" if ctype.signed else "u"
        return self.pool.apply(prefix + ("lt" if op in ("<", ">") else "le"), TRUTH, a, b)

    def _of_floats(self, state: State, op: str, a: Term, b: Term, node: Any) -> Term:
        if op == "/":
            self.need(Kind.DIVISION, state, self.pool.not_(self.pool.feq(b, self.pool.real(0.0, -b.sort))), node)
        if op in "+-":
            return self.pool.add(a, b) if op == "+" else self.pool.sub(a, b)
        if op in "*/":
            return self.pool.apply("fmul" if op == "*" else "fdiv", a.sort, a, b)
        raise CannotJudge(place_of(node), f"{op} of floats")

    def _of_wholes(self, state: State, op: str, a: Term, b: Term, ctype: Scalar, node: Any) -> Term:
        if op in BITWISE:
            return self.pool.apply(BITWISE[op], ctype.width, a, b)
        if op in ("/", "%"):
            zero = self.zero(ctype)
            self.need(Kind.DIVISION, state, self.pool.not_(self.pool.eq(b, zero)), node)
            if ctype.signed:  # the one quotient that is too large
                least, minus_one = self.pool.whole(1 << (ctype.width - 1), ctype.width), self.pool.whole(-1, ctype.width)
                too_large = self.pool.and_(self.pool.eq(a, least), self.pool.eq(b, minus_one))
                self.need(Kind.OVERFLOW, state, self.pool.not_(too_large), node)
            data = ("quotient" if op == "/" else "remainder", ctype.signed)
            return self.pool.apply("div", ctype.width, a, b, data=data)
        if op not in ARITHMETIC:
            raise CannotJudge(place_of(node), f"{op} of whole numbers")
        if ctype.signed:
            wide = [self.pool.wider(each, 2 * ctype.width, True) for each in (a, b)]
            exact = self.pool.apply(ARITHMETIC[op], 2 * ctype.width, *wide)
            self.need(Kind.OVERFLOW, state, self._fits(exact, ctype), node)
        return self.pool.apply(ARITHMETIC[op], ctype.width, a, b)

    def _fits(self, exact: Term, ctype: Scalar) -> Term:
        low, high = (self.pool.whole(each, exact.sort) for each in (-(1 << (ctype.width - 1)), (1 << (ctype.width - 1)) - 1))
        above = self.pool.apply("sle", TRUTH, low, exact)
        return self.pool.and_(above, self.pool.apply("sle", TRUTH, exact, high))

    def _shift(self, state: State, op: str, left: Typed, right: Typed, node: Any) -> Typed:
        ctype = promoted(left.scalar)
        number, amount = (self.converted(state, each, promoted(each.scalar), node) for each in (left, right))
        if Family.FLOAT in (number.scalar.family, amount.scalar.family):
            raise CannotJudge(place_of(node), "a shift of floats")
        by = self.pool.wider(amount.term, ctype.width, amount.scalar.signed)
        width = self.pool.whole(ctype.width, amount.scalar.width)
        self.need(Kind.SHIFT, state, self.pool.apply("ult", TRUTH, amount.term, width), node)
        if op == ">>":
            result = self.pool.apply("shr", ctype.width, number.term, by, data=ctype.signed)
        else:
            if ctype.signed:  # of what is not negative, to what has a number (C99 6.5.7)
                wide, far = (self.pool.wider(each, 2 * ctype.width, False) for each in (number.term, by))
                exact = self.pool.apply("shl", 2 * ctype.width, wide, far)
                positive = self.pool.apply("sle", TRUTH, self.zero(ctype), number.term)
                self.need(Kind.OVERFLOW, state, self.pool.and_(positive, self._fits(exact, ctype)), node)
            result = self.pool.apply("shl", ctype.width, number.term, by)
        state.scope.box(result)
        return Typed(ctype, result)

    def call_node(self, frame: Frame, node: Any, state: State) -> Typed:
        if not isinstance(node.name, c_ast.ID):
            raise CannotJudge(place_of(node), "a call through a pointer")
        arguments = self.operands(frame, node.args.exprs if node.args else (), state)
        function = self.program.called(frame.unit, node.name.name)
        if function is not None:
            return self.call(function, arguments, state, node)
        if node.name.name == "memcpy":
            return self._copied(arguments, state, node)
        if node.name.name in LIBRARY and all(isinstance(each.ctype, Scalar) for each in arguments):
            width = FLOAT.width if node.name.name.endswith("f") else DOUBLE.width
            return Typed(Scalar(Family.FLOAT, width, True), self.pool.fresh(node.name.name, -width))
        raise CannotJudge(place_of(node), f"a call of {node.name.name}")

    def _copied(self, arguments: list[Typed], state: State, node: Any) -> Typed:
        """memcpy of a whole number or array, to one of the same size."""
        if len(arguments) != 3:
            raise CannotJudge(place_of(node), f"{len(arguments)} arguments for memcpy")
        to, source, size = (each.payload for each in arguments)
        if not (isinstance(to, Reference) and isinstance(source, Reference) and isinstance(size, Term) and size.is_const):
            raise CannotJudge(place_of(node), "memcpy of other than objects and a constant size")
        target, value = to.ctype, source.ctype
        if isinstance(target, Scalar) and isinstance(value, Scalar) and target.size == value.size == size.data:
            read = self.read(state, source, node)
            self.write(state, to, self._same_bits(read, target, node), place_of(node))
            return arguments[0]
        if isinstance(target, Scalar) and target == value and size.data % target.size == 0:
            for index in range(size.data // target.size):
                step = self.pool.whole(index, INDEX_WIDTH)
                copied = self.read(state, self.element(state, source, step, node), node)
                self.write(state, self.element(state, to, step, node), copied, place_of(node))
            return arguments[0]
        raise CannotJudge(place_of(node), "memcpy between objects of different size")

    def _same_bits(self, value: Typed, to: Scalar, node: Any) -> Typed:
        have = value.scalar
        if Family.BOOL in (have.family, to.family) or have.enumerators is not None or to.enumerators is not None:
            raise CannotJudge(place_of(node), "the bits of a bool or an enum")
        if have.family == to.family:
            return Typed(to, value.term)
        return Typed(to, self.float_of_bits(value.term) if to.family == Family.FLOAT else self.bits_of_float(value.term))

    def compound(self, frame: Frame, node: Any, state: State) -> Typed:
        """`(type){ ... }`."""
        made = self.new_object("compound literal", self.program.units[frame.unit].type_of(node.type))
        self.initialise(frame, made, node.init, state)
        return self.read(state, made, node)

    def listed(self, frame: Frame, node: Any, state: State) -> Typed:
        """`a, b`."""
        return [self.value(frame, each, state) for each in node.exprs][-1]

    def call(self, function: Any, arguments: list[Typed], state: State, node: Any) -> Typed:
        """Of a function of the program."""
        raise NotImplementedError


LIBRARY = ("sinf", "cosf", "atanf", "sqrtf", "sin", "cos", "atan", "sqrt")
"""What the dynamics may call. Nothing is said of the result: it counts as any number."""

ARITHMETIC = {"+": "add", "-": "sub", "*": "mul"}
BITWISE = {"&": "band", "|": "bor", "^": "bxor"}

RULES: dict[type, Callable[[Expressions, Frame, Any, State], Typed]] = {
    c_ast.Constant: Expressions.constant,
    c_ast.ID: Expressions.named,
    c_ast.StructRef: Expressions.of_place,
    c_ast.ArrayRef: Expressions.of_place,
    c_ast.Cast: Expressions.cast,
    c_ast.UnaryOp: Expressions.unary,
    c_ast.BinaryOp: Expressions.binary_node,
    c_ast.TernaryOp: Expressions.choice,
    c_ast.FuncCall: Expressions.call_node,
    c_ast.CompoundLiteral: Expressions.compound,
    c_ast.ExprList: Expressions.listed,
}
