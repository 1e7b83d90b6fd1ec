"""Numbers, words and units as C text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from codegen.errors import BuildError

Precision = Literal["single", "double"]

_PREFIX = re.compile(r"[a-z][a-z0-9_]{0,30}\Z", re.ASCII)
_KEYWORDS = """
auto bool break case char class const continue default delete do double else enum extern float for goto if inline int long
namespace new private public register restrict return short signed sizeof static struct switch template this typedef union
unsigned virtual void volatile while
"""
KEYWORDS = frozenset(_KEYWORDS.split())
"""Keywords of C and C++."""
# With the target names that CMake reserves: the name of the library is the prefix.
_RESERVED = KEYWORDS | {"all", "clean", "help", "install", "package", "test"}


def c_type(precision: Precision) -> str:
    """Return the C type of a real number."""
    return "float" if precision == "single" else "double"


def numpy_type(precision: Precision) -> type[np.float32] | type[np.float64]:
    """Return the NumPy type of a real number."""
    return np.float32 if precision == "single" else np.float64


def literal(value: float, precision: Precision) -> str:
    """Return `value`, rounded to the precision, as the shortest C literal that reads back to the same bits.

    Raises:
        ValueError: the value is not finite in that precision.
    """
    number: float | np.floating = value
    kind = numpy_type(precision)
    if not isinstance(value, kind):  # the tables are in the precision already
        with np.errstate(over="ignore"):
            number = kind(value)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} has no finite {precision}-precision literal")
    digits = str(number)
    if "e" in digits and "." not in digits:
        digits = digits.replace("e", ".0e")
    return digits + ("f" if precision == "single" else "")


NUMBERS_PER_LINE = 8
LINE_WIDTH = 112
"""Largest number of characters in a line of numbers, without its indent."""


def lines_of(numbers: Sequence[str], last_comma: bool = False) -> tuple[str, ...]:
    """Return lines of literals, several to a line and separated by commas."""
    width = max(len(number) for number in numbers) + 2
    each = min(NUMBERS_PER_LINE, max(1, LINE_WIDTH // width))
    chunks = [numbers[k : k + each] for k in range(0, len(numbers), each)]
    lines = [", ".join(chunk) + "," for chunk in chunks]
    if not last_comma:
        lines[-1] = lines[-1].rstrip(",")
    return tuple(lines)


def comment_text(text: str) -> str:
    """Return `text` made safe for a C comment or string: printable ASCII on one line, without the end of a comment."""
    safe = "".join(character if " " <= character <= "~" else "?" for character in text)
    safe = safe.replace("\\", "/").replace('"', "'")
    for dangerous, harmless in (("*/", "* /"), ("/*", "/ *"), ("??", "? ?")):
        while dangerous in safe:  # the result of a replacement may be dangerous again
            safe = safe.replace(dangerous, harmless)
    return safe


def check_prefix(prefix: str) -> str:
    """Return `prefix` if C names may start with it. Raises BuildError otherwise."""
    if prefix in _RESERVED:
        raise BuildError(f"{prefix!r} is a reserved word", where="`prefix=`", remedy="use another one, such as ars")
    if not _PREFIX.match(prefix) or prefix.endswith("_") or "__" in prefix:
        raise BuildError(
            f"{prefix!r} cannot start C names",
            where="`prefix=`",
            remedy="use a lower-case letter, then letters, digits and single underscores, at most 31, such as ars",
        )
    return prefix


@dataclass(frozen=True)
class Unit:
    """A derived SI unit.

    Attributes:
        conversion: name of the unit as part of an identifier.
        exponents: exponents of m, kg, s, A, K, mol, cd, in the order of ASAP2's SI_EXPONENTS.
    """

    symbol: str
    conversion: str
    exponents: tuple[int, ...]


NONE = Unit("", "no_unit", (0,) * 7)
UNITS = (
    Unit("m/s^3", "m_s3", (1, 0, -3, 0, 0, 0, 0)),
    Unit("m/s^2", "m_s2", (1, 0, -2, 0, 0, 0, 0)),
    Unit("rad/s", "rad_s", (0, 0, -1, 0, 0, 0, 0)),
    Unit("m/s", "m_s", (1, 0, -1, 0, 0, 0, 0)),
    Unit("1/s", "per_s", (0, 0, -1, 0, 0, 0, 0)),
    Unit("rad", "rad", (0, 0, 0, 0, 0, 0, 0)),
    Unit("m", "m", (1, 0, 0, 0, 0, 0, 0)),
    Unit("s", "s", (0, 0, 1, 0, 0, 0, 0)),
    NONE,
)

_IN_COMMENT = re.compile(
    rf"(?P<symbol>{'|'.join(re.escape(unit.symbol) for unit in UNITS if unit.symbol)})(?P<after>[,:]|$| )(?P<rest>.*)"
)


def unit_of_comment(comment: str) -> Unit:
    """Return the unit at the start of a field's comment; `NONE` for a ratio, such as "rad for each rad"."""
    found = _IN_COMMENT.match(comment)
    if found is None or (found["after"] == " " and "for each" in found["rest"]):
        return NONE
    return next(unit for unit in UNITS if unit.symbol == found["symbol"])
