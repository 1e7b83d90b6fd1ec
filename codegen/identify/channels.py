"""Channels of a log: names and units first, samples when they are needed.

| format | read by | a channel is |
|---|---|---|
| `.blf`, `.asc`, `.log`, `.mf4` of a bus | python-can, cantools | a signal whose message is in the log: `Message.Signal` |
| `.mf4` of a measurement | asammdf | a channel, `Group.Channel` where the group has a name |
| `.csv`, `.tsv`, `.txt`, `.dat` | `codegen.importing.table` | a column |
| `.parquet` | pyarrow | a column |
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import IndexArray
from codegen.errors import CodegenError
from codegen.identify.drive import CLOCK, REMARK
from codegen.identify.names import Names
from codegen.importing.quantities import Name, take_apart, unit_of
from codegen.logs.account import BusLog, open_bus_log, open_rows
from codegen.logs.databases import BusKey, Databases, Defined
from codegen.logs.measurement import Account, Measurement, Samples, damage

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

NOT_AVAILABLE = re.compile(
    r"(?<![a-z])(?:sna|n/?a|err)(?![a-z])|invalid|not.?avail|unavail|error|fault|fail|init|unknown|reserved|undef|defect"
    r"|ungueltig|ungültig|fehler",
    re.IGNORECASE,
)
"""Name of a raw value that means that there is no physical value."""


CAUSES_SHOWN = 2
BITS_MAX = 64
"""Length of the longest number in a frame."""


@dataclass(frozen=True)
class Channel:
    """A channel of a log.

    Attributes:
        path: whole name: message or group, a dot, and the name; the name alone without either.
        name: parts of the name alone.
        unit: unit as in the log or its database; "" if it has none.
        place: where its samples are, for the log's reader.
        low, high: smallest and largest value that the channel can have, in its unit; infinite if not known.
    """

    path: str
    name: Name
    unit: str
    place: Any
    low: float = -np.inf
    high: float = np.inf

    @property
    def known_unit(self) -> str | None:
        """Unit as written in FACTORS of `codegen.importing.quantities`; None if there is none or it is not known."""
        return unit_of(self.unit) if self.unit else self.name.unit


@dataclass(frozen=True)
class Log:
    """A log.

    Attributes:
        channels: all channels.
        read: returns the samples of channels at these places, and the account of the file. Raises CodegenError.
        remarks: kind, text and number of lost frames of findings about the log as a whole.
        conflicts: a text for each identifier that several messages have.
        causes: texts about frames and lines of databases that were not read; a signal may be missing because of them.
    """

    channels: Sequence[Channel]
    read: Callable[[Sequence[Any]], tuple[list[Samples], BusLog | Account]]
    remarks: Sequence[tuple[str, str, int]] = ()
    conflicts: Sequence[str] = ()
    causes: Sequence[str] = ()


def read_channels(path: Path, databases: Databases, names: Names) -> Log:
    """Return the channels of a log.

    Args:
        databases: of the log of a bus.
        names: column and unit of the time, for a table; channel, for the log of a bus.

    Raises:
        CodegenError: the log or a database cannot be read, or a database is missing.
    """
    found = open_rows(path, names.time, names.time_unit)
    return _bus_log(path, databases, names.channel) if found is None else _measurement(found)


def _measurement(found: Measurement) -> Log:
    channels = [
        # INCA appends its device to a name.
        Channel(one.path, take_apart(one.name.partition("\\")[0]), one.unit, one.place)
        for one in found.columns
    ]
    return Log(_distinct(channels), found.read)


def _distinct(channels: Sequence[Channel]) -> list[Channel]:
    """Return the channels with numbers behind the paths that several of them have, so that names.toml can choose one."""
    counts, numbers = Counter(channel.path for channel in channels), Counter[str]()
    found = []
    for channel in channels:
        numbers[channel.path] += 1
        path = channel.path if counts[channel.path] == 1 else f"{channel.path}#{numbers[channel.path]}"
        found.append(replace(channel, path=path))
    return found


# --- logs of a bus -------------------------------------------------------------------------------------------------------


def _bus_log(path: Path, databases: Databases, channel: str | None) -> Log:
    if not databases.paths:
        raise CodegenError("the log of a bus needs its database", where=path, remedy="give the DBC or ARXML with `dbc=`")
    log = open_bus_log(path, databases, channel)
    found = log.allotment
    keys = [*found.keys, *found.conflicts]
    if not keys:
        named = ", ".join(each.name for each in databases.paths)
        what = f"none of its {len(log.frames)} frames is in {named}" if len(log.frames) else "it has no frame that is read"
        what += f" ({'; '.join(log.findings[:CAUSES_SHOWN])})" if log.findings else ""
        remedy = "give the database of this bus with `dbc=`" if len(log.frames) else "give a log with frames"
        raise CodegenError(what, where=path, remedy=remedy)
    parts = {(key, index): _Message(defined, log, key) for key in keys for index, defined in enumerate(databases.messages[key])}
    with damage(path, "log with this database"):
        channels = [channel for key, one in parts.items() for channel in one.channels(key)]

    def read_signals(places: Sequence[tuple[tuple[BusKey, int], str]]) -> tuple[list[Samples], BusLog]:
        with damage(path, "log with this database"):
            return [parts[key].samples(name) for key, name in places], log

    remarks = [(CLOCK, *found.clock)] if found.clock[0] else []
    remarks += [(REMARK, text, 0) for text in (*log.findings, *log.message_findings)]
    conflicts = [databases.conflicts[key] for key in keys if key in databases.conflicts]
    return Log(_distinct(channels), read_signals, remarks, conflicts, log.findings)


@dataclass(frozen=True)
class _Message:
    """A message of the database with its frames in a log."""

    defined: Defined
    log: BusLog
    key: BusKey

    def channels(self, place: object) -> Iterator[Channel]:
        """Yield the channels of all signals, with the database in their names where two define a message of one name."""
        message = self.defined.message
        is_twice = self.log.databases.names_of(self.key).count(message.name) > 1
        whole = f"{self.defined.path.stem}.{message.name}" if is_twice else message.name
        for signal in message.signals:
            name = f"{whole}.{signal.name}"
            yield Channel(name, take_apart(signal.name), signal.unit or "", (place, signal.name), *_limits(signal))

    def samples(self, name: str) -> Samples:
        """Return the samples of a signal. Raises CodegenError if several senders send the message with different data."""
        message = self.defined.message
        where = f"{self.log.path}: {message.name}"
        if self.key in self.log.allotment.conflicts:
            what, remedy = self.log.allotment.conflicts[self.key]
            raise CodegenError(what, where=where, remedy=remedy)
        chosen, decoded = self._decoded
        signal = message.get_signal_by_name(name)
        reserved = _reserved(signal)
        has_value = np.array([name in sample for sample in decoded], dtype=bool)  # else the frame has another multiplexed one
        raw = [sample[name] for sample in decoded if name in sample]
        values = np.array([np.nan if value in reserved else value for value in raw], dtype=np.float64)
        lost = int(np.count_nonzero(~has_value))
        is_multiplexed = signal.multiplexer_ids is not None
        failed = sum(not sample for sample in decoded)
        remark = ""
        if failed or (lost and not is_multiplexed):
            remark = f"{failed if is_multiplexed else lost} of {len(decoded)} frames of {message.name} do not contain it"
        return Samples(self.log.frames.time[chosen[has_value]], values, remark)

    @cached_property
    def _decoded(self) -> tuple[IndexArray, list[Any]]:
        """Number in the log and signals of each frame that is used."""
        chosen = self.log.allotment.keys[self.key]
        return chosen, [_decode(self.defined.message, self.log.frames.data[index]) for index in chosen.tolist()]


def _decode(message: Message, data: bytes) -> Any:
    """Return signal -> value of a frame; {} for one whose multiplexer has no such value."""
    from cantools.database import DecodeError

    try:
        return message.decode(data, decode_choices=False, allow_truncated=True)
    except DecodeError:
        return {}


def _physical(signal: Signal, raw: int) -> float:
    """Return the value of a raw number."""
    value: Any = signal.raw_to_scaled(raw, decode_choices=False)
    return float(value)


def _reserved(signal: Signal) -> set[float]:
    """Return the values of a signal that mean that there is none."""
    choices: Mapping[int, object] = signal.choices or {}
    return {_physical(signal, raw) for raw, text in choices.items() if NOT_AVAILABLE.search(str(text))}


def _limits(signal: Signal) -> tuple[float, float]:
    """Return the smallest and the largest value: those of the database, and those of the bits."""
    low = -np.inf if signal.minimum is None else float(signal.minimum)
    high = np.inf if signal.maximum is None else float(signal.maximum)
    if low >= high:  # a placeholder such as [0|0]
        low, high = -np.inf, np.inf
    if signal.is_float or signal.length > BITS_MAX:
        return low, high
    bits = signal.length - signal.is_signed
    ends = [_physical(signal, raw) for raw in (-(2**bits) if signal.is_signed else 0, 2**bits - 1)]
    return max(low, min(ends)), min(high, max(ends))
