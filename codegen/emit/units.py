"""Units in the comments of the generated C."""

from __future__ import annotations

import re
from dataclasses import dataclass


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
