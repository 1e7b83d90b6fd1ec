"""Types of C, as far as the generated code uses them. `int` has 32 bits; a pointer's size is never asked for."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from enum import StrEnum


class Family(StrEnum):
    """What a scalar is."""

    BOOL = "bool"
    INT = "int"
    FLOAT = "float"


@dataclass(frozen=True)
class Scalar:
    """A number. width: bits of its value; one for `_Bool`. enumerators: of an enum the smallest and the largest."""

    family: Family
    width: int
    signed: bool = False
    enumerators: tuple[int, int] | None = None

    @property
    def size(self) -> int:
        """In bytes."""
        return max(self.width // 8, 1)

    def __str__(self) -> str:
        return f"{'' if self.signed or self.family != Family.INT else 'unsigned '}{self.family} of {self.width} bits"


@dataclass(frozen=True)
class Void:
    """No value."""


@dataclass(frozen=True)
class Pointer:
    """To an object, or to an element of an array."""

    target: CType


@dataclass(frozen=True)
class Array:
    """length: None for a parameter that does not say."""

    element: CType
    length: int | None


@dataclass(frozen=True)
class Struct:
    """A struct or a union with its fields in order."""

    name: str
    fields: tuple[tuple[str, CType], ...]
    is_union: bool = False

    def field(self, name: str) -> CType | None:
        """Type of a field, None where there is none of that name."""
        return dict(self.fields).get(name)


CType = Scalar | Void | Pointer | Array | Struct

BOOL = Scalar(Family.BOOL, 1)
INT, UNSIGNED = Scalar(Family.INT, 32, True), Scalar(Family.INT, 32)
FLOAT, DOUBLE = Scalar(Family.FLOAT, 32, True), Scalar(Family.FLOAT, 64, True)
VOID = Void()

_INTS = {"char": 8, "short": 16, "int": 32, "long long": 64}


def scalar_named(words: tuple[str, ...]) -> Scalar | Void | None:
    """Of the words of a declaration such as ("unsigned", "short"); None for what is not known, as `long`: its width varies."""
    rest = [word for word in words if word not in ("signed", "unsigned")]
    name = " ".join(rest) or "int"
    if name in ("short int", "long long int"):
        name = name.removesuffix(" int")
    plain: dict[str, Scalar | Void] = {"void": VOID, "_Bool": BOOL, "float": FLOAT, "double": DOUBLE}
    if name in plain and len(rest) == len(words):
        return plain[name]
    return Scalar(Family.INT, _INTS[name], "unsigned" not in words) if name in _INTS else None


def promoted(scalar: Scalar) -> Scalar:
    """As an operand of arithmetic: what is narrower than `int` is one (C99 6.3.1.1)."""
    is_narrow = scalar.family != Family.FLOAT and scalar.width < INT.width
    return INT if is_narrow or scalar.enumerators is not None else scalar


def common(left: Scalar, right: Scalar) -> Scalar:
    """The type of arithmetic with both (C99 6.3.1.8)."""
    left, right = promoted(left), promoted(right)
    floats = [each for each in (left, right) if each.family == Family.FLOAT]
    if floats:
        return max(floats, key=lambda each: each.width)
    width = max(left.width, right.width)
    return Scalar(Family.INT, width, all(each.signed or each.width < width for each in (left, right)))


@functools.cache
def leaves(ctype: CType) -> tuple[tuple[tuple[str | int, ...], Scalar | Pointer], ...]:
    """The numbers and pointers inside a type, each with its path of fields and indices; a union is one number of its bits."""
    if isinstance(ctype, Struct):
        if ctype.is_union:
            return (((), union_bits(ctype)),)
        return tuple(((name, *path), leaf) for name, each in ctype.fields for path, leaf in leaves(each))
    if isinstance(ctype, Array):
        inner = leaves(ctype.element)
        return tuple(((index, *path), leaf) for index in range(ctype.length or 0) for path, leaf in inner)
    return () if isinstance(ctype, Void) else (((), ctype),)


def union_bits(union: Struct) -> Scalar:
    """What a union of numbers of one width is stored as. Raises TypeError: it holds something else."""
    widths = {member.width if _is_plain(member) and isinstance(member, Scalar) else 0 for _, member in union.fields}
    if len(widths) != 1 or 0 in widths:
        raise TypeError(f"union {union.name} of other than numbers of one width")
    return Scalar(Family.INT, widths.pop())


def _is_plain(member: CType) -> bool:
    return isinstance(member, Scalar) and member.family != Family.BOOL and member.enumerators is None


def size_of(ctype: CType) -> int:
    """In bytes, for numbers and arrays of them. Raises TypeError: a size that depends on the compiler."""
    if isinstance(ctype, Scalar) and ctype.enumerators is None:
        return ctype.size
    if isinstance(ctype, Array) and ctype.length is not None:
        return ctype.length * size_of(ctype.element)
    if isinstance(ctype, Struct) and ctype.is_union:
        return union_bits(ctype).size
    raise TypeError("the size of what has padding, is an enum or a pointer")
