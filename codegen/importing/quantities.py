"""Quantities of a map: their common names and units, the units inside names, and the plausibility of units.

`speed_km_h`, `v (km/h)` and `V [kph]` are one quantity in one unit. Where a name has no unit, the user must give it: a unit is
never assumed.

Impossible values reveal a wrong unit, and usually the right one. Each bound states its reason. The true unit of a road car is
never rejected. A wrong unit is detected when values exceed a bound: nearly always for a factor of 57 (degrees, radians) and
mostly for a factor of 3.6 (km/h, m/s).
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.errors import suggestion
from codegen.importing.source import ImportFault
from codegen.units import GRAVITY, KM_H, STANDARD_GRAVITY

SPEED_KIND, ANGLE_KIND, RATE_KIND, ACCELERATION_KIND, LOGICAL_KIND = "speed", "angle", "rate", "acceleration", "logical"

UNIT_FACTORS = {
    SPEED_KIND: {"m/s": 1.0, "km/h": KM_H, "mph": 0.44704},
    ANGLE_KIND: {"rad": 1.0, "deg": math.pi / 180.0},
    RATE_KIND: {"rad/s": 1.0, "deg/s": math.pi / 180.0},
    ACCELERATION_KIND: {"m/s^2": 1.0, "g": STANDARD_GRAVITY},
    LOGICAL_KIND: {"1": 1.0},
}
"""Kind of quantity -> unit -> its size in SI. 1 mph is 0.44704 m/s exactly (international mile of 1609.344 m). Drives have
accelerations, maps have none."""

SPELLINGS = {
    "m/s": ("m/s", "m_s", "mps", "m/sec", "ms^-1"),
    "km/h": ("km/h", "km_h", "kmh", "kph", "kmph", "km/hr", "unit_kilometerperhour"),
    "mph": ("mph", "mi/h"),
    "rad": ("rad", "radian", "radians"),
    "deg": ("deg", "°", "unit_degreofarc"),
    "rad/s": ("rad/s", "rad_s", "radps", "rad/sec"),
    "deg/s": ("deg/s", "deg_s", "degps", "dps", "deg/sec", "°/s", "unit_degreofarcpersecon"),
    "m/s^2": (
        "m/s^2",
        "m/s2",
        "m/s²",
        "m/s/s",
        "m_s2",
        "m_s^2",
        "m/s**2",
        "mps2",
        "m/sec^2",
        "unit_meterpersecon2",
        "unit_meterperseconsquar",
    ),
    "g": ("g",),
}
"""Unit -> its spellings, in small letters; `unit_of` makes "deg" of "degrees" first."""

TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
"""Unit of a time -> its size in s."""
_TIME_SPELLINGS = {"sec": "s", "second": "s", "seconds": "s", "µs": "us", "μs": "us", "hour": "h", "hours": "h"}
"""Other spellings; the micro sign and the Greek letter."""
_TIME_NAME = re.compile(r"(?:time|times|timestamp|timestamps|zeit|t)\Z", re.IGNORECASE)
_TIME_UNIT = re.compile(
    r"(?P<stem>.*?)\s*(?:[\[({]\s*(?P<bracketed>[^\])}]*?)\s*[\])}]|(?:[_\s.]+in)?[_\s.]+(?P<plain>[^_\s.]+))\Z", re.DOTALL
)
"""A name of a time with its unit: "Time [ms]", "time_ms", "t in s"."""

UNIT_OF = {spelling: unit for unit, spellings in SPELLINGS.items() for spelling in spellings}
KIND_OF = {unit: kind for kind, factors in UNIT_FACTORS.items() for unit in factors}


@dataclass(frozen=True)
class MapChannel:
    """One array of the map: its key in the file, its kind, its common names."""

    key: str
    kind: str
    names: tuple[str, ...]
    required: bool

    def argument(self, value: str = "") -> str:
        """Return the argument that names the variable, for messages."""
        return f"`variables['{self.key}']={value}`"


_NAMES = {
    ("vx", SPEED_KIND, True): "vx v speed velocity vehiclespeed longitudinalspeed longitudinalvelocity",
    ("delta_f", ANGLE_KIND, True): "deltaf df delta deltafront steer frontangle frontsteer frontsteeringangle roadwheelangle",
    ("yaw_rate", RATE_KIND, True): "yawrate r psidot psip omegaz rref yawrateref yawratereference",
    ("beta", ANGLE_KIND, False): "beta sideslip sideslipangle",
    ("delta_r", ANGLE_KIND, False): "deltar dr deltarear rearangle rearsteer rearsteeringangle",
    ("feasible", LOGICAL_KIND, False): "feasible valid",
}
MAP_CHANNELS = {
    key: MapChannel(key, kind, tuple(names.split()), is_required) for (key, kind, is_required), names in _NAMES.items()
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


def time_unit_of(text: str) -> str | None:
    """Return the unit of TIME_UNITS of a spelling, or None."""
    flat = text.strip().lower()
    flat = _TIME_SPELLINGS.get(flat, flat)
    return flat if flat in TIME_UNITS else None


def split_time(text: str) -> tuple[str, str]:
    """Return the name of a column of times without its unit, and the unit as it is written; "" without one.

    What stands in brackets is a unit, known or not; what stands at the end of a name only if it is known.
    """
    text = text.strip()
    match = _TIME_UNIT.fullmatch(text)
    if match is None or (match["bracketed"] is None and time_unit_of(match["plain"]) is None):
        return text, ""
    return match["stem"], match["bracketed"] if match["plain"] is None else match["plain"]


def is_time(text: str) -> bool:
    """Return whether a name denotes times by itself, with a unit or without."""
    return _TIME_NAME.fullmatch(split_time(text)[0]) is not None


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


def quantity_named(name: Name) -> MapChannel | None:
    """Return the quantity that a name denotes by itself."""
    return next((quantity for quantity in MAP_CHANNELS.values() if name.base in quantity.names), None)


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
        chosen[key] = _by_name(text, names, MAP_CHANNELS[key], where, unread)
    taken = {name.text for name in chosen.values()}
    for quantity in MAP_CHANNELS.values():
        if quantity.key in chosen:
            continue
        fitting = [name for name in names if name.base in quantity.names and name.text not in taken]
        if len(fitting) > 1:
            both = " and ".join(repr(name.text) for name in fitting[:2])
            raise ImportFault(
                f"{both} may both be {quantity.key}", where=where, remedy=f"name one with {quantity.argument('NAME')}"
            )
        if fitting:
            chosen[quantity.key] = fitting[0]
        elif quantity.required:
            has = ", ".join(name.text for name in names) or "nothing that is numeric"
            raise ImportFault(
                f"no variable is called {quantity.key} or the like",
                where=where,
                remedy=unread or f"name it with {quantity.argument('NAME')}; there is {has}",
            )
    return chosen


def _by_name(text: str, names: list[Name], quantity: MapChannel, where: object, unread: str) -> Name:
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
        remedy=f"{quantity.argument()} takes one of {', '.join(known) or '(none)'}{suggestion(text, known)}",
    )


def parse_units(text: str | None) -> dict[str, str]:
    """Parse units such as `vx=km/h,delta_f=deg` into quantity key -> unit. Raises ImportFault."""
    units: dict[str, str] = {}
    for part in (text or "").split(",") if text is not None else ():
        left, equals, right = part.partition("=")
        quantity = quantity_named(take_apart(left))
        place = "`units=`"
        if not equals or quantity is None or quantity.kind == LOGICAL_KIND:
            known = ", ".join(key for key, one in MAP_CHANNELS.items() if one.kind != LOGICAL_KIND)
            raise ImportFault(f"{part.strip()!r} is no NAME=UNIT", where=place, remedy=f"NAME is one of {known}")
        unit = unit_of(right)
        if unit is None or KIND_OF[unit] != quantity.kind:
            fitting = ", ".join(UNIT_FACTORS[quantity.kind])
            raise ImportFault(f"{right.strip()!r} is no unit for {quantity.key}", where=place, remedy=f"give one of {fitting}")
        if quantity.key in units:
            raise ImportFault(f"{quantity.key} is there twice", where=place, remedy="give each once")
        units[quantity.key] = unit
    return units


def named_unit(key: str, name: Name, given: Mapping[str, str], where: object) -> str | None:
    """Return the unit of a quantity from `units`, else from its name; None where neither has one.

    Raises:
        ImportFault: the name has a unit of another kind, or one that is not known.
    """
    quantity = MAP_CHANNELS[key]
    if quantity.kind == LOGICAL_KIND:
        return "1"
    place = f"{where}: {name.text}"
    if key not in given and name.unit is not None and KIND_OF[name.unit] != quantity.kind:
        fitting = ", ".join(UNIT_FACTORS[quantity.kind])
        raise ImportFault(f"{name.unit} is no unit for {key}", where=place, remedy=f"rename it; {key} is in one of {fitting}")
    if name.unknown_unit is not None and key not in given:
        fitting = ", ".join(UNIT_FACTORS[quantity.kind])
        raise ImportFault(
            f"{name.unknown_unit!r} is no unit for {key}", where=place, remedy=f"give one of {fitting}, or `units='{key}=UNIT'`"
        )
    return given.get(key, name.unit)


SPEED_MAX_LOW, SPEED_MAX_HIGH = 3.0, 120.0
"""m/s, of the largest speed. Control begins at 15 km/h (4.2 m/s); 120 m/s is 432 km/h, above what road tyres are sold for."""
FRONT_MAX_LOW, FRONT_MAX_HIGH = math.radians(1.0), math.radians(60.0)
"""rad, of the largest front angle: a map below 1 deg is useless; no car's road wheels turn beyond 60 deg."""
YAW_MAX_LOW, YAW_MAX_HIGH = 0.02, 4.0
"""rad/s, of the largest yaw rate: 1.1 deg/s is less than a car on ice reaches (1 m/s^2 at 30 m/s: 0.033 rad/s); 4 rad/s is a
whole turn in 1.6 s, 2 g at 5 m/s."""
REAR_MAX_HIGH = math.radians(25.0)
"""rad, of rear angle and sideslip: production cars turn their rear wheels by up to 10 deg."""
ACCELERATION_MAX_G = 2.0
"""Lateral acceleration, vx times yaw rate: the largest that ars.toml accepts; road tyres reach 1.2 g."""
TURNING_LENGTH_LOW, TURNING_LENGTH_HIGH = 0.9, 8.0
"""m, of vx tan(delta_f)/yaw_rate, which for slow turns is wheelbase * tan(delta_f)/(tan(delta_f) - tan(delta_r)). The shortest
car (1.7 m) with rear wheels turned nearly as far against the front ones has 0.9 m; no truck has a wheelbase of 8 m."""
SLOW = 15.0
"""m/s: above, understeer makes the turning length longer than any wheelbase."""
AT_THE_WHEEL = ", or are these angles of the steering wheel? delta_f is at the road wheel"


