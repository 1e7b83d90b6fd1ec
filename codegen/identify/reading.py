"""Reading of measured drives: from logs to signals on a uniform time grid, with findings about the data."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import firwin, upfirdn

from codegen.arrays import FloatArray
from codegen.errors import CodegenError, suggestion
from codegen.files import distinct_names
from codegen.identify.channels import CAUSES_SHOWN, Channel, Log, read_channels
from codegen.identify.conditioning import Conditioned, condition
from codegen.identify.cross_checks import cross_check, without_frozen, without_saturated
from codegen.identify.drive import NOT_USED, REMARK, Drive, Finding, merged
from codegen.identify.names import NO_SETTINGS, Names, SignalChoice, line_of
from codegen.identify.quantities import LOG_QUANTITIES, REQUIRED, LogQuantity
from codegen.importing.quantities import BRACKETED, unit_of
from codegen.logs.account import BusLog
from codegen.logs.databases import Databases
from codegen.logs.measurement import Account, Samples

_FILTER_STEPS = 5
"""Half length of the filter in steps of the grid. Number of steps beside a gap, and at both ends, that have no value."""
_KAISER_BETA = 5.0
"""Window of the filter: at least 53 dB above half of the grid's rate (J. F. Kaiser, 1974). With this length the transition is
0.31 of that rate wide, half of it above the cutoff."""
_CUTOFF = 0.335
"""Cutoff as a fraction of the grid's rate."""
_TIME_RESOLUTION_S = 2e-6
"""Difference below which two times of a log are equal: ASC and candump have 1 us, a float64 of Unix time 0.24 us."""
_FACTOR_MAX = 50
"""Largest number of samples in a step that are filtered; a faster signal is thinned out first."""
_FASTER = 1.25
"""Ratio of the rates up to which a signal is not filtered."""

STEPS_MAX = 4_000_000
"""Largest number of steps of a drive: eleven hours at 10 ms."""
CANDIDATES_SHOWN = 5


@dataclass(frozen=True)
class Source:
    """Origin of a quantity of a drive.

    Attributes:
        channel: name in the log.
        unit: unit of the log.
        is_given: whether names.toml names it.
        period: its sampling time in the log, s.
        samples: number of its samples in the log.
        share: fraction of the drive's steps that have a value.
    """

    channel: str
    unit: str
    is_given: bool
    period: float
    samples: int
    share: float


@dataclass(frozen=True)
class Reading:
    """Result of reading.

    Attributes:
        drives: the drives.
        sources: sources of the signals of each drive, by quantity.
        findings: all findings.
        accounts: what became of the frames of each log of a bus, and of the rows of each measurement.
    """

    drives: tuple[Drive, ...]
    sources: tuple[Mapping[str, Source], ...]
    findings: tuple[Finding, ...]
    accounts: tuple[BusLog | Account, ...]

    @property
    def names_toml(self) -> str:
        """Text of a names.toml that gives the same reading. It leaves a unit to the logs where they differ in it."""
        lines = []
        for key in LOG_QUANTITIES:
            of_key = [sources[key] for sources in self.sources if key in sources]
            units = {source.unit for source in of_key}
            if of_key:
                channels = list(dict.fromkeys(source.channel for source in of_key))
                lines.append(line_of(key, channels, units.pop() if len(units) == 1 else None))
        return "\n".join(lines) + "\n"


def read_drives(logs: Sequence[Path], databases: Sequence[Path] = (), names: Names | None = None) -> Reading:
    """Read logs of drives.

    Args:
        logs: files of the formats of `codegen.identify.channels`, at least one.
        databases: DBC or ARXML files for logs of a bus.
        names: signals of the quantities; by default, and for quantities not named there, common names are used. A signal that
            no drive needs may be missing in some of the logs.

    Raises:
        CodegenError: a file cannot be read, a required quantity is not found or not clear, its unit is not known or impossible.
    """
    settings, of_bus = names or Names(), Databases(databases)
    drives, sources, findings, accounts = [], [], [], []
    missing: list[_MissingSignalError] = []
    for path, name in zip(logs, _drive_names(logs), strict=True):
        log = read_channels(path, of_bus, settings)
        drive, of_drive, found, account = _read(log, path, name, settings, missing)
        accounts.append(account)
        drives.append(drive)
        sources.append(of_drive)
        findings += found
    for error in missing:
        if not any(error.key in of_drive for of_drive in sources):
            raise error
    return Reading(tuple(drives), tuple(sources), tuple(findings), tuple(accounts))


class _MissingSignalError(CodegenError):
    """A log does not have the signal that names.toml names for the quantity `key`."""

    key: str


