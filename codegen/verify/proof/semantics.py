"""What each operation of a term computes, for values that are known.

A value is a truth value, a whole number of w bits without a sign, or a float.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from codegen.verify.proof.floats import FORMATS

Value = bool | int | float

Operation = Callable[[int, object, Sequence[int], Sequence[Value]], Value]
"""Of sort, data, the operands' sorts and values."""


def compute(op: str, sort: int, data: object, sorts: Sequence[int], values: Sequence[Value]) -> Value:
    """The value of an operation. What C leaves undefined is some value: that it does not happen is shown elsewhere."""
    return OPERATIONS[op](sort, data, sorts, values)


def signed(value: Value, width: int) -> int:
    """Bits as a number with a sign."""
    whole = int(value)
    return whole - (1 << width) if whole >> (width - 1) else whole


def truncated(value: float, width: int, is_signed: bool) -> int | None:
    """Toward zero, None for what has no such number."""
    if math.isnan(value) or math.isinf(value):
        return None
    whole = int(value)
    low, high = (-(1 << (width - 1)), (1 << (width - 1)) - 1) if is_signed else (0, (1 << width) - 1)
    return whole if low <= whole <= high else None


def _whole(function: Callable[[int, int, int], int]) -> Operation:
    """Of two whole numbers without a sign, and their width."""
    return lambda sort, _data, _sorts, values: function(int(values[0]), int(values[1]), sort) & ((1 << sort) - 1)


def _divided(sort: int, data: object, _sorts: Sequence[int], values: Sequence[Value]) -> int:
    """Quotient or remainder, toward zero; data: ("quotient" or "remainder", whether with a sign)."""
    assert isinstance(data, tuple)
    what, is_signed = data
    a, b = (signed(each, sort) if is_signed else int(each) for each in values)
    if b == 0:
        return 0
    quotient = abs(a) // abs(b) * (1 if (a < 0) == (b < 0) else -1)
    return (quotient if what == "quotient" else a - quotient * b) & ((1 << sort) - 1)


def _shifted_right(sort: int, data: object, _sorts: Sequence[int], values: Sequence[Value]) -> int:
    """data: whether the sign is kept."""
    value = signed(values[0], sort) if data else int(values[0])
    return (value >> min(int(values[1]), sort)) & ((1 << sort) - 1)


def _of_real(sort: int, data: object, _sorts: Sequence[int], values: Sequence[Value]) -> int:
    """data: whether to a number with a sign."""
    return (truncated(float(values[0]), sort, bool(data)) or 0) & ((1 << sort) - 1)


def _of_whole(sort: int, data: object, sorts: Sequence[int], values: Sequence[Value]) -> float:
    """The nearest float; data: whether from a number with a sign."""
    value = signed(values[0], sorts[0]) if data else int(values[0])
    return FORMATS[-sort].round(float(value))  # up to 32 bits a double holds it


def _library(_sort: int, _data: object, _sorts: Sequence[int], _values: Sequence[Value]) -> float:
    return math.nan  # never asked for: what a library function gives is a variable


OPERATIONS: dict[str, Operation] = {
    "not": lambda _s, _d, _a, v: not v[0],
    "and": lambda _s, _d, _a, v: bool(v[0]) and bool(v[1]),
    "or": lambda _s, _d, _a, v: bool(v[0]) or bool(v[1]),
    "flt": lambda _s, _d, _a, v: v[0] < v[1],
    "fle": lambda _s, _d, _a, v: v[0] <= v[1],
    "feq": lambda _s, _d, _a, v: v[0] == v[1],
    "eq": lambda _s, _d, _a, v: v[0] == v[1],
    "ult": lambda _s, _d, _a, v: v[0] < v[1],
    "ule": lambda _s, _d, _a, v: v[0] <= v[1],
    "slt": lambda _s, _d, a, v: signed(v[0], a[0]) < signed(v[1], a[0]),
    "sle": lambda _s, _d, a, v: signed(v[0], a[0]) <= signed(v[1], a[0]),
    "fneg": lambda _s, _d, _a, v: -v[0],
    "fabs": lambda _s, _d, _a, v: math.fabs(v[0]),
    "fadd": lambda s, _d, _a, v: FORMATS[-s].add(v[0], v[1]),
    "fmul": lambda s, _d, _a, v: FORMATS[-s].mul(v[0], v[1]),
    "fdiv": lambda s, _d, _a, v: FORMATS[-s].div(v[0], v[1]),
    "fconvert": lambda s, _d, _a, v: FORMATS[-s].round(float(v[0])),
    "of_bits": lambda s, _d, _a, v: FORMATS[-s].of_bits(int(v[0])),
    "bits": lambda _s, _d, a, v: FORMATS[-a[0]].bits(float(v[0])),
    "of_whole": _of_whole,
    "of_real": _of_real,
    "add": _whole(lambda a, b, _w: a + b),
    "sub": _whole(lambda a, b, _w: a - b),
    "mul": _whole(lambda a, b, _w: a * b),
    "band": _whole(lambda a, b, _w: a & b),
    "bor": _whole(lambda a, b, _w: a | b),
    "bxor": _whole(lambda a, b, _w: a ^ b),
    "shl": _whole(lambda a, b, w: a << min(b, w)),
    "shr": _shifted_right,
    "div": _divided,
    "zext": lambda _s, _d, _a, v: int(v[0]),
    "sext": lambda s, _d, a, v: signed(v[0], a[0]) & ((1 << s) - 1),
    "trunc": lambda s, _d, _a, v: int(v[0]) & ((1 << s) - 1),
}