@dataclass(frozen=True)
class _Doubt:
    """An impossible value: the quantities that may have a wrong unit, most likely first, the message, and a hint."""

    keys: tuple[str, ...]
    what: str
    hint: str = ""


def check_units(values: Mapping[str, FloatArray], units: Mapping[str, str], where: object) -> None:
    """Reject impossible units.

    Args:
        values: quantity key -> values in the unit of the file: `vx` (n,), `delta_f` (m,), tables (n, m), NaN where infeasible.
        units: quantity key -> unit.
        where: the place that an error names.

    Raises:
        ImportFault: with the value, and the right unit where it can be inferred.
    """
    doubt = next(_doubts(values, units), None)
    if doubt is None:
        return
    guess = _guess(values, units, doubt.keys)
    if guess:
        pairs = ",".join(f"{key}={unit}" for key, unit in guess.items())
        remedy = f"`units='{pairs}'` would fit"
    else:
        remedy = "check the units of all three, and which variable is which"
    raise ImportFault(doubt.what, where=where, remedy=remedy + doubt.hint)


def likely_units(values: Mapping[str, FloatArray], known: Mapping[str, str]) -> dict[str, str] | None:
    """Return units for the quantities missing in `known` if exactly one set fits the values, slow turns included."""
    open_keys = [key for key in values if key not in known]
    fitting = [
        {**dict(known), **dict(zip(open_keys, chosen, strict=True))}
        for chosen in itertools.product(*(UNIT_FACTORS[MAP_CHANNELS[key].kind] for key in open_keys))
        if "mph" not in chosen
    ]
    fitting = [units for units in fitting if next(_doubts(values, units), None) is None]
    if len(fitting) != 1 or not _shows_slow_turns(values, fitting[0]):
        return None
    return {key: fitting[0][key] for key in open_keys}


