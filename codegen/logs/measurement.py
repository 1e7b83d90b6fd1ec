"""Measurements: tables of text, Parquet, and MF4 with physical values. One reader, which accounts for each of their rows.

A file is opened with the names of its channels. Samples are read when they are needed, together with their account.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from codegen.arrays import FloatArray
from codegen.errors import CodegenError, one_line
from codegen.files import refuse_empty, require_regular
from codegen.importing import child, quantities, table
from codegen.importing.rows import MISSING_CHANNEL, TEXT, UNUSED_GROUP, Count, Group, group_of, without
from codegen.importing.source import TABLE_BYTES_MAX, ImportFault, read, text_of
from codegen.limits import Limits
from codegen.logs.formats import TABLE_ENDINGS
from codegen.logs.frames import BYTES_MAX
from codegen.logs.text import are_differences

if TYPE_CHECKING:
    from codegen.importing.mf4 import ChannelName

UNIX_MIN_S = 1e8
"""Smallest first stamp of Unix time: 1973. No measurement takes three years."""
NAMES_SHOWN = 3


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
class Column:
    """A channel of a measurement: name of its group, its own name, its unit ("" without one), and its place for the reader."""

    group: str
    name: str
    unit: str
    place: Any

    @property
    def path(self) -> str:
        """Name of the group, a dot, and the name; the name alone without a group."""
        return f"{self.group}.{self.name}" if self.group else self.name


@dataclass(frozen=True)
class Account:
    """Account of the rows of a measurement.

    Attributes:
        path: the file. form: name of its format. clock: meaning of its stamps.
        groups: rows of channels with common stamps; a table has one.
        channels: samples of the channels that were read.
        others: kind of a line that is no row -> number.
        warnings: warnings of the library.
    """

    path: Path
    form: str
    clock: str
    groups: Sequence[Group]
    channels: Sequence[Count]
    others: Mapping[str, int] = field(default_factory=dict)
    warnings: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Raise CodegenError if the account of a channel does not close."""
        for each in self.channels:
            group = self.groups[each.group]
            in_data = group.rows - group.skipped.get(MISSING_CHANNEL, (0, ""))[0]
            if each.samples + sum(each.without.values()) != in_data:
                what = f"its account does not close: {in_data} rows, {each.samples} samples, {dict(each.without)} without"
                raise CodegenError(what, where=f"{self.path}: {each.channel}", remedy="report it with the file")

    @property
    def findings(self) -> list[str]:
        """One line for each thing that is not plain about the file as a whole."""
        lines = [
            f"{count} of {group.rows} rows{_of(group)} are not read: {reason} (first: {place})"
            for group in self.groups
            for reason, (count, place) in group.skipped.items()
            if reason != UNUSED_GROUP
        ]
        lines += [f"asammdf warns: {text}" for text in self.warnings]
        if self.clock == DIFFERENCES:
            lines.append("its stamps do not grow: they seem to be times from one row to the next, which are not added up")
        return lines

    @property
    def channel_findings(self) -> list[str]:
        """One line for each thing that is not plain about stamps and channels. `identify` reports it with the quantities."""
        lines = [
            f"{count} stamps{_of(group)} {what}"
            for group in self.groups
            for count, what in ((group.back, "go back"), (group.repeated, "repeat another one"))
            if count
        ]
        empty = [each.channel for each in self.channels if not each.samples]
        if empty:
            shown = ", ".join(empty[:NAMES_SHOWN])
            more = f" and {len(empty) - NAMES_SHOWN} more" if len(empty) > NAMES_SHOWN else ""
            lines.append(f"channels without a number: {shown}{more}")
        return lines


def _of(group: Group) -> str:
    return f" of group {group.name}" if group.name else ""


DIFFERENCES = "time from the row before"
PLAIN_CLOCK, UNIX = "time from the start of the log", "Unix time"


@dataclass(frozen=True)
class Measurement:
    """A measurement.

    Attributes:
        columns: all channels with times.
        read: returns the samples of channels at these places, and the account of what was read. Raises CodegenError.
        account: returns the account of all channels. Raises CodegenError.
    """

    columns: Sequence[Column]
    read: Callable[[Sequence[Any]], tuple[list[Samples], Account]]
    account: Callable[[], Account]


def open_measurement(path: Path, time: str | None = None, time_unit: str | None = None) -> Measurement | None:
    """Return the channels of a measurement; None for the MF4 log of a bus.

    Args:
        path: its extension is one of MEASUREMENTS.
        time, time_unit: column of the time in a table, and its unit; by default by its name.

    Raises:
        CodegenError: it cannot be read.
    """
    kind = path.suffix.lower()
    size = require_regular(
        path, TABLE_BYTES_MAX if kind in TABLE_ENDINGS else BYTES_MAX, "name a log", smaller="give a shorter log"
    )
    refuse_empty(size, path)
    if kind == ".mf4":
        return _mf4(path)
    return _parquet(path, time, time_unit) if kind == ".parquet" else _text_table(path, time, time_unit)


