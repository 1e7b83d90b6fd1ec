"""Channels of a log: names and units first, samples when they are needed.

| format | read by | a channel is |
|---|---|---|
| `.blf`, `.asc`, `.log`, `.mf4` of a bus | python-can, cantools | a signal whose message is in the log: `Message.Signal` |
| `.mf4` of a measurement | asammdf | a channel, `Group.Channel` where the group has a name |
| `.csv`, `.tsv`, `.txt`, `.dat` | `codegen.importing.table` | a column |
| `.parquet` | pyarrow | a column |
"""

from __future__ import annotations

import contextlib
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import FloatArray, IndexArray
from codegen.errors import CodegenError, one_line
from codegen.files import require_regular
from codegen.identify.findings import CLOCK, REMARK
from codegen.identify.names import Names
from codegen.importing import child, table
from codegen.importing.quantities import Name, take_apart, unit_of
from codegen.importing.source import TABLE_BYTES_MAX, read, text_of
from codegen.limits import Limits
from codegen.logs.account import BusLog, open_bus_log
from codegen.logs.databases import BusKey, Databases, Defined
from codegen.logs.reader import BYTES_MAX, LOGS
from codegen.requirements import missing

if TYPE_CHECKING:
    from cantools.database.can import Message, Signal

    from codegen.importing.mf4 import ChannelName

TABLES = (".csv", ".tsv", ".txt", ".dat")
ENDINGS = (*LOGS, *TABLES, ".parquet")
"""Extensions of logs."""
KINDS = "give .mf4, .blf, .asc, .log (candump), .csv or .parquet"
TIME_NAMES = re.compile(
    r"(time|t|times|timestamp|timestamps|zeit)(?:[\s_.]*[\[({]?\s*(s|sec|ms|us|ns)\s*[\])}]?)?\Z", re.IGNORECASE
)
"""Name of a column of times, with its unit or without."""
TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
NOT_AVAILABLE = re.compile(
    r"(?<![a-z])(?:sna|n/?a|err)(?![a-z])|invalid|not.?avail|unavail|error|fault|fail|init|unknown|reserved|undef|defect"
    r"|ungueltig|ungültig|fehler",
    re.IGNORECASE,
)
"""Name of a raw value that means that there is no physical value."""


BITS_MAX = 64
"""Length of the longest number in a frame."""


@dataclass(frozen=True)
class Samples:
    """Samples of a channel, in the order of the file.

    Attributes:
        time: (n,) s, in any order; NaN where the log has no time.
        values: (n,) in the unit of the channel; NaN where the log marks them as not available.
        remark: note for the user on how they were read.
    """

    time: FloatArray
    values: FloatArray
    remark: str = ""


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
        read: returns the samples of channels at these places. Raises CodegenError.
        remarks: kind, text and number of lost frames of what is not plain in the log as a whole.
        conflicts: a text for each identifier that several messages have.
        bus: the account, for the log of a bus.
    """

    channels: Sequence[Channel]
    read: Callable[[Sequence[Any]], list[Samples]]
    remarks: Sequence[tuple[str, str, int]] = ()
    conflicts: Sequence[str] = ()
    bus: BusLog | None = None


def open_log(path: Path, databases: Databases, names: Names) -> Log:
    """Return the channels of a log.

    Args:
        databases: of the log of a bus.
        names: column and unit of the time, for a table; channel, for the log of a bus.

    Raises:
        CodegenError: the log or a database cannot be read, or a database is missing.
    """
    kind = path.suffix.lower()
    if kind not in ENDINGS:
        raise CodegenError("not the log of a drive", where=path, remedy=KINDS)
    require_regular(path, TABLE_BYTES_MAX if kind in TABLES else BYTES_MAX, KINDS)
    if kind in TABLES:
        return _text_table(path, names)
    if kind == ".parquet":
        return _parquet(path, names)
    measurement = _measurement(path) if kind == ".mf4" else None
    return measurement or _bus_log(path, databases, names.channel)


# --- tables --------------------------------------------------------------------------------------------------------------


def _time_column(columns: Sequence[str], names: Names, path: Path) -> tuple[int, float]:
    """Return the number of the column of times and the size of its unit in s.

    Raises:
        CodegenError: there is no such column, or a name is there twice.
    """
    twice = next((name for name, count in Counter(columns).items() if count > 1), None)
    if twice is not None:
        raise CodegenError(f"the column {twice!r} is there twice", where=path, remedy="give each column a name of its own")
    if names.time is not None:
        if names.time not in columns:
            raise CodegenError(f"no column {names.time!r}", where=path, remedy=f"`time` is one of {', '.join(columns)}")
        index = columns.index(names.time)
    else:
        found = [index for index, column in enumerate(columns) if TIME_NAMES.fullmatch(column.strip())]
        if len(found) != 1:
            what = "no column is called time" if not found else f"{len(found)} columns of times"
            remedy = f'name it in a file for --signals: time = "NAME"; there is {", ".join(columns)}'
            raise CodegenError(what, where=path, remedy=remedy)
        index = found[0]
    match = TIME_NAMES.fullmatch(columns[index].strip())
    return index, TIME_UNITS[names.time_unit or ((match and match[2]) or "s").lower()]


def _text_table(path: Path, names: Names) -> Log:
    source = read(path, TABLE_BYTES_MAX)
    limits = Limits.of(len(source.data))
    with limits.enforced(path):
        cells = table.split(text_of(source), path)
    if cells.head is None:
        raise CodegenError(
            "the first line has no names", where=path, remedy="give a line such as time_s, vx_m_s, yaw_rate_rad_s"
        )
    columns = list(cells.head.cells)
    of_time, size = _time_column(columns, names, path)

    def read_columns(indices: Sequence[int]) -> list[Samples]:
        with limits.enforced(path):
            time, *values = (np.array([cells.value(line, index, path) for line in cells.body]) for index in (of_time, *indices))
        return [_present(time * size, one) for one in values]

    return Log(_columns(columns, of_time), read_columns)


def _columns(columns: Sequence[str], of_time: int) -> list[Channel]:
    return [Channel(column, take_apart(column), "", index) for index, column in enumerate(columns) if index != of_time]


def _present(time: FloatArray, values: FloatArray) -> Samples:
    """Return the samples that have a value: in a table of several rates most cells of a slow signal are empty."""
    has_value = ~np.isnan(values)
    return Samples(time[has_value], values[has_value])


def _parquet(path: Path, names: Names) -> Log:
    limits = Limits.of(path.stat().st_size)
    found: list[tuple[str, str]] = _in_child(path, "parquet", "columns", limits=limits)
    columns = [name for name, _ in found]
    of_time, size = _time_column(columns, names, path)
    if found[of_time][1] == "time":
        size = 1e-9

    def read_columns(indices: Sequence[int]) -> list[Samples]:
        wanted = [columns[index] for index in (of_time, *indices)]
        time, *values = _in_child(path, "parquet", "read", wanted, child.result_bytes(limits), limits=limits)
        return [_present(time * size, one) for one in values]

    return Log(_columns(columns, of_time), read_columns)


@contextlib.contextmanager
def _damage(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library raises for a damaged file into a CodegenError."""
    try:
        yield
    except CodegenError:
        raise
    except Exception as error:  # readers may raise anything
        reason = re.sub("'<.*>'", "it", one_line(error)) or type(error).__name__  # asammdf names an object in memory
        raise CodegenError(f"not a readable {what} ({reason})", where=path, remedy="export or copy it again") from None