def _guess(values: Mapping[str, FloatArray], units: Mapping[str, str], blamed: tuple[str, ...]) -> dict[str, str]:
    """Return the least change of units that makes all values possible: one quantity, else two, else all; {} if none does.

    A change that only makes the slow turns fast ones proves nothing: then the bounds of the turning length have no data.
    """
    needs_slow_turns = _shows_slow_turns(values, units)
    keys = [*blamed, *(key for key in values if key not in blamed)]
    for count in range(1, len(keys) + 1):
        for changed in itertools.combinations(keys, count):
            others = [
                [unit for unit in UNIT_FACTORS[MAP_CHANNELS[key].kind] if unit not in (units[key], "mph")] for key in changed
            ]
            for chosen in itertools.product(*others):
                change = dict(zip(changed, chosen, strict=True))
                changed_units = {**dict(units), **change}
                if next(_doubts(values, changed_units), None) is not None:
                    continue
                if not needs_slow_turns or _shows_slow_turns(values, changed_units):
                    return change
    return {}


def _shows_slow_turns(values: Mapping[str, FloatArray], units: Mapping[str, str]) -> bool:
    """Return whether the bounds of the turning length have data with these units."""
    si = _in_si(values, units)
    fitting = si["yaw_rate"].shape == (si["vx"].size, si["delta_f"].size)
    return fitting and _slow_turns(_turning_lengths(si["vx"], si["delta_f"], si["yaw_rate"]), si["vx"]).size > 0


