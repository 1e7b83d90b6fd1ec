"""The units of a build, preprocessed and parsed: their types, constants, objects and functions."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

from pycparser import c_ast, c_parser

from codegen.verify.proof.c_types import INT, Array, CType, Pointer, Scalar, Struct, scalar_named, size_of
from codegen.verify.target.cross import preprocess


class CannotJudge(Exception):
    """C that the proof does not understand: it proves nothing then.

    Attributes:
        place: file and line.
        what: the construct.
    """

    def __init__(self, place: str, what: str) -> None:
        self.place, self.what = place, what
        super().__init__(f"{place}: {what}")


@dataclass(frozen=True)
class Parameter:
    """Of a function.

    Attributes:
        length: of an array that it is declared as, None for none or for one that does not say.
        is_const: whether what it points to may not be written.
    """

    name: str
    ctype: CType
    length: int | None
    is_const: bool


@dataclass(frozen=True)
class Function:
    """A function with a body."""

    unit: str
    name: str
    node: Any
    parameters: tuple[Parameter, ...]
    result: CType
    is_static: bool

    @property
    def place(self) -> str:
        """File and line."""
        return place_of(self.node.decl)


@dataclass(frozen=True)
class Object:
    """A variable outside the functions, or a static one inside; its initialiser as parsed."""

    name: str
    ctype: CType
    init: Any
    is_const: bool
    place: str


@dataclass
class Unit:
    """What one C file defines, and what it sees of the headers."""

    name: str
    typedefs: dict[str, CType] = field(default_factory=dict)
    tags: dict[str, CType] = field(default_factory=dict)
    constants: dict[str, int] = field(default_factory=dict)
    functions: dict[str, Function] = field(default_factory=dict)
    objects: dict[str, Object] = field(default_factory=dict)

    @classmethod
    def parse(cls, name: str, text: str) -> Self:
        """Raises CannotJudge: not plain C99, or something in it is not understood."""
        try:
            tree = c_parser.CParser().parse(text, name)
        except c_parser.ParseError as error:
            raise CannotJudge(name, f"not plain C99: {error}") from None
        unit = cls(name)
        _refuse_qualified(tree)
        for node in tree.ext:
            unit._take(node)
        return unit

    def _take(self, node: Any) -> None:
        if isinstance(node, c_ast.Typedef):
            self.typedefs[node.name] = self.type_of(node.type, node.name)
        elif isinstance(node, c_ast.FuncDef):
            self.functions[node.decl.name] = self._function(node)
        elif isinstance(node, c_ast.Decl):
            if isinstance(node.type, c_ast.Struct | c_ast.Union | c_ast.Enum):
                self.type_of(node.type)
            elif not isinstance(node.type, c_ast.FuncDecl) and (node.init is not None or "extern" not in node.storage):
                self.objects[node.name] = self.object_of(node)
        elif not isinstance(node, c_ast.StaticAssert | c_ast.EmptyStatement):
            raise CannotJudge(place_of(node), type(node).__name__)

    def object_of(self, node: Any) -> Object:
        """Of a declaration. Raises CannotJudge."""
        ctype = self.type_of(node.type)
        if isinstance(ctype, Array) and ctype.length is None:
            if not isinstance(node.init, c_ast.InitList):
                raise CannotJudge(place_of(node), "an array without a length")
            ctype = Array(ctype.element, len(node.init.exprs))
        return Object(node.name, ctype, node.init, _is_const(node), place_of(node))

    def _function(self, node: Any) -> Function:
        declared = node.decl.type
        parameters = [] if declared.args is None else declared.args.params
        if any(isinstance(each, c_ast.EllipsisParam | c_ast.ID) for each in parameters):
            raise CannotJudge(place_of(node.decl), "a function without a prototype")
        named = [each for each in parameters if each.name is not None]
        return Function(
            self.name,
            node.decl.name,
            node,
            tuple(self._parameter(each) for each in named),
            self.type_of(declared.type),
            "static" in node.decl.storage,
        )

    def _parameter(self, node: Any) -> Parameter:
        ctype = self.type_of(node.type)
        if isinstance(ctype, Array):  # stands for a pointer to its first element (C99 6.7.5.3)
            return Parameter(node.name, Pointer(ctype.element), ctype.length, _points_to_const(node))
        return Parameter(node.name, ctype, None, _points_to_const(node))

    def type_of(self, node: Any, name: str = "") -> CType:
        """The type that a declarator gives, called `name` where it has no tag. Raises CannotJudge."""
        if isinstance(node, c_ast.Typename | c_ast.TypeDecl | c_ast.Decl):
            return self.type_of(node.type, name)
        if isinstance(node, c_ast.PtrDecl):
            return Pointer(self.type_of(node.type, name))
        if isinstance(node, c_ast.ArrayDecl):
            return Array(self.type_of(node.type, name), None if node.dim is None else self.constant(node.dim))
        if isinstance(node, c_ast.IdentifierType):
            return self._named(node)
        if isinstance(node, c_ast.Enum):
            return self._enum(node)
        if isinstance(node, c_ast.Struct | c_ast.Union):
            return self._struct(node, name)
        raise CannotJudge(place_of(node), f"the type {type(node).__name__}")

    def _named(self, node: Any) -> CType:
        if len(node.names) == 1 and node.names[0] in self.typedefs:
            return self.typedefs[node.names[0]]
        known = scalar_named(tuple(node.names))
        if known is None:
            raise CannotJudge(place_of(node), f"the type {' '.join(node.names)}")
        return known

    def _enum(self, node: Any) -> CType:
        if node.values is None:
            if node.name not in self.tags:
                raise CannotJudge(place_of(node), f"an enum of which only the name is known: {node.name}")
            return self.tags[node.name]
        value, values = 0, []
        for each in node.values.enumerators:
            value = value if each.value is None else self.constant(each.value)
            self.constants[each.name] = value
            values.append(value)
            value += 1
        if min(values) < -(1 << (INT.width - 1)) or max(values) >= 1 << (INT.width - 1):
            raise CannotJudge(place_of(node), "an enumerator that is no int")
        made = replace(INT, enumerators=(min(values), max(values)))
        if node.name is not None:
            self.tags[node.name] = made
        return made

    def _struct(self, node: Any, name: str) -> CType:
        if node.decls is None:
            if node.name not in self.tags:
                raise CannotJudge(place_of(node), f"a struct of which only the name is known: {node.name}")
            return self.tags[node.name]
        if any(each.bitsize is not None or each.name is None for each in node.decls):
            raise CannotJudge(place_of(node), "a bit field, or a field without a name")
        fields = tuple((str(each.name), self.type_of(each.type)) for each in node.decls)
        made = Struct(name or str(node.name or place_of(node)), fields, isinstance(node, c_ast.Union))
        if node.name is not None:
            self.tags[node.name] = made
        return made

    def constant(self, node: Any) -> int:
        """Of a whole number that is known when it is compiled. Raises CannotJudge."""
        if isinstance(node, c_ast.Constant) and node.type.endswith("int"):
            return whole_of(node.value, place_of(node))
        if isinstance(node, c_ast.ID) and node.name in self.constants:
            return self.constants[node.name]
        if isinstance(node, c_ast.Cast) and isinstance(self.type_of(node.to_type), Scalar):
            return self.constant(node.expr)
        if isinstance(node, c_ast.UnaryOp) and node.op == "-":
            return -self.constant(node.expr)
        if isinstance(node, c_ast.UnaryOp) and node.op == "sizeof" and isinstance(node.expr, c_ast.Typename):
            return self._size(node)
        if isinstance(node, c_ast.BinaryOp) and node.op in ("+", "-", "*"):
            left, right = self.constant(node.left), self.constant(node.right)
            return {"+": left + right, "-": left - right, "*": left * right}[node.op]
        raise CannotJudge(place_of(node), "a number that has to be constant")

    def _size(self, node: Any) -> int:
        try:
            return size_of(self.type_of(node.expr))
        except TypeError as error:
            raise CannotJudge(place_of(node), str(error)) from None


class ParsedProgram:
    """All units of a build."""

    def __init__(self, units: Mapping[str, Unit]) -> None:
        self.units = dict(units)

    @classmethod
    def read(cls, sources: Mapping[str, bytes]) -> Self:
        """Of files by path; headers are found in include/.

        Raises:
            MissingTool: `ziglang`, which resolves the preprocessor's lines, is not installed.
            BuildError: what the compiler refuses.
            CannotJudge: C that is not understood.
        """
        units = sorted(path for path in sources if path.endswith(".c"))
        return cls({name: Unit.parse(name, text) for name, text in preprocess(sources, units).items()})

    @property
    def functions(self) -> Iterator[Function]:
        """Of all units."""
        return (function for unit in self.units.values() for function in unit.functions.values())

    @property
    def objects(self) -> Iterator[Object]:
        """ExternalFigures the functions, of all units."""
        return (each for unit in self.units.values() for each in unit.objects.values())

    def public(self, name: str) -> Function | None:
        """The function of that name that all units see."""
        return next((each for each in self.functions if each.name == name and not each.is_static), None)

    def called(self, unit: str, name: str) -> Function | None:
        """The function of that name that a unit calls: its own first."""
        return self.units[unit].functions.get(name) or self.public(name)

    def object_seen(self, unit: str, name: str) -> tuple[str, Object] | None:
        """The object of that name that a unit sees, with the unit that defines it."""
        for other in (unit, *self.units):
            if name in self.units[other].objects:
                return other, self.units[other].objects[name]
        return None

    def callees_first(self) -> list[Function]:
        """Every function after those that it calls. Raises CannotJudge: recursion."""
        ordered: dict[Function, None] = {}

        def visit(function: Function, callers: tuple[Function, ...]) -> None:
            if function in callers:
                raise CannotJudge(function.place, f"{function.name} calls itself")
            if function not in ordered:
                for name in called_names(function.node.body):
                    other = self.called(function.unit, name)
                    if other is not None:
                        visit(other, (*callers, function))
                ordered[function] = None

        for function in self.functions:
            visit(function, ())
        return list(ordered)


def called_names(node: Any) -> Iterator[str]:
    """Of the functions that are called anywhere inside."""
    if isinstance(node, c_ast.FuncCall) and isinstance(node.name, c_ast.ID):
        yield node.name.name
    for _, child in node.children():
        yield from called_names(child)


def holds_call(node: Any) -> bool:
    """Whether a function is called anywhere inside."""
    return isinstance(node, c_ast.FuncCall) or any(holds_call(child) for _, child in node.children())


def place_of(node: Any) -> str:
    """File and line, "" for what the parser gives none."""
    return f"{node.coord.file}:{node.coord.line}" if node.coord else ""


def whole_of(text: str, place: str) -> int:
    """A literal. Raises CannotJudge."""
    digits = text.rstrip("uUlL")
    try:
        return int(digits, 8) if digits.isdigit() and digits[0] == "0" else int(digits, 0)
    except ValueError:
        raise CannotJudge(place, f"the constant {text}") from None


def _is_const(node: Any) -> bool:
    """Whether what is declared is constant, or has constant elements."""
    inner = _element(node.type)
    return isinstance(inner, c_ast.TypeDecl | c_ast.PtrDecl) and "const" in inner.quals


def _points_to_const(node: Any) -> bool:
    """Whether what a parameter points to, or has as elements, is constant. Of a pointer behind a typedef: no."""
    if not isinstance(node.type, c_ast.PtrDecl | c_ast.ArrayDecl):
        return False
    inner = _element(node.type.type)
    return isinstance(inner, c_ast.TypeDecl) and "const" in inner.quals


def _element(declarator: Any) -> Any:
    return _element(declarator.type) if isinstance(declarator, c_ast.ArrayDecl) else declarator


REFUSED_QUALIFIERS = ("volatile", "_Atomic")


def _refuse_qualified(node: Any) -> None:
    """What others may change between two statements is no C of which a run for all inputs could be made."""
    for qualifier in REFUSED_QUALIFIERS:
        if qualifier in (getattr(node, "quals", None) or ()):
            raise CannotJudge(place_of(node), qualifier)
    for _, child in node.children():
        if not isinstance(child, c_ast.Constant):
            _refuse_qualified(child)
