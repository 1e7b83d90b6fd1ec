"""Claims about helper functions, and the C of a build that they are made about."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from codegen import config as configuration
from codegen.config import Config
from codegen.emit.text import literal
from codegen.errors import CodegenError
from codegen.verify.check import Subject

FLOATS = 2**32
"""Inputs of a helper that takes a number in single precision: every pattern of bits."""

_COMMENT = re.compile(r'/\*.*?\*/|^extern "C" \{$|^#\s*(?!define)[^\n]*', re.DOTALL | re.MULTILINE)
_DEFINITION = re.compile(r"^(?:#define [^\n]*|[^\s#}][^{;]*(?:\{[^{}\n]*\})?;|[^\s#}].*?^\}[^\n]*)", re.DOTALL | re.MULTILINE)
_NAME = re.compile(r"#define (\w+)|[^({\[=;]*?(\w+)\s*[({\[=;]")
_NAME_AFTER = re.compile(r"^\} *(\w+);", re.MULTILINE)
_LOCAL = re.compile(r"(?:\w+\s)?(?:static|typedef|enum|#define)\b")
_FUNCTION = re.compile(r"[^({\[=;]*?(\w+)\(([^(){}]*)\)\s*\{")
_PLAIN = re.compile(r"(?:const )?(\w+(?: \w+)*) (\w+)")
_WORD = re.compile(r"\b[A-Za-z_]\w*\b")
_REAL = {"float", "double"}
_WHOLE = re.compile(r"u?int\d+_t\Z|int\Z|unsigned")


@dataclass(frozen=True)
class Claim:
    """A helper function and the result that it must have for each of its inputs.

    The C texts are Jinja templates, rendered into exhaustive.c.j2. They see `values`, the prefix of the build as `p` and in
    capitals as `P`, and `call(parameter=…)`, which calls the function, or another one: `call("name", parameter=…)`.

    Attributes:
        unit: without prefix, such as "map". function: with "@" for the prefix.
        text: the claim, one sentence without its full stop.
        body: C that judges the input `x` with the bits `bits`. With few inputs, `bits` is the number of the input.
        edges: C that names further inputs of a quick run with EDGE(x).
        setup: C at file scope. start: C that resets the memory of a claim that compares an input with the one before it.
        of: suffix of the name where one function has several claims.
        inputs: number of inputs; FLOATS, or few enough to run all of them in a quick run.
    """

    unit: str
    function: str
    text: str
    body: str
    edges: str = ""
    setup: str = ""
    start: str = ""
    of: str = ""
    inputs: int = FLOATS
    values: Mapping[str, Any] = field(default_factory=dict)


def number(value: float) -> str:
    """Return a number as a C literal in single precision."""
    return literal(value, "single")


def exact(value: float) -> str:
    """Return a number as a C literal in double precision that has the value of the single one."""
    return repr(float(np.float32(value)))


def edges(*values: str) -> str:
    """Return C that runs the inputs around some numbers."""
    return "".join(f"EDGE({value});\n" for value in dict.fromkeys(values))


class Absent(CodegenError):
    """A function or one of its parameters is not the one that a claim expects."""


@dataclass(frozen=True, eq=False)
class Source:
    """The C of a build. It relies on the layout of the templates: definitions at file scope start in the first column."""

    subject: Subject

    @cached_property
    def config(self) -> Config:
        """Configuration that the build was made with. Expected values come from here, not from the C."""
        return configuration.parse(self.subject.manifest["configuration"], "manifest.json: configuration")

    def path(self, unit: str) -> str:
        """Return the path of a unit such as "map"."""
        return f"src/{self.subject.prefix}_{unit}.c"

    def has(self, unit: str) -> bool:
        """Return whether the build has a unit."""
        return self.path(unit) in self.subject.files

    @property
    def units(self) -> list[str]:
        """Names of the units, without prefix."""
        sources = (path for path in self.subject.sources("src") if path.endswith(".c"))
        return sorted(path.removeprefix(self.path("")[:-2]).removesuffix(".c") for path in sources)

    @cached_property
    def _definitions(self) -> dict[str, list[str]]:
        """Definitions at file scope by path, without comments."""
        texts = {path: _COMMENT.sub("", content.decode("ascii")) for path, content in self.subject.sources().items()}
        return {path: _DEFINITION.findall(text) for path, text in texts.items()}

    def functions(self, unit: str) -> dict[str, dict[str, str]]:
        """Return the functions that a unit defines: name to parameters, each name to type; "*" for pointers and arrays."""
        found = (_FUNCTION.match(text) for text in self._definitions[self.path(unit)])
        return {match[1]: dict(map(_parameter, match[2].split(","))) for match in found if match}

    def call(self, unit: str, function: str, arguments: Mapping[str, object]) -> str:
        """Return a call in C, with the arguments in the order of the function's parameters; others are left out.

        Raises:
            Absent: there is no such function, or it has a parameter that is not among the arguments.
        """
        known = self.functions(unit).get(function)
        if known is None:
            raise Absent(f"{function}() is not there", where=self.path(unit))
        given = {"void": "", **arguments}
        if missing := [name for name in known if name not in given]:
            raise Absent(f"{function}() takes {missing[0]!r}, which its claim does not know", where=self.path(unit))
        return f"{function}({', '.join(str(given[name]) for name in known)})"

    @cached_property
    def _by_name(self) -> dict[str, list[tuple[str, str]]]:
        """Path and text of all definitions by the name that they define."""
        named: dict[str, list[tuple[str, str]]] = {}
        for path, texts in self._definitions.items():
            for text in texts:
                for name in _names(text):
                    named.setdefault(name, []).append((path, text))
        return named

    def dependence(self, unit: str, text: str) -> list[str]:
        """Return all definitions that a text in C, compiled with a unit, depends on. Equal lists mean equal C."""
        found: set[tuple[str, str]] = set()
        waiting = {(self.path(unit), text)}
        while waiting:
            path, content = waiting.pop()
            named = (each for word in set(_WORD.findall(content)) for each in self._by_name.get(word, ()))
            # A name that is local to another source is another name.
            new = {(where, each) for where, each in named if where == path or where.endswith(".h") or not _LOCAL.match(each)}
            waiting |= new - found
            found |= new
        return sorted({each for _, each in found})


def takes_number(parameters: Mapping[str, str]) -> bool:
    """Return whether a function needs a claim: it takes a real number, or whole numbers only."""
    types = [kind for kind in parameters.values() if kind != "void"]
    return any(kind in _REAL for kind in types) or (bool(types) and all(_WHOLE.match(kind) for kind in types))


def _parameter(text: str) -> tuple[str, str]:
    plain = _PLAIN.fullmatch(text.strip())
    name = _WORD.findall(text.partition("[")[0])[-1]
    return (name, plain[1]) if plain else (name, "void" if name == "void" else "*")


def _names(text: str) -> Iterable[str]:
    if "enum" in text.partition("{")[0]:
        return {*_WORD.findall(text)} - {"typedef", "enum"}
    head = _NAME.match(text)
    return {*(head.groups("") if head else ()), *_NAME_AFTER.findall(text)} - {"", "struct", "union"}
