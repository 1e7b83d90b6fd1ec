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
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import BoolArray, FloatArray
from codegen.errors import CodegenError, one_line
from codegen.files import require_regular
from codegen.identify.findings import CLOCK
from codegen.identify.names import Names
from codegen.identify.stamps import blocks
from codegen.importing import mf4, table
from codegen.importing.bus_log import BYTES_MAX, LOGS, TOOLS, frames
from codegen.importing.quantities import Name, take_apart, unit_of
from codegen.importing.source import TABLE_BYTES_MAX, read, text_of

if TYPE_CHECKING:
    from cantools.database.can import Database, Message, Signal

TABLES = (".csv", ".tsv", ".txt", ".dat")
ENDINGS = (*LOGS, *TABLES, ".parquet")
"""Extensions of logs."""
DATABASE_ENDINGS = (".dbc", ".arxml")
DATABASE_BYTES_MAX = 2**28
KINDS = "give .mf4, .blf, .asc, .log (candump), .csv or .parquet"
TIME_NAMES = re.compile(
    r"(time|t|times|timestamp|timestamps|zeit)(?:[\s_.]*[\[({]?\s*(s|sec|ms|us|ns)\s*[\])}]?)?\Z", re.IGNORECASE
)
"""Name of a column of times, with its unit or without."""
TIME_UNITS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
NOT_AVAILABLE = re.compile(
    r"sna|invalid|not.?avail|unavail|n/?a\b|err|fault|fail|init|unknown|reserved|undef|defect|ungueltig|ungültig|fehler",
    re.IGNORECASE,
)
"""Name of a raw value that means that there is no physical value."""


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
        load: reads the samples. Raises CodegenError.
        low, high: smallest and largest value that the channel can have, in its unit; infinite if not known.
    """

    path: str
    name: Name
    unit: str
    load: Callable[[], Samples]
    low: float = -np.inf
    high: float = np.inf

    @property
    def known_unit(self) -> str | None:
        """Unit as written in FACTORS of `codegen.importing.quantities`; None if there is none or it is not known."""
        return unit_of(self.unit) if self.unit else self.name.unit


@dataclass(frozen=True)
class Log:
    """Channels of a log; kind, text and number of lost frames of what is wrong with the log as a whole."""

    channels: Sequence[Channel]
    remarks: Sequence[tuple[str, str, int]] = ()


@contextlib.contextmanager
def open_log(path: Path, databases: Sequence[Path], names: Names) -> Iterator[Log]:
    """Open a log. The samples of its channels can be read until the context ends.

    Args:
        databases: DBC or ARXML files, for the log of a bus.
        names: column and unit of the time, for a table.

    Raises:
        CodegenError: the log or a database cannot be read, or a database is missing.
    """
    kind = path.suffix.lower()
    if kind not in ENDINGS:
        raise CodegenError("not the log of a drive", where=path, remedy=KINDS)
    require_regular(path, TABLE_BYTES_MAX if kind in TABLES else BYTES_MAX, KINDS)
    if kind in TABLES:
        yield Log(_table_channels(path, names))
    elif kind == ".parquet":
        yield Log(_parquet_channels(path, names))
    elif kind == ".mf4":
        with _opened_mf4(path) as mdf:
            is_of_bus = "CAN_DataFrame" in mdf.channels_db
            yield _bus_log(path, databases) if is_of_bus else Log(_mf4_channels(path, mdf))
    else:
        yield _bus_log(path, databases)


# --- tables --------------------------------------------------------------------------------------------------------------


def _time_column(columns: Sequence[str], names: Names, path: Path) -> tuple[int, float]:
    """Return the number of the column of times and the size of its unit in s. Raises CodegenError if there is none."""
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


def _table_channels(path: Path, names: Names) -> list[Channel]:
    source = read(path, TABLE_BYTES_MAX)
    cells = table.split(text_of(source), path)
    if cells.head is None:
        raise CodegenError(
            "the first line has no names", where=path, remedy="give a line such as time_s, vx_m_s, yaw_rate_rad_s"
        )
    columns = list(cells.head.cells)
    of_time, size = _time_column(columns, names, path)

    @cache
    def values(index: int) -> FloatArray:
        return np.array([cells.value(line, index, path) for line in cells.body])

    def load(index: int) -> Samples:
        return _present(values(of_time) * size, values(index))

    return _columns(columns, of_time, load, {})


def _columns(columns: Sequence[str], of_time: int, load: Callable[[int], Samples], units: dict[str, str]) -> list[Channel]:
    return [
        Channel(column, take_apart(column), units.get(column, ""), partial(load, index))
        for index, column in enumerate(columns)
        if index != of_time
    ]


def _present(time: FloatArray, values: FloatArray) -> Samples:
    """Return the samples that have a value: in a table of several rates most cells of a slow signal are empty."""
    has_value = ~np.isnan(values)
    return Samples(time[has_value], values[has_value])


def _parquet_channels(path: Path, names: Names) -> list[Channel]:
    try:
        from pyarrow import parquet
    except ImportError:
        raise CodegenError("pyarrow, which reads .parquet, is missing", where=path, remedy=TOOLS) from None
    with _damage(path, "Parquet file"):
        schema = parquet.read_schema(path)
        columns, metadata = list(schema.names), schema.metadata or {}
        units = _column_units(metadata.get(b"columns", b"{}"))
    of_time, size = _time_column(columns, names, path)

    @cache
    def values(index: int) -> FloatArray:
        import pyarrow as pa

        with _damage(path, f"Parquet file: {columns[index]}"):
            column = parquet.read_table(path, columns=[columns[index]]).column(0)
            if pa.types.is_timestamp(column.type):
                column = column.cast(pa.timestamp("ns")).cast(pa.int64())
            return np.asarray(column.to_numpy(), dtype=np.float64)

    def load(index: int) -> Samples:
        is_stamp = str(schema.field(of_time).type).startswith("timestamp")
        return _present(values(of_time) * (1e-9 if is_stamp else size), values(index))

    return _columns(columns, of_time, load, units)


def _column_units(metadata: bytes) -> dict[str, str]:
    """Return the units in the metadata of a run that `codegen` wrote; {} of any other file."""
    try:
        found = json.loads(metadata)
        return {name: str(column["unit"]) for name, column in found.items()}
    except (ValueError, AttributeError, TypeError, KeyError, RecursionError):
        return {}


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


@contextlib.contextmanager
def _opened_mf4(path: Path) -> Iterator[Any]:
    with contextlib.ExitStack() as stack:
        with _damage(path, "MF4 file"):
            mdf = stack.enter_context(mf4.opened(path))
        yield mdf


def _mf4_channels(path: Path, mdf: Any) -> list[Channel]:
    found = []
    with _damage(path, "MF4 file"):
        for number, group in enumerate(mdf.groups):
            masters = mdf.masters_db.get(number)
            group_name = str(getattr(group.channel_group, "acq_name", "") or "")
            for index, channel in enumerate(group.channels):
                if index != masters:
                    found.append(_mf4_channel(path, mdf, group_name, (number, index), channel))
    return found


def _mf4_channel(path: Path, mdf: Any, group: str, place: tuple[int, int], channel: Any) -> Channel:
    name = str(channel.name)
    conversion = channel.conversion
    unit = str(channel.unit or "") or str(getattr(conversion, "unit", "") or "")

    def load() -> Samples:
        with _damage(path, f"MF4 file: {name}"):
            signal = mdf.get(group=place[0], index=place[1])
            values = _as_numbers(signal.samples)
            if signal.invalidation_bits is not None:
                values[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
            return Samples(np.array(signal.timestamps, dtype=np.float64), values)

    plain = name.partition("\\")[0]  # INCA appends its device
    return Channel(f"{group}.{name}" if group else name, take_apart(plain), unit, load)


def _as_numbers(samples: Any) -> FloatArray:
    """Return samples as numbers; NaN for texts, which mark reserved values. Raises ValueError if there is no number."""
    if samples.dtype.kind in "biuf" and samples.ndim == 1:
        return np.array(samples, dtype=np.float64)
    if samples.dtype.kind not in "SUO" or samples.ndim != 1:
        raise ValueError("its values are no numbers")
    values = np.full(samples.size, np.nan)
    for index, sample in enumerate(samples.tolist()):
        with contextlib.suppress(TypeError, ValueError):
            values[index] = float(sample)
    if samples.size and np.isnan(values).all():
        raise ValueError("its values are texts")
    return values


# --- logs of a bus -------------------------------------------------------------------------------------------------------

BusKey = tuple[int, bool]
"""Identifier of a message, and whether it is an extended one."""


@dataclass
class _Received:
    """Frames of one message: number in the log, data, bus and whether the logger sent it."""

    numbers: list[int]
    data: list[bytes]
    buses: list[object]
    sent: list[bool]


def _bus_log(path: Path, databases: Sequence[Path]) -> Log:
    if not databases:
        raise CodegenError("the log of a bus needs its database", where=path, remedy="give the DBC or ARXML with --dbc")
    messages = dict(_messages(databases))
    received: dict[BusKey, _Received] = {}
    stamps: list[float] = []
    for frame in frames(path):
        if frame.is_error_frame or frame.is_remote_frame:
            continue
        key = (frame.arbitration_id, frame.is_extended_id)
        if key in messages:
            into = received.setdefault(key, _Received([], [], [], []))
            into.numbers.append(len(stamps))
            into.data.append(bytes(frame.data))
            into.buses.append(frame.channel)
            into.sent.append(not frame.is_rx)
        stamps.append(frame.timestamp)
    if not received:
        named = ", ".join(each.name for each in databases)
        what = f"none of its {len(stamps)} frames is in {named}" if stamps else "it has no frame"
        raise CodegenError(what, where=path, remedy="give the database of this bus with --dbc")
    time = np.array(stamps)
    parts = blocks(time)
    used = max(parts, key=len, default=np.array([], dtype=np.intp))
    usable = np.zeros(time.size, dtype=bool)
    usable[used] = True
    lost = time.size - used.size
    remark = ""
    if len(parts) > 1:
        remark = (
            f"the clock restarts {len(parts) - 1} times; only the longest part is used, {lost} of {time.size} frames are lost"
        )
    elif lost:
        remark = f"{lost} of {time.size} frames have an impossible time"
    channels = [
        channel for key, one in received.items() for channel in _message_channels(path, messages[key], one, time, usable)
    ]
    return Log(channels, ((CLOCK, remark, lost),) if remark else ())


def _messages(databases: Sequence[Path]) -> Iterator[tuple[BusKey, Message]]:
    """Yield the messages of all databases. Raises CodegenError if two have different ones with the same identifier."""
    origin: dict[BusKey, Path] = {}
    for path in databases:
        for message in load_database(path).messages:
            if message.is_container:
                continue
            key = (message.frame_id, message.is_extended_frame)
            if key in origin and origin[key] != path:
                what = f"the identifier 0x{message.frame_id:x} of {message.name} is in {origin[key].name} too"
                raise CodegenError(what, where=path, remedy="give the database of one bus, and the log of that bus")
            origin[key] = path
            yield key, message


def load_database(path: Path) -> Database:
    """Read a DBC or ARXML with cantools. Raises CodegenError."""
    require_regular(path, DATABASE_BYTES_MAX, "give a DBC or ARXML")
    if path.suffix.lower() not in DATABASE_ENDINGS:
        raise CodegenError("not a database of a bus", where=path, remedy="give a .dbc or .arxml")
    try:
        from cantools import database
    except ImportError:
        raise CodegenError("cantools, which reads databases of buses, is missing", where=path, remedy=TOOLS) from None
    with _damage(path, "database of a CAN bus"):
        # Not strict: databases in use have signals that overlap, or that are longer than their message.
        found: Database = database.load_file(path, database_format=path.suffix.lower()[1:], strict=False)  # type: ignore[assignment]
        if not found.messages:
            raise CodegenError("it has no message", where=path, remedy="give the database of the bus")
    return found


def _message_channels(
    path: Path, message: Message, received: _Received, time: FloatArray, usable: BoolArray
) -> Iterator[Channel]:
    numbers = np.array(received.numbers)
    chosen, remark = _one_copy(received)
    chosen &= usable[numbers]

    @cache
    def decoded() -> list[Any]:
        with _damage(path, f"log with this database: {message.name}"):
            return [_decoded(message, received.data[index]) for index in np.flatnonzero(chosen)]

    def load(signal: Signal) -> Samples:
        reserved = _reserved(signal)
        has_value = np.array([signal.name in sample for sample in decoded()], dtype=bool)  # else another multiplexed one
        raw = [sample[signal.name] for sample in decoded() if signal.name in sample]
        values = np.array([np.nan if value in reserved else value for value in raw], dtype=np.float64)
        return Samples(time[numbers[chosen][has_value]], values, remark)

    for signal in message.signals:
        low, high = _limits(signal)
        unit = signal.unit or ""
        whole = f"{message.name}.{signal.name}"
        yield Channel(whole, take_apart(signal.name), unit, partial(load, signal), low, high)


def _one_copy(received: _Received) -> tuple[BoolArray, str]:
    """Return which frames to use if the log has copies of them, and a remark on it.

    A node on some buses receives its own frames too; the time of sending counts. A gateway repeats frames on another bus.
    """
    sent = np.array(received.sent, dtype=bool)
    chosen = sent if sent.any() else ~sent
    counts = Counter(bus for bus, is_chosen in zip(received.buses, chosen, strict=True) if is_chosen)
    if len(counts) < 2:
        return chosen, ""
    most, count = counts.most_common(1)[0]
    return chosen & np.array(
        [bus == most for bus in received.buses]
    ), f"on {len(counts)} buses; {count} frames of {most} are used"


def _decoded(message: Message, data: bytes) -> Any:
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
    if signal.is_float:
        return low, high
    bits = signal.length - signal.is_signed
    ends = [_physical(signal, raw) for raw in (-(2**bits) if signal.is_signed else 0, 2**bits - 1)]
    return max(low, min(ends)), min(high, max(ends))