# --- tables --------------------------------------------------------------------------------------------------------------


def _time_column(columns: Sequence[str], time: str | None, path: Path) -> int:
    """Return the number of the column of times. Raises CodegenError: there is no such column, or a name is there twice."""
    twice = next((name for name, count in Counter(columns).items() if count > 1), None)
    if twice is not None:
        raise CodegenError(f"the column {twice!r} is there twice", where=path, remedy="give each column a name of its own")
    if time is not None:
        if time not in columns:
            raise CodegenError(f"no column {time!r}", where=path, remedy=f"`time` is one of {', '.join(columns)}")
        return columns.index(time)
    found = [index for index, column in enumerate(columns) if quantities.is_time(column)]
    if len(found) != 1:
        what = "no column is called time" if not found else f"{len(found)} columns of times"
        remedy = f'name it in a file for `signals=`: time = "NAME"; there is {", ".join(columns)}'
        raise CodegenError(what, where=path, remedy=remedy)
    return found[0]


def _time_size(column: str, unit: str | None, path: Path) -> float:
    """Return the size in s of the unit of a column of times: `unit`, else that in its name, else s. Raises CodegenError."""
    text = unit or quantities.split_time(column)[1] or "s"
    known = quantities.time_unit_of(text)
    if known is None:
        remedy = 'give s, ms, us or ns in a file for `signals=`, such as time_unit = "ms"'
        raise CodegenError(f"{text!r} is no known unit of a time", where=f"{path}: {column}", remedy=remedy)
    return quantities.TIME_UNITS[known]


def _clock(time: FloatArray) -> str:
    """Return the meaning of the stamps (n,) s of a table."""
    good = time[np.isfinite(time)]
    if good.size and good[0] > UNIX_MIN_S:
        return UNIX
    return DIFFERENCES if are_differences(good) else PLAIN_CLOCK


def _columns(names: Sequence[str], of_time: int) -> list[Column]:
    return [Column("", name, "", index) for index, name in enumerate(names) if index != of_time]


def _present(time: FloatArray, values: FloatArray) -> Samples:
    """Return the samples that have a value: in a table of several rates most cells of a slow signal are empty."""
    has_value = ~np.isnan(values)
    return Samples(time[has_value], values[has_value])


def _text_table(path: Path, time: str | None, time_unit: str | None) -> Measurement:
    source = read(path, TABLE_BYTES_MAX)
    limits = Limits.of(len(source.data))
    text = text_of(source)
    with limits.enforced(path):
        cells = table.split(text, path)
    if cells.head is None:
        raise CodegenError(
            "the first line has no names", where=path, remedy="give a line such as time_s, vx_m_s, yaw_rate_rad_s"
        )
    names = list(cells.head.cells)
    of_time = _time_column(names, time, path)
    size = _time_size(names[of_time], time_unit, path)

    def column(index: int) -> FloatArray:
        return np.array([cells.value(line, index, path) for line in cells.body], dtype=np.float64)

    def count(index: int) -> Count:
        values = []
        for line in cells.body:
            try:
                values.append(cells.value(line, index, path))
            except ImportFault:
                if cells.is_number(line.cells[index]):
                    raise
        texts = len(cells.body) - len(values)
        reasons = without(np.array(values, dtype=np.float64)) | ({TEXT: texts} if texts else {})
        return Count(names[index], "", 0, len(cells.body) - sum(reasons.values()), reasons)

    def account(times: FloatArray, counts: Sequence[Count]) -> Account:
        rows = text.removesuffix("\n").count("\n") + 1 - sum(cells.others.values())
        group = group_of("", times * size, rows, lambda row: f"line {cells.body[row].number}")
        return Account(path, "table of text", _clock(times * size), [group], counts, cells.others)

    def read_columns(indices: Sequence[int]) -> tuple[list[Samples], Account]:
        with limits.enforced(path):
            times, *values = (column(index) for index in (of_time, *indices))
        counts = [_count_of(names[index], one) for index, one in zip(indices, values, strict=True)]
        return [_present(times * size, one) for one in values], account(times, counts)

    def read_all() -> Account:
        with limits.enforced(path):
            return account(column(of_time), [count(index) for index in range(len(names)) if index != of_time])

    return Measurement(_columns(names, of_time), read_columns, read_all)


def _count_of(name: str, values: FloatArray) -> Count:
    reasons = without(values)
    return Count(name, "", 0, values.size - sum(reasons.values()), reasons)


