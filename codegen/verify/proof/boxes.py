"""Between which values a term lies: boxes of truth values, of whole numbers, of floats, and how operations carry them on.

Rounding to nearest is monotone: the bounds of a sum, a product or a quotient are the rounded ones of the operands' bounds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from codegen.verify.proof.floats import Format
from codegen.verify.proof.semantics import Value, signed, truncated

INF = math.inf


class Truth(NamedTuple):
    """Which of the two a truth value may be."""

    may_hold: bool
    may_fail: bool

    @property
    def is_empty(self) -> bool:
        return not (self.may_hold or self.may_fail)


class Whole(NamedTuple):
    """Bits, read without a sign and with one. Both bounds hold."""

    low: int
    high: int
    signed_low: int
    signed_high: int

    @property
    def is_empty(self) -> bool:
        return self.low > self.high or self.signed_low > self.signed_high


class Real(NamedTuple):
    """A float: NaN where that may be, or between the bounds, which it may reach."""

    low: float
    high: float
    may_be_nan: bool

    @property
    def is_empty(self) -> bool:
        return self.low > self.high and not self.may_be_nan

    @property
    def is_finite(self) -> bool:
        """Neither NaN nor infinite, and there are such numbers."""
        return not self.may_be_nan and -INF < self.low <= self.high < INF

    @property
    def largest(self) -> float:
        """Of the magnitudes."""
        return max(abs(self.low), abs(self.high))


Box = Truth | Whole | Real

TRUE, FALSE, EITHER = Truth(True, False), Truth(False, True), Truth(True, True)
ANY_REAL = Real(-INF, INF, True)
NO_REAL = Real(INF, -INF, False)


def any_of(sort: int) -> Box:
    """Every value of a sort."""
    if sort == 0:
        return EITHER
    return ANY_REAL if sort < 0 else Whole(0, (1 << sort) - 1, -(1 << (sort - 1)), (1 << (sort - 1)) - 1)


def single(value: Value, sort: int) -> Box:
    """One value."""
    if sort == 0:
        return TRUE if value else FALSE
    if sort > 0:
        return Whole(int(value), int(value), signed(value, sort), signed(value, sort))
    return Real(INF, -INF, True) if math.isnan(value) else Real(float(value), float(value), False)


def unsigned(low: int, high: int, width: int) -> Whole:
    """Numbers without a sign, of so many bits."""
    return tightened(Whole(low, high, -(1 << (width - 1)), (1 << (width - 1)) - 1), width)


def with_sign(low: int, high: int, width: int) -> Whole:
    """Numbers with a sign, of so many bits."""
    return tightened(Whole(0, (1 << width) - 1, low, high), width)


def tightened(box: Whole, width: int) -> Whole:
    """What each reading of the bits says of the other."""
    half, span = 1 << (width - 1), 1 << width
    low, high, signed_low, signed_high = box
    if high < half or low >= half:  # all of one sign
        shift = 0 if high < half else span
        signed_low, signed_high = max(signed_low, low - shift), min(signed_high, high - shift)
    if signed_low >= 0 or signed_high < 0:
        shift = 0 if signed_low >= 0 else span
        low, high = max(low, signed_low + shift), min(high, signed_high + shift)
    return Whole(low, high, signed_low, signed_high)


def meet(a: Box, b: Box, sort: int) -> Box:
    """What lies in both."""
    if isinstance(a, Real) and isinstance(b, Real):
        return Real(max(a.low, b.low), min(a.high, b.high), a.may_be_nan and b.may_be_nan)
    if isinstance(a, Whole) and isinstance(b, Whole):
        low, high = max(a.low, b.low), min(a.high, b.high)
        return tightened(Whole(low, high, max(a.signed_low, b.signed_low), min(a.signed_high, b.signed_high)), sort)
    assert isinstance(a, Truth)
    assert isinstance(b, Truth)
    return Truth(a.may_hold and b.may_hold, a.may_fail and b.may_fail)


def hull(a: Box, b: Box) -> Box:
    """The smallest box around both."""
    if isinstance(a, Real) and isinstance(b, Real):
        return Real(min(a.low, b.low), max(a.high, b.high), a.may_be_nan or b.may_be_nan)
    if isinstance(a, Whole) and isinstance(b, Whole):
        signs = min(a.signed_low, b.signed_low), max(a.signed_high, b.signed_high)
        return Whole(min(a.low, b.low), max(a.high, b.high), *signs)
    assert isinstance(a, Truth)
    assert isinstance(b, Truth)
    return Truth(a.may_hold or b.may_hold, a.may_fail or b.may_fail)


def negated(a: Real) -> Real:
    return Real(-a.high, -a.low, a.may_be_nan)


def magnitude(a: Real) -> Real:
    if a.low > a.high:
        return a
    low = 0.0 if a.low <= 0.0 <= a.high else min(abs(a.low), abs(a.high))
    return Real(low, a.largest, a.may_be_nan)


def added(a: Real, b: Real, form: Format) -> Real:
    if a.low > a.high or b.low > b.high:
        return Real(INF, -INF, True)
    opposite = (a.high == INF and b.low == -INF) or (a.low == -INF and b.high == INF)
    low = -INF if -INF in (a.low, b.low) else form.add(a.low, b.low)
    high = INF if INF in (a.high, b.high) else form.add(a.high, b.high)
    return Real(low, high, a.may_be_nan or b.may_be_nan or opposite)


def multiplied(a: Real, b: Real, form: Format) -> Real:
    if a.low > a.high or b.low > b.high:
        return Real(INF, -INF, True)
    # Zero times infinity is NaN, beside which the products on either side go through zero.
    undefined = (_has_zero(a) and b.largest == INF) or (_has_zero(b) and a.largest == INF)
    corners = [0.0 if 0.0 in (x, y) else form.mul(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    return Real(min(corners), max(corners), a.may_be_nan or b.may_be_nan or undefined)


def divided(a: Real, b: Real, form: Format) -> Real:
    if a.low > a.high or b.low > b.high:
        return Real(INF, -INF, True)
    undefined = (_has_zero(a) and _has_zero(b)) or (a.largest == INF and b.largest == INF)
    may_be_nan = a.may_be_nan or b.may_be_nan or undefined
    if _has_zero(b):
        return Real(-INF, INF, may_be_nan)
    corners = [form.div(x, y) for x in (a.low, a.high) for y in (b.low, b.high)]
    defined = [each for each in corners if not math.isnan(each)]  # the others: infinity over infinity, between 0 and infinity
    if len(defined) < len(corners):
        return Real(-INF, INF, True)
    return Real(min(defined), max(defined), may_be_nan)


def of_whole(a: Whole, is_signed: bool, form: Format) -> Real:
    low, high = (a.signed_low, a.signed_high) if is_signed else (a.low, a.high)
    return Real(form.round(float(low)), form.round(float(high)), False)


def of_real(a: Real, width: int, is_signed: bool) -> Whole | None:
    """None where some conversion is not defined."""
    if a.may_be_nan or a.low > a.high:
        return None
    low, high = truncated(a.low, width, is_signed), truncated(a.high, width, is_signed)
    if low is None or high is None:
        return None
    return with_sign(low, high, width) if is_signed else unsigned(low, high, width)


def compared(op: str, a: Real, b: Real) -> Truth:
    """Of "flt", "fle" and "feq"; false for NaN."""
    if a.low > a.high or b.low > b.high:
        return FALSE
    may_be_nan = a.may_be_nan or b.may_be_nan
    if op == "feq":
        same = a.low == a.high == b.low == b.high
        return Truth(max(a.low, b.low) <= min(a.high, b.high), may_be_nan or not same)
    if op == "flt":
        return Truth(a.low < b.high, may_be_nan or a.high >= b.low)
    return Truth(a.low <= b.high, may_be_nan or a.high > b.low)


def compared_whole(op: str, a: Whole, b: Whole) -> Truth:
    """Of "eq", "ult", "ule", "slt" and "sle"."""
    if op == "eq":
        may_hold = max(a.low, b.low) <= min(a.high, b.high) and max(a.signed_low, b.signed_low) <= min(
            a.signed_high, b.signed_high
        )
        return Truth(may_hold, not (a.low == a.high == b.low == b.high))
    if op in ("ult", "ule"):
        a_low, a_high, b_low, b_high = a.low, a.high, b.low, b.high
    else:
        a_low, a_high, b_low, b_high = a.signed_low, a.signed_high, b.signed_low, b.signed_high
    if op in ("ult", "slt"):
        return Truth(a_low < b_high, a_high >= b_low)
    return Truth(a_low <= b_high, a_high > b_low)


def _has_zero(a: Real) -> bool:
    return a.low <= 0.0 <= a.high
