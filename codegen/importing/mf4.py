"""Measurements in MF4 files, read with asammdf. Only a child process imports it (see `child`): asammdf may crash."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF

from codegen.arrays import AnyArray, BoolArray, FloatArray
from codegen.importing import child
from codegen.importing.quantities import TIME_UNITS, time_unit_of
from codegen.importing.rows import ARRAY, INVALID, NO_VALUE, TEXT, UNUSED_GROUP, Count, Group, group_of

FRAME_CHANNELS = ("CAN_DataFrame", "CAN_RemoteFrame", "CAN_ErrorFrame", "CAN_OverloadFrame")
"""Channels of the log of a bus (ASAM MDF 4.1, bus logging)."""


CHANNELS_SHOWN = 20


def is_bus_log(mdf: MDF) -> bool:
    """Return whether a file has frames of a bus."""
    return any(name in mdf.channels_db for name in FRAME_CHANNELS)


def columns(path: Path, names: Sequence[str], bytes_max: int) -> tuple[list[FloatArray], list[str]] | None:
    """Return the physical values of the named channels, and the findings about them; None for the log of a bus.

    Invalid values are NaN. A channel whose values are texts, as those of a status are, gives its numbers. For `bytes_max` and
    errors see `samples`.
    """
    with child.collected() as warnings, MDF(path) as mdf:
        if is_bus_log(mdf):
            return None
        if absent := [name for name in names if name not in mdf.channels_db]:
            raise ValueError(_absent(absent, mdf))
        _check_size(mdf, [place for name in names for place in mdf.channels_db[name][:1]], bytes_max)
        found = [_column(mdf, name, warnings) for name in names]
    return found, warnings


def _absent(absent: Sequence[str], mdf: MDF) -> str:
    """Return a text about channels that a file does not have, with those that it has."""
    present = list(mdf.channels_db)
    shown = ", ".join(present[:CHANNELS_SHOWN]) or "none"
    more = f" and {len(present) - CHANNELS_SHOWN} more" if len(present) > CHANNELS_SHOWN else ""
    return f"it has no channel {', '.join(absent)}; its channels are {shown}{more}"


def _column(mdf: MDF, name: str, notes: list[str]) -> FloatArray:
    signal = mdf.get(name, ignore_invalidation_bits=True)
    samples: AnyArray = signal.samples
    if samples.dtype.kind not in "biuf":
        raw = np.array(mdf.get(name, raw=True, ignore_invalidation_bits=True).samples, dtype=np.float64)
        numbers = np.array([_number(sample) for sample in samples.tolist()], dtype=np.float64)
        is_scaled = bool(np.any(np.isfinite(numbers) & (numbers != raw)))  # then the texts mark values that are not available
        samples = numbers if is_scaled else raw
    values = np.array(samples, dtype=np.float64)
    valid = _valid(signal)
    if not valid.all():
        notes.append(f"{np.count_nonzero(~valid)} of {valid.size} samples of {name} are {INVALID}")
    values[~valid] = np.nan
    return values


def _valid(signal: Any) -> BoolArray:
    if signal.invalidation_bits is None:
        return np.ones(len(signal.samples), dtype=bool)
    return ~np.asarray(signal.invalidation_bits, dtype=bool)


BYTES_PER_NUMBER = 8


@dataclass(frozen=True)
class ChannelName:
    """A channel: name of its group, its own name, its unit ("" without one), and numbers of group and channel."""

    group: str
    name: str
    unit: str
    place: tuple[int, int]


def channels(path: Path) -> list[ChannelName] | None:
    """Return all channels that have times, but for these; None for the log of a bus.

    Raises:
        ValueError: a file of another version.
        Exception: whatever asammdf raises for a damaged file.
    """
    with MDF(path) as mdf:
        if not str(mdf.version).startswith("4"):
            raise ValueError(f"an MDF of version {mdf.version}; only version 4 is read")
        if is_bus_log(mdf):
            return None
        return [
            ChannelName(_name(group), str(channel.name), _unit(channel), (number, index))
            for number, group in enumerate(list[Any](mdf.groups))
            for index, channel in enumerate(group.channels)
            if not _no_time(mdf, number) and index != mdf.masters_db.get(number)
        ]


def _name(group: Any) -> str:
    return str(group.channel_group.acq_name or "")


def _unit(channel: Any) -> str:
    return str(channel.unit or getattr(channel.conversion, "unit", "") or "")


TIME = (0, 1)
"""Kind of the stamps of a group: time, or not specified (ASAM MDF 4.1, cn_sync_type)."""
SYNC_NAMES = {2: "angles", 3: "distances", 4: "numbers"}


def _no_time(mdf: MDF, number: int) -> str:
    """Return why a group has no times; "" if it has. asammdf returns the numbers of the rows instead."""
    index = mdf.masters_db.get(number)
    if index is None:
        return "their group has no stamps"
    kind = getattr(mdf.groups[number].channels[index], "sync_type", 0)
    return "" if kind in TIME else f"their stamps are {SYNC_NAMES.get(kind, 'of an unknown kind')}, not times"


def _time_size(mdf: MDF, number: int) -> float:
    """Return the size in s of the unit of a group's stamps. The standard requires s; some tools write ms and name the unit."""
    unit = time_unit_of(_unit(mdf.groups[number].channels[mdf.masters_db[number]]))
    return TIME_UNITS[unit or "s"]