def _drive_names(logs: Sequence[Path]) -> list[str]:
    """Return a name for each log, see `distinct_names`. Raises CodegenError for a repetition."""
    repeated = [path for path, count in Counter(path.resolve() for path in logs).items() if count > 1]
    if repeated:
        raise CodegenError("given twice", where=repeated[0], remedy="give each log once")
    return distinct_names(logs)


def _read(
    log: Log, path: Path, name: str, names: Names, missing: list[_MissingSignalError]
) -> tuple[Drive, dict[str, Source], list[Finding], BusLog | Account]:
    findings = [Finding(name, "", *remark) for remark in log.remarks]
    chosen = _choose(log, names, name, path, findings, missing)
    read: dict[str, Conditioned] = {}
    flags = _sign_signals(log, names, chosen, path)
    samples, account = log.read([channel.place for channel in (*(channel for channel, _ in chosen.values()), *flags.values())])
    if isinstance(account, Account):
        findings += [Finding(name, "", REMARK, text) for text in account.findings]
    flag_of = dict(zip(flags, samples[len(samples) - len(flags) :], strict=True))
    for (key, (channel, unit)), one in zip(list(chosen.items()), samples[: len(samples) - len(flags)], strict=True):
        if one.time.size < 2 and _is_optional(key, chosen):
            reason = f" ({one.remark})" if one.remark else ""
            findings.append(Finding(name, key, NOT_USED, f"{channel.path} has {one.time.size} samples{reason}"))
            del chosen[key]
            continue
        if key in flag_of:
            one = _signed(one, flag_of[key], f"{path}: {flags[key].path}")
            channel = replace(channel, low=-channel.high, high=channel.high)
        read[key], found = condition(channel, one, LOG_QUANTITIES[key], unit, names.choices.get(key, NO_SETTINGS), name, path)
        findings += found
    read, saturated = without_saturated(read, name)
    start = min(one.time[0] for one in read.values())
    read = {key: replace(one, time=one.time - start) for key, one in read.items()}
    grid = _grid(read, names.sampling_time_s, path)
    signals = {key: resample(one, grid, is_held=LOG_QUANTITIES[key].is_held) for key, one in read.items()}
    drive, frozen = without_frozen(Drive(name, grid, signals))
    settings = {key: names.choices.get(key, NO_SETTINGS) for key in chosen}
    readings = {key: (unit, settings[key].factor, settings[key].offset) for key, (_, unit) in chosen.items()}
    findings += [*saturated, *frozen, *cross_check(drive, readings)]
    sources = {
        key: Source(
            channel.path,
            unit,
            key in names.choices,
            read[key].period,
            read[key].time.size,
            float(np.mean(np.isfinite(drive.signals[key]))),
        )
        for key, (channel, unit) in chosen.items()
    }
    empty = next(
        (key for key, source in sources.items() if source.share == 0.0 and any(key in group for group in REQUIRED)), None
    )
    if empty is not None:
        reasons = "; ".join(finding.text for finding in findings if finding.quantity == empty)
        what = f"{empty} has no usable value" + (f" ({reasons})" if reasons else "")
        raise CodegenError(
            what,
            where=f"{path}: {sources[empty].channel}",
            remedy="check the log; sampling_time_s of names.toml sets the time between samples",
        )
    return drive, sources, merged(findings), account


def _is_optional(key: str, chosen: Mapping[str, object]) -> bool:
    """Return whether a drive does without a quantity: it needs none of its group, or has another one of it."""
    return not any(key in group and not any(other in chosen for other in group if other != key) for group in REQUIRED)


def _sign_signals(log: Log, names: Names, chosen: Mapping[str, object], path: Path) -> dict[str, Channel]:
    """Return quantity -> channel of its sign, for quantities whose sign is a signal. Raises CodegenError if there is none."""
    settings = {key: names.choices[key] for key in chosen if key in names.choices}
    return {
        key: _by_name(log, SignalChoice(signal=one.sign), f"{key}.sign", path)
        for key, one in settings.items()
        if isinstance(one.sign, str)
    }


def _signed(samples: Samples, flags: Samples, where: str) -> Samples:
    """Return samples that are negative where a flag is not 0. Raises CodegenError if the times differ."""
    if not np.array_equal(samples.time, flags.time):
        raise CodegenError(
            "it has other times than the signal whose sign it is", where=where, remedy="name a signal of the same message"
        )
    return replace(samples, values=np.where(flags.values != 0.0, -samples.values, samples.values))


