"""Units: the one table from which C comments, A2L, ARXML, FMUs and the names of columns take them; and gravity."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

KM_H = 1.0 / 3.6
"""m/s per km/h."""
DEGREE = math.radians(1.0)
"""rad per degree."""
GRAVITY = 9.81
"""m/s^2; the default of `road.gravity_m_s2`."""
STANDARD_GRAVITY = 9.80665
"""m/s^2 per g, by definition."""

ASAP2_BASE = ("m", "kg", "s", "A", "K", "mol", "cd")
"""Base units in the order of SI_EXPONENTS in an A2L."""


@dataclass(frozen=True)
class Unit:
    """An SI unit. As text it is its symbol.

    Attributes:
        symbol: such as "m/s^2"; "" for a ratio.
        identifier: the unit in a name, such as "m_s2"; names of columns end with it.
        exponents: base unit, or "rad" -> its exponent.
        shown: unit that people read instead, and its number per unit; None: this one.
    """

    symbol: str
    identifier: str
    exponents: Mapping[str, int] = field(default_factory=dict, hash=False)
    shown: tuple[str, float] | None = None

    def __str__(self) -> str:
        return self.symbol

    def __bool__(self) -> bool:
        return bool(self.symbol)

    @property
    def suffix(self) -> str:
        """Ending of the name of a column."""
        return f"_{self.identifier}" if self else ""

    @property
    def fmi_name(self) -> str:
        """Symbol in an FMU, which writes exponents without a sign."""
        return self.symbol.replace("^", "").replace(" ", ".")

    def as_shown(self, value: float) -> str:
        """Return a value with four digits in the unit that people read."""
        name, factor = self.shown or (self.symbol, 1.0)
        return f"{value * factor:.4g} {name}"

    @property
    def base_exponents(self) -> tuple[int, ...]:
        """Exponents of ASAP2_BASE; an angle counts as a ratio."""
        return tuple(self.exponents.get(base, 0) for base in ASAP2_BASE)


NONE = Unit("", "no_unit")
M_S3 = Unit("m/s^3", "m_s3", {"m": 1, "s": -3})
M_S2 = Unit("m/s^2", "m_s2", {"m": 1, "s": -2})
RAD_S = Unit("rad/s", "rad_s", {"rad": 1, "s": -1}, ("deg/s", math.degrees(1.0)))
M_S = Unit("m/s", "m_s", {"m": 1, "s": -1}, ("km/h", 3.6))
PER_S = Unit("1/s", "per_s", {"s": -1})
RAD = Unit("rad", "rad", {"rad": 1}, ("deg", math.degrees(1.0)))
M = Unit("m", "m", {"m": 1})
S = Unit("s", "s", {"s": 1})
RAD_M = Unit("rad/m", "rad_m", {"rad": 1, "m": -1})
S2_M = Unit("s^2/m", "s2_m", {"s": 2, "m": -1})
RAD_S2_M = Unit("rad s^2/m", "rad_s2_m", {"rad": 1, "s": 2, "m": -1})
NEWTON_METRE = Unit("N m", "n_m", {"kg": 1, "m": 2, "s": -2})
UNITS = (M_S3, M_S2, RAD_S, M_S, PER_S, RAD, M, S, RAD_M, S2_M, RAD_S2_M, NEWTON_METRE, NONE)
"""All units, in the order of the files."""

_BY_SYMBOL = {unit.symbol: unit for unit in UNITS}


def unit_of(symbol: str) -> Unit:
    """Return the unit with a symbol. Raises KeyError if there is none."""
    return _BY_SYMBOL[symbol]


def unit_of_name(name: str) -> Unit:
    """Return the unit at the end of a name, such as that of speed_m_s; `NONE` if there is none.

    >>> unit_of_name("lateral_acceleration_m_s2").symbol
    'm/s^2'
    """
    found = (unit for unit in UNITS if unit and name.endswith(unit.suffix))
    return max(found, key=lambda unit: len(unit.suffix), default=NONE)


def in_order(units: Iterable[Unit]) -> tuple[Unit, ...]:
    """Return the units in the order of the table, each once."""
    found = set(units)
    return tuple(unit for unit in UNITS if unit in found)