def samples(
    path: Path, places: Sequence[tuple[int, int]], bytes_max: int
) -> tuple[list[tuple[FloatArray, FloatArray, str]], list[Count], list[Group], list[str]]:
    """Return times in s and values of channels with a remark on those that have none, their counts, those of all groups, and
    asammdf's warnings.

    Invalid samples are left out; texts, which mark reserved values, are NaN. Only stamps of the channels' groups are read.

    Args:
        bytes_max: limit on the size of all results.

    Raises:
        ValueError: more than that.
        Exception: whatever asammdf raises for a damaged file.
    """
    with child.collected() as warnings, MDF(path) as mdf:
        _check_size(mdf, places, bytes_max)
        found, counts = [], []
        for place in places:
            try:
                time, values, reasons = _samples(mdf, *place)
                found.append((time, values, ""))
            except _NoNumbersError as error:
                values, reasons = np.zeros(error.reasons.get(TEXT, 0)), error.reasons
                found.append((np.array([]), np.array([]), str(error)))
            counts.append(_count(mdf, place, values, reasons))
        groups = _groups(mdf, {group for group, _ in places})
    return found, counts, groups, warnings


def account(path: Path, bytes_max: int) -> tuple[list[Count], list[Group], list[str]]:
    """Return the counts of all channels that have times, and of all groups, and asammdf's warnings.

    Args:
        bytes_max: limit on the size of each channel.

    Raises:
        ValueError: a channel is larger.
        Exception: whatever asammdf raises for a damaged file.
    """
    with child.collected() as warnings, MDF(path) as mdf:
        counts = []
        for number, group in enumerate(list[Any](mdf.groups)):
            _check_size(mdf, [(number, 0)], bytes_max)
            for index in range(len(group.channels)):
                if _no_time(mdf, number) or index == mdf.masters_db.get(number):
                    continue
                try:
                    _, values, reasons = _samples(mdf, number, index)
                except _NoNumbersError as error:
                    values, reasons = np.zeros(error.reasons.get(TEXT, 0)), error.reasons
                counts.append(_count(mdf, (number, index), values, reasons))
        groups = _groups(mdf, set(range(len(mdf.groups))))
    return counts, groups, warnings


def _groups(mdf: MDF, wanted: set[int]) -> list[Group]:
    """Return the counts of all groups. The stamps of those that are not wanted are not read."""
    groups = []
    for number, group in enumerate(list[Any](mdf.groups)):
        rows = int(group.channel_group.cycles_nr)
        reason = _no_time(mdf, number) or ("" if number in wanted else UNUSED_GROUP)
        if not reason:
            groups.append(
                group_of(_name(group), _time_size(mdf, number) * np.asarray(mdf.get_master(number), dtype=np.float64), rows)
            )
        else:
            groups.append(Group(_name(group), rows, {reason: (rows, f"group {number}")} if rows else {}))
    return groups


def _count(mdf: MDF, place: tuple[int, int], values: FloatArray, reasons: Mapping[str, int]) -> Count:
    group, index = place
    channel = mdf.groups[group].channels[index]
    name = _name(mdf.groups[group])
    path = f"{name}.{channel.name}" if name else str(channel.name)
    return Count(path, _unit(channel), group, values.size - sum(reasons.get(key, 0) for key in (NO_VALUE, TEXT)), reasons)


def _check_size(mdf: MDF, places: Sequence[tuple[int, int]], bytes_max: int) -> None:
    """Raise ValueError if times and values of channels are too large: packed zeros of a small file can have any length."""
    numbers = sum(int(mdf.groups[group].channel_group.cycles_nr) for group, _ in places)
    if 2 * BYTES_PER_NUMBER * numbers > bytes_max:
        raise ValueError(f"{numbers} samples, more than a file of its size may hold")


class _NoNumbersError(ValueError):
    """A channel has no numbers, for these reasons."""

    def __init__(self, text: str, reasons: dict[str, int]) -> None:
        super().__init__(text)
        self.reasons = reasons


def _samples(mdf: MDF, group: int, index: int) -> tuple[FloatArray, FloatArray, dict[str, int]]:
    """Return times and values without invalid samples, and the number of samples without a number by reason.

    Raises _NoNumbersError: it has none.
    """
    signal = mdf.get(group=group, index=index, ignore_invalidation_bits=True)
    found, time = signal.samples, np.array(signal.timestamps, dtype=np.float64) * _time_size(mdf, group)
    if found.ndim != 1 or found.dtype.kind not in "biufSUO":
        raise _NoNumbersError(f"{signal.name} has no numbers", {ARRAY: len(found)} if len(found) else {})
    valid = _valid(signal)
    reasons = {INVALID: int(np.count_nonzero(~valid))}
    if found.dtype.kind in "biuf":
        values = np.array(found, dtype=np.float64)[valid]
        reasons[NO_VALUE] = int(np.count_nonzero(np.isnan(values)))
    else:
        values = np.array([_number(sample) for sample in found[valid].tolist()], dtype=np.float64)
        reasons[TEXT] = int(np.count_nonzero(np.isnan(values)))
        if reasons[TEXT] == values.size:
            raise _NoNumbersError(f"{signal.name} has texts instead of numbers", _present(reasons))
    return time[valid], values, _present(reasons)


def _present(reasons: Mapping[str, int]) -> dict[str, int]:
    return {reason: count for reason, count in reasons.items() if count}


def _number(sample: Any) -> float:
    try:
        return float(sample)
    except (TypeError, ValueError):
        return math.nan
