"""Check that every loop of the generated C has a number of rounds that is known at compile time.

Together with the absence of recursion, this bounds the number of instructions of every call. The rules, on the syntax tree:

- the only loop is `for (i = constant; i < constant; i++)`, or likewise downwards or with another constant step;
- its counter is not written in its body;
- no `while`, `do` or `goto`; no call through a pointer; no function that calls itself, however indirectly.

A bound may also be a parameter of a static function whose every call passes a constant.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from pycparser import c_ast, c_parser

from codegen.errors import BuildError
from codegen.verify.number_tables import without_tables
from codegen.verify.target import preprocess

LIBRARY = ("memcpy",)
"""Library functions without a bound of their own; the generated C calls them with constant sizes."""

DIRECTIONS = {"<": "up", "<=": "up", ">": "down"}
STEPS = {"p++": "up", "++": "up", "+=": "up", "p--": "down", "--": "down", ">>=": "down"}
"""Not "-=", which can step over its end, and below zero."""


class _Function(NamedTuple):
    """A function and its location."""

    unit: str
    name: str
    is_static: bool
    node: Any


def complaints(files: Mapping[str, bytes], manifest: Mapping[str, Any]) -> tuple[str, ...]:
    """Return violations of the rule in the sources of a build, one text each, with file and line.

    Raises:
        CodegenError: `ziglang`, which resolves the preprocessor's lines, is not installed.
        BuildError: C that is not C99.
    """
    sources = {path: content for path, content in files.items() if path.startswith(("include/", "src/"))}
    sources = without_tables(sources, manifest)  # tables are most of the text and contain no loop
    units = sorted(path for path in sources if path.endswith(".c"))
    return _Program(preprocess(sources, units), (*LIBRARY, *manifest["dynamics_library_functions"])).complaints()


class _Program:
    """All units of a build, parsed."""

    def __init__(self, units: Mapping[str, str], library: tuple[str, ...]) -> None:
        self._library = library
        self._constants: set[str] = set()
        self._functions: list[_Function] = []
        for unit, text in units.items():
            try:
                tree = c_parser.CParser().parse(text, unit)
            except c_parser.ParseError as error:
                raise BuildError(f"not plain C99: {error}", where=unit) from error
            self._constants |= {str(node.name) for node in _all(tree, c_ast.Enumerator)}
            defined = [node for node in tree.ext if isinstance(node, c_ast.FuncDef)]
            self._functions += [_Function(unit, str(node.decl.name), "static" in node.decl.storage, node) for node in defined]

    def complaints(self) -> tuple[str, ...]:
        found = []
        for function in self._functions:
            body = function.node.body
            faults = [(node, type(node).__name__.lower()) for node in _all(body, c_ast.While, c_ast.DoWhile, c_ast.Goto)]
            faults += [(loop, why) for loop in _all(body, c_ast.For) if (why := self._why_unbounded(loop, function))]
            for call in _all(body, c_ast.FuncCall):
                name = call.name.name if isinstance(call.name, c_ast.ID) else "a pointer"
                if self._called(function, name) is None and name not in self._library:
                    faults.append((call, f"a call of {name}"))
            found += [f"{_place(node)}: {what} in {function.name}" for node, what in faults]
        return (*found, *self._recursions())

    def _why_unbounded(self, loop: Any, function: _Function) -> str:
        """Describe why a for loop breaks the rule; "" if it does not."""
        head, condition = loop.init, loop.cond
        if not (isinstance(head, c_ast.Assignment) and head.op == "=" and isinstance(head.lvalue, c_ast.ID)):
            return "a for loop that does not start with counter = constant"
        counter = str(head.lvalue.name)
        if not self._is_constant(head.rvalue):
            return "a for loop from what is no constant"
        if not (isinstance(condition, c_ast.BinaryOp) and _is_name(condition.left, counter)):
            return "a for loop whose condition does not compare its counter"
        if not (self._is_constant(condition.right) or self._is_always_constant(condition.right, function)):
            return "a for loop to what is no constant"
        direction = DIRECTIONS.get(condition.op)
        if direction is None or STEPS.get(self._step(loop.next, counter)) != direction:
            return "a for loop that does not step towards its end"
        return "a for loop whose body writes its counter" if _writes(loop.stmt, counter) else ""

    def _step(self, step: Any, counter: str) -> str:
        """Return the operator that moves the counter by a constant other than zero; "" if there is none."""
        if isinstance(step, c_ast.UnaryOp) and _is_name(step.expr, counter):
            return str(step.op)
        if isinstance(step, c_ast.Assignment) and _is_name(step.lvalue, counter):
            by = step.rvalue
            moves = isinstance(by, c_ast.Constant) and by.type.endswith("int") and int(by.value.rstrip("uUlL"), 0) > 0
            return str(step.op) if moves else ""
        return ""

    def _is_constant(self, node: Any) -> bool:
        if isinstance(node, c_ast.ID):
            return node.name in self._constants
        if isinstance(node, c_ast.Cast):
            return self._is_constant(node.expr)
        if isinstance(node, c_ast.BinaryOp):
            return self._is_constant(node.left) and self._is_constant(node.right)
        return isinstance(node, c_ast.Constant)

    def _is_always_constant(self, node: Any, function: _Function) -> bool:
        """Return whether a node is a parameter to which every call passes a constant and which no statement changes."""
        declared = function.node.decl.type.args
        parameters = [str(parameter.name) for parameter in declared.params] if declared else []
        if not (isinstance(node, c_ast.ID) and function.is_static and node.name in parameters):
            return False
        place, others = parameters.index(node.name), (each for each in self._functions if each.unit == function.unit)
        calls = [call for each in others for call in _all(each.node.body, c_ast.FuncCall) if _is_name(call.name, function.name)]
        return not _writes(function.node.body, node.name) and all(self._is_constant(call.args.exprs[place]) for call in calls)

    def _called(self, caller: _Function, name: str) -> _Function | None:
        """Return the function of a name that a unit sees, its own first."""
        named = [each for each in self._functions if each.name == name and (each.unit == caller.unit or not each.is_static)]
        return min(named, key=lambda each: each.unit != caller.unit, default=None)

    def _recursions(self) -> list[str]:
        found: list[str] = []
        done: list[_Function] = []

        def visit(function: _Function, callers: tuple[_Function, ...]) -> None:
            if function in callers:
                cycle = " -> ".join(each.name for each in (*callers[callers.index(function) :], function))
                found.append(f"{_place(function.node)}: recursion, {cycle}")
            elif function not in done:
                for call in _all(function.node.body, c_ast.FuncCall):
                    other = self._called(function, call.name.name) if isinstance(call.name, c_ast.ID) else None
                    if other is not None:
                        visit(other, (*callers, function))
                done.append(function)

        for function in self._functions:
            visit(function, ())
        return found


def _all(node: Any, *kinds: type) -> Iterator[Any]:
    if isinstance(node, kinds):
        yield node
    for _, child in node.children():
        # Nothing of interest is inside the initialisers of a table, and they are most of the tree.
        if not (isinstance(child, c_ast.InitList) and c_ast.Enumerator in kinds):
            yield from _all(child, *kinds)


def _is_name(node: Any, name: str) -> bool:
    return isinstance(node, c_ast.ID) and node.name == name


def _writes(node: Any, name: str) -> bool:
    assigned = (_is_name(each.lvalue, name) for each in _all(node, c_ast.Assignment))
    changed = (each.op in ("p++", "p--", "++", "--", "&") and _is_name(each.expr, name) for each in _all(node, c_ast.UnaryOp))
    return any(assigned) or any(changed)


def _place(node: Any) -> str:
    return f"{node.coord.file}:{node.coord.line}"
