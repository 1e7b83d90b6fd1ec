"""Numbers and words as C text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
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


def digits(value: float, precision: Precision) -> str:
    """Return `value`, rounded to the precision, as the shortest decimal number with the same bits; a count as it is.

    Raises:
        ValueError: the value is not finite in that precision.
    """
    if isinstance(value, int):
        return str(value)
    number: float | np.floating = value
    kind = numpy_type(precision)
    if not isinstance(value, kind):  # the tables are in the precision already
        with np.errstate(over="ignore"):
            number = kind(value)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} has no finite {precision}-precision literal")
    text = str(number)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


def shortest(value: float, precision: Precision) -> float:
    """Return the number of the fewest digits that has the same bits in the precision."""
    return float(digits(value, precision))


def literal(value: float, precision: Precision) -> str:
    """Return `value` as a C literal, see `digits`. An `int` is an unsigned count. Raises ValueError: it is not finite."""
    if isinstance(value, int):
        return f"{value}u"
    return digits(value, precision) + ("f" if precision == "single" else "")


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


def initialiser(values: Sequence[float], precision: Precision) -> str:
    """Return the values of an array in a struct as a C initialiser in braces."""
    lines = lines_of([literal(value, precision) for value in values])
    if len(lines) == 1:
        return f"{{ {lines[0]} }}"
    rows = "\n".join(f"        {line}" for line in lines)
    return f"{{\n{rows}\n    }}"


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