def _parquet(path: Path, time: str | None, time_unit: str | None) -> Measurement:
    limits = Limits.of(path.stat().st_size)
    found, rows = _in_child(path, "parquet", "columns", limits=limits)
    names = [name for name, _ in found]
    of_time = _time_column(names, time, path)
    size = 1e-9 if found[of_time][1] == "time" else _time_size(names[of_time], time_unit, path)

    def account(times: FloatArray, counts: Sequence[Count]) -> Account:
        return Account(path, "Parquet", _clock(times * size), [group_of("", times * size, rows)], counts)

    def read_columns(indices: Sequence[int]) -> tuple[list[Samples], Account]:
        wanted = [names[index] for index in (of_time, *indices)]
        times, *values = _in_child(path, "parquet", "read", wanted, child.result_bytes(limits), limits=limits)
        counts = [_count_of(names[index], one) for index, one in zip(indices, values, strict=True)]
        return [_present(times * size, one) for one in values], account(times, counts)

    def read_all() -> Account:
        return account(*_in_child(path, "parquet", "account", names[of_time], child.result_bytes(limits), limits=limits))

    return Measurement(_columns(names, of_time), read_columns, read_all)


# --- MF4 -----------------------------------------------------------------------------------------------------------------


def _mf4(path: Path) -> Measurement | None:
    limits = Limits.of(path.stat().st_size)
    found: list[ChannelName] | None = _in_child(path, "mf4", "channels", limits=limits)
    if found is None:
        return None
    bytes_max = child.result_bytes(limits)

    def read_samples(places: Sequence[Any]) -> tuple[list[Samples], Account]:
        samples, counts, groups, warnings = _in_child(path, "mf4", "samples", list(places), bytes_max, limits=limits)
        return [Samples(*one) for one in samples], Account(path, "MF4", PLAIN_CLOCK, groups, counts, warnings=warnings)

    def read_all() -> Account:
        counts, groups, warnings = _in_child(path, "mf4", "account", bytes_max, limits=limits)
        return Account(path, "MF4", PLAIN_CLOCK, groups, counts, warnings=warnings)

    return Measurement([Column(one.group, one.name, one.unit, one.place) for one in found], read_samples, read_all)


READERS = {"mf4": "MF4 file", "parquet": "Parquet file"}
"""Module of `codegen.importing` -> the kind of file that it reads."""


def _in_child(path: Path, module: str, function: str, *arguments: Any, limits: Limits) -> Any:
    """Call a function of a module of READERS. Raises CodegenError."""
    with damage(path, READERS[module]):
        return child.read(path, module, function, *arguments, limits=limits)


@contextlib.contextmanager
def damage(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a library raises for a damaged file into a CodegenError."""
    try:
        yield
    except CodegenError:
        raise
    except Exception as error:  # readers may raise anything
        reason = re.sub("'<.*>'", "it", one_line(error)) or type(error).__name__  # asammdf names an object in memory
        raise CodegenError(f"not a readable {what} ({reason})", where=path, remedy="export or copy it again") from None


# --- output --------------------------------------------------------------------------------------------------------------


def to_dict(account: Account) -> dict[str, Any]:
    """Return the account for JSON."""
    return {
        "file": account.path.name,
        "format": account.form,
        "clock": account.clock,
        "rows": {
            "in_file": sum(group.rows for group in account.groups),
            "read": sum(group.read for group in account.groups),
            "other_entries": dict(account.others),
        },
        "groups": [
            {
                "group": group.name,
                "in_file": group.rows,
                "read": group.read,
                "skipped": [{"reason": why, "rows": count, "first": place} for why, (count, place) in group.skipped.items()],
                **{key: getattr(group, key) for key in ("first_s", "duration_s", "back", "repeated")},
            }
            for group in account.groups
        ],
        "channels": [dataclasses.asdict(each) for each in account.channels],
        "findings": [*account.findings, *account.channel_findings],
    }


GROUP_HEADER = ("group", "rows", "read", "first [s]", "duration [s]", "go back", "repeat")
MEASUREMENT_CHANNEL_HEADER = ("channel", "unit", "group", "samples", "without one")


def summary_lines(account: Account) -> list[str]:
    """Return the account of the file as lines."""
    in_file, was_read = (sum(getattr(group, key) for group in account.groups) for key in ("rows", "read"))
    others = ", ".join(f"{count} {name}" for name, count in sorted(account.others.items()))
    return [
        f"{account.path.name}: {account.form}, {account.clock}",
        f"rows: {in_file} in the file, {was_read} read, {in_file - was_read} skipped",
        *([f"other lines: {others}"] if others else []),
    ]


def group_cells(account: Account) -> list[tuple[str, ...]]:
    """Return the rows under GROUP_HEADER."""
    return [
        (
            f"{number} {group.name}".strip(),
            str(group.rows),
            str(group.read),
            "" if group.first_s is None else f"{group.first_s:.3f}",
            "" if group.duration_s is None else f"{group.duration_s:.3f}",
            str(group.back),
            str(group.repeated),
        )
        for number, group in enumerate(account.groups)
    ]


def channel_cells(account: Account) -> list[tuple[str, ...]]:
    """Return the rows under CHANNEL_HEADER."""
    return [
        (
            each.channel,
            each.unit,
            str(each.group),
            str(each.samples),
            ", ".join(f"{count} {reason}" for reason, count in each.without.items()),
        )
        for each in account.channels
    ]