# --- measurements in MF4 -------------------------------------------------------------------------------------------------


def _measurement(path: Path) -> Log | None:
    """Return the measurement in an MF4 file; None for the log of a bus."""
    limits = Limits.of(path.stat().st_size)
    found: list[ChannelName] | None = _in_child(path, "mf4", "channels", limits=limits)
    if found is None:
        return None
    channels = [
        # INCA appends its device to a name.
        Channel(
            f"{one.group}.{one.name}" if one.group else one.name, take_apart(one.name.partition("\\")[0]), one.unit, one.place
        )
        for one in found
    ]

    def read_samples(places: Sequence[Any]) -> list[Samples]:
        bytes_max = child.result_bytes(limits)
        return [Samples(*one) for one in _in_child(path, "mf4", "samples", list(places), bytes_max, limits=limits)]

    return Log(channels, read_samples)


READERS = {"mf4": ("MF4 file", "asammdf"), "parquet": ("Parquet file", "pyarrow")}
"""Module of `codegen.importing` -> what it reads, and the package that it needs."""


def _in_child(path: Path, module: str, function: str, *arguments: Any, limits: Limits) -> Any:
    """Call a function of a module of READERS. Raises CodegenError."""
    what, package = READERS[module]
    with _damage(path, what):
        try:
            return child.call(f"codegen.importing.{module}", function, path, *arguments, limits=limits)
        except ImportError:
            raise missing(package, f"reads {path.suffix.lower()}", path) from None


# --- logs of a bus -------------------------------------------------------------------------------------------------------


def _bus_log(path: Path, databases: Databases, channel: str | None) -> Log:
    if not databases.paths:
        raise CodegenError("the log of a bus needs its database", where=path, remedy="give the DBC or ARXML with --dbc")
    log = open_bus_log(path, databases, channel)
    found = log.allotment
    keys = [*found.keys, *found.conflicts]
    if not keys:
        named = ", ".join(each.name for each in databases.paths)
        what = f"none of its {len(log.frames)} frames is in {named}" if len(log.frames) else "it has no frame"
        what += f" ({log.findings[0]})" if log.file.skipped else ""
        raise CodegenError(what, where=path, remedy="give the database of this bus with --dbc")
    parts = {(key, index): _Message(defined, log, key) for key in keys for index, defined in enumerate(databases.messages[key])}
    with _damage(path, "log with this database"):
        channels = [channel for key, one in parts.items() for channel in one.channels(key)]

    def read_signals(places: Sequence[tuple[tuple[BusKey, int], str]]) -> list[Samples]:
        with _damage(path, "log with this database"):
            return [parts[key].samples(name) for key, name in places]

    remarks = [(CLOCK, *found.clock)] if found.clock[0] else []
    remarks += [(REMARK, text, 0) for text in (*log.findings, *log.message_findings)]
    conflicts = [databases.conflicts[key] for key in keys if key in databases.conflicts]
    return Log(channels, read_signals, remarks, conflicts, log)


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
