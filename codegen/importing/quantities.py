"""Quantities of a map: their common names and units, and the units inside names.

`speed_km_h`, `v (km/h)` and `V [kph]` are one quantity in one unit. Where a name has no unit, the user must give it: a unit is
never assumed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from codegen.errors import suggestion
from codegen.importing.source import ImportFault
from codegen.units import KM_H

SPEED, ANGLE, RATE, LOGICAL = "speed", "angle", "rate", "logical"

FACTORS = {
    SPEED: {"m/s": 1.0, "km/h": KM_H, "mph": 0.44704},
    ANGLE: {"rad": 1.0, "deg": math.pi / 180.0},
    RATE: {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    LOGICAL: {"1": 1.0},
}
"""Kind of quantity -> unit -> its size in SI. 1 mph is 0.44704 m/s exactly (international mile of 1609.344 m)."""

SPELLINGS = {
    "m/s": ("m/s", "m_s", "mps", "m/sec", "ms^-1"),
    "km/h": ("km/h", "km_h", "kmh", "kph", "kmph", "km/hr"),
    "mph": ("mph", "mi/h"),
    "rad": ("rad", "radian", "radians"),
    "deg": ("deg", "°"),
    "rad/s": ("rad/s", "rad_s", "radps", "rad/sec"),
    "deg/s": ("deg/s", "deg_s", "degps", "dps", "deg/sec", "°/s"),
}
"""Unit -> its spellings, in small letters; `unit_of` makes "deg" of "degrees" first."""

UNIT_OF = {spelling: unit for unit, spellings in SPELLINGS.items() for spelling in spellings}
KIND_OF = {unit: kind for kind, factors in FACTORS.items() for unit in factors}


@dataclass(frozen=True)
class Quantity:
    """One array of the map: its key in the file, its kind, the option that names its variable, its common names."""

    key: str
    kind: str
    names: tuple[str, ...]
    required: bool = False

    @property
    def option(self) -> str:
        """Option that names the variable, such as --delta-f."""
        return "--" + self.key.replace("_", "-")


QUANTITIES = {
    quantity.key: quantity
    for quantity in (
        Quantity(
            "vx",
            SPEED,
            ("vx", "v", "speed", "velocity", "vehiclespeed", "longitudinalspeed", "longitudinalvelocity"),
            required=True,
        ),
        Quantity(
            "delta_f",
            ANGLE,
            (
                "deltaf",
                "df",
                "delta",
                "deltafront",
                "steer",
                "frontangle",
                "frontsteer",
                "frontsteeringangle",
                "roadwheelangle",
            ),
            required=True,
        ),
        Quantity(
            "yaw_rate",
            RATE,
            ("yawrate", "r", "psidot", "psip", "omegaz", "rref", "yawrateref", "yawratereference"),
            required=True,
        ),
        Quantity("beta", ANGLE, ("beta", "sideslip", "sideslipangle")),
        Quantity("delta_r", ANGLE, ("deltar", "dr", "deltarear", "rearangle", "rearsteer", "rearsteeringangle")),
        Quantity("feasible", LOGICAL, ("feasible", "valid")),
    )
}
BRACKETED = re.compile(r"\s*[\[({]\s*([^\])}]*?)\s*[\])}]\s*\Z")


@dataclass(frozen=True)
class Name:
    """Parts of a variable's or column's name.

    Attributes:
        text: the name in the file.
        base: letters and digits without unit and struct, in small letters: "Map.Delta_f [deg]" gives "deltaf".
        unit: a unit of FACTORS, None where the name has none.
        unknown_unit: text in brackets that is no known unit.
    """

    text: str
    base: str
    unit: str | None = None
    unknown_unit: str | None = None


def unit_of(text: str) -> str | None:
    """Return the unit of a spelling, or None."""
    flat = re.sub(r"\s+", "", text.lower()).replace("degrees", "deg").replace("degree", "deg").replace("·", "")
    return UNIT_OF.get(flat)


def take_apart(text: str) -> Name:
    """Split a name into base and unit. The unit is in brackets at the end, or is the name's last part (`_km_h`, ` in km/h`)."""
    stem, unit, unknown = text.strip(), None, None
    bracketed = BRACKETED.search(stem)
    if bracketed:
        stem, unit = stem[: bracketed.start()], unit_of(bracketed[1])
        unknown = bracketed[1] if unit is None else None
    else:
        stem, unit = _unit_at_end(stem)
    base = re.sub(r"[^a-z0-9]", "", stem.rpartition(".")[2].lower())
    return Name(text.strip(), base, unit, unknown)


