"""The C of a unit as far as the exhaustive part needs it: its functions, how to call them, and what they depend on."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from pycparser import c_ast

from codegen.errors import CodegenError
from codegen.verify.check import Subject
from tests.evidence.mutation.source import Unit, name_of, printed

_WORD = re.compile(r"\b[A-Za-z_]\w*\b")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_DECLARED = re.compile(r"\}\s*(\w+)\s*;|^\s+(\w+)\s*=|\b(\w+)\s*\([^()]*\)\s*;|^extern const \w+ (\w+);", re.MULTILINE)
_REAL = {"float", "double"}
_WHOLE = re.compile(r"u?int\d+_t\Z|int\Z|unsigned")


class Absent(CodegenError):
    """A function, or a parameter of one, is not what its check takes it to be."""


@dataclass(frozen=True)
class Function:
    """A function that is defined in a unit.

    Attributes:
        parameters: name to type; what is no plain type, such as a pointer, is "*".
    """

    name: str
    parameters: Mapping[str, str]

    @property
    def takes_number(self) -> bool:
        """Whether it is given a real number, or nothing but whole ones: a claim is owed, or a reason why there is none."""
        types = self.parameters.values()
        return any(kind in _REAL for kind in types) or (bool(types) and all(_WHOLE.match(kind) for kind in types))


@dataclass(frozen=True, eq=False)
class Judged:
    """A unit whose helpers are judged.

    Attributes:
        path: such as src/ars_map.c.
        subject: its build.
    """

    path: str
    subject: Subject

    @cached_property
    def unit(self) -> Unit:
        """As a tree. Raises BuildError where it does not parse."""
        return Unit.read(self.path, self.subject.files)

    @cached_property
    def functions(self) -> dict[str, Function]:
        """Those that it defines, by name."""
        defined = (node for node in self.unit.nodes if isinstance(node, c_ast.FuncDef))
        return {name_of(node): Function(name_of(node), _parameters(node)) for node in defined}

    def call(self, function: str, arguments: Mapping[str, object]) -> str:
        """A call in C with the arguments put where the function's declaration has parameters of their names.

        Raises:
            Absent: there is no such function, or it has a parameter that is not among the arguments.
        """
        known = self.functions.get(function)
        if known is None:
            raise Absent(f"{function}() is not there", where=self.path)
        missing = [name for name in known.parameters if name not in arguments]
        if missing:
            raise Absent(f"{function}() takes {missing[0]!r}, which its check does not know of", where=self.path)
        return f"{function}({', '.join(str(arguments[name]) for name in known.parameters)})"

    @cached_property
    def _texts(self) -> dict[str, str]:
        """What the unit defines at file scope, by name, in C; what has no name by an empty one."""
        texts: dict[str, str] = {}
        for node in self.unit.nodes:
            texts[name_of(node)] = texts.get(name_of(node), "") + printed(node)
        return texts

    def dependence(self, text: str) -> str:
        """All C that a text which is compiled with the unit depends on: definitions of the unit, whole headers, other units."""
        used = sorted({"", *_reached(text, self._texts)} & self._texts.keys())
        own = "".join(self._texts[name] for name in used)
        return own + "".join(self._elsewhere(set(_WORD.findall(text + own)) - self._texts.keys()))

    def _elsewhere(self, words: set[str]) -> Iterator[str]:
        for path, content in sorted(self.subject.sources("include").items()):
            text = _plain(content)
            if not words & {name for found in _DECLARED.findall(text) for name in found}:
                continue
            yield text
            defined = path.replace("include/", "src/").replace(".h", ".c")
            if defined != self.path and defined in self.subject.files:
                yield _plain(self.subject.files[defined])


def _parameters(node: Any) -> dict[str, str]:
    declared = node.decl.type.args.params if node.decl.type.args else []
    return {one.name: _type_of(one.type) for one in declared if one.name is not None}


def _type_of(declared: Any) -> str:
    if isinstance(declared, c_ast.TypeDecl) and isinstance(declared.type, c_ast.IdentifierType):
        return " ".join(declared.type.names)
    return "*"


def _reached(text: str, nodes: Mapping[str, str]) -> set[str]:
    found: set[str] = set()
    waiting = set(_WORD.findall(text)) & nodes.keys()
    while waiting:
        name = waiting.pop()
        found.add(name)
        waiting |= (set(_WORD.findall(nodes[name])) & nodes.keys()) - found
    return found


def _plain(content: bytes) -> str:
    """Without what tells builds of the same C apart: comments and the build's number."""
    lines = _COMMENT.sub(" ", content.decode("ascii")).splitlines()
    return "\n".join(line.rstrip() for line in lines if line.strip() and "_BUILD" not in line)
