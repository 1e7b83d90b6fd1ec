"""Checks of the signals of a drive against each other: saturated and frozen signals, offsets, signs and units.

A signal is frozen where it stays exactly constant although another one shows that it cannot. A constant angle alone is no
fault, because drivers, robots and simulations hold it. The rear angle is saturated where it stays at its own extreme although
its command goes beyond, or, without a command, while the front angle changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.identify.conditioning import PLATEAU_SAMPLES, Conditioned, clipped
from codegen.identify.drive import CONTRADICTION, FROZEN, OFFSET, SATURATED, SIGN, Drive, Finding
from codegen.identify.quantities import LOG_QUANTITIES

TINY = float(np.finfo(np.float64).tiny)
FROZEN_S = 1.0
"""Shortest time in s that a frozen signal is constant."""
RESPONSE_S = 0.3
"""Time in s within which a sound signal responds: what changes so late in a constant part is what ends it."""
LEAD_S = 0.15
"""Largest time in s by which the front angle leads the rear angle."""
STAYS_FRACTION = 0.1
"""Change of a saturated rear angle, as a fraction of its largest magnitude, that is noise."""
MOVES_FRACTION = 0.2
"""Change of another signal, as a fraction of its largest magnitude in the drive, that shows that the car moves."""
MOVES_STEPS = 5.0
"""The change must also be at least this many steps of the signal's resolution. A coarse yaw rate stays constant on a straight
road while the steering wheel moves a little."""
TYPICAL_PERCENTILE = 99.0
RESPONSES = ("yaw_rate", "lateral_acceleration", "sideslip")
LATERAL = (*RESPONSES, "steering_wheel_angle", "delta_f")
WITNESSES: Mapping[str, tuple[str, ...]] = {
    **{key: tuple(other for other in LATERAL if other != key) for key in RESPONSES},
    "steering_wheel_angle": ("delta_f",),
    "delta_f": ("steering_wheel_angle",),
    "delta_r": ("delta_r_command",),
}
"""Quantity -> others that cannot change while it stays constant in a car that moves."""

STANDSTILL_M_S = 0.1
MOVING_M_S = 2.0
STRAIGHT_M_S = 10.0
STRAIGHT_YAW_RATE = 0.005
"""rad/s (0.3 deg/s): at 10 m/s a curve of 2 km."""
STEADY_S = 1.0
"""Shortest time in s of a standstill, and of straight running, that shows an offset."""
AT_STANDSTILL = ("yaw_rate", "lateral_acceleration")
ON_STRAIGHT = ("steering_wheel_angle", "delta_f", "delta_r")

TURNING_M_S2 = 0.5
"""Standard deviation of the lateral acceleration from which signs and units can be compared."""
SLOW_S = 1.0
"""Time in s over which means of signals are compared. A car follows a sine of 2 Hz late, and turns less than it moves sideways:
that contradicts no sign and no unit."""
SLOPE_LOW, SLOPE_HIGH = 0.6, 1.7
"""Range of the ratio of lateral acceleration to speed times yaw rate. Roll adds some 10 %; transients and banked roads more."""
SLOPE_FACTOR_MAX, AGREEMENT = 3.0, 0.8
"""Factor between both that is an error, and their correlation from which it is one. Fast steering of the rear wheels alone
halves the ratio and the correlation; km/h read as m/s divides the ratio by 3.6."""
IN_PHASE, STEERING_RATIO = 0.3, 15.0
"""Rear angle over front angle from which the car moves sideways more than it turns, and a usual ratio if only the angle of the
steering wheel is known."""
CORRELATION = 0.3
"""Smallest correlation of steering and yaw rate that has a sign."""
PAIRS = (("delta_r", "delta_r_command"), ("delta_f", "steering_wheel_angle"))
"""Angles and what moves them."""


def without_saturated(signals: dict[str, Conditioned], drive: str) -> tuple[dict[str, Conditioned], list[Finding]]:
    """Return the signals with NaN where the rear angle is saturated, and the findings. `drive`: name for them."""
    if "delta_r" not in signals:
        return signals, []
    angle = signals["delta_r"]
    cause = next(key for key in ("delta_r_command", "delta_f", "steering_wheel_angle") if key in signals)
    known = np.isfinite(signals[cause].values)
    if not known.any() or not np.isfinite(angle.values).any():
        return signals, []
    witness = np.interp(angle.time, signals[cause].time[known], signals[cause].values[known])
    is_commanded = cause == "delta_r_command"
    flags = _not_followed(angle, witness) if is_commanded else _clipped(angle, witness)
    if not flags.any():
        return signals, []
    lost, values = int(np.count_nonzero(flags)), np.degrees(angle.values[flags])
    ends = " and ".join(f"{np.median(side):.3g}" for side in (values[values < 0.0], values[values > 0.0]) if side.size)
    reason = "its command goes beyond" if is_commanded else f"{cause} changes"
    found = Finding(drive, "delta_r", SATURATED, f"{lost} samples stay at {ends} deg although {reason}", lost)
    return {**signals, "delta_r": replace(angle, values=np.where(flags, np.nan, angle.values))}, [found]


def _not_followed(angle: Conditioned, command: FloatArray) -> BoolArray:
    """Return which samples (n,) of an angle stay at its extreme longer than it takes to follow a command (n,) beyond it."""
    flags, size, late = np.zeros(command.size, dtype=bool), _size(angle.values), round(RESPONSE_S / angle.period)
    for values, wanted in ((angle.values, command), (-angle.values, -command)):
        end = np.nanmax(values)
        for part in _parts(wanted > end + MOVES_FRACTION * size, late + PLATEAU_SAMPLES):
            least = values[part.start + late : part.stop].min()
            if least >= end - STAYS_FRACTION * size > np.nanmin(values):  # false for NaN, and for an angle that never moves
                flags |= values >= least
    return flags


def _clipped(angle: Conditioned, front: FloatArray) -> BoolArray:
    """Return which samples (n,) of an angle are clipped while the front angle (n,) moves."""
    flags, late = np.zeros(front.size, dtype=bool), round(LEAD_S / angle.period)
    for part in _parts(clipped(angle.values), late + PLATEAU_SAMPLES):
        flags[part] = np.ptp(front[part.start : part.stop - late]) > MOVES_FRACTION * _size(front)
    return flags


def without_frozen(drive: Drive) -> tuple[Drive, list[Finding]]:
    """Return the drive with NaN where a signal is frozen, and the findings."""
    signals = dict(drive.signals)
    moving = np.abs(drive.signals["vx"]) > MOVING_M_S  # NaN: False
    found = []
    for key, witnesses in WITNESSES.items():
        others = {other: drive.signals[other] for other in witnesses if other in drive.signals}
        if key not in signals or not others:
            continue
        share = max(MOVES_FRACTION, MOVES_STEPS * _step(signals[key]) / _size(signals[key]))
        late = _count(drive, RESPONSE_S)
        parts = [part for part in _constant(drive, key) if moving[part].all() and _some_move(others, part, late, share)]
        if not parts:
            continue
        values = signals[key].copy()
        for part in parts:
            values[part] = np.nan
        signals[key] = values
        longest = max(parts, key=lambda part: part.stop - part.start)
        seconds, start = _seconds(drive, longest)
        verb = "change" if len(others) > 1 else "changes"
        text = f"constant for {seconds:.3g} s at {start:.3f} s although {' and '.join(others)} {verb}"
        text += f", and {len(parts) - 1} more times" if len(parts) > 1 else ""
        found.append(Finding(drive.name, key, FROZEN, text, sum(part.stop - part.start for part in parts)))
    return Drive(drive.name, drive.time, signals), found


def _constant(drive: Drive, key: str) -> list[slice]:
    """Return the parts of at least FROZEN_S in which a signal has exactly one value."""
    same = np.concatenate(([False], np.diff(drive.signals[key]) == 0.0))
    return [slice(part.start - 1, part.stop) for part in _parts(same, _count(drive, FROZEN_S))]


def _parts(flags: BoolArray, shortest: int) -> list[slice]:
    """Return the runs of at least `shortest` true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    pairs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [slice(start, stop) for start, stop in pairs if stop - start >= shortest]


