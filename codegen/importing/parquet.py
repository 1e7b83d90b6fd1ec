"""Columns of Parquet files, read with pyarrow. Only a child process imports it (see `child`): a small file may hold any number
of rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from codegen.arrays import FloatArray
from codegen.importing.rows import ARRAY, TEXT, Count, without

BYTES_PER_NUMBER = 8

Kind = Literal["time", "other"]
"""Whether a column has times in a type of its own, which become ns."""


def columns(path: Path) -> tuple[list[tuple[str, Kind]], int]:
    """Return name and kind of each column, and the number of rows. Raises whatever pyarrow raises for a damaged file."""
    kinds: list[tuple[str, Kind]] = [
        (field.name, "time" if _in_nanoseconds(field.type) is not None else "other") for field in parquet.read_schema(path)
    ]
    return kinds, int(parquet.read_metadata(path).num_rows)


def read(path: Path, names: Sequence[str], bytes_max: int) -> list[FloatArray]:
    """Return the numbers of columns, times in ns.

    Args:
        bytes_max: limit on the size of all results.

    Raises:
        ValueError: the results are larger, or a column has no numbers.
        Exception: whatever pyarrow raises for a damaged file.
    """
    rows = parquet.read_metadata(path).num_rows
    if rows * len(names) * BYTES_PER_NUMBER > bytes_max:
        raise ValueError(f"{rows} rows, more than a file of its size may hold")
    table = parquet.read_table(path, columns=list(dict.fromkeys(names)), use_threads=False)
    return [_numbers(table.column(name)) for name in names]


def account(path: Path, of_time: str, bytes_max: int) -> tuple[FloatArray, list[Count]]:
    """Return the times in their unit (in ns for times), and the counts of the other columns.

    Reads one column after the other. Raises ValueError if one is larger than `bytes_max`, and whatever pyarrow raises.
    """
    rows = int(parquet.read_metadata(path).num_rows)
    time, counts = np.array([]), []
    for field in parquet.read_schema(path):
        try:
            (values,) = read(path, [field.name], bytes_max)
        except (ValueError, TypeError, pa.ArrowException):
            if rows * BYTES_PER_NUMBER > bytes_max or field.name == of_time:
                raise
            kind = ARRAY if pa.types.is_nested(field.type) else TEXT
            counts.append(Count(field.name, "", 0, 0, {kind: rows} if rows else {}))
            continue
        if field.name == of_time:
            time = values
        else:
            reasons = without(values)
            counts.append(Count(field.name, "", 0, values.size - sum(reasons.values()), reasons))
    return time, counts


def _numbers(column: pa.ChunkedArray) -> FloatArray:
    if pa.types.is_time32(column.type):
        column = column.cast(pa.time64("us"))  # there is no direct way
    wanted = _in_nanoseconds(column.type)
    if wanted is not None:
        column = column.cast(wanted).cast(pa.int64())
    return np.asarray(column.to_numpy(), dtype=np.float64)


def _in_nanoseconds(kind: pa.DataType) -> pa.DataType | None:
    """Return the type of times in ns; None for other types."""
    if pa.types.is_timestamp(kind):
        return pa.timestamp("ns", tz=kind.tz)
    if pa.types.is_date(kind):
        return pa.timestamp("ns")
    if pa.types.is_time(kind):
        return pa.time64("ns")
    return pa.duration("ns") if pa.types.is_duration(kind) else None