def _grid(read: Mapping[str, Conditioned], step: float, path: Path) -> FloatArray:
    """Return times (n,) from 0 to the last sample. Raises CodegenError for a drive that is too short or too long."""
    end = max(float(one.time[-1]) for one in read.values())
    count = int((end + _TIME_RESOLUTION_S) / step) + 1
    if count < 2:
        raise CodegenError(f"it lasts {end:.3g} s", where=path, remedy="log longer, or choose a shorter sampling_time_s")
    if count > STEPS_MAX:
        what = f"it lasts {end:.4g} s, which are {count} steps of {step:g} s (at most {STEPS_MAX})"
        raise CodegenError(what, where=path, remedy="check the unit of its time, or cut it")
    return step * np.arange(count, dtype=np.float64)


# --- which channel is which quantity -------------------------------------------------------------------------------------


def _choose(
    log: Log, names: Names, drive: str, path: Path, findings: list[Finding], missing: list[_MissingSignalError]
) -> dict[str, tuple[Channel, str]]:
    """Return quantity -> channel and unit, and extend the findings and the missing signals.

    Raises:
        CodegenError: a required quantity is missing or not clear, or a unit is not known.
    """
    chosen: dict[str, Channel] = {}
    absent: dict[str, _MissingSignalError] = {}
    for key, choice in names.choices.items():
        try:
            chosen[key] = _by_name(log, choice, key, path)
        except _MissingSignalError as error:
            error.key = key
            absent[key] = error
    units = {key: _unit_of(channel, LOG_QUANTITIES[key], names, path) for key, channel in chosen.items()}
    taken = {channel.path for channel in chosen.values()}
    unclear: dict[str, list[Channel]] = {}
    for key, quantity in LOG_QUANTITIES.items():
        if key in names.choices or key in names.without:
            continue
        fitting = [channel for channel in log.channels if channel.path not in taken and _is_obvious(channel, quantity)]
        if len(fitting) == 1:
            chosen[key] = fitting[0]
        elif fitting:
            unclear[key] = fitting
    for group in REQUIRED:
        if not any(key in chosen for key in group):
            raise next((absent[key] for key in group if key in absent), None) or _not_clear(group, unclear, log, path)
    missing += absent.values()
    findings += [Finding(drive, key, NOT_USED, error.what) for key, error in absent.items()]
    for key, fitting in unclear.items():
        shown = ", ".join(channel.path for channel in fitting[:CANDIDATES_SHOWN])
        findings.append(Finding(drive, key, NOT_USED, f"several signals may be it ({shown}); name one in names.toml"))
    units |= {key: _unit_of(channel, LOG_QUANTITIES[key], names, path) for key, channel in chosen.items() if key not in units}
    return {key: (chosen[key], units[key]) for key in LOG_QUANTITIES if key in chosen}


def _is_obvious(channel: Channel, quantity: LogQuantity) -> bool:
    unit = channel.known_unit
    return quantity.is_named(channel.name) and (unit is None or unit in quantity.units)


def _by_name(log: Log, choice: SignalChoice, key: str, path: Path) -> Channel:
    """Return the channel that names.toml names. Raises CodegenError if there is none or more than one."""
    for text in choice.signals:
        exact = [channel for channel in log.channels if channel.path == text]
        found = exact or [channel for channel in log.channels if text in _short_names(channel)]
        if len(found) == 1:
            return found[0]
        if found:
            shown = ", ".join(channel.path for channel in found[:CANDIDATES_SHOWN])
            raise CodegenError(
                f"{len(found)} signals are called {text!r}", where=f"{path}: {key}", remedy=f"name one of {shown}"
            )
    known = [name for channel in log.channels for name in (channel.path, channel.name.text)]
    text = choice.signals[0]
    remedy = f"correct the name in names.toml{suggestion(text, known)}"
    raise _MissingSignalError(f"the log has no signal {text!r}", where=f"{path}: {key}", remedy=remedy)


def _short_names(channel: Channel) -> tuple[str, ...]:
    """Return the names of a channel without its message or group, and without a unit in brackets."""
    return channel.name.text, channel.path.rpartition(".")[2], BRACKETED.sub("", channel.name.text)