def _in_si(values: Mapping[str, FloatArray], units: Mapping[str, str]) -> dict[str, FloatArray]:
    return {key: array * UNIT_FACTORS[MAP_CHANNELS[key].kind][units[key]] for key, array in values.items()}


def _turning_lengths(speed: FloatArray, angle: FloatArray, yaw_rate: FloatArray) -> FloatArray:
    """Return turning lengths (n, m) in m; NaN where there is none, as on the straight."""
    with np.errstate(all="ignore"):
        length = speed[:, np.newaxis] * np.tan(angle) / yaw_rate
    return np.where(np.isfinite(length) & (length > 0.0), length, np.nan)


def _slow_turns(length: FloatArray, speed: FloatArray) -> npt.NDArray[np.intp]:
    """Return the rows with a turning length at a slow speed."""
    return np.flatnonzero(np.isfinite(length).any(axis=1) & (speed <= SLOW))


def _doubts(values: Mapping[str, FloatArray], units: Mapping[str, str]) -> Iterator[_Doubt]:
    si = _in_si(values, units)
    yield from _doubts_of_size(units, si)
    speed, angle, yaw_rate = si["vx"], si["delta_f"], si["yaw_rate"]
    if yaw_rate.shape != (speed.size, angle.size):
        return  # reported by the map's own checks, with the shapes
    yield from _doubts_of_motion(speed, angle, yaw_rate, units)


def _doubts_of_size(units: Mapping[str, str], si: Mapping[str, FloatArray]) -> Iterator[_Doubt]:
    bounds = {
        "vx": (SPEED_MAX_LOW, SPEED_MAX_HIGH),
        "delta_f": (FRONT_MAX_LOW, FRONT_MAX_HIGH),
        "yaw_rate": (YAW_MAX_LOW, YAW_MAX_HIGH),
        "beta": (0.0, REAR_MAX_HIGH),
        "delta_r": (0.0, REAR_MAX_HIGH),
    }
    for key, (low, high) in bounds.items():
        if key not in si or not np.isfinite(si[key]).any():
            continue
        largest = float(np.nanmax(np.abs(si[key])))
        if low <= largest <= high * (1.0 + 1e-9):
            continue
        factor = UNIT_FACTORS[MAP_CHANNELS[key].kind][units[key]]
        shown = f"{largest / factor:.4g} {units[key]}"
        side = f"above {high / factor:.4g}" if largest > high else f"below {low / factor:.3g}"
        hint = AT_THE_WHEEL if key == "delta_f" and largest > high else ""
        yield _Doubt((key,), f"{key} goes to {shown}, which no car's map does ({side} {units[key]})", hint)


def _doubts_of_motion(speed: FloatArray, angle: FloatArray, yaw_rate: FloatArray, units: Mapping[str, str]) -> Iterator[_Doubt]:
    said = f"with vx in {units['vx']}, delta_f in {units['delta_f']} and yaw_rate in {units['yaw_rate']}"
    in_g = speed[:, np.newaxis] * yaw_rate / GRAVITY
    if np.isfinite(in_g).any() and np.nanmax(in_g) > ACCELERATION_MAX_G:
        what = f"{said} the map requires {np.nanmax(in_g):.3g} g of lateral acceleration, above {ACCELERATION_MAX_G:g} g"
        yield _Doubt(("vx", "yaw_rate"), what)
    length = _turning_lengths(speed, angle, yaw_rate)
    slow = _slow_turns(length, speed)
    if not slow.size:
        return
    shortest = float(np.nanmin(length))
    last = int(np.flatnonzero(np.isfinite(length[slow[0]]))[-1])  # where the rear wheels matter least
    sharpest = float(length[slow[0], last])
    if shortest > TURNING_LENGTH_HIGH:
        what = (
            f"{said} even slow turns are those of a car with a wheelbase of {shortest:.3g} m (at most {TURNING_LENGTH_HIGH:g})"
        )
        yield _Doubt(("vx", "yaw_rate", "delta_f"), what, AT_THE_WHEEL)
    if sharpest < TURNING_LENGTH_LOW:
        what = f"{said} slow turns are those of a car with a wheelbase of {sharpest:.3g} m (at least {TURNING_LENGTH_LOW:g})"
        yield _Doubt(("vx", "yaw_rate", "delta_f"), what)