def _some_move(others: Mapping[str, FloatArray], part: slice, late: int, share: float) -> bool:
    """Return whether some other signal changes in a part, but for its `late` last steps, by a share of its typical largest
    magnitude."""
    for values in others.values():
        inside = values[part.start : part.stop - late]
        inside = inside[np.isfinite(inside)]
        if inside.size and np.ptp(inside) > share * _size(values):
            return True
    return False


def _size(values: FloatArray) -> float:
    """Return the typical largest magnitude of a signal; the smallest positive number if it is zero."""
    known = np.abs(values[np.isfinite(values)])
    return max(float(np.percentile(known, TYPICAL_PERCENTILE)), TINY) if known.size else TINY


def _step(values: FloatArray) -> float:
    """Return the median change of a signal from one step to the next, of those that change it."""
    changes = np.abs(np.diff(values))
    changes = changes[changes > 0.0]
    return float(np.median(changes)) if changes.size else 0.0


def _count(drive: Drive, seconds: float) -> int:
    return max(2, round(seconds / float(drive.time[1] - drive.time[0])))


def _seconds(drive: Drive, part: slice) -> tuple[float, float]:
    """Return the length and the start of a part in s."""
    return float(drive.time[part.stop - 1] - drive.time[part.start]), float(drive.time[part.start])


def cross_check(drive: Drive, units: Mapping[str, tuple[str, int, float]]) -> Iterator[Finding]:
    """Yield findings about offsets, signs and units; the drive is not changed.

    Args:
        units: quantity -> unit, sign and offset with which it was read.
    """
    speed = drive.signals["vx"]
    stands = _steady(np.abs(speed) <= STANDSTILL_M_S, drive)
    yaw_rate = drive.signals["yaw_rate"]
    bias = float(np.nanmedian(yaw_rate[stands])) if np.isfinite(yaw_rate[stands]).any() else 0.0
    straight = _steady((speed >= STRAIGHT_M_S) & (np.abs(yaw_rate - bias) <= STRAIGHT_YAW_RATE), drive)
    for keys, where, name in ((AT_STANDSTILL, stands, "at standstill"), (ON_STRAIGHT, straight, "on the straight")):
        for key in keys:
            if key in drive.signals:
                yield from _offset(drive, key, where, name, units[key])
    yield from _signs(drive)