def _not_clear(group: Sequence[str], unclear: Mapping[str, Sequence[Channel]], log: Log, path: Path) -> CodegenError:
    """Return the error for a required quantity: its candidates, and a line for names.toml."""
    key = next((key for key in group if key in unclear), group[0])
    quantity = LOG_QUANTITIES[key]
    candidates = list(unclear.get(key, ())) or [
        channel for channel in log.channels if quantity.is_candidate(channel.name, channel.known_unit)
    ]
    candidates.sort(key=lambda channel: channel.known_unit not in quantity.units)  # those with a fitting unit first
    several = key in unclear
    what = f"several signals may be {key}" if several else f"no signal is called {' or '.join(group)} or the like"
    if not several and log.causes:
        what += f" ({'; '.join(log.causes[:CAUSES_SHOWN])})"
    shown = candidates or list(log.channels)
    names = ", ".join(
        f"{channel.path} [{channel.unit}]" if channel.unit else channel.path for channel in shown[:CANDIDATES_SHOWN]
    )
    more = f" and {len(shown) - CANDIDATES_SHOWN} more" if len(shown) > CANDIDATES_SHOWN else ""
    example = candidates[0] if candidates else None
    unit = None if example is not None and example.known_unit in quantity.units else quantity.si_unit
    line = line_of(key, [example.path if example else "NAME"], unit)
    offered = f"there is {names}{more}" if names else "there is none"
    if several and log.conflicts:
        offered += f" ({'; '.join(log.conflicts)})"
    return CodegenError(f"{what}; {offered}", where=path, remedy=f"put a line such as {line} into names.toml, for `signals=`")


def _unit_of(channel: Channel, quantity: LogQuantity, names: Names, path: Path) -> str:
    """Return the unit of a channel. Raises CodegenError if it is not known, or one of another kind."""
    choice = names.choices.get(quantity.key)
    if choice is not None and choice.unit is not None:
        return unit_of(choice.unit) or quantity.si_unit  # `Names` has checked it
    unit = channel.known_unit
    if unit in quantity.units and unit is not None:
        return unit
    text = channel.unit or channel.name.unit or channel.name.unknown_unit
    what = f"{text!r} is no unit for {quantity.key}" if text else f"the unit of {quantity.key} is not known"
    fitting = " or ".join(f'"{each}"' for each in quantity.units)
    line = line_of(quantity.key, [channel.path], "UNIT")
    raise CodegenError(what, where=f"{path}: {channel.path}", remedy=f"put {line} into names.toml, where UNIT is {fitting}")


def resample(signal: Conditioned, grid: FloatArray, *, is_held: bool) -> FloatArray:
    """Return the values (n,) of a signal on a uniform grid (n,); NaN outside of its samples, in gaps and beside NaN.

    A measured quantity is interpolated linearly between its own time stamps, which shifts no phase. Holding the last sample
    would delay the signal by half of its sampling time, and differences of delays between signals are identified. A command is
    held, because the actuator holds it from one frame to the next. A signal that is sampled faster than the grid passes a
    symmetric filter first, without phase, so that its higher frequencies do not appear as lower ones.

    Args:
        signal: samples at their own times.
        grid: s, on the same clock.
        is_held: hold each sample until the next one; else interpolate.
    """
    step = float(grid[1] - grid[0])
    factor = min(math.ceil(step / signal.period - (_FASTER - 1.0)), _FACTOR_MAX)
    if factor < 2:
        return _at(signal, grid, is_held)
    fine = grid[0] + step / factor * np.arange(factor * (grid.size - 1) + 1)
    half = _FILTER_STEPS * factor
    taps = firwin(2 * half + 1, 2.0 * _CUTOFF / factor, window=("kaiser", _KAISER_BETA))
    beyond = np.full(half, np.nan)
    padded = np.concatenate((beyond, _at(signal, fine, is_held), beyond))
    # Output k of the convolution has the filter's middle at input k * factor - half, and the first `half` inputs are padding.
    filtered: FloatArray = upfirdn(taps, padded, down=factor)[2 * _FILTER_STEPS : 2 * _FILTER_STEPS + grid.size]
    return filtered


def _at(signal: Conditioned, times: FloatArray, is_held: bool) -> FloatArray:
    """Return the values at times (n,), interpolated or held within a pause that is no gap; NaN elsewhere."""
    time, values = signal.time, signal.values
    inside = (times >= time[0] - _TIME_RESOLUTION_S) & (times <= time[-1] + _TIME_RESOLUTION_S)
    left = np.clip(np.searchsorted(time, times, side="right") - 1, 0, time.size - 2)
    before, after = time[left], time[left + 1]
    share = np.clip((times - before) / (after - before), 0.0, 1.0)
    share[times - before <= _TIME_RESOLUTION_S] = 0.0
    share[after - times <= _TIME_RESOLUTION_S] = 1.0
    between = values[left] if is_held else values[left] + share * (values[left + 1] - values[left])
    found = np.where(share == 0.0, values[left], np.where(share == 1.0, values[left + 1], between))
    has_value = (share == 0.0) | (share == 1.0) | (after - before <= signal.pause_max)
    return np.where(inside & has_value, found, np.nan)
