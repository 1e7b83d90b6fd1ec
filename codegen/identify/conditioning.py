"""Samples of one signal in SI, in order of time, with NaN in place of values that are none.

Saturation is found by known limits: those of names.toml, else those of the database. A limit of zero is none, since cars stand
still. Where no limit is known, a response of the car that stays at its largest value is clipped if it got there at speed: the
top of a smooth curve is reached slowly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from codegen.arrays import BoolArray, FloatArray
from codegen.errors import CodegenError
from codegen.identify.channels import Channel
from codegen.identify.drive import CLOCK, GAP, IMPOSSIBLE, JUMP, REMARK, RESERVED, SATURATED, Finding
from codegen.identify.names import SignalChoice
from codegen.identify.quantities import LogQuantity
from codegen.logs.frames import blocks, increasing
from codegen.logs.measurement import Samples

GAP_PERIODS = 2.5
"""A pause of more sampling times is a gap: at least two samples are lost. A single lost sample is bridged by interpolation."""
WRONG_UNIT_FRACTION = 0.02
"""Fraction of impossible values from which the unit is wrong, and not the sensor now and then."""
CODES_MAX = 2
"""Largest number of different values beyond the limits of the database that are codes, such as "not available". A measured
quantity takes more; then the limits are wrong, as they often are."""
ROUNDING = 1e-9
"""Relative difference of a scaled value from a limit that is rounding: 4999 * 0.1 is not 499.9."""
PERIOD_MIN_S, PERIOD_MAX_S = 1e-5, 5.0
"""Range of sampling times. Outside of it, the unit of the time is wrong: 10 ms are not 10 s."""
PLATEAU_SAMPLES = 5
"""Shortest plateau of a clipped curve."""
APPROACH_SAMPLES = 3
"""Distance before and behind a plateau at which its approach is judged."""
JUMP_WINDOW = 5
"""Number of samples around one whose median it is compared with."""
JUMP_RANGE_FRACTION = 0.25
"""Least distance of a sample from that median, as a fraction of the range of the signal, that is a jump."""
JUMP_NOISE_FACTOR = 8.0
"""The same, over the upper quartile of all such distances, so that noise is none."""
JUMP_STEPS = 4.0
"""The same, over the smallest difference of two values."""
ALTERNATION_FACTOR, ALTERNATION_LAGS = 3.0, (2, 3)
"""Least ratio of the differences of neighbours to those of samples that lie farther apart, from which samples alternate between
two courses. Noise has a ratio of 1, a smooth signal a smaller one."""
CLIPPED = ("yaw_rate", "lateral_acceleration", "sideslip")
"""Responses of the car. A driver may hold the steering wheel still for any length of time."""


@dataclass(frozen=True)
class Conditioned:
    """Samples of a quantity.

    Attributes:
        time: (n,) s, increasing, n >= 2.
        values: (n,) SI, NaN where there is no value.
        period: sampling time, s.
    """

    time: FloatArray
    values: FloatArray
    period: float

    @property
    def pause_max(self) -> float:
        """Longest time in s between two samples that are not a gap."""
        return GAP_PERIODS * self.period


def condition(
    channel: Channel, samples: Samples, quantity: LogQuantity, unit: str, settings: SignalChoice, drive: str, where: object
) -> tuple[Conditioned, list[Finding]]:
    """Check the samples of a channel.

    Args:
        unit: a unit of the quantity.
        settings: settings of names.toml.
        drive: name for findings.
        where: the log, for errors.

    Raises:
        CodegenError: there are fewer than two samples, or their times or values are impossible.
    """
    found: list[Finding] = []

    def report(kind: str, text: str, lost: int = 0) -> None:
        if text:
            found.append(Finding(drive, quantity.key, kind, text, lost))

    report(REMARK, samples.remark)
    place = f"{where}: {channel.path}"
    time, raw, text = _in_order(samples)
    report(CLOCK, text, samples.time.size - time.size)
    if time.size < 2:
        what = f"{time.size} samples for {quantity.key}"
        for reason in (samples.remark, text):
            what += f" ({reason})" if reason else ""
        raise CodegenError(what, where=place, remedy="name another signal, or log longer")
    period = float(np.median(np.diff(time)))
    if not PERIOD_MIN_S <= period <= PERIOD_MAX_S:
        raise CodegenError(
            f"its samples are {period:.3g} s apart", where=place, remedy="check the unit of its time (time_unit)"
        )
    period = settings.sampling_time_s or period
    reserved = int(np.count_nonzero(~np.isfinite(raw)))
    report(RESERVED, f"{reserved} of {raw.size} samples are marked as not available" if reserved else "", reserved)
    raw = np.where(np.isfinite(raw), raw, np.nan)
    at_limit, text = _at_limit(channel, settings, quantity, raw, unit)
    report(SATURATED if at_limit.any() else REMARK, text, int(np.count_nonzero(at_limit)))
    raw[at_limit] = np.nan
    values = settings.factor * (raw - settings.offset) * quantity.units[unit]
    impossible = np.abs(values) > quantity.largest
    _check_unit(values, impossible, quantity, unit, place)
    if impossible.any():
        worst = float(np.nanmax(np.abs(values))) / quantity.units[unit]
        count = int(np.count_nonzero(impossible))
        report(IMPOSSIBLE, f"{count} samples beyond what a car does, up to {worst:.4g} {unit}", count)
        values[impossible] = np.nan
    refuse_alternation(values, place)
    jumping = jumps(time, values, GAP_PERIODS * period)
    values[jumping] = np.nan
    count = int(np.count_nonzero(jumping))
    report(JUMP, f"{count} samples jump away and back: faults, or another sender of the signal" if count else "", count)
    result = Conditioned(time, values, period)
    report(GAP, _gaps(result))
    return result, found


def _in_order(samples: Samples) -> tuple[FloatArray, FloatArray, str]:
    """Return time and values in increasing order of time, from the longest part of the log, and what was left out."""
    parts = blocks(samples.time)
    if not parts:
        return samples.time[:0], samples.values[:0], "no sample has a time" if samples.time.size else ""
    used = max(parts, key=len)
    used = used[increasing(samples.time[used])]
    lost = samples.time.size - used.size
    text = ""
    if len(parts) > 1:
        text = f"the clock restarts {len(parts) - 1} times; only the longest part is used"
    elif lost:
        text = "times that repeat, go back or are impossible"
    return samples.time[used], samples.values[used], text


def _at_limit(
    channel: Channel, settings: SignalChoice, quantity: LogQuantity, raw: FloatArray, unit: str
) -> tuple[BoolArray, str]:
    """Return which samples are at a limit of the sensor or beyond it, and a text about them."""
    nothing = np.zeros(raw.size, dtype=bool)
    limits = f"{{:g}} to {{:g}} {unit}"
    if settings.low is not None or settings.high is not None:
        low = -np.inf if settings.low is None else settings.low
        high = np.inf if settings.high is None else settings.high
        reaches = (raw <= low) | (raw >= high)
        count = int(np.count_nonzero(reaches))
        return reaches, f"{count} samples at the limits of names.toml or beyond ({limits.format(low, high)})" if count else ""
    low, high = channel.low, channel.high
    at_low, at_high = np.isclose(raw, low, rtol=ROUNDING, atol=0.0), np.isclose(raw, high, rtol=ROUNDING, atol=0.0)
    beyond = ((raw < low) & ~at_low) | ((raw > high) & ~at_high)
    if np.unique(raw[beyond]).size > CODES_MAX:
        return nothing, f"it exceeds the limits of the database ({limits.format(low, high)}), which are ignored"
    reaches = beyond | (at_low & (low != 0.0)) | (at_high & (high != 0.0))
    count = int(np.count_nonzero(reaches))
    if count:
        return reaches, f"{count} samples at the limits of the sensor or beyond ({limits.format(low, high)})"
    at_end = clipped(raw) if quantity.key in CLIPPED else nothing
    count = int(np.count_nonzero(at_end))
    if not count:
        return nothing, ""
    shown = " and ".join(f"{value:g}" for value in np.unique(raw[at_end]))
    return at_end, f"{count} samples are clipped at {shown} {unit}; low and high in names.toml set other limits"


def clipped(raw: FloatArray) -> BoolArray:
    """Return which samples (n,) lie on a plateau at the largest or smallest value that was reached at speed.

    A smooth top is a parabola. If it stays within one step q of the resolution for h samples to each side, it has fallen by at
    most q (1 + m/h)^2 after m samples more; rounding adds up to q. A clipped curve falls further.
    """
    at_end = np.zeros(raw.size, dtype=bool)
    steps = np.abs(np.diff(raw))
    steps = steps[steps > 0.0]
    if not steps.size:
        return at_end
    resolution = float(np.min(steps))
    for extreme in (np.nanmax(raw), np.nanmin(raw)):
        edges = np.flatnonzero(np.diff(np.concatenate(([0], raw == extreme, [0]))))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            before, after = start - APPROACH_SAMPLES, stop + APPROACH_SAMPLES - 1
            if stop - start < PLATEAU_SAMPLES or before < 0 or after >= raw.size:
                continue
            smooth = (1.0 + APPROACH_SAMPLES / (0.5 * (stop - start - 1))) ** 2 + 1.0
            if min(abs(raw[before] - extreme), abs(raw[after] - extreme)) > smooth * resolution:
                at_end[start:stop] = True
    return at_end


def _resolution(values: FloatArray) -> float:
    """Return the smallest difference of two values, 0 if all are equal."""
    return float(np.min(np.diff(np.unique(values)), initial=np.inf)) if np.ptp(values) > 0.0 else 0.0


def refuse_alternation(values: FloatArray, place: str) -> None:
    """Raise CodegenError if samples alternate between two courses, as those of two senders do on one channel."""
    finite = values[np.isfinite(values)]
    if finite.size <= 4 * ALTERNATION_LAGS[-1]:
        return
    near, *far = (float(np.quantile(np.abs(finite[lag:] - finite[:-lag]), 0.75)) for lag in (1, *ALTERNATION_LAGS))
    if near > max(ALTERNATION_FACTOR * min(far), JUMP_STEPS * _resolution(finite)):
        remedy = "log one of them, or choose a bus with `channel=`"
        raise CodegenError("its samples alternate between two courses, as of two senders", where=place, remedy=remedy)


def jumps(time: FloatArray, values: FloatArray, pause_max: float) -> BoolArray:
    """Return which samples (n,) lie far from the median of five: their own, two before and two behind, with no gap."""
    if values.size < JUMP_WINDOW:
        return np.zeros(values.size, dtype=bool)
    length = np.ptp(sliding_window_view(time, JUMP_WINDOW), axis=1)
    median = np.median(sliding_window_view(values, JUMP_WINDOW), axis=1)
    median[length > (JUMP_WINDOW - 1) * pause_max] = np.nan
    distance = np.abs(values - np.pad(median, JUMP_WINDOW // 2, mode="edge"))
    if np.isnan(distance).all():
        return np.zeros(values.size, dtype=bool)
    least = max(
        JUMP_RANGE_FRACTION * float(np.nanmax(values) - np.nanmin(values)),
        JUMP_NOISE_FACTOR * float(np.nanquantile(distance, 0.75)),
        JUMP_STEPS * _resolution(values[np.isfinite(values)]),
    )
    far: BoolArray = distance > least
    return far


def _check_unit(values: FloatArray, impossible: BoolArray, quantity: LogQuantity, unit: str, place: str) -> None:
    """Raise CodegenError if so many values are impossible that the unit must be wrong."""
    if np.count_nonzero(impossible) <= WRONG_UNIT_FRACTION * values.size:
        return
    size = quantity.units[unit]
    largest = float(np.nanmax(np.abs(values)))
    fitting = [other for other, of_other in quantity.units.items() if largest / size * of_other <= quantity.largest]
    fit = f'unit = "{fitting[0]}" in names.toml would fit' if fitting else "check which signal it is"
    what = f"{quantity.key} goes to {largest / size:.4g} {unit}, which no car does (above {quantity.largest / size:.4g} {unit})"
    raise CodegenError(what, where=place, remedy=fit)


def _gaps(signal: Conditioned) -> str:
    pauses = np.diff(signal.time)
    gaps = pauses > signal.pause_max
    if not gaps.any():
        return ""
    longest = int(np.argmax(pauses))
    count = int(np.count_nonzero(gaps))
    start = signal.time[longest] - signal.time[0]
    length = f"{pauses[longest]:.3g} s at {start:.3f} s, where {signal.period:.3g} s are normal"
    return f"a gap of {length}" if count == 1 else f"{count} gaps, the longest {length}"
