"""Units of the variables: exponents of SI base units, and display units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

DEGREES = math.degrees(1.0)


@dataclass(frozen=True)
class Unit:
    """A unit of FMI.

    Attributes:
        exponents: exponents of SI base units and rad.
        shown: display unit and its number per unit; None: no other display unit.
    """

    exponents: Mapping[str, int]
    shown: tuple[str, float] | None = None


UNITS: Mapping[str, Unit] = {
    "m": Unit({"m": 1}),
    "m/s": Unit({"m": 1, "s": -1}, ("km/h", 3.6)),
    "m/s2": Unit({"m": 1, "s": -2}),
    "m/s3": Unit({"m": 1, "s": -3}),
    "rad": Unit({"rad": 1}, ("deg", DEGREES)),
    "rad/s": Unit({"rad": 1, "s": -1}, ("deg/s", DEGREES)),
    "s": Unit({"s": 1}),
    "1/s": Unit({"s": -1}),
    "N.m": Unit({"kg": 1, "m": 2, "s": -2}),
}

_ENDINGS = {"_m_s2": "m/s2", "_rad_s": "rad/s", "_m_s": "m/s", "_n_m": "N.m", "_rad": "rad", "_s": "s"}


def unit_of_name(name: str) -> str:
    """Return the unit in the suffix of a name, such as "m/s" for speed_m_s; "" if there is none."""
    return next((unit for ending, unit in _ENDINGS.items() if name.endswith(ending)), "")