def _unit_at_end(stem: str) -> tuple[str, str | None]:
    for spelling in sorted(UNIT_OF, key=len, reverse=True):
        match = re.search(rf"[_\s.,]{re.escape(spelling)}\Z", stem, re.IGNORECASE)
        if match and match.start() > 0:
            return re.sub(r"[_\s]in\Z", "", stem[: match.start()], flags=re.IGNORECASE), UNIT_OF[spelling]
    return stem, None


def quantity_named(name: Name) -> Quantity | None:
    """Return the quantity that a name denotes by itself."""
    return next((quantity for quantity in QUANTITIES.values() if name.base in quantity.names), None)


def choose(available: Iterable[str], wanted: Mapping[str, str], where: object, unread: str = "") -> dict[str, Name]:
    """Assign variables to quantities.

    Args:
        available: the names in the file.
        wanted: quantity key -> name given by the user; the others are found by common names.
        where: the place that an error names.
        unread: remedy for a missing quantity where the file holds unread data; "" where it does not.

    Returns:
        Quantity key -> name, with at least the three required ones.

    Raises:
        ImportFault: a required one is not found, or two names fit.
    """
    names = [take_apart(text) for text in available]
    chosen: dict[str, Name] = {}
    for key, text in wanted.items():
        chosen[key] = _by_name(text, names, QUANTITIES[key], where, unread)
    taken = {name.text for name in chosen.values()}
    for quantity in QUANTITIES.values():
        if quantity.key in chosen:
            continue
        fitting = [name for name in names if name.base in quantity.names and name.text not in taken]
        if len(fitting) > 1:
            both = " and ".join(repr(name.text) for name in fitting[:2])
            raise ImportFault(f"{both} may both be {quantity.key}", where=where, remedy=f"name one with {quantity.option} NAME")
        if fitting:
            chosen[quantity.key] = fitting[0]
        elif quantity.required:
            has = ", ".join(name.text for name in names) or "nothing that is numeric"
            raise ImportFault(
                f"no variable is called {quantity.key} or the like",
                where=where,
                remedy=unread or f"name it with {quantity.option} NAME; there is {has}",
            )
    return chosen


def _by_name(text: str, names: list[Name], quantity: Quantity, where: object, unread: str) -> Name:
    exact = [name for name in names if name.text == text]
    loose = [name for name in names if name.text.lower() == text.lower() or take_apart(text).base == name.base]
    found = exact or loose
    if len(found) == 1:
        return found[0]
    if not found and unread:
        raise ImportFault(f"no variable {text!r}", where=where, remedy=unread)
    known = [name.text for name in names]
    raise ImportFault(
        f"{'no' if not found else 'more than one'} variable {text!r}",
        where=where,
        remedy=f"{quantity.option} takes one of {', '.join(known) or '(none)'}{suggestion(text, known)}",
    )


def parse_units(text: str | None) -> dict[str, str]:
    """Parse `--units vx=km/h,delta_f=deg` into quantity key -> unit. Raises ImportFault."""
    units: dict[str, str] = {}
    for part in (text or "").split(",") if text is not None else ():
        left, equals, right = part.partition("=")
        quantity = quantity_named(take_apart(left))
        place = "--units"
        if not equals or quantity is None or quantity.kind == LOGICAL:
            known = ", ".join(key for key, one in QUANTITIES.items() if one.kind != LOGICAL)
            raise ImportFault(f"{part.strip()!r} is no NAME=UNIT", where=place, remedy=f"NAME is one of {known}")
        unit = unit_of(right)
        if unit is None or KIND_OF[unit] != quantity.kind:
            fitting = ", ".join(FACTORS[quantity.kind])
            raise ImportFault(f"{right.strip()!r} is no unit for {quantity.key}", where=place, remedy=f"give one of {fitting}")
        if quantity.key in units:
            raise ImportFault(f"{quantity.key} is there twice", where=place, remedy="give each once")
        units[quantity.key] = unit
    return units


def named_unit(key: str, name: Name, given: Mapping[str, str], where: object) -> str | None:
    """Return the unit of a quantity from --units, else from its name; None where neither has one.

    Raises:
        ImportFault: the name has a unit of another kind, or one that is not known.
    """
    quantity = QUANTITIES[key]
    if quantity.kind == LOGICAL:
        return "1"
    place = f"{where}: {name.text}"
    if key not in given and name.unit is not None and KIND_OF[name.unit] != quantity.kind:
        fitting = ", ".join(FACTORS[quantity.kind])
        raise ImportFault(f"{name.unit} is no unit for {key}", where=place, remedy=f"rename it; {key} is in one of {fitting}")
    if name.unknown_unit is not None and key not in given:
        fitting = ", ".join(FACTORS[quantity.kind])
        raise ImportFault(
            f"{name.unknown_unit!r} is no unit for {key}", where=place, remedy=f"give one of {fitting}, or --units {key}=UNIT"
        )
    return given.get(key, name.unit)