def _steady(flags: BoolArray, drive: Drive) -> BoolArray:
    """Return the flags without their runs shorter than STEADY_S."""
    steady = np.zeros(flags.size, dtype=bool)
    for part in _parts(flags, _count(drive, STEADY_S)):
        steady[part] = True
    return steady


def _offset(drive: Drive, key: str, where: BoolArray, name: str, reading: tuple[str, int, float]) -> Iterator[Finding]:
    values = drive.signals[key][where]
    values = values[np.isfinite(values)]
    if not values.size:
        return
    offset, quantity = float(np.median(values)), LOG_QUANTITIES[key]
    if abs(offset) < quantity.offset_noted:
        return
    unit, sign, subtracted = reading
    in_unit = sign * offset / quantity.units[unit] + subtracted
    text = f"an offset of {offset / quantity.units[unit]:.3g} {unit} {name}; offset = {in_unit:.4g} in names.toml subtracts it"
    yield Finding(drive.name, key, OFFSET, text)


def _signs(drive: Drive) -> Iterator[Finding]:
    """Yield findings about signals that contradict the yaw rate."""
    yaw_rate, speed = drive.signals["yaw_rate"], drive.signals["vx"]
    turning = speed * yaw_rate
    lateral = drive.signals.get("lateral_acceleration")
    if lateral is not None:
        turning, slowly = _slow(drive, turning), _slow(drive, lateral)
        both = np.isfinite(turning) & np.isfinite(slowly) & (np.abs(speed) > MOVING_M_S)
        x, y = _centred(turning[both]), _centred(slowly[both])
        if x.size and max(np.std(x), np.std(y)) > TURNING_M_S2 and np.std(x) > 0.0:
            slope = float(x @ y / (x @ x))
            if not SLOPE_LOW <= slope <= SLOPE_HIGH:
                largest = np.inf if _is_in_phase(drive) else SLOPE_FACTOR_MAX
                is_gross = not 1.0 / SLOPE_FACTOR_MAX <= slope <= largest
                is_clear = float(x @ y) ** 2 > AGREEMENT**2 * float((x @ x) * (y @ y))
                text = f"it is {slope:.3g} times vx * yaw_rate, where about 1 is normal; check sign and unit of all three"
                yield Finding(drive.name, "lateral_acceleration", CONTRADICTION if is_gross and is_clear else SIGN, text)
    for key in ("steering_wheel_angle", "delta_f"):
        if key in drive.signals and _correlation(drive, drive.signals[key], yaw_rate, speed > MOVING_M_S) < -CORRELATION:
            yield Finding(drive.name, key, SIGN, "the car turns against it; check the signs of it and of yaw_rate")
    for key, cause in PAIRS:
        moved, by = drive.signals.get(key), drive.signals.get(cause)
        if moved is not None and by is not None and _correlation(drive, moved, by, np.isfinite(speed)) < -CORRELATION:
            yield Finding(drive.name, key, SIGN, f"it moves against {cause}; check the signs of both")


def _slow(drive: Drive, values: FloatArray) -> FloatArray:
    """Return the mean of a signal (n,) over SLOW_S around each sample; NaN where half of that is unknown."""
    count = min(2 * (_count(drive, SLOW_S) // 2) + 1, values.size)
    known = np.isfinite(values)
    window = np.ones(count)
    number = np.convolve(known, window, "same")
    total = np.convolve(np.where(known, values, 0.0), window, "same")
    result: FloatArray = np.where(number >= 0.5 * count, total / np.maximum(number, 1.0), np.nan)
    return result


def _correlation(drive: Drive, first: FloatArray, second: FloatArray, used: BoolArray) -> float:
    """Return the correlation of the slow parts of two signals where both are known; zero if one is constant."""
    first, second = _slow(drive, first), _slow(drive, second)
    both = np.isfinite(first) & np.isfinite(second) & used
    x, y = _centred(first[both]), _centred(second[both])
    size = float(np.sqrt((x @ x) * (y @ y)))
    return float(x @ y) / size if size > 0.0 else 0.0


def _is_in_phase(drive: Drive) -> bool:
    """Return whether the rear wheels follow the front ones so far that the car moves sideways more than it turns."""
    rear = drive.signals.get("delta_r", drive.signals.get("delta_r_command"))
    front = drive.signals.get("delta_f")
    if front is None:
        front = drive.signals["steering_wheel_angle"] / STEERING_RATIO
    if rear is None:
        return False
    both = np.isfinite(rear) & np.isfinite(front)
    x, y = _centred(front[both]), _centred(rear[both])
    return float(x @ y) > IN_PHASE * float(x @ x)


def _centred(values: FloatArray) -> FloatArray:
    return values - np.mean(values) if values.size else values
