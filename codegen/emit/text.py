"""Numbers and words as C text."""

from __future__ import annotations

import math
import re
from typing import Literal

import numpy as np

from codegen.errors import BuildError

Precision = Literal["single", "double"]

_PREFIX = re.compile(r"[a-z][a-z0-9_]{0,30}\Z", re.ASCII)
# Words that a C or C++ compiler takes: a prefix stands before an underscore, so only the prefix itself can collide.
_RESERVED = frozenset({"int", "float", "double", "void", "static", "const", "struct", "enum", "union", "volatile"})


def c_type(precision: Precision) -> str:
    """The C type of a real number."""
    return "float" if precision == "single" else "double"


def numpy_type(precision: Precision) -> type[np.float32] | type[np.float64]:
    """The NumPy type of a real number."""
    return np.float32 if precision == "single" else np.float64


def literal(value: float, precision: Precision) -> str:
    """`value` rounded to the precision, as the shortest C literal that reads back to the same bits.

    Raises:
        ValueError: the value is not finite in that precision.
    """
    with np.errstate(over="ignore"):
        number = numpy_type(precision)(value)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} has no finite {precision}-precision literal")
    digits = str(number)
    if "e" in digits and "." not in digits:
        digits = digits.replace("e", ".0e")
    return digits + ("f" if precision == "single" else "")


def comment_text(text: str) -> str:
    """`text` made safe for a C comment or string: printable ASCII on one line that cannot end a comment or continue a line."""
    safe = "".join(character if " " <= character <= "~" else "?" for character in text)
    return safe.replace("*/", "* /").replace("/*", "/ *").replace("\\", "/").replace('"', "'").replace("??", "?")


def check_prefix(prefix: str) -> str:
    """`prefix` if C names may start with it, else BuildError."""
    if prefix in _RESERVED:
        raise BuildError(f"{prefix!r} is a word of C", where="--prefix", remedy="use another one, such as ars")
    if not _PREFIX.match(prefix) or prefix.endswith("_"):
        raise BuildError(
            f"{prefix!r} cannot start C names",
            where="--prefix",
            remedy="use a lower-case letter, then letters, digits and single underscores, at most 31, such as ars",
        )
    return prefix
