"""IEEE 754 numbers of one width: rounding, neighbours, and the whole number that orders them.

Python's floats compute in double precision. Of sums, products and quotients of singles that is enough: rounded again to single
they are what single precision gives (S. A. Figueroa, When is double rounding innocuous?, 1995).
"""

from __future__ import annotations

import ctypes
import math
import struct
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

SINGLE_BITS, DOUBLE_BITS = 32, 64


@dataclass(frozen=True)
class Format:
    """Of 32 or 64 bits."""

    width: int

    @cached_property
    def largest(self) -> float:
        """The largest finite number."""
        return self.from_key(self.key(math.inf) - 1)

    @cached_property
    def tiniest(self) -> float:
        """The smallest number above zero."""
        return self.from_key(1)

    @property
    def unit_roundoff(self) -> float:
        """Half the distance of 1 to the next number."""
        return 2.0**-24 if self.width == SINGLE_BITS else 2.0**-53

    @property
    def whole_below(self) -> int:
        """Every whole number up to here is a number of the format."""
        return 1 << (24 if self.width == SINGLE_BITS else 53)

    def round(self, value: float) -> float:
        """The nearest number, the even one of two."""
        return ctypes.c_float(value).value if self.width == SINGLE_BITS else value

    def nearest(self, exact: Fraction) -> float:
        """The nearest number to one that is exact, the even one of two; not by way of a double."""
        near = self.round(float(exact))
        beside = [each for each in (self.down(near), near, self.up(near)) if not math.isinf(each)]
        return min(beside, key=lambda each: (abs(Fraction(each) - exact), self.bits(each) & 1)) if beside else near

    def key(self, value: float) -> int:
        """The whole number that orders the numbers as they are ordered; 0 for both zeros. Not for NaN."""
        bits = self.bits(value)
        magnitude = bits & ((1 << (self.width - 1)) - 1)
        return -magnitude if bits >> (self.width - 1) else magnitude

    def from_key(self, key: int) -> float:
        """The number of a key between those of the infinities."""
        value = self.of_bits(abs(key))
        return -value if key < 0 else value

    def bits(self, value: float) -> int:
        """As it is stored."""
        if self.width == SINGLE_BITS:
            return int(struct.unpack("<I", bytes(ctypes.c_float(value)))[0])
        return int(struct.unpack("<Q", struct.pack("<d", value))[0])

    def of_bits(self, bits: int) -> float:
        """The number that is stored so."""
        if self.width == SINGLE_BITS:
            return float(struct.unpack("<f", struct.pack("<I", bits))[0])
        return float(struct.unpack("<d", struct.pack("<Q", bits))[0])

    def up(self, value: float) -> float:
        """The next larger number; infinity has none."""
        return value if value == math.inf else self.from_key(self.key(value) + 1)

    def down(self, value: float) -> float:
        """The next smaller number."""
        return value if value == -math.inf else self.from_key(self.key(value) - 1)

    def at_least(self, value: float) -> float:
        """The smallest number that is not below a double."""
        rounded = self.round(value)
        return rounded if rounded >= value else self.up(rounded)

    def at_most(self, value: float) -> float:
        """The largest number that is not above a double."""
        rounded = self.round(value)
        return rounded if rounded <= value else self.down(rounded)

    def add(self, a: float, b: float) -> float:
        return self.round(a + b)

    def mul(self, a: float, b: float) -> float:
        return self.round(a * b)

    def div(self, a: float, b: float) -> float:
        """As the hardware does: no exception."""
        if b != 0.0 or math.isnan(a) or math.isnan(b):
            return self.round(a / b) if b != 0.0 else math.nan
        return math.nan if a == 0.0 else math.copysign(math.inf, a) * math.copysign(1.0, b)


FORMATS = {width: Format(width) for width in (SINGLE_BITS, DOUBLE_BITS)}
