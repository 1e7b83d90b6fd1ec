"""The controller's parameters as variables, read from the build: its struct, and the comments and checks in its C.

No parameter is named here, so builds with other parameters or edited comments work as well.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from codegen.emit.text import unit_of_comment
from codegen.export.fmu.variables import Variable
from codegen.sil.software import Software

GROUP = "parameters"

_STRUCT = re.compile(r"typedef struct \{(?P<body>[^{}]*)\} (?P<name>\w+);")
_FIELD = re.compile(r"^ *\w+ (?P<name>\w+)(?:\[[^;]*\])?; */\* (?P<comment>.*?) \*/$", re.MULTILINE)
_CHECK = re.compile(r"\(const (?P<struct>\w+) \*parameters\)\n\{(?P<body>.*?)\n\}", re.DOTALL)
_RANGE = re.compile(r"is_between\(parameters->(?P<name>\w+)(?:\[\w+\])*, (?P<low>[-+.\de]+)f?, (?P<high>[-+.\de]+)f?\)")
_COUNTS = 65535.0

Key = tuple[str, str]
"""Names of a struct and of one of its fields."""


@dataclass(frozen=True)
class Status:
    """One value of the status enumeration."""

    name: str
    value: int
    description: str


def status_values(files: Mapping[str, bytes], prefix: str) -> tuple[Status, ...]:
    """Return the values of `<prefix>_status_t` from the header."""
    header = files[f"include/{prefix}_controller.h"].decode("ascii", "replace")
    pattern = rf"\b{prefix.upper()}_STATUS_(\w+) = (\d+),? */\* (.*?) \*/"
    return tuple(Status(name, int(value), comment) for name, value, comment in re.findall(pattern, header))


def parameter_variables(software: Software, files: Mapping[str, bytes]) -> tuple[Variable, ...]:
    """Return every number of `<prefix>_parameters_t`, array elements one by one (from 1), with the build's value as start.

    A field whose type no variable can have, such as a pointer, keeps the value of the build.
    """
    texts = {path: content.decode("ascii", "replace") for path, content in files.items()}
    walk = _Walk(_comments(texts), _ranges(texts))
    struct = software.ffi.typeof(f"{software.prefix}_parameters_t")
    return tuple(walk.struct(struct, software.function("parameters_default"), GROUP, GROUP))


def _comments(texts: Mapping[str, str]) -> dict[Key, str]:
    return {
        (struct["name"], field["name"]): field["comment"]
        for path, text in texts.items()
        if path.endswith(".h")
        for struct in _STRUCT.finditer(text)
        for field in _FIELD.finditer(struct["body"])
    }


def _ranges(texts: Mapping[str, str]) -> dict[Key, tuple[float, float]]:
    return {
        (check["struct"], found["name"]): (float(found["low"]), float(found["high"]))
        for path, text in texts.items()
        if path.endswith(".c")
        for check in _CHECK.finditer(text)
        for found in _RANGE.finditer(check["body"])
    }


@dataclass(frozen=True)
class _Walk:
    """Traversal of the struct's fields, as cffi describes them."""

    comments: Mapping[Key, str]
    ranges: Mapping[Key, tuple[float, float]]

    def struct(self, struct: Any, value: Any, name: str, member: str) -> Iterator[Variable]:
        for field_name, field in struct.fields:
            key = (struct.cname, field_name)
            yield from self._field(
                key, field.type, getattr(value, field_name), f"{name}.{field_name}", f"{member}.{field_name}"
            )

    def _field(self, key: Key, kind: Any, value: Any, name: str, member: str) -> Iterator[Variable]:
        if kind.kind == "struct":
            yield from self.struct(kind, value, name, member)
        elif kind.kind == "array":
            for index, path in _indices(kind):
                element = value
                for k in index:
                    element = element[k]
                place = "".join(f"[{k}]" for k in index)
                number = ",".join(str(k + 1) for k in index)
                yield from self._number(key, path, element, f"{name}[{number}]", member + place)
        else:
            yield from self._number(key, kind, value, name, member)

    def _number(self, key: Key, kind: Any, value: Any, name: str, member: str) -> Iterator[Variable]:
        comment = self.comments.get(key, "")
        low, high = self.ranges.get(key, (None, None))
        if kind.cname in ("float", "double"):
            real = np.float32 if kind.cname == "float" else np.float64
            start = float(str(real(value)))  # the shortest decimal that is equal in the build's precision
            unit = unit_of_comment(comment).symbol.replace("^", "")  # as FMI writes exponents
            yield Variable(name, member, "real", "tunable", comment, kind.cname, unit, start, low, high)
        elif kind.cname == "uint16_t":
            low, high = (0.0, _COUNTS) if low is None else (low, high)
            yield Variable(name, member, "integer", "tunable", comment, kind.cname, "", float(value), low, high)


def _indices(kind: Any) -> Iterator[tuple[tuple[int, ...], Any]]:
    """Yield every index of an array of any dimension, in order, with the type of its elements."""
    shape = []
    while kind.kind == "array":
        shape.append(kind.length)
        kind = kind.item
    for index in np.ndindex(*shape):
        yield tuple(index), kind
