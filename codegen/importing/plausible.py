"""Plausibility of the units of a map: impossible values reveal a wrong unit, and usually the right one.

Each bound states its reason. The true unit of a road car is never rejected. A wrong one is found where it exceeds a bound:
nearly always for a factor of 57 (degrees, radians) and mostly for a factor of 3.6 (km/h, m/s).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from codegen.arrays import FloatArray
from codegen.importing.quantities import FACTORS, QUANTITIES
from codegen.importing.source import ImportFault
from codegen.units import GRAVITY

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
        remedy = f"--units {pairs} would fit"
    else:
        remedy = "check the units of all three, and which variable is which"
    raise ImportFault(doubt.what, where=where, remedy=remedy + doubt.hint)


def likely_units(values: Mapping[str, FloatArray], known: Mapping[str, str]) -> dict[str, str] | None:
    """Return units for the quantities missing in `known` if exactly one set fits the values, slow turns included."""
    open_keys = [key for key in values if key not in known]
    fitting = [
        {**dict(known), **dict(zip(open_keys, chosen, strict=True))}
        for chosen in itertools.product(*(FACTORS[QUANTITIES[key].kind] for key in open_keys))
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
            others = [[unit for unit in FACTORS[QUANTITIES[key].kind] if unit not in (units[key], "mph")] for key in changed]
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
    return {key: array * FACTORS[QUANTITIES[key].kind][units[key]] for key, array in values.items()}


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
        factor = FACTORS[QUANTITIES[key].kind][units[key]]
        shown = f"{largest / factor:.4g} {units[key]}"
        side = f"above {high / factor:.4g}" if largest > high else f"below {low / factor:.3g}"
        hint = AT_THE_WHEEL if key == "delta_f" and largest > high else ""
        yield _Doubt((key,), f"{key} goes to {shown}, which no car's map does ({side} {units[key]})", hint)


def _doubts_of_motion(speed: FloatArray, angle: FloatArray, yaw_rate: FloatArray, units: Mapping[str, str]) -> Iterator[_Doubt]:
    said = f"with vx in {units['vx']}, delta_f in {units['delta_f']} and yaw_rate in {units['yaw_rate']}"
    in_g = speed[:, np.newaxis] * yaw_rate / GRAVITY
    if np.isfinite(in_g).any() and np.nanmax(in_g) > ACCELERATION_MAX_G:
        what = f"{said} the map asks for {np.nanmax(in_g):.3g} g of lateral acceleration, above {ACCELERATION_MAX_G:g} g"
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
