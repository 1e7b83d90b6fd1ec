"""Measurements in MF4 files, read with asammdf. Only a child process imports it (see `child`): asammdf may crash."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF

from codegen.arrays import AnyArray, FloatArray


def columns(path: Path, names: Sequence[str], bytes_max: int) -> list[FloatArray] | None:
    """Return the physical values of the named channels; None for the log of a bus.

    A channel whose values are texts, as those of a status are, gives its numbers. For `bytes_max` and errors see `samples`.
    """
    with MDF(path) as mdf:
        if "CAN_DataFrame" in mdf.channels_db:
            return None
        _check_size(mdf, [place for name in names for place in mdf.channels_db[name][:1]], bytes_max)
        return [_column(mdf, name) for name in names]


def _column(mdf: MDF, name: str) -> FloatArray:
    samples: AnyArray = mdf.get(name).samples
    if samples.dtype.kind not in "biuf":
        samples = mdf.get(name, raw=True).samples
    return np.array(samples, dtype=np.float64)


BYTES_PER_NUMBER = 8


@dataclass(frozen=True)
class ChannelName:
    """A channel: name of its group, its own name, its unit ("" without one), and numbers of group and channel."""

    group: str
    name: str
    unit: str
    place: tuple[int, int]


def channels(path: Path) -> list[ChannelName] | None:
    """Return all channels but those of time; None for the log of a bus. Raises whatever asammdf raises."""
    with MDF(path) as mdf:
        if "CAN_DataFrame" in mdf.channels_db:
            return None
        return [
            ChannelName(str(group.channel_group.acq_name or ""), str(channel.name), _unit(channel), (number, index))
            for number, group in enumerate(list[Any](mdf.groups))
            for index, channel in enumerate(group.channels)
            if index != mdf.masters_db.get(number)
        ]


def _unit(channel: Any) -> str:
    return str(channel.unit or getattr(channel.conversion, "unit", "") or "")


def samples(path: Path, places: Sequence[tuple[int, int]], bytes_max: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return times in s and values of channels, without invalid samples; NaN for texts, which mark reserved values.

    Args:
        bytes_max: limit on the size of all results.

    Raises:
        ValueError: more than that, or a channel has no number.
        Exception: whatever asammdf raises for a damaged file.
    """
    with MDF(path) as mdf:
        _check_size(mdf, places, bytes_max)
        return [_samples(mdf, *place) for place in places]


def _check_size(mdf: MDF, places: Sequence[tuple[int, int]], bytes_max: int) -> None:
    """Raise ValueError if times and values of channels are too large: packed zeros of a small file can have any length."""
    numbers = sum(int(mdf.groups[group].channel_group.cycles_nr) for group, _ in places)
    if 2 * BYTES_PER_NUMBER * numbers > bytes_max:
        raise ValueError(f"{numbers} samples, more than a file of its size may hold")


def _samples(mdf: MDF, group: int, index: int) -> tuple[FloatArray, FloatArray]:
    signal = mdf.get(group=group, index=index)
    found = signal.samples
    if found.ndim != 1 or found.dtype.kind not in "biufSUO":
        raise ValueError(f"{signal.name} has no numbers")
    if found.dtype.kind in "biuf":
        values = np.array(found, dtype=np.float64)
    else:
        values = np.array([_number(sample) for sample in found.tolist()], dtype=np.float64)
        if np.isnan(values).all():
            raise ValueError(f"{signal.name} has texts instead of numbers")
    return np.array(signal.timestamps, dtype=np.float64), values


def _number(sample: Any) -> float:
    try:
        return float(sample)
    except (TypeError, ValueError):
        return math.nan
